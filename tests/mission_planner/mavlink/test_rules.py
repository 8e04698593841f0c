"""Missions that must not be uploaded, and why."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.mission import Autopilot, FenceCircle, FencePolygon, Home, Mission, MissionItem
from photomap_gis.mission_planner.mavlink.rules import (
    Limits,
    Situation,
    first_survey_item,
    judge,
    line_starts,
    nearest_start,
)

A, P = Autopilot.ARDUPILOT, Autopilot.PX4
HOME = Home(51.5, 7.4, 100.0)
TAKEOFF = MissionItem(22, 3, (0, 0, 0, math.nan), 51.5, 7.4, 40.0)
SQUARE = FencePolygon(((51.49, 7.39), (51.49, 7.41), (51.51, 7.41), (51.51, 7.39)))


def at(lat, lon, z=50.0, frame=3, **change):
    return replace(MissionItem(16, frame, (0, 0, 0, math.nan), lat, lon, z), **change)


def refusals(*items, situation=None, limits=None, **mission):
    situation = situation or Situation(A, HOME, needs_takeoff=True)
    made = Mission(items=tuple(items), **mission)
    if not situation.fence_polygons and not situation.fence_circles:
        situation = replace(situation, fence_polygons=made.fence_polygons, fence_circles=made.fence_circles)
    return " | ".join(judge(made, situation, limits or Limits()).refusals)


def test_a_sound_mission_passes():
    assert refusals(TAKEOFF, at(51.5, 7.4005), MissionItem(20, 2), fence_polygons=(SQUARE,)) == ""


@pytest.mark.parametrize(
    ("item", "why"),
    [
        (at(91, 7), "not on Earth"),
        (at(math.nan, 7), "not on Earth"),
        (at(51.5, 7.4, math.nan), "altitude"),
        (at(51.5, 7.4, frame=1), "frame 1"),
        (at(51.5, 7.4, params=(math.nan, 0, 0, 0)), "hold time"),
        (MissionItem(214, 2, (2.0, 0, 0, 0)), "TRIGG_INTERVAL"),
        (MissionItem(260, 2), "OBLIQUE"),
        (MissionItem(206, 2, (-5.0, 0, 0, 0)), "negative"),
        (MissionItem(177, 2, (9.0, 1, 0, 0)), "does not exist"),
        (MissionItem(178, 2, (1.0, math.inf, 0, 0)), "infinite"),
    ],
)
def test_what_ardupilot_would_refuse_in_mid_upload_is_refused_before(item, why):
    assert why in refusals(TAKEOFF, item)


def test_px4_knows_no_terrain_frame():
    situation = Situation(P, HOME, needs_takeoff=True)
    assert "terrain" in refusals(TAKEOFF, at(51.5, 7.4, frame=10), situation=situation)
    assert refusals(TAKEOFF, at(51.5, 7.4, frame=10)) == ""
    assert refusals(TAKEOFF, at(51.5, 7.4, params=(math.nan, 0, 0, 0)), situation=situation) == ""


def test_takeoff_is_needed_on_the_ground_only():
    assert "take-off" in refusals(at(51.5, 7.4005), TAKEOFF)
    assert refusals(at(51.5, 7.4005), situation=Situation(A, HOME, needs_takeoff=False)) == ""
    assert refusals(at(51.5, 7.4005), limits=Limits(takes_off_by_hand=True)) == ""
    assert refusals(MissionItem(178, 2, (1, 5, 0, 0)), TAKEOFF) == ""


@pytest.mark.parametrize(
    ("item", "passes"),
    [
        (at(51.5, 7.4005, 120.0), True),
        (at(51.5, 7.4005, 121.0), False),
        (at(51.5, 7.4005, 219.0, frame=0), True),
        (at(51.5, 7.4005, 222.0, frame=0), False),
        (at(51.5, 7.4005, 130.0, frame=10), False),
        (MissionItem(21, 0, (0, 0, 0, 0), 51.5, 7.4005, 4000.0), True),  # a landing's altitude is not flown
    ],
)
def test_too_high(item, passes):
    assert (refusals(TAKEOFF, item) == "") is passes


def test_a_height_that_cannot_be_checked_is_told():
    verdict = judge(
        Mission(items=(TAKEOFF, at(51.5, 7.4005, 900.0, frame=0))),
        Situation(A, Home(51.5, 7.4), needs_takeoff=True),
        Limits(),
    )
    assert not verdict.refusals and "not checked" in verdict.warnings[0]


def test_too_far_from_home():
    assert "--max-distance" in refusals(TAKEOFF, at(51.6, 7.4))
    assert refusals(TAKEOFF, at(51.6, 7.4), limits=Limits(distance_m=12_000)) == ""
    unknown = judge(Mission(items=(TAKEOFF, at(51.6, 7.4))), Situation(A, None, needs_takeoff=True), Limits())
    assert not unknown.refusals and "home is not known" in unknown.warnings[0]


def test_the_vehicles_own_fence_parameters_hold_where_they_are_enforced():
    def params(enabled):
        return {"FENCE_ENABLE": enabled, "FENCE_TYPE": 7.0, "FENCE_ALT_MAX": 60.0, "FENCE_RADIUS": 300.0}

    on, off = (Situation(A, HOME, needs_takeoff=True, params=params(e)) for e in (1.0, 0.0))
    assert "FENCE_ALT_MAX" in refusals(TAKEOFF, at(51.5, 7.4005, 70.0), situation=on)
    assert "FENCE_RADIUS" in refusals(TAKEOFF, at(51.505, 7.4), situation=on)
    assert refusals(TAKEOFF, at(51.505, 7.4, 70.0), situation=off) == ""


def test_an_old_fence_that_is_not_enforced_is_told_and_does_not_refuse():
    far = FencePolygon(((51.51, 7.39), (51.51, 7.41), (51.52, 7.41), (51.52, 7.39)))

    def verdict(**change):
        situation = Situation(A, HOME, needs_takeoff=True, fence_polygons=(far,), fence_is_plans=False, **change)
        return judge(Mission(items=(TAKEOFF, at(51.5, 7.4005))), situation, Limits())

    idle = verdict(params={"FENCE_ENABLE": 0.0, "FENCE_TYPE": 7.0})
    assert not idle.refusals and "does not enforce" in idle.warnings[0]
    assert verdict(params={"FENCE_ENABLE": 1.0, "FENCE_TYPE": 3.0}).refusals == ()
    assert verdict(params={"FENCE_ENABLE": 1.0, "FENCE_TYPE": 7.0}).refusals
    assert verdict().refusals  # not known: it may be


def test_legs_not_only_points_must_stay_inside():
    hook = FencePolygon(((51.49, 7.39), (51.49, 7.41), (51.51, 7.41), (51.51, 7.405), (51.50, 7.405), (51.50, 7.395),
                         (51.51, 7.395), (51.51, 7.39)))  # fmt: skip
    south = Home(51.495, 7.393, 100.0)
    takeoff = replace(TAKEOFF, x=51.495, y=7.393)
    situation = Situation(A, south, needs_takeoff=True)
    around = (at(51.505, 7.393), at(51.495, 7.393), at(51.495, 7.407), at(51.505, 7.407), at(51.495, 7.407))
    assert refusals(takeoff, *around, fence_polygons=(hook,), situation=situation) == ""
    across = (at(51.505, 7.393), at(51.505, 7.407))
    assert "way to item 3" in refusals(takeoff, *across, fence_polygons=(hook,), situation=situation)


def test_a_zone_to_stay_out_of():
    zone = FenceCircle(51.5, 7.403, 50.0, inclusion=False)
    assert "excludes" in refusals(TAKEOFF, at(51.5, 7.406), fence_circles=(zone,))
    assert refusals(TAKEOFF, at(51.503, 7.403), fence_circles=(zone,)) == ""


def test_home_outside_the_fence():
    far = FencePolygon(((51.51, 7.39), (51.51, 7.41), (51.52, 7.41), (51.52, 7.39)))
    assert "home" in refusals(TAKEOFF, at(51.515, 7.4), fence_polygons=(far,))


def test_the_way_home_counts():
    ring = FencePolygon(((51.499, 7.399), (51.499, 7.407), (51.501, 7.407), (51.501, 7.399)))
    zone = FenceCircle(51.5, 7.403, 30.0, inclusion=False)
    round_it = (at(51.5008, 7.401), at(51.5008, 7.405), at(51.5, 7.406))
    assert refusals(TAKEOFF, *round_it, fence_polygons=(ring,), fence_circles=(zone,)) == ""
    assert "way home" in refusals(TAKEOFF, *round_it, MissionItem(20, 2), fence_polygons=(ring,), fence_circles=(zone,))


def test_ardupilot_wants_every_inclusion_and_px4_any():
    north = FencePolygon(((51.4995, 7.39), (51.4995, 7.41), (51.51, 7.41), (51.51, 7.39)))
    south = FencePolygon(((51.49, 7.39), (51.49, 7.41), (51.5005, 7.41), (51.5005, 7.39)))
    items = (TAKEOFF, at(51.505, 7.4), at(51.495, 7.4))
    assert "fence" in refusals(*items, fence_polygons=(north, south))
    assert refusals(*items, fence_polygons=(north, south), situation=Situation(P, HOME, needs_takeoff=True)) == ""


def test_across_the_antimeridian():
    fence = FencePolygon(((-17.0, 179.9), (-17.0, -179.9), (-16.8, -179.9), (-16.8, 179.9)))
    situation = Situation(A, Home(-16.9, 179.99, 0.0), needs_takeoff=True)
    takeoff = replace(TAKEOFF, x=-16.9, y=179.99)
    assert refusals(takeoff, at(-16.9, -179.99), fence_polygons=(fence,), situation=situation) == ""
    assert refusals(takeoff, at(-16.9, -179.8), fence_polygons=(fence,), situation=situation,
                    limits=Limits(distance_m=1e6)) != ""  # fmt: skip


def test_degenerate_fences():
    assert "too few" in refusals(TAKEOFF, fence_polygons=(FencePolygon(((51.0, 7.0), (51.1, 7.0))),))
    assert "radius" in refusals(TAKEOFF, fence_circles=(FenceCircle(51.5, 7.4, 0.0),))


@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02))
def test_a_point_is_inside_just_where_the_square_says_so(dlat, dlon):
    inside = abs(dlat) < 0.00999 and abs(dlon) < 0.00999
    outside = abs(dlat) > 0.01001 or abs(dlon) > 0.01001
    words = refusals(TAKEOFF, at(51.5 + dlat, 7.4 + dlon), fence_polygons=(SQUARE,))
    assert not (inside and words) and not (outside and not words)


def _trigger(distance_m):
    return MissionItem(206, 2, (distance_m, 0, 1, 0))


def test_the_survey_begins_at_the_waypoint_before_the_camera():
    items = (TAKEOFF, at(51.5, 7.4), at(51.5, 7.401), _trigger(12), at(51.5, 7.402), _trigger(0), at(51.501, 7.402),
             _trigger(12), at(51.501, 7.401))  # fmt: skip
    assert line_starts(items) == (3, 7) and first_survey_item(items) == 3
    assert nearest_start(items, 51.5011, 7.4021) == 7
    assert nearest_start(items, 51.49, 7.401) == 3


def test_without_a_camera_it_is_the_first_waypoint():
    items = (TAKEOFF, at(51.5, 7.4), at(51.5, 7.401))
    assert first_survey_item(items) == 2 and nearest_start(items, 51.5, 7.4012) == 3
    assert first_survey_item((TAKEOFF, MissionItem(20, 2))) is None


def test_a_camera_that_is_on_from_the_start_is_started_again():
    items = (TAKEOFF, _trigger(12), at(51.5, 7.4), at(51.5, 7.401))
    assert first_survey_item(items) == 2
