"""The benchmarks are a package beside the product, not inside of it."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.registration.pictures import REPORTING, Origin, Sources


@pytest.fixture(scope="session")
def scenes() -> Sources:
    """Sources that need nothing beside the repository and no extra: two procedural scenes."""
    return Sources("reporting", (tuple(p for p in REPORTING if p.origin is Origin.SCENE)[:2],), ())
