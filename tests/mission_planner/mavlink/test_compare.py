"""What is forgiven in a read-back, and what is not: each line of what was measured on the autopilots."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.mission import Autopilot
from photomap_gis.mission_planner.mavlink.compare import compare
from photomap_gis.mission_planner.mavlink.wire import Kind, WireItem, as_float32

A, P = Autopilot.ARDUPILOT, Autopilot.PX4
HOME = WireItem(16, 0)
WAYPOINT = WireItem(16, 3, (0.0, 0.0, 0.0, 0.0), 515_000_001, 74_000_001, 50.0)


def same(sent: WireItem, read: WireItem, autopilot: Autopilot, kind: Kind = Kind.MISSION) -> bool:
    home = (HOME,) if autopilot is A and kind is Kind.MISSION else ()
    return compare(kind, (*home, sent), (*home, read), autopilot).is_same


@pytest.mark.parametrize(
    ("sent", "read"),
    [
        ({"frame": 6}, {"frame": 3}),
        ({"frame": 11}, {"frame": 10}),
        ({"frame": 5}, {"frame": 0}),
        ({"z": 50.129}, {"z": 50.12}),
        ({"z": -0.019}, {"z": -0.01}),
        ({"params": (2.7, 0, 0, 0)}, {"params": (2, 0, 0, 0)}),
        ({"params": (0, 3, 1, 90)}, {"params": (0, 0, 0, 0)}),
        ({"params": (0, 0, 0, math.nan)}, {"params": (0, 0, 0, 0)}),
        ({"command": 19, "params": (5, 0, 0, 0)}, {"command": 19, "params": (5, 0, 1, 1)}),
        ({"command": 21}, {"command": 21, "params": (0, 0, 0, 1)}),
        (
            {"command": 206, "frame": 2, "params": (12.5, 0, 1, 0)},
            {"command": 206, "frame": 0, "params": (12.5, 0, 1, 0)},
        ),
        ({"autocontinue": True}, {"autocontinue": False}),
    ],
)
def test_what_ardupilot_is_known_to_do_is_forgiven(sent, read):
    assert same(replace(WAYPOINT, **sent), replace(WAYPOINT, **read), A)


@pytest.mark.parametrize(
    "change",
    [
        {"x": 515_000_002},
        {"y": 74_000_000},
        {"z": 50.02},
        {"z": 49.98},
        {"frame": 0},
        {"frame": 10},
        {"command": 82},
        {"params": (1.0, 0, 0, 0)},
        {"params": (0, 0, 0, 45.0)},
    ],
)
@pytest.mark.parametrize("autopilot", list(Autopilot))
def test_what_would_be_another_flight_is_not(change, autopilot):
    assert not same(WAYPOINT, replace(WAYPOINT, **change), autopilot)


def test_a_trigger_distance_must_be_the_same():
    trigger = WireItem(206, 2, (12.5, 0.0, 1.0, 0.0))
    assert not same(trigger, replace(trigger, params=(12.0, 0.0, 1.0, 0.0)), A)
    assert not same(trigger, replace(trigger, params=(12.5, 0.0, 0.0, 0.0)), A)


def test_a_yaw_that_is_not_kept_is_told():
    sent = (HOME, replace(WAYPOINT, params=(0, 0, 0, 90.0)))
    result = compare(Kind.MISSION, sent, (HOME, WAYPOINT), A)
    assert result.is_same and "yaw" in result.notes[0]
    unknown = (HOME, replace(WAYPOINT, params=(0, 0, 0, math.nan)))
    assert compare(Kind.MISSION, unknown, (HOME, WAYPOINT), A).notes == ()


def test_home_is_not_compared():
    moved = replace(HOME, x=1, y=2, z=3.0)
    assert compare(Kind.MISSION, (HOME, WAYPOINT), (moved, WAYPOINT), A).is_same
    assert not compare(Kind.MISSION, (HOME, WAYPOINT), (moved, WAYPOINT), P).is_same


def test_a_lost_first_item_is_another_number_of_items():
    result = compare(Kind.MISSION, (HOME, WAYPOINT, WAYPOINT), (HOME, WAYPOINT), A)
    assert [d.field for d in result.differences] == ["number of items"]


def test_an_empty_mission_may_hold_home():
    assert compare(Kind.MISSION, (), (HOME,), A).is_same
    assert not compare(Kind.MISSION, (), (HOME,), P).is_same
    assert not compare(Kind.FENCE, (), (HOME,), A).is_same


def test_px4_turns_yaw_and_answers_with_int_frames():
    west = replace(WAYPOINT, params=(0, 0, 0, -90.0))
    assert same(west, replace(west, frame=6, params=(0, 0, 0, 270.0)), P)
    assert not same(west, replace(west, frame=6, params=(0, 0, 0, 90.0)), P)


def test_px4_keeps_fractions():
    hold = replace(WAYPOINT, params=(2.7, 0, 0, 0))
    assert not same(hold, replace(hold, params=(2.0, 0, 0, 0)), P)


def test_rally_heights_are_whole_metres_in_ardupilot():
    rally = WireItem(5100, 3, x=1, y=1, z=30.9)
    assert same(rally, replace(rally, z=30.0), A, Kind.RALLY)
    assert not same(rally, replace(rally, z=29.8), A, Kind.RALLY)
    assert not same(rally, replace(rally, z=30.0), P, Kind.RALLY)


def test_a_fence_has_no_heights_and_its_radius_may_be_whole():
    circle = WireItem(5004, 0, (20.5, 0, 0, 0), 1, 1)
    assert same(circle, replace(circle, params=(20.0, 0, 0, 0), autocontinue=False), A, Kind.FENCE)
    assert not same(circle, replace(circle, params=(21.0, 0, 0, 0)), A, Kind.FENCE)
    assert not same(circle, replace(circle, command=5003), A, Kind.FENCE)


@given(st.integers(-900_000_000, 900_000_000), st.integers(-1_800_000_000, 1_800_000_000))
def test_float_items_are_as_near_as_their_degrees_can_be(x, y):
    sent = replace(WAYPOINT, x=x, y=y)
    read = replace(sent, x=round(as_float32(x / 1e7) * 1e7), y=round(as_float32(y / 1e7) * 1e7), from_float=True)
    assert same(sent, read, A)
    assert not same(sent, replace(read, x=x + 400), A)  # four metres, more than any 32-bit degree is off


@given(st.floats(-1000, 5000))
def test_any_height_survives_the_centimetres(z):
    z = as_float32(z)
    kept = math.trunc(round(z * 100, 3)) / 100
    assert same(replace(WAYPOINT, z=z), replace(WAYPOINT, z=as_float32(kept)), A)
