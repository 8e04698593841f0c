"""``photomap convert``: missions between ground stations."""

import json
from pathlib import Path

import pytest

from photomap_gis.cli import main
from photomap_gis.core.mission import Autopilot, FencePolygon, Home, Mission, MissionItem
from photomap_gis.mission_planner.files import read_mission, write_mission

MISSION = Mission(
    items=(MissionItem(22, 3, x=47.0, y=8.0, z=30.0), MissionItem(16, 3, x=47.001, y=8.0, z=30.0), MissionItem(20, 2)),
    fence_polygons=(FencePolygon(((46.9, 7.9), (46.9, 8.1), (47.1, 8.0))),),
    home=Home(47.0, 8.0, 400.0),
    autopilot=Autopilot.PX4,
    cruise_speed_m_s=5.0,
)


def test_there_and_back_says_what_is_lost(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    plan, way, back = tmp_path / "a.plan", tmp_path / "a.waypoints", tmp_path / "b.plan"
    write_mission(plan, MISSION)
    assert main(["convert", str(plan), "-o", str(way), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["items"] == 3 and len(told["warnings"]) == 1 and "no fence" in told["warnings"][0]
    assert read_mission(way).items == MISSION.items and read_mission(way).home == MISSION.home
    assert main(["convert", str(way), "-o", str(back), "--autopilot", "ardupilot"]) == 0
    assert read_mission(back).items == MISSION.items and read_mission(back).autopilot is Autopilot.ARDUPILOT
    assert capsys.readouterr().err == ""


def test_what_is_no_mission_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["convert", str(tmp_path / "none.plan"), "-o", str(tmp_path / "x.plan")]) == 3
    plan = tmp_path / "a.plan"
    write_mission(plan, MISSION)
    assert main(["convert", str(plan), "-o", str(tmp_path / "x.kml")]) == 2
    assert ".waypoints" in capsys.readouterr().err
