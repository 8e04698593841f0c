"""Layers say of every pixel what is true of it: asked of the exact placements, frame by frame, by a slow twin."""

import dataclasses
import math

import cv2
import numpy as np
import pytest

from photomap_gis.core.camera import Camera
from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.grid import Window
from photomap_gis.core.layer import LAYERS, Layer, Searched
from photomap_gis.mosaic import plan_grid, render_layers, render_mosaic
from photomap_gis.mosaic.measured import load_measured
from tests.mosaic.flight import GSD_M, MAP_FRAME, lawnmower, place

CAMERA = Camera(240, 180, focal_px=220.0, k1=-0.06)


@pytest.fixture(scope="module")
def flight(ground):
    flown = lawnmower(ground, np.random.default_rng(4), camera=CAMERA, tilt_sigma_rad=math.radians(3))
    covariance = np.diag([0.3, 0.2, 4e-5, 2e-5])
    flown.placements = [
        dataclasses.replace(p, pose_covariance=(1 + p.frame / 9) * covariance) for p in flown.placements
    ]
    flown.images[5] = cv2.GaussianBlur(flown.images[5], (0, 0), 3.0)
    return flown


@pytest.fixture(scope="module")
def times(flight):
    return {f: 1_700_000_000.0 + 3.0 * f for f in flight.images if f != 7}


@pytest.fixture(scope="module")
def store(flight, tmp_path_factory):
    grid = plan_grid(flight.trajectory, MAP_FRAME, pixel_size=GSD_M, tile_size=256)
    folder = tmp_path_factory.mktemp("map")
    return render_mosaic(flight.trajectory, MAP_FRAME, grid, flight.read, folder, revision=1)


@pytest.fixture(scope="module")
def layers(flight, store, times):
    return render_layers(store, flight.trajectory, MAP_FRAME, times_s=times)


def whole(layers, layer):
    return layers.read(layer, Window(0, 0, layers.grid.width, layers.grid.height))


@pytest.fixture(scope="module")
def twin(flight, store, times):
    """By frame: ``(height, width)`` whether it sees a pixel, and its pixel's longer side on the ground."""
    g = store.grid
    px = np.stack(np.meshgrid(np.arange(g.width), np.arange(g.height)), axis=-1).reshape(-1, 2)
    xy = MAP_FRAME.from_crs(g.to_crs(px))
    out = {}
    for p in flight.placements:
        outline = p.outline_xy_map_m(8)
        near = ((xy >= outline.min(axis=0) - 1) & (xy <= outline.max(axis=0) + 1)).all(axis=1)
        uv = np.full(xy.shape, np.nan)
        uv[near] = p.camera_to_map.unproject(xy[near])
        with np.errstate(invalid="ignore"):
            inside = (np.abs(uv - p.centre_xy_px) <= np.array([p.width_px, p.height_px]) / 2).all(axis=1)
        gsd = np.full(len(xy), np.nan)
        gsd[inside] = np.linalg.svd(p.camera_to_map.jacobian(uv[inside]), compute_uv=False)[:, 0]
        out[p.frame] = inside.reshape(g.height, g.width), gsd.reshape(g.height, g.width)
    return out


def test_views_are_counted(layers, twin):
    expected = np.sum([inside for inside, _ in twin.values()], axis=0)
    assert np.mean(whole(layers, Layer.VIEWS)[0] != expected) < 2e-3
    assert expected.max() >= 4


def test_the_newest_look_is_told(layers, twin, times):
    expected = np.max([np.where(inside, times.get(f, 0), 0) for f, (inside, _) in twin.items()], axis=0)
    got = whole(layers, Layer.LAST_SEEN)[0]
    assert got.dtype == np.uint32 and np.mean(got != np.rint(expected)) < 2e-3
    assert got[got > 0].min() >= 1_700_000_000


def test_the_source_is_the_frame_that_is_shown(layers, flight, store):
    source = whole(layers, Layer.SOURCE_FRAME)[0]
    alpha = store.read(Window(0, 0, store.grid.width, store.grid.height))[..., 3]
    assert np.array_equal(source >= 0, alpha == 255)
    assert set(np.unique(source)) <= {-1, *flight.images}
    inside = [source == p.frame for p in flight.placements]
    assert np.sum(inside) == (source >= 0).sum() and sum(m.any() for m in inside) >= 12


def test_sigma_is_that_of_the_frame_that_is_shown(layers, flight):
    g, rng = layers.grid, np.random.default_rng(0)
    source, sigma = whole(layers, Layer.SOURCE_FRAME)[0], whole(layers, Layer.SIGMA)[0]
    assert np.array_equal(np.isnan(sigma), source < 0)
    rows, cols = (v[rng.permutation(len(v))[:200]] for v in np.nonzero(source >= 0))
    for r, c in zip(rows, cols, strict=True):
        if source[r, c] < 0:
            continue
        p = next(p for p in flight.placements if p.frame == source[r, c])
        uv = p.camera_to_map.unproject(MAP_FRAME.from_crs(g.to_crs([[c, r]])))
        expected = math.sqrt(np.trace(p.position_covariance_m2(uv)[0]) / 2.0)
        assert sigma[r, c] == pytest.approx(expected, rel=0.02)


def test_searched_is_the_sighting_that_shows_most(layers, store, twin, times):
    blur = load_measured(store).blur_px
    assert blur[5] > 2.0 > max(b for f, b in blur.items() if f != 5)
    frames = sorted(twin)
    detail = np.array([np.where(twin[f][0], twin[f][1] * max(1.0, 2.3548 * blur[f]), np.inf) for f in frames])
    best = detail.min(axis=0)
    got = whole(layers, Layer.SEARCHED)
    bands = dict(zip(Searched, got, strict=True))
    seen = np.isfinite(best) & np.isfinite(bands[Searched.RESOLUTION])
    assert np.mean(np.isfinite(best) != np.isfinite(bands[Searched.RESOLUTION])) < 2e-3
    assert np.isclose(bands[Searched.RESOLUTION][seen], best[seen], rtol=0.01).mean() > 0.998
    assert np.allclose(
        bands[Searched.GSD][seen] * np.maximum(1.0, 2.3548 * bands[Searched.BLUR][seen]),
        bands[Searched.RESOLUTION][seen], rtol=2e-3,
    )  # fmt: skip
    runner_up = np.sort(detail, axis=0)[1]
    clear = seen & (runner_up > 1.02 * best)
    which = np.array(frames)[detail.argmin(axis=0)]
    age = np.array([times.get(f, math.nan) for f in range(max(frames) + 1)])
    expected = max(times.values()) - age[which]
    assert np.isclose(bands[Searched.AGE][clear], expected[clear], rtol=1e-3, equal_nan=True).mean() > 0.998


def test_a_killed_run_keeps_its_tiles_and_another_time_makes_them_anew(flight, store, times, layers):
    files = sorted((store.folder / "layers").glob("*/*.layers"))
    before = {p: p.stat().st_mtime_ns for p in files}
    files[0].unlink()
    again = render_layers(store, flight.trajectory, MAP_FRAME, times_s=times)
    after = {p: p.stat().st_mtime_ns for p in files}
    assert [p for p in files if before[p] != after[p]] == files[:1]
    assert all(
        np.array_equal(whole(again, k), whole(layers, k), equal_nan=k in (Layer.SIGMA, Layer.SEARCHED)) for k in LAYERS
    )
    later = render_layers(store, flight.trajectory, MAP_FRAME, times_s={f: t + 60 for f, t in times.items()})
    assert whole(later, Layer.LAST_SEEN).max() == round(max(times.values())) + 60
    render_layers(store, flight.trajectory, MAP_FRAME, times_s=times)


def test_threads_and_windows_change_nothing(flight, store, times, layers):
    window = Window(200, 130, 300, 190)
    for layer in LAYERS:
        part = whole(layers, layer)[:, 130:320, 200:500]
        assert np.array_equal(layers.read(layer, window), part, equal_nan=layer in (Layer.SIGMA, Layer.SEARCHED))


def test_beyond_the_map_there_is_nothing(layers):
    for layer, spec in LAYERS.items():
        out = layers.read(layer, Window(-50, -40, 30, 20))
        assert out.shape == (len(spec.bands), 20, 30) and np.array_equal(
            out, np.full_like(out, spec.nodata), equal_nan=True
        )


def test_a_frame_that_only_its_gps_places_is_as_unsure_as_it_says(ground, tmp_path):
    unsure = place(0, 100, 80, status=FrameStatus.GPS_ONLY)
    unsure = type(unsure)(0, 240, 180, unsure.camera_to_map, np.diag([9.0, 9.0, 0.0, 0.0]), unsure.status)
    flight = type(lawnmower(ground, np.random.default_rng(0)))(
        ground, [unsure], {0: np.full((180, 240, 3), 90, np.uint8)}
    )
    grid = plan_grid(flight.trajectory, MAP_FRAME, pixel_size=GSD_M)
    store = render_mosaic(flight.trajectory, MAP_FRAME, grid, flight.read, tmp_path, revision=1)
    layers = render_layers(store, flight.trajectory, MAP_FRAME, times_s={})
    sigma = whole(layers, Layer.SIGMA)
    expected = math.sqrt(np.trace(unsure.position_covariance_m2()[0]) / 2.0)
    assert np.nanmedian(sigma) == pytest.approx(expected, rel=0.01)
    assert not whole(layers, Layer.LAST_SEEN).any(), "no clock, no time"
    assert np.isnan(whole(layers, Layer.SEARCHED)).all(), "an even grey tells no blur"


def test_a_map_without_notes_of_its_sources_says_what_to_do(flight, times, tmp_path):
    grid = plan_grid(flight.trajectory, MAP_FRAME, pixel_size=GSD_M, tile_size=256)
    store = render_mosaic(flight.trajectory, MAP_FRAME, grid, flight.read, tmp_path, revision=1)
    for path in tmp_path.glob("*/*.from"):
        path.unlink()
    with pytest.raises(DataError, match="photomap solve"):
        render_layers(store, flight.trajectory, MAP_FRAME, times_s=times)
    done = sorted(store.folder.glob("*/*.tile"))
    done[0].with_suffix(".from").write_bytes(b"nonsense")
    with pytest.raises(DataError):
        render_layers(store, flight.trajectory, MAP_FRAME, times_s=times, workers=1)
