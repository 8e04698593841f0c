"""The evaluation finds what is known to be wrong with a map."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
from rasterio.vrt import WarpedVRT
from rasterio.warp import Resampling, reproject

from photomap_gis.core.camera import Camera
from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import GpsFix
from photomap_gis.core.grid import MapGrid
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.simulate import FlightSpec, Ground, procedural_scene, simulate_photos
from photomap_gis.simulate.evaluate import Comparison, MapErrors, evaluate_map, gps_floor, measure, raised_mask
from photomap_gis.simulate.geodesy import GeoFrame
from photomap_gis.simulate.ground import load_ground
from photomap_gis.simulate.ideal import write_ideal_map
from photomap_gis.simulate.pose import CameraPose
from photomap_gis.simulate.truth import TrueFrame, Truth

SIZE = (900, 1000)
GSD = 0.1


@pytest.fixture(scope="module")
def scene() -> Ground:
    return procedural_scene((SIZE[1] * GSD, SIZE[0] * GSD), GSD, seed=11)


def _compare(
    scene: Ground, warp: np.ndarray | None = None, flow: np.ndarray | None = None, holes: bool = False
) -> MapErrors:
    """Evaluate the scene itself, moved: ``warp`` (2, 3) takes true pixels to map pixels, ``flow`` adds to that."""
    true = cv2.cvtColor(scene.colour, cv2.COLOR_BGR2GRAY)
    h, w = true.shape
    y, x = np.mgrid[0:h, 0:w].astype(np.float32)
    m = np.vstack([np.eye(3)[:2] if warp is None else warp, [0, 0, 1]])
    back = np.linalg.inv(m)
    fx, fy = (back[i, 0] * x + back[i, 1] * y + back[i, 2] for i in (0, 1))
    if flow is not None:
        fx, fy = fx - flow[..., 0], fy - flow[..., 1]
    mapped = cv2.remap(true, fx.astype(np.float32), fy.astype(np.float32), cv2.INTER_CUBIC)
    alpha = (fx >= 0) & (fx <= w - 1) & (fy >= 0) & (fy <= h - 1)
    # another exposure, noise, and compression must not matter
    mapped = np.clip(0.8 * mapped + 20 + np.random.default_rng(0).normal(0, 3, mapped.shape), 0, 255).astype(np.uint8)
    if holes:
        alpha[100:250, 300:600] = False
        mapped[~alpha] = 0
    seen = np.zeros((h, w), bool)
    seen[150:-150, 150:-150] = True
    assert scene.height_m is not None
    grid = MapGrid(scene.crs_wkt, scene.west, scene.north, GSD, w, h)
    return measure(Comparison(grid, true, seen, raised_mask(scene.height_m, GSD), mapped, alpha))


def _about_centre(angle_deg: float, scale: float, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    T = Similarity2D(0, 0, math.radians(angle_deg), math.log(scale)).about(-SIZE[1] / 2, -SIZE[0] / 2)
    return (Similarity2D.translation_of(*shift) @ T).matrix[:2]


def test_a_perfect_map_has_no_error(scene: Ground) -> None:
    e = _compare(scene)
    assert e.patches > 40
    assert e.absolute_rmse_m < 0.01
    assert e.unmatched_share == 0.0
    assert e.coverage == 1.0


@pytest.mark.parametrize("shift", [(3.3, -2.6), (24.0, 17.5), (-70.25, 61.5)])
def test_a_shift_is_absolute_error_only(scene: Ground, shift: tuple[float, float]) -> None:
    e = _compare(scene, np.array([[1, 0, shift[0]], [0, 1, shift[1]]], float))
    assert e.absolute_rmse_m == pytest.approx(GSD * math.hypot(*shift), abs=0.01)
    assert (e.offset_east_m, e.offset_north_m) == pytest.approx((GSD * shift[0], -GSD * shift[1]), abs=0.01)
    assert e.relative_rmse_m < 0.03
    assert e.unmatched_share == 0.0


@pytest.mark.parametrize(("angle_deg", "scale"), [(0.4, 1.0), (-2.5, 1.0), (0.0, 1.012), (1.5, 0.97), (6.0, 1.05)])
def test_turn_and_scale_are_found_and_removed(scene: Ground, angle_deg: float, scale: float) -> None:
    e = _compare(scene, _about_centre(angle_deg, scale, (5.0, -8.0)))
    assert e.rotation_deg == pytest.approx(angle_deg, abs=0.02)
    assert e.scale == pytest.approx(scale, abs=3e-4)
    assert e.relative_rmse_m < 0.3 * GSD
    assert e.absolute_rmse_m > 0.3
    assert e.unmatched_share == 0.0


@pytest.mark.parametrize("amplitude", [3.0, 12.0, 25.0])
def test_a_local_warp_is_measured_even_where_it_is_large(scene: Ground, amplitude: float) -> None:
    y, x = np.mgrid[0 : SIZE[0], 0 : SIZE[1]]
    flow = np.stack([amplitude * np.sin(np.pi * y / 450.0), amplitude * np.cos(np.pi * x / 1000.0)], -1)
    flow /= 1.0 + amplitude / 30.0  # no shear so strong that a patch of 64 pixels no longer looks like itself
    e = _compare(scene, flow=flow)
    inner = flow[150:-150, 150:-150].reshape(-1, 2)
    true = np.stack([x, y], -1)[150:-150, 150:-150].reshape(-1, 2)[::97]
    from photomap_gis.core.similarity import fit_similarity

    best = fit_similarity(true + inner[::97], true.astype(float))
    expected = np.sqrt(np.mean(np.sum((best.apply(true) - true - inner[::97]) ** 2, axis=1))) * GSD
    assert e.relative_rmse_m == pytest.approx(expected, rel=0.2)
    assert e.unmatched_share < 0.03


def test_holes_are_lost_coverage_and_not_unmatched(scene: Ground) -> None:
    e = _compare(scene, holes=True)
    seen = (SIZE[0] - 300) * (SIZE[1] - 300)
    assert e.coverage == pytest.approx(1 - 100 * 300 / seen, abs=2e-3)
    assert e.unmatched_share == 0.0
    assert e.absolute_rmse_m < 0.01


def test_another_picture_matches_nowhere(scene: Ground) -> None:
    other = procedural_scene((SIZE[1] * GSD, SIZE[0] * GSD), GSD, seed=12)
    true = cv2.cvtColor(scene.colour, cv2.COLOR_BGR2GRAY)
    mapped = cv2.cvtColor(other.colour, cv2.COLOR_BGR2GRAY)
    every = np.ones(true.shape, bool)
    e = measure(Comparison(scene.grid, true, every, ~every, mapped, every))
    assert e.unmatched_share > 0.9


def test_a_blank_map_is_no_crash(scene: Ground) -> None:
    true = cv2.cvtColor(scene.colour, cv2.COLOR_BGR2GRAY)
    every = np.ones(true.shape, bool)
    e = measure(Comparison(scene.grid, true, every, ~every, np.zeros_like(true), ~every))
    assert e.coverage == 0.0
    assert math.isnan(e.absolute_rmse_m)


def test_what_stands_on_the_land_is_told_from_sloping_land() -> None:
    y, x = np.mgrid[0:400, 0:500].astype(np.float32)
    land = 0.02 * x + 0.5 * np.sin(y / 150)
    houses = land.copy()
    houses[100:150, 200:270] += 8.0
    mask = raised_mask(houses, 0.25)
    assert mask[100:150, 200:270].all()
    assert mask[100:150, 188:200].all()  # 8 m lean 3.2 m over the land beside them
    assert not mask[:80].any() and not mask[:, 300:].any() and not raised_mask(land, 0.25).any()


def test_the_floor_is_the_gps_error_that_a_similarity_cannot_remove() -> None:
    scene = procedural_scene((60.0, 60.0), 0.5, seed=0)
    frame = GeoFrame(scene.crs_wkt)
    e0, n0 = scene.centre_en_m
    places = np.array([(e0 + x, n0 + y) for x in (-50.0, 0.0, 50.0) for y in (-50.0, 0.0, 50.0)])

    def truth(fixes_en: np.ndarray) -> Truth:
        lon_lat = frame.to_lon_lat(fixes_en)
        frames = tuple(
            TrueFrame(k, str(k), 0.0, CameraPose(*places[k], 100.0, np.eye(3)), 0.0, np.zeros((0, 2)), GpsFix(b, a))
            for k, (a, b) in enumerate(lon_lat)
        )
        return Truth(Path(), scene.crs_wkt, Camera(10, 10, 10.0), frames, {})

    assert gps_floor(truth(places + np.array([3.0, -4.0])), places) == pytest.approx(5.0, abs=1e-3)
    assert gps_floor(truth(places), places + 30.0) == pytest.approx(0.0, abs=1e-3)
    stretched = (places - (e0, n0)) * 1.02 + (e0, n0)
    assert gps_floor(truth(stretched), [(e0 + 100.0, n0)]) == pytest.approx(2.0, abs=1e-3)
    # errors that cancel in the fit leave no floor
    mixed = places + np.array([[1, 0], [-2, 0], [1, 0]] * 3, float)
    assert gps_floor(truth(mixed), places) < 0.2


def test_no_fix_no_floor() -> None:
    assert gps_floor(Truth(Path(), "", Camera(10, 10, 10.0), (), {})) is None


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flown")
    spec = FlightSpec(frames=12, width_px=400, height_px=300, altitude_m=60.0, front_overlap=0.7, side_overlap=0.6)
    ground = procedural_scene((200.0, 190.0), 0.2, seed=5)
    truth = simulate_photos(ground, spec, folder)
    write_ideal_map(truth, lambda f: cv2.imread(str(folder / "photos" / f.name)), folder / "ideal.tif")
    return folder


def test_the_map_of_true_poses_lies_where_the_ground_is(flown: Path) -> None:
    # renderer, poses, truth and evaluation each use the camera's geometry: together they must close
    e = evaluate_map(flown / "ideal.tif", flown)
    assert e.patches > 20
    assert e.relative_rmse_gsd < 2.0
    assert e.absolute_median_m < e.true_gsd_m_per_px
    assert e.unmatched_share < 0.02
    assert e.coverage > 0.98
    assert e.floor_rmse_m is not None and e.absolute_rmse_m < e.floor_rmse_m


def test_a_map_in_another_crs_is_compared_all_the_same(flown: Path, tmp_path: Path) -> None:
    with rasterio.open(flown / "ideal.tif") as source:
        with WarpedVRT(source, crs="EPSG:3857") as vrt:
            transform, width, height = vrt.transform, vrt.width, vrt.height
        profile = source.profile | {"crs": "EPSG:3857", "transform": transform, "width": width, "height": height}
        with rasterio.open(tmp_path / "mercator.tif", "w", **profile) as out:
            for band in range(1, 5):
                reproject(rasterio.band(source, band), rasterio.band(out, band), resampling=Resampling.bilinear)
    e = evaluate_map(tmp_path / "mercator.tif", flown)
    assert e.absolute_median_m < 1.5 * e.true_gsd_m_per_px
    assert e.coverage > 0.97


def test_unusable_maps_are_one_line(flown: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot read the map"):
        evaluate_map(tmp_path / "missing.tif", flown)
    ground = load_ground(flown / "truth" / "ground.tif")
    cv2.imwrite(str(tmp_path / "plain.png"), ground.colour)
    with pytest.raises(DataError, match="no CRS"):
        evaluate_map(tmp_path / "plain.png", flown)
