"""Missions over the wire and back."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from photomap_gis.core.errors import DataError
from photomap_gis.core.mission import (
    Autopilot,
    FenceCircle,
    FencePolygon,
    Home,
    Mission,
    MissionItem,
    RallyPoint,
)
from photomap_gis.mission_planner.mavlink.wire import Kind, WireItem, lists_of, mission_of, to_degrees, to_wire


@given(st.integers(-1_800_000_000, 1_800_000_000))
@example(-1)
def test_degrees_are_rounded_not_cut(x):
    assert to_wire(to_degrees(x)) == x
    assert to_wire(to_degrees(x) + 0.4e-7) == x


def test_ardupilot_has_home_first_and_px4_has_not():
    mission = Mission(items=(MissionItem(16, 3, x=51.5, y=7.4, z=50.0),), home=Home(51.0, 7.0, 99.0))
    ours = lists_of(mission, Autopilot.ARDUPILOT)[Kind.MISSION]
    assert [i.command for i in ours] == [16, 16] and ours[0].x == 510_000_000 and ours[0].z == 99.0
    assert ours[0].frame == 0
    assert len(lists_of(mission, Autopilot.PX4)[Kind.MISSION]) == 1


def test_a_home_that_is_not_known_is_a_placeholder():
    mission = Mission(items=(MissionItem(20, 2),))
    home = lists_of(mission, Autopilot.ARDUPILOT)[Kind.MISSION][0]
    assert (home.x, home.y, home.z) == (0, 0, 0.0)
    assert mission_of({Kind.MISSION: (home,)}, Autopilot.ARDUPILOT)[0].home is None


def test_items_without_a_place_go_in_the_mission_frame_with_plain_numbers():
    mission = Mission(items=(MissionItem(203, 3, x=1.0), MissionItem(206, 3, (12.5, math.nan, 1.0, 0.0))))
    for autopilot in Autopilot:
        shot, trigger = lists_of(mission, autopilot)[Kind.MISSION][-2:]
        assert (shot.frame, shot.x) == (2, 1) and trigger.frame == 2
        # ArduPilot refuses a NaN as the shutter of the trigger.
        assert (trigger.params[1] == 0.0) is (autopilot is Autopilot.ARDUPILOT)


def test_nan_yaw_stays_where_ardupilot_takes_it():
    mission = Mission(items=tuple(MissionItem(c, 3, (0, 0, 0, math.nan), 1.0, 1.0, 9.0) for c in (16, 22, 21, 17, 19)))
    kept = [math.isnan(i.params[3]) for i in lists_of(mission, Autopilot.ARDUPILOT)[Kind.MISSION][1:]]
    assert kept == [True, True, True, True, False]


def test_px4_takes_a_landing_start_without_a_place_only():
    item = lists_of(Mission(items=(MissionItem(189, 3, x=51.0, y=7.0),)), Autopilot.PX4)[Kind.MISSION][0]
    assert (item.frame, item.x, item.y) == (2, 0, 0)


def test_jumps_point_at_the_same_item_on_either_wire():
    mission = Mission(items=(MissionItem(22, 3, z=9.0), MissionItem(16, 3, x=1.0), MissionItem(177, 2, (2.0, 3, 0, 0))))
    for autopilot, target in ((Autopilot.ARDUPILOT, 2.0), (Autopilot.PX4, 1.0)):
        lists = lists_of(mission, autopilot)
        assert lists[Kind.MISSION][-1].params == (target, 3, 0, 0)
        assert mission_of(lists, autopilot)[0].items == mission.items


def test_a_take_off_where_the_vehicle_is():
    mission = Mission(items=(MissionItem(22, 3, x=math.nan, y=math.nan, z=9.0),))
    home = Home(51.5, 7.4, 100.0)
    assert lists_of(mission, Autopilot.ARDUPILOT, home)[Kind.MISSION][1].x == 0
    assert lists_of(mission, Autopilot.PX4, home)[Kind.MISSION][0].x == 515_000_000
    with pytest.raises(DataError, match="not known"):
        lists_of(mission, Autopilot.PX4)


def test_a_place_that_is_no_number_is_an_error():
    with pytest.raises(DataError, match="not known"):
        lists_of(Mission(items=(MissionItem(16, 3, x=math.nan, y=7.0),)), Autopilot.PX4)


_degrees = st.floats(-80, 80, allow_nan=False).map(lambda v: round(v, 7))
_places = st.tuples(_degrees, _degrees)
_missions = st.builds(
    Mission,
    items=st.lists(
        st.builds(
            MissionItem,
            command=st.sampled_from([16, 22, 21]),
            frame=st.sampled_from([0, 3, 10]),
            x=_degrees,
            y=_degrees,
            z=st.floats(-100, 1000),
        ),
        min_size=1,
        max_size=5,
    ).map(tuple),
    fence_polygons=st.lists(
        st.builds(FencePolygon, st.lists(_places, min_size=3, max_size=6).map(tuple), st.booleans()), max_size=4
    ).map(tuple),
    fence_circles=st.lists(
        st.builds(FenceCircle, _degrees, _degrees, st.floats(1, 500), st.booleans()), max_size=2
    ).map(tuple),
    rally=st.lists(st.builds(RallyPoint, _degrees, _degrees, st.integers(0, 100).map(float)), max_size=3).map(tuple),
)


@given(_missions, st.sampled_from(list(Autopilot)))
def test_a_mission_comes_back_as_it_went(mission, autopilot):
    back, warnings = mission_of(lists_of(mission, autopilot), autopilot)
    assert (back.items, back.fence_polygons, back.fence_circles, back.rally) == (
        mission.items,
        mission.fence_polygons,
        mission.fence_circles,
        mission.rally,
    )
    assert not warnings


def test_a_broken_fence_and_a_return_point_are_told():
    fence = (
        WireItem(5001, 0, (4.0, 0, 0, 0), 1, 1),
        WireItem(5001, 0, (4.0, 0, 0, 0), 2, 1),
        WireItem(5000, 0, x=5, y=5),
    )
    mission, warnings = mission_of({Kind.FENCE: fence}, Autopilot.ARDUPILOT)
    assert mission.fence_polygons == () and len(warnings) >= 1


def test_int_frames_of_px4_are_read_as_the_plain_ones():
    items = (WireItem(16, 6, x=1, y=1), WireItem(16, 5, x=1, y=1))
    assert [i.frame for i in mission_of({Kind.MISSION: items}, Autopilot.PX4)[0].items] == [3, 0]
