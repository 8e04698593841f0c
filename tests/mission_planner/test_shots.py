"""Pictures as they are drawn: as many as the plan counts, and together they show what the proof says."""

import json
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from photomap_gis.core.plan import (
    AltitudeFrame,
    CameraTrigger,
    GeoPolygon,
    Sortie,
    SurveyPlan,
    Waypoint,
    WaypointRole,
)
from photomap_gis.mission_planner.area import survey_area
from photomap_gis.mission_planner.files.drawing import plan_drawing
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.optics import Optics
from photomap_gis.mission_planner.shots import footprint_ring, planned_shots
from photomap_gis.mission_planner.survey import SurveySettings, plan_survey

OPTICS = Optics(4000, 3000, 3000.0)
FIELD = GeoPolygon((((8.0, 47.0), (8.004, 47.0), (8.004, 47.003), (8.001, 47.003), (8.0, 47.0)),))
HOUSE = GeoPolygon((((8.002, 47.001), (8.0025, 47.001), (8.0025, 47.0014), (8.002, 47.0014), (8.002, 47.001)),))


def _drawn(plan, height_m=60.0, **options):
    found: dict[str, list] = {}
    collection = json.loads(plan_drawing(plan, OPTICS, height_m, **options))
    for f in collection["features"]:
        found.setdefault(f["properties"]["kind"], []).append(f)
    return collection, found


@pytest.mark.parametrize("trigger", ["distance", "hover"])
@pytest.mark.parametrize("endurance_s", [None, 400.0])
def test_as_many_pictures_are_drawn_as_the_plan_counts(trigger, endurance_s):
    asked = survey_area((FIELD,), (HOUSE,))
    plan = plan_survey(asked, SurveySettings(OPTICS, 60.0, trigger=trigger, endurance_s=endurance_s)).plan
    shots = list(planned_shots(plan, asked.frame))
    assert [sum(s.sortie == n for s in shots) for n in range(1, len(plan.sorties) + 1)] == [
        s.photos for s in plan.sorties
    ]


@settings(max_examples=12, deadline=None)
@given(angle=st.floats(0, 180), front=st.floats(0.3, 0.85), inset=st.booleans())
def test_what_is_sure_to_be_seen_lies_within_the_footprints(angle, front, inset):
    asked = survey_area((FIELD,), (HOUSE,))
    plan = plan_survey(asked, SurveySettings(OPTICS, 60.0, front_overlap=front, angle_deg=angle, inset=inset)).plan
    _, found = _drawn(plan)
    seen = shapely.union_all([shapely.geometry.shape(f["geometry"]) for f in found["footprint"]])
    covered = shapely.union_all([shapely.geometry.shape(f["geometry"]) for f in found["covered"]])
    assert covered.difference(seen).area < 1e-9 * covered.area
    whole = shapely.Polygon(FIELD.rings[0]).difference(shapely.Polygon(HOUSE.rings[0]))
    # degrees here, metres there: shares agree to the cosine's change over the field
    assert covered.area / whole.area == pytest.approx(plan.covered_share, abs=1e-4)


def test_footprints_are_thinned_evenly_and_say_so():
    plan = plan_survey(survey_area((FIELD,)), SurveySettings(OPTICS, 60.0)).plan
    every, found = _drawn(plan, most_footprints=50)
    photos = sum(s.photos for s in plan.sorties)
    assert every["footprints_every"] == math.ceil(photos / 50)
    assert [f["properties"]["photo"] for f in found["footprint"]] == list(
        range(1, photos + 1, every["footprints_every"])
    )


def _flight(*waypoints):
    points = tuple(
        Waypoint(float(lat), float(lon), 50.0, WaypointRole.SURVEY, trigger, speed_m_s=5.0, gimbal_pitch_deg=pitch)
        for lat, lon, trigger, pitch in waypoints
    )
    return SurveyPlan((), (), AltitudeFrame.RELATIVE, (Sortie(points, 0, 0.0, 0.0),), 0.0, (), 0.02, "survey")


def test_distance_runs_on_round_a_corner():
    frame, every = LocalFrame.about(0.0, 0.0), CameraTrigger(distance_m=40.0)
    corners = frame.to_lat_lon([(0, 0), (100, 0), (100, 100)])
    plan = _flight(*((lat, lon, t, None) for (lat, lon), t in zip(corners, (every, every, None), strict=True)))
    xy = np.array([s.xy_m for s in planned_shots(plan, frame)])
    assert xy == pytest.approx(np.array([(0, 0), (40, 0), (80, 0), (100, 20), (100, 60), (100, 100)]), abs=1e-3)


def test_time_goes_by_the_speed_of_the_leg_and_a_camera_that_looks_ahead_has_no_footprint():
    frame, every = LocalFrame.about(0.0, 0.0), CameraTrigger(interval_s=2.0)
    (a, b), (c, d) = frame.to_lat_lon([(0, 0), (0, 35)])
    down = _flight((a, b, every, -90.0), (c, d, None, None))
    ahead = _flight((a, b, every, -30.0), (c, d, None, None))
    assert [round(float(s.xy_m[1])) for s in planned_shots(down, frame)] == [0, 10, 20, 30]
    assert len(_drawn(down)[1]["footprint"]) == 4
    assert "footprint" not in _drawn(ahead)[1]


def test_a_footprint_is_as_wide_as_the_raster_across_its_heading():
    frame = LocalFrame.about(0.0, 0.0)
    (a, b), (c, d) = frame.to_lat_lon([(0, 0), (50, 0)])  # eastwards
    shot = next(planned_shots(_flight((a, b, CameraTrigger(distance_m=60.0), None), (c, d, None, None)), frame))
    west, south, east, north = shapely.Polygon(footprint_ring(shot, OPTICS, 60.0)).bounds
    assert (east - west, north - south) == pytest.approx((60.0, 80.0))


def test_across_the_antimeridian_a_footprint_stays_whole():
    ring = ((179.999, 10.0), (180.001, 10.0), (180.001, 10.001), (179.999, 10.001), (179.999, 10.0))
    plan = plan_survey(survey_area((GeoPolygon((ring,)),)), SurveySettings(OPTICS, 60.0)).plan
    _, found = _drawn(plan)
    for f in found["footprint"]:
        west, _, east, _ = shapely.geometry.shape(f["geometry"]).bounds
        assert east - west < 0.01
