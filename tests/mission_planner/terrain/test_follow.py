"""Plans bent to the ground: known hills, flown again by straight lines between the waypoints."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from numpy.typing import ArrayLike
from pyproj import Transformer
from rasterio.transform import from_origin

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.plan import AltitudeFrame, SurveyPlan, WaypointRole
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.terrain import FollowSettings, VerticalDatum, follow_terrain, on_flat_ground, open_dem
from photomap_gis.mission_planner.terrain.profile import fewest, flyable

Plans = Callable[..., SurveyPlan]
FRAME = LocalFrame.about(47.0, 8.0)
TO_UTM = Transformer.from_crs(4326, 32632, always_xy=True)
LANE_UTM = TO_UTM.transform(7.9995, 47.002)


class Hills:
    """Analytic ground, above the sea."""

    vertical = VerticalDatum.MSL
    stated = True
    cell_m = 4.0

    def __init__(self, height_m: float = 25.0, length_m: float = 150.0, base_m: float = 500.0):
        self.height_m, self.length_m, self.base_m = height_m, length_m, base_m

    def elevation_m(self, lat_lon_deg: ArrayLike) -> np.ndarray:
        x, y = FRAME.to_xy(lat_lon_deg).T
        return self.base_m + self.height_m * np.sin(y / self.length_m * 2 * np.pi) * np.cos(x / self.length_m)


def flown_over(plan: SurveyPlan, ground: Hills) -> tuple[np.ndarray, np.ndarray]:
    """Height above ground along straight lines between the waypoints, and whether the camera is on: the twin."""
    zero = 0.0 if plan.frame is AltitudeFrame.AMSL else float(ground.elevation_m([plan.home])[0])
    clear, camera = [], []
    waypoints = [w for w in plan.sorties[0].waypoints if w.role is not WaypointRole.LAND]
    for a, b in itertools.pairwise(waypoints):
        t = np.linspace(0, 1, 200)[:, None]
        place = (1 - t) * [a.lat_deg, a.lon_deg] + t * [b.lat_deg, b.lon_deg]
        z = zero + (1 - t[:, 0]) * a.alt_m + t[:, 0] * b.alt_m
        clear.append(z - ground.elevation_m(place))
        camera.append(np.full(200, a.trigger is not None))
    return np.concatenate(clear), np.concatenate(camera)


@pytest.mark.parametrize("frame", [AltitudeFrame.RELATIVE, AltitudeFrame.AMSL])
@pytest.mark.parametrize("height_m", [0.0, 3.0, 12.0])
def test_height_above_ground_stays_within_the_tolerance(frame: AltitudeFrame, height_m: float, two_lanes: Plans):
    ground = Hills(height_m)
    # a fast climber: nothing but the tolerance counts
    config = FollowSettings(3.0, climb_m_s=20.0, descent_m_s=20.0, beside_m=0.0)
    plan, report = follow_terrain(two_lanes(), ground, config, frame)
    clear, camera = flown_over(plan, ground)
    assert np.abs(clear[camera] - 60.0).max() <= 3.1
    assert clear.min() >= 40.0 - 3.1  # the take-off's height
    assert report.lowest_survey_m == pytest.approx(clear[camera].min(), abs=0.3)
    assert report.highest_survey_m == pytest.approx(clear[camera].max(), abs=0.3)
    assert plan.home_alt_amsl_m == pytest.approx(500.0)
    assert (report.waypoints_added == 0) == (height_m <= 3.0) or height_m == 3.0
    assert plan.warnings == ()


def test_slope_limits_hold_and_peaks_are_cleared_all_the_same(two_lanes: Plans):
    ground = Hills(25.0)
    config = FollowSettings(3.0, climb_m_s=2.0, descent_m_s=1.0, beside_m=0.0)
    plan, report = follow_terrain(two_lanes(), ground, config)
    clear, camera = flown_over(plan, ground)
    assert clear[camera].min() >= 57.0 - 0.1
    assert report.highest_survey_m == pytest.approx(clear[camera].max(), abs=0.5) and report.highest_survey_m > 65
    assert any("climb and descent limits" in w for w in plan.warnings)
    speed = 10.0
    waypoints = plan.sorties[0].waypoints
    for a, b in itertools.pairwise(waypoints):
        speed = a.speed_m_s or speed
        run = np.hypot(*np.diff(FRAME.to_xy([(a.lat_deg, a.lon_deg), (b.lat_deg, b.lon_deg)]), axis=0)[0])
        rise = b.alt_m - a.alt_m
        # chords of a limited profile are limited; altitudes are rounded to a millimetre
        assert -1.0 / speed * run - 0.01 <= rise <= 2.0 / speed * run + 0.01


def test_added_waypoints_change_nothing_but_height(two_lanes: Plans):
    flat = two_lanes(heading_deg=90.0, land=True)
    plan, report = follow_terrain(flat, Hills(12.0), FollowSettings(2.0, 20.0, 20.0))
    old, new = flat.sorties[0].waypoints, plan.sorties[0].waypoints
    assert report.waypoints_added == len(new) - len(old) > 0
    places = {(w.lat_deg, w.lon_deg, w.role): w for w in old}
    kept = [w for w in new if (w.lat_deg, w.lon_deg, w.role) in places]
    assert [replace(w, alt_m=0.0) for w in kept] == [replace(w, alt_m=0.0) for w in old]
    added = [w for w in new if w not in kept]
    assert {w.role for w in added} <= {
        WaypointRole.SURVEY,
        WaypointRole.TURN,
        WaypointRole.TRANSIT,
        WaypointRole.LEAD_IN,
    }
    assert all((w.trigger is not None) == (w.role is WaypointRole.SURVEY) for w in added)
    assert new[-1].role is WaypointRole.LAND and new[-1].alt_m == pytest.approx(0.0, abs=0.01)


def test_terrain_frame_leaves_the_waypoints_and_asks_for_the_vehicles_data(two_lanes: Plans):
    plan, _ = follow_terrain(two_lanes(), Hills(12.0), FollowSettings(3.0), AltitudeFrame.TERRAIN)
    assert plan.sorties == two_lanes().sorties and plan.frame is AltitudeFrame.TERRAIN
    assert any("terrain data is loaded" in w for w in plan.warnings)


def test_without_a_model_the_plan_says_so_once(two_lanes: Plans):
    flat = on_flat_ground(on_flat_ground(two_lanes()))
    assert len(flat.warnings) == 1 and "flat ground" in flat.warnings[0]
    plan, _ = follow_terrain(flat, Hills(0.0), FollowSettings(3.0))
    assert plan.warnings == ()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0, 100), min_size=2, max_size=60), st.floats(0.05, 1.0), st.floats(0.05, 1.0))
def test_flyable_is_the_lowest_profile_that_clears_and_keeps_the_slopes(wanted: list[float], up: float, down: float):
    want = np.array(wanted)
    along = np.arange(len(want)) * 10.0
    found = flyable(along, want, np.full(len(want) - 1, up), np.full(len(want) - 1, down))
    assert (found >= want - 1e-9).all()
    slopes = np.diff(found) / 10.0
    assert (slopes <= up + 1e-9).all() and (slopes >= -down - 1e-9).all()
    # lowest: at each place some wanted height forces it (the definition, by brute force)
    gap = along[:, None] - along[None, :]
    forced = want[None, :] - np.where(gap < 0, -gap * up, gap * down)
    assert np.allclose(found, forced.max(axis=1))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0, 100), min_size=2, max_size=80), st.floats(0.1, 30.0))
def test_fewest_points_say_the_profile_within_the_tolerance(heights: list[float], tolerance: float):
    along, height = np.arange(len(heights)) * 5.0, np.array(heights)
    kept = fewest(along, height, tolerance)
    assert kept[0] == 0 and kept[-1] == len(heights) - 1
    assert np.abs(np.interp(along, along[kept], height[kept]) - height).max() <= tolerance + 1e-9


def write_dem(
    path: Path, crs: str, values: np.ndarray, origin: tuple[float, float], cell: float, **more: object
) -> Path:
    profile = {"driver": "GTiff", "width": values.shape[1], "height": values.shape[0], "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", crs=crs, transform=from_origin(*origin, cell, cell), **{**profile, **more}) as raster:
        raster.write(values.astype("float32"), 1)
    return path


def sloped(tmp_path: Path, crs: str = "EPSG:32632", **more: object) -> Path:
    """A plane that rises by 0.1 m a metre to the north, about 47 N 8 E (UTM 32: 423 900 E, 5 205 800 N)."""
    rows = np.arange(1200)[:, None] * np.ones((1, 1200))
    top = 5_206_800.0 - 0.5
    return write_dem(
        tmp_path / "dem.tif", crs, 500.0 + (top - rows) * 0.1 - 520_500.0, (423_300.0, 5_206_800.0), 1.0, **more
    )


def test_a_model_in_any_crs_is_read_between_its_pixels(tmp_path: Path):
    dem = open_dem(sloped(tmp_path), VerticalDatum.EGM96)
    places = [[47.0, 8.0], [47.0005, 8.001], [47.00049, 7.9991]]
    _, north = TO_UTM.transform(*np.array(places).T[::-1])
    assert dem.elevation_m(places) == pytest.approx(500.0 + north * 0.1 - 520_500.0, abs=1e-3)
    assert dem.cell_m == pytest.approx(1.0, rel=0.01) and dem.stated
    assert np.isnan(dem.elevation_m([[48.0, 8.0], [47.0, 9.0]])).all()


def test_missing_elevation_is_an_error_and_never_zero(tmp_path: Path, two_lanes: Plans):
    path = sloped(tmp_path, nodata=-9999.0)
    follow_terrain(two_lanes(), open_dem(path), FollowSettings(3.0))
    with rasterio.open(path, "r+") as raster:
        values = raster.read(1)
        row, col = raster.index(*LANE_UTM)
        hole = (slice(row - 5, row + 5), slice(col - 20, col + 20))
        values[hole] = -9999.0
        raster.write(values, 1)
    with pytest.raises(DataError, match="says nothing of"):
        follow_terrain(two_lanes(), open_dem(path), FollowSettings(3.0))
    far = replace(two_lanes(), home=(46.0, 8.0))
    with pytest.raises(DataError, match="take-off place"):
        follow_terrain(far, open_dem(path), FollowSettings(3.0))
    with rasterio.open(path, "r+") as raster:
        raster.nodata = None
        values[hole] = -32768.0  # a hole that nobody marked
        raster.write(values, 1)
    with pytest.raises(DataError, match="says nothing of"):
        follow_terrain(two_lanes(), open_dem(path), FollowSettings(3.0))


def test_heights_above_the_ellipsoid_become_heights_above_the_sea_or_are_refused(tmp_path: Path, two_lanes: Plans):
    dem = open_dem(sloped(tmp_path), VerticalDatum.ELLIPSOID)
    given_geoid = FollowSettings(3.0, geoid_m=48.0)
    plan, _ = follow_terrain(two_lanes(), dem, given_geoid, AltitudeFrame.AMSL)
    ground = float(dem.elevation_m([[47.0, 8.0]])[0])
    assert plan.home_alt_amsl_m == pytest.approx(ground - 48.0, abs=0.006)
    assert plan.sorties[0].waypoints[0].alt_m == pytest.approx(ground - 48.0 + 40.0, abs=3.1)
    # relative heights need no geoid
    relative, _ = follow_terrain(two_lanes(), dem, FollowSettings(3.0), AltitudeFrame.RELATIVE)
    assert relative.sorties[0].waypoints[0].alt_m == pytest.approx(40.0, abs=3.1)
    try:
        plan, _ = follow_terrain(two_lanes(), dem, FollowSettings(3.0), AltitudeFrame.AMSL)
    except DataError as error:  # PROJ has no grid here: said, with what to do
        assert "projsync" in str(error) and "--geoid-m" in str(error)
    else:
        assert plan.home_alt_amsl_m == pytest.approx(ground - 48.0, abs=2.0)


def test_what_the_file_says_of_its_heights_is_used(tmp_path: Path):
    assert open_dem(sloped(tmp_path, "EPSG:32632+5773")).vertical is VerticalDatum.EGM96
    plain = open_dem(sloped(tmp_path))
    assert plain.vertical is VerticalDatum.MSL and not plain.stated


def test_feet_are_feet_and_files_that_are_no_models_say_so(tmp_path: Path):
    path = sloped(tmp_path)
    metres = open_dem(path).elevation_m([[47.0, 8.0]])[0]
    with rasterio.open(path, "r+") as raster:
        raster.units = ("ft",)
    assert open_dem(path).elevation_m([[47.0, 8.0]])[0] == pytest.approx(metres * 0.3048)
    with rasterio.open(path, "r+") as raster:
        raster.units = ("cubits",)
    with pytest.raises(DataError, match="cubits"):
        open_dem(path)
    (tmp_path / "x.tif").write_text("no raster")
    for bad in (tmp_path / "x.tif", tmp_path / "missing.tif"):
        with pytest.raises(DataError, match="cannot be read"):
            open_dem(bad)
    with rasterio.open(tmp_path / "p.tif", "w", driver="GTiff", width=2, height=2, count=1, dtype="uint8") as raster:
        raster.write(np.zeros((1, 2, 2), "uint8"))
    with pytest.raises(DataError, match="where on Earth"):
        open_dem(tmp_path / "p.tif")


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(UsageError, match="climb_m_s"):
        FollowSettings(3.0, climb_m_s=0.0)
