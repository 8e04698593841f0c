"""Surveys over random areas: what is told as covered is, no leg enters a zone, inset flights stay inside."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString

from photomap_gis.core.errors import DataError, PhotomapError, UsageError
from photomap_gis.core.plan import GeoPolygon, WaypointRole
from photomap_gis.mission_planner.area import survey_area
from photomap_gis.mission_planner.flight_time import FlightModel
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.optics import Optics, Tolerances, space, sure_footprint
from photomap_gis.mission_planner.proof import counted_shots
from photomap_gis.mission_planner.survey import SurveySettings, plan_survey

OPTICS = Optics(5472, 3648, 3648.0)
PLACES = [(47.0, 8.0), (0.0, 179.9995), (89.995, 10.0), (-60.0, -180.0)]


def ring(frame: LocalFrame, xy) -> GeoPolygon:
    places = frame.to_lat_lon(np.asarray(xy, float))
    closed = [(float(lon), float(lat)) for lat, lon in places]
    return GeoPolygon((tuple([*closed, closed[0]]),))


def square(side_m: float, place=(47.0, 8.0)) -> GeoPolygon:
    h = side_m / 2
    return ring(LocalFrame.about(*place), [(-h, -h), (h, -h), (h, h), (-h, h)])


@st.composite
def requests(draw):
    """An area anywhere, star-shaped or crossing itself, thin or not, with zones; and how to fly it."""
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    frame = LocalFrame.about(*draw(st.sampled_from(PLACES)))
    size = 10 ** draw(st.floats(0.7, 2.5))
    corners = draw(st.integers(3, 12))
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    xy = (size * rng.uniform(0.15, 1.0, corners))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if draw(st.integers(0, 4)) == 0:
        rng.shuffle(xy)
    if draw(st.integers(0, 4)) == 0:
        xy = np.repeat(xy * [1.0, 0.02], 2, axis=0)
    zones = []
    for _ in range(draw(st.integers(0, 3))):
        spots = rng.uniform(-0.6, 0.6, 2) * size + rng.uniform(-0.25, 0.25, (4, 2)) * size
        zones.append(ring(frame, shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(spots)))[:-1]))
    chosen = SurveySettings(
        OPTICS,
        draw(st.floats(20.0, 80.0)),
        inset=draw(st.booleans()),
        endurance_s=draw(st.sampled_from([None, 1500.0])),
        trigger=draw(st.sampled_from(["distance", "hover"])),
        crosshatch=draw(st.integers(0, 5)) == 0,
        model=FlightModel(wind_east_m_s=draw(st.sampled_from([0.0, 4.0]))),
    )
    return ring(frame, xy), zones, chosen


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(requests())
def test_any_area_is_refused_in_words_or_flown_soundly(request_):
    polygon, zones, chosen = request_
    try:
        area = survey_area([polygon], zones)
        survey = plan_survey(area, chosen)
    except PhotomapError as refusal:
        assert len(str(refusal)) > 20
        return
    for sortie in survey.plan.sorties:
        path = LineString(area.frame.to_xy([(w.lat_deg, w.lon_deg) for w in sortie.waypoints]))
        assert not path.intersects(area.avoid)
        assert not chosen.inset or area.area.covers(path)
        assert sortie.waypoints[0].role is WaypointRole.TAKEOFF
        assert sortie.waypoints[-1].role is WaypointRole.RETURN
        assert chosen.endurance_s is None or sortie.duration_s <= 1.02 * chosen.endurance_s
    assert_raster_agrees(survey, chosen)
    if not zones and not chosen.inset:
        assert survey.plan.covered_share > 1 - 1e-6


def assert_raster_agrees(survey, chosen):
    """The twin: each cell's centre asked against each picture by projecting it, off by the tolerances."""
    west, south, east, north = survey.area.target.bounds
    cell = max(east - west, north - south) / 60
    x, y = np.meshgrid(np.arange(west, east, cell) + cell / 2, np.arange(south, north, cell) + cell / 2)
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    spots = shapely.points(points)
    points = points[
        shapely.contains(survey.area.target, spots)
        & (shapely.distance(survey.left, spots) != 0 if not survey.left.is_empty else True)
    ]
    shots, headings = counted_shots(survey.lanes, survey.spacing)
    seen = np.zeros(len(points), bool)
    t, h = chosen.tolerances, chosen.height_m
    for place, heading in zip(shots, headings, strict=True):
        near = np.flatnonzero(~seen & (np.hypot(*(points - place).T) < h))
        if len(near):
            seen[near] = surely_sees(points[near] - place, heading, h, t)
    assert seen.all()


def surely_sees(offset, heading, height_m, t):
    ok = np.ones(len(offset), bool)
    limits = np.array([OPTICS.width_px, OPTICS.height_px]) / 2 / OPTICS.focal_px
    for turn in (-1, 0, 1):
        a = heading + turn * math.radians(t.heading_deg)
        across = offset @ [math.cos(a), -math.sin(a)]
        along = offset @ [math.sin(a), math.cos(a)]
        for shift_x, shift_y in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
            for share in (-1, 1):
                ray = np.stack([across + shift_x * t.cross_track_m, along + shift_y * t.cross_track_m,
                                np.full(len(offset), height_m * (1 + share * t.height_share))], axis=1)  # fmt: skip
                for axis in range(2):
                    for tilt in (-1, 1):
                        b = tilt * math.radians(t.tilt_deg)
                        lean = ray.copy()
                        lean[:, axis] = ray[:, axis] * math.cos(b) + ray[:, 2] * math.sin(b)
                        lean[:, 2] = ray[:, 2] * math.cos(b) - ray[:, axis] * math.sin(b)
                        ok &= (np.abs(lean[:, :2] / lean[:, 2:]) <= limits).all(axis=1)
    return ok


def test_the_same_request_gives_the_same_plan():
    area = survey_area([square(400)], [square(60)])
    chosen = SurveySettings(OPTICS, 60.0, endurance_s=600.0)
    assert plan_survey(area, chosen).plan == plan_survey(area, chosen).plan


def test_a_square_kilometre_is_planned_as_a_pilot_expects():
    survey = plan_survey(survey_area([square(1000)]), SurveySettings(OPTICS, OPTICS.height_m(0.02)))
    assert survey.plan.covered_share == 1.0
    assert survey.headings_deg[0] % 90 < 1.0
    assert survey.spacing.side_overlap >= 0.65 - 1e-9
    assert survey.spacing.front_overlap >= 0.8 - 1e-9
    assert len(survey.plan.sorties[0].waypoints) == 2 * len(survey.lanes) + 2
    assert 20 <= len(survey.lanes) <= 27


def test_tolerances_draw_lanes_together_where_overlaps_would_leave_gaps():
    sure = sure_footprint(OPTICS, 60.0, Tolerances())
    made = space(OPTICS, 60.0, sure, front_overlap=0.0, side_overlap=0.0)
    assert made.side_overlap > 0.05
    chosen = SurveySettings(OPTICS, 60.0, front_overlap=0.0, side_overlap=0.0)
    survey = plan_survey(survey_area([square(500)]), chosen)
    assert survey.plan.covered_share == 1.0
    assert any("more overlap" in w for w in survey.plan.warnings)


def test_bow_ties_and_duplicates_are_repaired_and_said():
    frame = LocalFrame.about(47.0, 8.0)
    area = survey_area([ring(frame, [(0, 0), (200, 200), (200, 200), (200, 0), (0, 200)])])
    assert any("repaired" in w for w in area.warnings)
    assert area.area.area == pytest.approx(20_000, rel=1e-3)


@pytest.mark.parametrize(
    "xy", [[(0, 0), (100, 0), (50, 0)], [(0, 0), (0, 0), (0, 0)], [(0, 0), (9e4, 0), (9e4, 9e4), (0, 9e4)]]
)
def test_what_cannot_be_planned_is_refused(xy):
    with pytest.raises(DataError):
        survey_area([ring(LocalFrame.about(47.0, 8.0), xy)])


def test_wind_turns_the_sweep_and_a_storm_is_refused():
    with pytest.raises(UsageError, match="wind"):
        FlightModel(speed_m_s=8.0, wind_east_m_s=9.0)
    chosen = SurveySettings(OPTICS, 60.0, model=FlightModel(wind_east_m_s=7.0), most_crab_deg=20.0)
    heading = plan_survey(survey_area([square(400)]), chosen).headings_deg[0]
    assert abs(math.sin(math.radians(heading - 90.0))) < math.sin(math.radians(30.0))


def test_a_corridor_is_covered_by_lanes_along_its_line():
    line = [(8.31, 47.05), (8.321, 47.058), (8.33, 47.06)]
    survey = plan_survey(survey_area([], line=line, corridor_width_m=120.0), SurveySettings(OPTICS, 80.0))
    assert survey.plan.covered_share == 1.0
    assert sum(not lane.spot for lane in survey.lanes) == 2


def test_one_battery_that_does_not_reach_is_said():
    chosen = SurveySettings(OPTICS, 60.0, endurance_s=240.0, home=(47.05, 8.0))
    with pytest.raises(UsageError, match="battery"):
        plan_survey(survey_area([square(400)]), chosen)


@pytest.mark.parametrize("nose", [0.0, 30.0, 90.0, 250.0])
def test_a_nose_that_stays_is_flown_and_proved_as_it_points(nose):
    zone = ring(LocalFrame.about(47.0, 8.0), [(60, 60), (90, 60), (90, 90), (60, 90)])
    chosen = SurveySettings(OPTICS, 50.0, fixed_heading=True, nose_deg=nose, angle_deg=0.0, crosshatch=nose == 30.0)
    survey = plan_survey(survey_area([square(240)], [zone]), chosen)
    noses = {w.heading_deg for s in survey.plan.sorties for w in s.waypoints}
    assert noses == {nose}
    assert survey.plan.covered_share > 0.995
    points = np.random.default_rng(1).uniform(-120, 120, (400, 2))
    spots = shapely.points(points)
    points = points[shapely.contains(survey.area.target, spots) & (shapely.distance(survey.left, spots) > 0)]
    shots, _ = counted_shots(survey.lanes, survey.spacing)
    seen = np.zeros(len(points), bool)
    for place in shots:
        seen |= surely_sees(points - place, math.radians(nose), 50.0, chosen.tolerances)
    assert seen.all()


def test_a_nose_across_the_lanes_lays_them_by_the_pictures_other_side():
    area = survey_area([square(400)])
    along = plan_survey(area, SurveySettings(OPTICS, 60.0, angle_deg=0.0, fixed_heading=True, nose_deg=0.0))
    across = plan_survey(area, SurveySettings(OPTICS, 60.0, angle_deg=0.0, fixed_heading=True, nose_deg=90.0))
    assert across.spacing.lane_m == pytest.approx(along.spacing.lane_m * 2 / 3, rel=0.01)
    assert across.spacing.step_m >= along.spacing.step_m
    assert across.plan.covered_share == along.plan.covered_share == 1.0


def test_a_nose_that_stays_along_a_corridor_with_corners_sees_all_of_it():
    line = [(8.31, 47.05), (8.316, 47.052), (8.3115, 47.0525), (8.312, 47.056)]
    chosen = SurveySettings(OPTICS, 60.0, fixed_heading=True, nose_deg=20.0)
    survey = plan_survey(survey_area([], line=line, corridor_width_m=90.0), chosen)
    assert survey.plan.covered_share == 1.0
    west, south, east, north = survey.area.target.bounds
    points = np.random.default_rng(2).uniform((west, south), (east, north), (1500, 2))
    points = points[shapely.contains(survey.area.target, shapely.points(points))]
    seen = np.zeros(len(points), bool)
    for place in counted_shots(survey.lanes, survey.spacing)[0]:
        seen |= surely_sees(points - place, math.radians(20.0), 60.0, chosen.tolerances)
    assert seen.all()
