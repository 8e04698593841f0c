"""Missions written and read: golden documents, round trips, another reader of the format, and hostile files."""

import json
import math
import string
from collections.abc import Callable
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import example, given, settings
from pymavlink import mavwp

from photomap_gis.core.errors import DataError, OutputError, UsageError
from photomap_gis.core.mission import (
    PLACED_COMMANDS,
    Autopilot,
    FenceCircle,
    FencePolygon,
    Home,
    Mission,
    MissionItem,
    RallyPoint,
)
from photomap_gis.core.plan import SurveyPlan
from photomap_gis.mission_planner.files import read_mission, write_mission
from photomap_gis.mission_planner.files.qgc_plan import plan_document, read_plan_document
from photomap_gis.mission_planner.files.waypoints import read_waypoints, waypoints_text
from photomap_gis.mission_planner.items import to_mission

GOLDEN = Path(__file__).parent / "golden"
Plans = Callable[..., SurveyPlan]


def same(one: Mission, other: Mission) -> bool:
    """Equal, NaN being equal to NaN."""
    return repr(one) == repr(other)


def numbers(low: float, high: float, digits: int = 6) -> st.SearchStrategy[float]:
    return st.integers(round(low * 10**digits), round(high * 10**digits)).map(lambda n: n / 10**digits)


LATS, LONS, ALTS = numbers(-90, 90, 7), numbers(-180, 180, 7), numbers(-500, 9000, 3)
PARAMS = st.one_of(numbers(-1000, 1000), st.just(math.nan))
PLACED = st.builds(
    MissionItem,
    command=st.sampled_from(sorted(PLACED_COMMANDS)),
    frame=st.sampled_from([0, 3, 10]),
    params=st.tuples(*[PARAMS] * 4),
    x=LATS,
    y=LONS,
    z=ALTS,
    autocontinue=st.booleans(),
)
OTHERS = st.builds(
    MissionItem,
    command=st.sampled_from([20, 112, 115, 178, 203, 206, 2000, 2500]),
    frame=st.just(2),
    params=st.tuples(*[PARAMS] * 4),
    x=numbers(-1000, 1000),
    y=numbers(-1000, 1000),
    z=numbers(-1000, 1000),
)
ITEMS = st.lists(st.one_of(PLACED, OTHERS), max_size=12).map(tuple)
HOMES = st.one_of(st.none(), st.builds(Home, LATS, LONS, st.one_of(st.none(), numbers(-500, 9000, 3))))
POLYGONS = st.builds(
    FencePolygon, st.lists(st.tuples(LATS, LONS), min_size=3, max_size=6, unique=True).map(tuple), st.booleans()
)
MISSIONS = st.builds(
    Mission,
    items=ITEMS,
    fence_polygons=st.lists(POLYGONS, max_size=3).map(tuple),
    fence_circles=st.lists(st.builds(FenceCircle, LATS, LONS, numbers(0.001, 5000), st.booleans()), max_size=2).map(
        tuple
    ),
    rally=st.lists(st.builds(RallyPoint, LATS, LONS, ALTS), max_size=3).map(tuple),
    home=st.builds(Home, LATS, LONS, st.one_of(st.none(), ALTS)),
    autopilot=st.sampled_from([None, *Autopilot]),
    cruise_speed_m_s=numbers(0.1, 40),
)


@settings(max_examples=40, deadline=None)
@given(MISSIONS)
def test_a_plan_is_read_as_it_was_written(mission: Mission):
    assert same(read_plan_document(plan_document(mission), "x"), mission)


@settings(max_examples=40, deadline=None)
@given(ITEMS, HOMES)
@example((), Home(1.0, 2.0, None))
@example((MissionItem(16, 3, (math.nan,) * 4, math.nan, math.nan, 5.0),), None)
def test_waypoints_are_read_as_they_were_written(items: tuple[MissionItem, ...], home: Home | None):
    if home is not None and ((home.lat_deg == 0 and home.lon_deg == 0) or home.alt_amsl_m == 0):
        home = None
    mission = Mission(items=items, home=home)
    assert same(read_waypoints(waypoints_text(mission), "x"), mission)


@pytest.mark.parametrize("autopilot", list(Autopilot))
@pytest.mark.parametrize("suffix", [".plan", ".waypoints"])
def test_golden_documents(autopilot: Autopilot, suffix: str, two_lanes: Plans, tmp_path: Path):
    """Written by tests/mission_planner/files/golden/make.py; look at the difference before renewing them."""
    mission = to_mission(two_lanes(), 0, autopilot)
    # The fence's vertices come from a projection: compared apart, to a millimetre.
    written = tmp_path / f"two_lanes_{autopilot}{suffix}"
    write_mission(written, mission)
    golden = GOLDEN / written.name
    if suffix == ".waypoints":
        assert written.read_text() == golden.read_text()
        return
    ours, theirs = json.loads(written.read_text()), json.loads(golden.read_text())
    fences = [[v for p in d.pop("geoFence")["polygons"] for xy in p["polygon"] for v in xy] for d in (ours, theirs)]
    assert fences[0] == pytest.approx(fences[1], abs=1e-8)
    assert ours == theirs


@settings(max_examples=40, deadline=None)
@given(ITEMS, HOMES)
def test_pymavlinks_own_reader_agrees_about_waypoints(items: tuple[MissionItem, ...], home: Home | None):
    """The peer: the reader that MAVProxy uses."""
    lines = waypoints_text(Mission(items=items, home=home)).splitlines()
    loader = mavwp.MAVWPLoader()
    loader._read_waypoints_v110(lines[1:])
    assert loader.count() == len(items) + 1
    for seq, item in enumerate(items, 1):
        theirs = loader.wp(seq)
        assert (theirs.command, theirs.frame, theirs.autocontinue) == (item.command, item.frame, item.autocontinue)
        ours = (*item.params, item.x, item.y, item.z)
        read = [theirs.param1, theirs.param2, theirs.param3, theirs.param4, theirs.x, theirs.y, theirs.z]
        assert read == pytest.approx(ours, abs=1e-6, nan_ok=True)


def test_what_mission_planner_and_others_write_is_read(tmp_path: Path):
    """Windows line ends, a byte order mark, spaces for tabs, a take-off where home should be."""
    path = tmp_path / "a.waypoints"
    row = "0\t0\t0\t0\t47.5\t8.25\t50\t1"
    path.write_bytes(f"\ufeffQGC WPL 110\r\n0\t1\t0\t16\t{row}\r\n1\t0\t3\t22\t{row}\r\n\r\n".encode())
    mission = read_mission(path)
    assert mission.home == Home(47.5, 8.25, 50.0) and len(mission.items) == 1 and mission.items[0].command == 22
    path.write_text(f"QGC WPL 120\n0 1 3 22 {row}\n1 0 3 16 {row}\n")
    mission = read_mission(path)
    assert mission.home is None and [i.command for i in mission.items] == [22, 16]


def qgc_plan(items: list[object], **more: object) -> str:
    mission = {"version": 2, "firmwareType": 12, "plannedHomePosition": [47.0, 8.0, None], "items": items, **more}
    return json.dumps({"fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "mission": mission})


def simple(command: int, jump_id: int, params: list[float | None]) -> dict[str, object]:
    return {
        "type": "SimpleItem",
        "command": command,
        "frame": 3,
        "doJumpId": jump_id,
        "autoContinue": True,
        "params": params,
    }


def test_a_survey_of_qgroundcontrol_is_read_as_its_items_and_jumps_follow():
    wp = [0, 0, 0, None, 47.0, 8.0, 50]
    survey = {
        "type": "ComplexItem",
        "complexItemType": "survey",
        "TransectStyleComplexItem": {"Items": [simple(16, 2, wp), simple(206, 3, [20, 0, 1, 0, 0, 0, 0])]},
    }
    jump = simple(177, 9, [7, 2, 0, 0, 0, 0, 0])
    mission = read_plan_document(qgc_plan([simple(22, 1, wp), survey, simple(16, 7, wp), jump]), "x")
    assert [i.command for i in mission.items] == [22, 16, 206, 16, 177]
    assert mission.items[-1].params[0] == 4  # counted from 1 in the order of the items
    assert math.isnan(mission.items[0].params[3]) and mission.home == Home(47.0, 8.0, None)
    with pytest.raises(DataError, match="jumps to item 8"):
        read_plan_document(qgc_plan([simple(177, 1, [8, 1, 0, 0, 0, 0, 0])]), "x")
    with pytest.raises(DataError, match="save it again in QGroundControl"):
        read_plan_document(qgc_plan([{"type": "ComplexItem", "complexItemType": "fwLandingPattern"}]), "x")


GOOD = simple(16, 1, [0, 0, 0, None, 47.0, 8.0, 50])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "neither"),
        ("<kml/>", "neither"),
        ("{", "not valid JSON"),
        ("[" * 100_000, "neither"),
        ('{"a":' * 100_000, "not valid JSON"),
        ("{}", "fileType"),
        ('{"fileType": "Plan"}', "mission is missing"),
        (qgc_plan([1]), "item"),
        (qgc_plan([{**GOOD, "params": [0] * 6}]), "seven params"),
        (qgc_plan([{**GOOD, "params": [0, 0, 0, 0, 147.0, 8.0, 5]}]), "no place on Earth"),
        (qgc_plan([{**GOOD, "params": [0, 0, 0, 0, "47", 8.0, 5]}]), "a number is needed"),
        (qgc_plan([{**GOOD, "params": [True, 0, 0, 0, 47, 8.0, 5]}]), "a number is needed"),
        (qgc_plan([GOOD]).replace("8.0, 50]", "8.0, Infinity]"), "finite"),
        (qgc_plan([GOOD]).replace("8.0, 50]", "8.0, 1" + "0" * 400 + "]"), "too large"),
        (qgc_plan([{**GOOD, "command": 16.5}]), "whole number"),
        (qgc_plan([{**GOOD, "command": -1}]), "whole number"),
        (qgc_plan([{**GOOD, "autoContinue": "yes"}]), "autoContinue"),
        (qgc_plan([GOOD] * 20_001), "more than 20000 items"),
        (qgc_plan([GOOD], plannedHomePosition=[95.0, 8.0, 1.0]), "no place on Earth"),
        ("QGC WPL 110\n", "no items"),
        ("QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t47\t8\t400\n", "12 columns"),
        ("QGC WPL 110\n1\t1\t0\t16\t0\t0\t0\t0\t47\t8\t400\t1\n", "not whole"),
        ("QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t47\t8\tx\t1\n", "'x' is not a number"),
        ("QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t47\t8\tinf\t1\n", "finite"),
        ("QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t1_0\t8\t1\t1\n", "not a number"),
        ("QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t8\t181\t1\t1\n", "no place on Earth"),
    ],
)
def test_files_that_are_no_missions_say_why(text: str, words: str, tmp_path: Path):
    path = tmp_path / "bad.plan"
    path.write_text(text)
    with pytest.raises(DataError, match=words):
        read_mission(path)


@settings(max_examples=40, deadline=None)
@given(st.text(alphabet=string.printable, max_size=200))
def test_noise_is_a_data_error_and_nothing_else(noise: str):
    for read, start in ((read_plan_document, '{"fileType": "Plan", "mission": '), (read_waypoints, "QGC WPL 110\n")):
        with pytest.raises(DataError):
            read(start + noise, "noise")


def test_unreadable_and_unwritable_files(tmp_path: Path, two_lanes: Plans):
    with pytest.raises(DataError, match="cannot be read"):
        read_mission(tmp_path / "missing.plan")
    (tmp_path / "binary.plan").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DataError, match="not text"):
        read_mission(tmp_path / "binary.plan")
    mission = to_mission(two_lanes(), 0, Autopilot.PX4)
    with pytest.raises(UsageError, match=r"\.plan, \.waypoints"):
        write_mission(tmp_path / "a.docx", mission)
    with pytest.raises(OutputError, match="does not exist"):
        write_mission(tmp_path / "nowhere" / "a.plan", mission)
