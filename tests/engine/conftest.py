"""Engines for tests: one that many share, since each takes a second to start."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from photomap_gis.core.mission import Autopilot, Home, Mission, MissionItem
from photomap_gis.mission_planner.files import write_mission
from tests.engine.engines import EngineUnderTest


@pytest.fixture(scope="module")
def engine() -> Iterator[EngineUnderTest]:
    engine = EngineUnderTest()
    yield engine
    assert engine.close() == 0


@pytest.fixture(scope="session")
def waypoints(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small mission file: what quick jobs work on."""
    path = tmp_path_factory.mktemp("missions") / "field.waypoints"
    items = (MissionItem(22, 3, x=47.0, y=8.0, z=30.0), MissionItem(16, 3, x=47.001, y=8.0, z=30.0))
    write_mission(path, Mission(items=items, home=Home(47.0, 8.0, 400.0), autopilot=Autopilot.ARDUPILOT))
    return path
