"""Coverage over the ground: the flat proof's own on flat ground, a ray-by-ray twin on hills."""

import math

import numpy as np
import pytest
import shapely

from photomap_gis.core.errors import DataError
from photomap_gis.core.plan import AltitudeFrame, GeoPolygon
from photomap_gis.mission_planner.area import survey_area
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.optics import Optics
from photomap_gis.mission_planner.proof import counted_shots
from photomap_gis.mission_planner.survey import SurveySettings, plan_survey
from photomap_gis.mission_planner.terrain import FollowSettings, VerticalDatum, follow_terrain
from photomap_gis.mission_planner.terrain.proof import _altitudes, prove_over_ground

FRAME = LocalFrame.about(47.0, 8.0)
OPTICS = Optics(5472, 3648, 3648.0)
HEIGHT_M = 60.0


class Ground:
    """Ground by a formula, metres above the sea."""

    vertical = VerticalDatum.MSL
    stated = True
    cell_m = 3.0

    def __init__(self, rise=lambda x, y: 0.0 * x):
        self.rise = rise

    def elevation_m(self, lat_lon_deg):
        return 500.0 + self.rise(*FRAME.to_xy(lat_lon_deg).T)


def square(side_m):
    h = side_m / 2
    places = FRAME.to_lat_lon([(-h, -h), (h, -h), (h, h), (-h, h), (-h, -h)])
    return survey_area([GeoPolygon((tuple((float(lon), float(lat)) for lat, lon in places),))])


def proved(ground, frame=AltitudeFrame.RELATIVE, tolerance_m=3.0, area_m=300.0, **more):
    settings = SurveySettings(OPTICS, HEIGHT_M, **more)
    flat = plan_survey(square(area_m), settings)
    plan, _ = follow_terrain(flat.plan, ground, FollowSettings(tolerance_m), frame)
    return settings, *prove_over_ground(flat, plan, ground, settings)


@pytest.mark.parametrize("frame", list(AltitudeFrame))
def test_flat_ground_is_as_it_was_planned(frame):
    _, survey, proof = proved(Ground(), frame)
    assert survey.plan.covered_share == 1.0 and survey.plan.uncovered == ()
    assert proof.height_range_m == pytest.approx((HEIGHT_M, HEIGHT_M), abs=0.01)
    assert proof.front_overlap == pytest.approx(survey.spacing.front_overlap, abs=1e-3)
    assert not any("sink" in w for w in survey.plan.warnings)


HILL = Ground(lambda x, y: 35.0 * np.exp(-((x - 90) ** 2 + y**2) / 2 / 30.0**2))


def test_a_hill_between_lanes_is_told_where_the_plan_does_not_see_it():
    """Overlaps of nearly none leave no reserve: the hill between lanes comes too near to the cameras."""
    _, survey, proof = proved(HILL, front_overlap=0.0, side_overlap=0.0, tolerance_m=3.0)
    plan = survey.plan
    assert 0.8 < plan.covered_share < 1.0
    assert plan.uncovered
    assert any("over the terrain" in w for w in plan.warnings)
    assert proof.height_range_m[0] < HEIGHT_M - 5.0


@pytest.mark.parametrize("overlaps", [(0.0, 0.0), (0.8, 0.65)])
def test_every_place_is_as_the_twin_sees_it(overlaps):
    settings, survey, proof = proved(HILL, front_overlap=overlaps[0], side_overlap=overlaps[1])
    points = np.random.default_rng(4).uniform(-149, 149, (1500, 2))
    shots, headings = counted_shots(survey.lanes, survey.spacing)
    frame = survey.area.frame
    up = _altitudes(survey.plan, frame, HILL, shots)
    lat_lon = frame.to_lat_lon(points)
    ground = HILL.elevation_m(lat_lon)
    below = HILL.elevation_m(frame.to_lat_lon(shots))
    seen = np.zeros(len(points), bool)
    for at, heading, z, e in zip(shots, headings, up, below, strict=True):
        seen |= surely(points - at, heading, z - ground, z - e, settings.tolerances)
    spots = shapely.points(points)
    said = shapely.distance(survey.left, spots) > 2 * proof.cell_m if not survey.left.is_empty else np.ones(1500, bool)
    assert seen[said].all()
    open_ = shapely.contains(survey.left.buffer(-2 * proof.cell_m), spots)
    assert not seen[open_].any()


def surely(offset, heading, depth, over, t):
    ok = np.ones(len(offset), bool)
    limits = np.array([OPTICS.width_px, OPTICS.height_px]) / 2 / OPTICS.focal_px
    for turn in np.radians([-t.heading_deg, 0, t.heading_deg]):
        c, s = math.cos(heading + turn), math.sin(heading + turn)
        flat = offset @ np.array([[c, s], [-s, c]])
        for shift in t.cross_track_m * np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)]):
            for share in (-t.height_share, t.height_share):
                ray = np.column_stack([flat + shift, depth + share * over])
                for axis in (0, 1):
                    for lean in np.radians([-t.tilt_deg, t.tilt_deg]):
                        a = ray[:, axis] * math.cos(lean) + ray[:, 2] * math.sin(lean)
                        down = ray[:, 2] * math.cos(lean) - ray[:, axis] * math.sin(lean)
                        other = ray[:, 1 - axis]
                        ok &= (np.abs(a / down) <= limits[axis]) & (np.abs(other / down) <= limits[1 - axis])
                        ok &= down > 0
    return ok


def test_sinking_overlaps_are_said_with_their_place():
    _, survey, proof = proved(Ground(lambda x, y: 0.25 * x))
    assert proof.side_overlap < 0.64
    assert any("overlaps sink to" in w for w in survey.plan.warnings)


def test_ground_that_the_model_does_not_know_is_not_covered():
    half = Ground(lambda x, y: np.where(x > 148.0, np.nan, 0.0))
    settings = SurveySettings(OPTICS, HEIGHT_M, angle_deg=0.0, home=tuple(FRAME.to_lat_lon([(0, 0)])[0]))
    flat = plan_survey(square(300), settings)
    survey, _ = prove_over_ground(flat, flat.plan, half, settings)
    assert 0.98 < survey.plan.covered_share < 1.0
    assert any("outside of the elevation model" in w for w in survey.plan.warnings)
    with pytest.raises(DataError, match="nothing of the area"):
        prove_over_ground(flat, flat.plan, Ground(lambda x, y: np.nan * x), settings)
