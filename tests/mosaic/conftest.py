"""What the mosaic's tests share."""

import numpy as np
import pytest

from tests.mosaic.flight import procedural_ground


@pytest.fixture(scope="session")
def ground() -> np.ndarray:
    return procedural_ground(np.random.default_rng(7))
