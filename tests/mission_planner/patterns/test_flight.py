"""Search patterns as flights: round zones, within the battery, complete."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString, Polygon, box

from photomap_gis.core.errors import UsageError
from photomap_gis.core.mission import Autopilot
from photomap_gis.core.plan import CameraTrigger, SurveyPlan, WaypointRole
from photomap_gis.mission_planner.flight_time import FlightModel
from photomap_gis.mission_planner.items import to_mission
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.patterns import Pattern, Track, from_area, from_datum
from photomap_gis.mission_planner.patterns.flight import SearchFlight, search_plan

FRAME = LocalFrame.about(60.0, 179.999)  # across the antimeridian
AREA = box(-300, -150, 300, 150)
PARALLEL = from_area(Pattern.PARALLEL, AREA, spacing_m=40)
Make = Callable[..., SurveyPlan]


def flight(**more: object) -> SearchFlight:
    return SearchFlight(
        **{  # type: ignore[arg-type]
            "height_m": 60.0,
            "gsd_m_per_px": 0.02,
            "sweep_width_m": 40.0,
            "trigger": CameraTrigger(distance_m=10.0),
            "model": FlightModel(),
            "survey_speed_m_s": 8.0,
            **more,
        }
    )


def plan_of(track: Track = PARALLEL, config: SearchFlight | None = None, **more: object) -> SurveyPlan:
    return search_plan(track, FRAME, config or flight(), **{"pattern": "test", "target": AREA, **more})  # type: ignore[arg-type]


def path(plan: SurveyPlan, sortie: int = 0) -> np.ndarray:
    return FRAME.to_xy([(w.lat_deg, w.lon_deg) for w in plan.sorties[sortie].waypoints])


def test_a_sortie_is_complete_and_covers():
    plan = plan_of(home=(60.0, 179.99))
    roles = [w.role for w in plan.sorties[0].waypoints]
    assert roles[0] is WaypointRole.TAKEOFF and roles[-1] is WaypointRole.RETURN
    assert roles.count(WaypointRole.SURVEY) == 2 * len(PARALLEL.legs)
    assert plan.covered_share == 1.0 and plan.uncovered == ()
    assert np.allclose(path(plan)[[0, -1]], FRAME.to_xy([(60.0, 179.99)]), atol=1e-3)
    # the camera is on along each leg and nowhere else
    on = [w.trigger is not None for w in plan.sorties[0].waypoints]
    assert on == [False] + [True, False] * len(PARALLEL.legs) + [False]
    assert plan.sorties[0].photos == sum(int(np.hypot(*(b - a)) / 10) + 1 for a, b in PARALLEL.legs)
    assert plan.sorties[0].length_m == pytest.approx(LineString(path(plan)).length, rel=1e-6)
    assert to_mission(plan, 0, Autopilot.ARDUPILOT).items


def test_no_leg_enters_a_zone_and_the_rest_is_told():
    zone = box(-60, -40, 80, 30)
    for track in (PARALLEL, from_datum(Pattern.SECTOR, spacing_m=40, radius_m=250, heading_deg=10)):
        plan = plan_of(track, avoid=zone, home=tuple(FRAME.to_lat_lon([-350.0, 0.0])[0]))
        assert not LineString(path(plan)).intersects(zone.buffer(4.9))
    assert plan_of(avoid=zone).covered_share < 1.0 or plan_of(avoid=zone).uncovered == ()
    narrow = plan_of(config=flight(sweep_width_m=30.0))
    assert narrow.covered_share == pytest.approx(30 / (300 / 8), abs=0.05) and narrow.uncovered


def test_camera_stays_on_where_a_track_goes_on():
    (leg,) = from_datum(Pattern.EXPANDING_SQUARE, spacing_m=40, radius_m=100).legs
    waypoints = plan_of(Track((leg,)), target=box(-120, -120, 120, 120)).sorties[0].waypoints
    assert [w.trigger is not None for w in waypoints[1:-1]] == [True] * (len(leg) - 1) + [False]


def test_sorties_fit_the_battery_and_miss_nothing():
    config = flight(endurance_s=240.0)
    plan = plan_of(config=config, home=(60.0, 179.99))
    assert len(plan.sorties) > 1 and plan.covered_share == 1.0
    assert all(s.duration_s <= 240.0 for s in plan.sorties)
    assert all(s.waypoints[0].role is WaypointRole.TAKEOFF for s in plan.sorties)
    seen = []
    for i, sortie in enumerate(plan.sorties):
        xy = path(plan, i)
        on = [w.trigger is not None for w in sortie.waypoints]
        seen += [LineString([a, b]) for (a, b), o in zip(itertools.pairwise(xy), on, strict=False) if o]
    flown = shapely.union_all(seen)
    legs = shapely.union_all([LineString(leg) for leg in PARALLEL.legs])
    assert legs.difference(flown.buffer(0.01)).length < 0.1 and flown.length == pytest.approx(legs.length, abs=0.1)
    with pytest.raises(UsageError, match="battery does not reach"):
        plan_of(config=flight(endurance_s=60.0), home=(60.02, 179.99))


def test_transit_is_high_and_descends_above_the_search_only():
    plan = plan_of(config=flight(transit_height_m=90.0, lands=True), home=(60.0, 179.99))
    waypoints = plan.sorties[0].waypoints
    heights = {w.role: {v.alt_m for v in waypoints if v.role is w.role} for w in waypoints}
    assert heights[WaypointRole.TAKEOFF] == heights[WaypointRole.TRANSIT] == heights[WaypointRole.RETURN] == {90.0}
    assert heights[WaypointRole.SURVEY] == {60.0} and waypoints[-1].role is WaypointRole.LAND
    xy = path(plan)
    for i, (a, b) in enumerate(itertools.pairwise(waypoints)):
        if a.alt_m != b.alt_m:
            assert np.hypot(*(xy[i + 1] - xy[i])) < 0.01


def test_an_orbit_looks_at_its_middle():
    track = from_datum(Pattern.ORBIT, spacing_m=1, radius_m=60)
    plan = plan_of(track, flight(look_at_datum=True), target=Polygon())
    survey = [w for w in plan.sorties[0].waypoints if w.role is WaypointRole.SURVEY]
    assert {w.gimbal_pitch_deg for w in survey} == {-45.0}
    xy = FRAME.to_xy([(w.lat_deg, w.lon_deg) for w in survey])
    noses = np.radians([w.heading_deg for w in survey])
    assert np.allclose(xy + 60 * np.column_stack((np.sin(noses), np.cos(noses))), 0, atol=0.01)
    assert plan.covered_share == 1.0


def test_what_cannot_be_flown_is_refused_with_words():
    with pytest.raises(UsageError, match="nothing is left"):
        plan_of(avoid=box(-400, -400, 400, 400))
    with pytest.raises(UsageError, match="--home"):
        plan_of(avoid=box(-60, -40, 80, 30), home=(60.0, 179.999))
    shut = box(-320, -170, 320, 170).difference(box(-305, -155, 305, 155))
    with pytest.raises(UsageError, match="shut a part"):
        plan_of(avoid=shut, home=(60.0, 179.98))
