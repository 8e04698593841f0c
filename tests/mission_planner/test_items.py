"""What an autopilot is told to do, and that it may."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
from shapely.geometry import LineString, Polygon

from photomap_gis.core.errors import UsageError
from photomap_gis.core.mission import Autopilot, MissionItem, RallyPoint
from photomap_gis.core.plan import AltitudeFrame, CameraTrigger, SurveyPlan
from photomap_gis.mission_planner.commands import Cmd
from photomap_gis.mission_planner.items import storage_warnings, to_mission
from photomap_gis.mission_planner.local_frame import LocalFrame

Plans = Callable[..., SurveyPlan]
ARDUPILOT, PX4 = Autopilot.ARDUPILOT, Autopilot.PX4


def commands(items: tuple[MissionItem, ...]) -> list[int]:
    return [item.command for item in items]


def test_a_sortie_by_distance_for_ardupilot(two_lanes: Plans):
    items = to_mission(two_lanes(), 0, ARDUPILOT).items
    assert commands(items) == [22, 178, 205, 16, 16, 206, 178, 16, 206, 16, 206, 16, 206, 16, 178, 20]
    on = [item.params for item in items if item.command == Cmd.DO_SET_CAM_TRIGG_DIST]
    assert on == [(12.5, 0, 1, 0), (0, 0, 0, 0)] * 2
    assert [item.params[1] for item in items if item.command == Cmd.DO_CHANGE_SPEED] == [10.0, 8.0, 10.0]


@pytest.mark.parametrize(
    ("frame", "takeoff", "waypoint"),
    [(AltitudeFrame.RELATIVE, 3, 3), (AltitudeFrame.AMSL, 0, 0), (AltitudeFrame.TERRAIN, 3, 10)],
)
def test_frames_are_mavlinks_own(two_lanes: Plans, frame: AltitudeFrame, takeoff: int, waypoint: int):
    items = to_mission(two_lanes(frame), 0, ARDUPILOT).items
    assert items[0].frame == takeoff
    assert {item.frame for item in items if item.command == Cmd.NAV_WAYPOINT} == {waypoint}
    assert {item.frame for item in items if item.command not in (16, 21, 22)} == {2}


def test_px4_takes_no_terrain_frame_and_is_told_what_to_do_instead(two_lanes: Plans):
    with pytest.raises(UsageError, match="--altitude-frame"):
        to_mission(two_lanes(AltitudeFrame.TERRAIN), 0, PX4)


def test_ardupilot_gets_nothing_that_it_refuses_or_loses(two_lanes: Plans):
    """FACTS: no NaN in param1 or altitude, no 214 or 260, whole seconds of hold, param2 of the trigger 0."""
    for trigger in (CameraTrigger(distance_m=9.0), CameraTrigger(interval_s=2.0), CameraTrigger(hover=True)):
        for item in to_mission(two_lanes(trigger=trigger, heading_deg=270.0), 0, ARDUPILOT).items:
            assert item.command not in (214, 260)
            assert all(math.isfinite(v) for v in (*item.params, item.x, item.y, item.z))
            if item.command == Cmd.NAV_WAYPOINT:
                assert item.params[0] == int(item.params[0])
                assert item.params[1:] == (0, 0, 0)
            if item.command == Cmd.DO_MOUNT_CONTROL:
                assert item.z == 0


def test_time_trigger_starts_and_stops(two_lanes: Plans):
    for autopilot in Autopilot:
        items = to_mission(two_lanes(trigger=CameraTrigger(interval_s=1.5)), 0, autopilot).items
        shots = [(item.command, item.params[1]) for item in items if item.command in (2000, 2001)]
        assert shots == [(2000, 1.5), (2001, 0), (2000, 1.5), (2001, 0)]


@pytest.mark.parametrize(("autopilot", "shot"), [(ARDUPILOT, 203), (PX4, 2000)])
def test_hover_stops_before_each_shot(two_lanes: Plans, autopilot: Autopilot, shot: int):
    items = to_mission(two_lanes(trigger=CameraTrigger(hover=True)), 0, autopilot).items
    at = [i for i, item in enumerate(items) if item.command == shot]
    assert len(at) == 4
    for i in at:
        assert items[i - 1].command == Cmd.NAV_WAYPOINT and items[i - 1].params[0] >= 1.0
    if autopilot is ARDUPILOT:
        assert {items[i].x for i in at} == {1.0}
    else:
        assert {items[i].params for i in at} == {(0.0, 0.0, 1.0, 0.0)}


def test_fixed_heading_is_said_again_at_every_waypoint_to_ardupilot_and_in_the_waypoint_to_px4(two_lanes: Plans):
    items = to_mission(two_lanes(heading_deg=-90.0), 0, ARDUPILOT).items
    turned = [i for i, item in enumerate(items) if item.command == Cmd.CONDITION_YAW]
    assert [items[i].params[0] for i in turned] == [270.0] * 5
    # ArduPilot starts what follows a condition only when it is met: the yaw must be the last before the next waypoint.
    assert all(items[i + 1].command == Cmd.NAV_WAYPOINT for i in turned)
    headings = [item.params[3] for item in to_mission(two_lanes(heading_deg=-90.0), 0, PX4).items if item.command == 16]
    assert headings[:-1] == [270.0] * 5 and math.isnan(headings[-1])


def test_landing_takes_the_place_of_return(two_lanes: Plans):
    items = to_mission(two_lanes(land=True), 0, ARDUPILOT).items
    assert items[-1].command == Cmd.NAV_LAND and (items[-1].x, items[-1].y, items[-1].z) == (47.0, 8.0, 0.0)
    assert Cmd.NAV_RETURN_TO_LAUNCH not in commands(items)


def test_the_fence_holds_the_flight_with_a_margin_and_leaves_zones_out(two_lanes: Plans):
    plan = two_lanes()
    mission = to_mission(plan, 0, ARDUPILOT, fence_margin_m=30.0)
    frame = LocalFrame.about(47.0, 8.0)
    inside, zone = (Polygon(frame.to_xy(f.vertices)) for f in mission.fence_polygons)
    path = LineString(frame.to_xy([(w.lat_deg, w.lon_deg) for w in plan.sorties[0].waypoints]))
    assert [f.inclusion for f in mission.fence_polygons] == [True, False]
    assert inside.covers(path.buffer(29.9))
    assert zone.distance(path) > 50.0 and zone.area > 0


def test_more_items_than_an_autopilot_stores_are_said(two_lanes: Plans):
    plan = two_lanes(trigger=CameraTrigger(hover=True))
    assert storage_warnings(plan, ARDUPILOT) == []
    (sortie,) = plan.sorties
    long = replace(plan, sorties=(replace(sortie, waypoints=sortie.waypoints * 50), sortie))
    (words,) = storage_warnings(long, ARDUPILOT)
    assert words.startswith("sortie 1 has ") and "--endurance-min" in words


def test_home_and_rally_go_along(two_lanes: Plans):
    mission = to_mission(two_lanes(), 0, PX4, rally=[RallyPoint(47.0, 8.001, 30.0)])
    assert mission.home is not None and mission.home.alt_amsl_m == 412.0
    assert mission.rally == (RallyPoint(47.0, 8.001, 30.0),)
    assert mission.cruise_speed_m_s == 10.0


def test_a_sortie_that_is_not_there_is_an_error(two_lanes: Plans):
    with pytest.raises(ValueError, match="sortie_index"):
        to_mission(two_lanes(), 1, PX4)
