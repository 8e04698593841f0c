"""One small simulated flight and its mission, shared by the tests that only look at them."""

from pathlib import Path
from typing import NamedTuple

import pytest

from photomap_gis.pipeline import MapSummary, map_flight
from photomap_gis.simulate import FlightSpec, GpsError, Motion, Truth, run_simulation


class Flown(NamedTuple):
    """A simulated flight: what ``photomap map`` takes, and the truth."""

    photos: Path
    truth: Truth


class Mapped(NamedTuple):
    """A mission and what the run told of it."""

    folder: Path
    summary: MapSummary


SPEC = FlightSpec(
    frames=14,
    altitude_m=80.0,
    width_px=640,
    height_px=480,
    motion=Motion(tilt_deg=1.0),
    gps=GpsError(bias_east_m=0.5),
    seed=3,
)


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    result = run_simulation("procedural", tmp_path_factory.mktemp("flight"), SPEC)
    return Flown(result.source, result.truth)


@pytest.fixture(scope="session")
def mapped(flown: Flown, tmp_path_factory: pytest.TempPathFactory) -> Mapped:
    folder = tmp_path_factory.mktemp("missions") / "m"
    return Mapped(folder, map_flight([flown.photos], folder))
