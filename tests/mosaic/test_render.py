"""Rendered tiles are the ground: in place to a tenth of a pixel, not mirrored, alpha exact, detail kept, no seams."""

import math

import cv2
import numpy as np
import pytest

from photomap_gis.core.camera import Camera
from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.grid import Window
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.mosaic import plan_grid
from photomap_gis.mosaic.exposure import Exposure
from photomap_gis.mosaic.lowband import low_band_of
from photomap_gis.mosaic.pixels import prepare
from photomap_gis.mosaic.render import render_tile
from photomap_gis.mosaic.views import views_of
from tests.mosaic.flight import GSD_M, MAP_FRAME, Flight, lawnmower, picture, place

CAMERA = Camera(240, 180, focal_px=220.0, k1=-0.08, k2=0.02)


class Source:
    """``FrameSource`` over a flight in memory."""

    def __init__(self, flight: Flight, pixel_size: float) -> None:
        self.flight, self.pixel_size = flight, pixel_size

    def image(self, view):
        return prepare(self.flight.images[view.frame], self.pixel_size / view.gsd_m_per_px)

    def low_band(self, view):
        return low_band_of(self.image(view))


def rendered(flight: Flight, *, pixel_size=GSD_M, exposure=None, window=None):
    grid = plan_grid(flight.trajectory, MAP_FRAME, pixel_size=pixel_size)
    views = views_of(flight.trajectory)
    return grid, render_tile(
        window or Window(0, 0, grid.width, grid.height),
        grid,
        MAP_FRAME,
        givers=views,
        neighbours=views,
        source=Source(flight, pixel_size),
        exposure=exposure or Exposure({}),
    )


def single(ground, placement) -> Flight:
    image = np.clip(np.rint(picture(ground, placement)), 0, 255).astype(np.uint8)
    return Flight(ground, [placement], {placement.frame: image})


def offset_px(a, b):
    """Sub-pixel shift between two grey images, by least squares on the gradients (Lucas and Kanade): unbiased here."""
    a, b = (cv2.GaussianBlur(image, (0, 0), 1.0) for image in (a, b))
    gy, gx = np.gradient(0.5 * (a + b))
    design = np.stack([gx.ravel(), gy.ravel()], axis=1)
    return np.linalg.lstsq(design, (a - b).ravel(), rcond=None)[0]


def patches(rgba, truth, size=96):
    grey, true_grey = rgba[..., :3].astype(np.float64).mean(axis=-1), truth.astype(np.float64).mean(axis=-1)
    for y in range(0, rgba.shape[0] - size, size):
        for x in range(0, rgba.shape[1] - size, size):
            part = np.s_[y : y + size, x : x + size]
            if (rgba[part][..., 3] == 255).all():
                yield grey[part], true_grey[part]


@pytest.mark.parametrize("heading_deg", [0, 90, 180, 270, 33])
def test_one_frame_comes_back_as_the_ground_at_every_heading(ground, heading_deg):
    flight = single(ground, place(0, 100.0, 80.0, heading_rad=math.radians(heading_deg)))
    grid, rgba = rendered(flight)
    seen = rgba[..., 3] == 255
    error = rgba[seen][:, :3] - flight.truth(grid)[seen]
    assert np.sqrt(np.mean(error**2)) < 2.5


@pytest.mark.parametrize("pixel_size", [GSD_M, 2.3 * GSD_M])
def test_a_tilted_distorted_flight_is_in_place_to_a_tenth_of_a_pixel(ground, rng, pixel_size):
    flight = lawnmower(ground, rng, camera=CAMERA, tilt_sigma_rad=math.radians(4))
    grid, rgba = rendered(flight, pixel_size=pixel_size)
    truth = flight.truth(grid)
    if pixel_size > GSD_M:
        truth = cv2.GaussianBlur(truth, (0, 0), 0.3)
    shifts = np.array([offset_px(a, b) for a, b in patches(rgba, truth, 96 if pixel_size == GSD_M else 48)])
    assert len(shifts) > 10
    assert np.abs(shifts).max() <= 0.1
    assert np.linalg.norm(shifts.mean(axis=0)) <= 0.02


def test_the_ground_comes_back_through_many_frames(ground, rng):
    flight = lawnmower(ground, rng, camera=CAMERA, tilt_sigma_rad=math.radians(3))
    grid, rgba = rendered(flight)
    truth = flight.truth(grid)
    seen = rgba[..., 3] == 255
    psnr = 20 * np.log10(255 / np.sqrt(np.mean((rgba[seen][:, :3] - truth[seen]) ** 2)))
    assert psnr > 38


def test_detail_is_kept(ground, rng):
    flight = lawnmower(ground, rng)
    grid, rgba = rendered(flight)
    ratios = [
        np.square(np.gradient(a)).sum() / np.square(np.gradient(b)).sum()
        for a, b in patches(rgba, flight.truth(grid), 64)
    ]
    assert 0.9 < np.median(ratios) < 1.1


def test_alpha_is_exactly_where_frames_see_the_ground(ground, rng):
    flight = lawnmower(ground, rng, camera=CAMERA, tilt_sigma_rad=math.radians(4))
    grid, rgba = rendered(flight)
    wrong = (rgba[..., 3] == 255) != flight.seen(grid)
    assert set(np.unique(rgba[..., 3])) == {0, 255}
    near_edge = cv2.morphologyEx(flight.seen(grid).astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3))) > 0
    assert not wrong[~near_edge].any() and wrong.mean() < 1e-3
    assert not rgba[rgba[..., 3] == 0].any()


def test_black_ground_is_seen_ground():
    placement = place(0, 30, 25)
    _, rgba = rendered(Flight(np.zeros((9, 9, 3), np.uint8), [placement], {0: np.zeros((180, 240, 3), np.uint8)}))
    assert (rgba[5:-5, 5:-5] == (0, 0, 0, 255)).all()


def test_grey_and_colour_frames_make_one_map(ground, rng):
    flight = lawnmower(cv2.cvtColor(cv2.cvtColor(ground, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR), rng)
    for frame in list(flight.images)[::2]:
        flight.images[frame] = flight.images[frame][..., 0].copy()
    grid, rgba = rendered(flight)
    seen = rgba[..., 3] == 255
    assert np.sqrt(np.mean((rgba[seen][:, :3] - flight.truth(grid)[seen]) ** 2)) < 4


def test_tiles_rendered_apart_fit_together(ground, rng):
    flight = lawnmower(ground, rng, gain_sigma=0.1)
    _, whole = rendered(flight)
    left = rendered(flight, window=Window(96, 64, 133, 150))[1]
    assert np.mean(np.abs(left.astype(int) - whole[64:214, 96:229]).max(axis=-1) > 3) < 0.002


def seam_steps(rgba, truth):
    """Worst low-frequency error relative to the map's own mean error: what an eye takes for a seam."""
    seen = (rgba[..., 3] == 255).astype(np.float32)
    error = (rgba[..., :3] - truth).mean(axis=-1).astype(np.float32) * seen
    smooth = cv2.GaussianBlur(error, (0, 0), 3) / np.maximum(cv2.GaussianBlur(seen, (0, 0), 3), 0.3)
    inside = cv2.erode(seen, np.ones((15, 15))) > 0
    step = np.hypot(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)) / 8.0
    return float(np.percentile(step[inside], 99))


def test_seams_vanish_under_changes_of_exposure(ground, rng):
    """Even with no gains found at all, the low frequencies meet."""
    flight = lawnmower(ground, rng, gain_sigma=0.06)
    grid, rgba = rendered(flight)
    truth = flight.truth(grid)
    pasted = truth * 1.0
    views = views_of(flight.trajectory)
    for view in views:  # the naive way: each frame pasted over the others
        _, alone = rendered_on(flight, grid, [view])
        pasted[alone[..., 3] == 255] = alone[alone[..., 3] == 255][:, :3]
    naive = seam_steps(np.dstack([pasted, rgba[..., 3]]), truth)
    assert seam_steps(rgba, truth) < 0.45 * naive


def rendered_on(flight, grid, views):
    return grid, render_tile(
        Window(0, 0, grid.width, grid.height), grid, MAP_FRAME,
        givers=views, neighbours=views, source=Source(flight, grid.pixel_size), exposure=Exposure({}),
    )  # fmt: skip


def test_misplaced_frames_do_not_show_things_twice(ground):
    """Two frames half a metre apart: every spot shows one of them, never the mean of both."""
    flight = Flight(ground, [], {})
    for frame, x in enumerate((80.0, 105.0)):
        true = place(frame, x, 80.0)
        flight.images[frame] = np.clip(np.rint(picture(ground, true)), 0, 255).astype(np.uint8)
        flight.placements.append(place(frame, x + (1.5 if frame else 0.0), 80.0))
    grid, rgba = rendered(flight)
    truth = flight.truth(grid)
    shifted = np.roll(truth, 6, axis=1)
    grey = rgba[..., :3].astype(float)
    best = np.minimum(np.abs(grey - truth).mean(axis=-1), np.abs(grey - shifted).mean(axis=-1))
    inside = np.s_[10:-10, 10:-20]
    assert np.mean(best[inside] > 12) < 0.05


def test_gps_placed_frames_only_fill(ground):
    good, poor = place(0, 90, 80), place(1, 110, 80, status=FrameStatus.GPS_ONLY)
    flight = single(ground, good)
    flight.placements.append(poor)
    flight.images[1] = np.full((180, 240, 3), 128, np.uint8)
    grid, rgba = rendered(flight)
    only_good = single(ground, good)
    seen_by_good = only_good.seen(grid)
    inner = cv2.erode(seen_by_good.astype(np.uint8), np.ones((61, 61))) > 0
    error = np.abs(rgba[..., :3] - flight.truth(grid)).mean(axis=-1)
    assert error[inner].mean() < 3
    assert (rgba[..., 3] == 255)[flight.seen(grid)].mean() > 0.999


def test_nothing_seen_is_empty(ground):
    flight = single(ground, place(0, 100, 80))
    views = views_of(flight.trajectory)
    grid = plan_grid(flight.trajectory, MAP_FRAME, pixel_size=GSD_M)
    args = {"source": Source(flight, GSD_M), "exposure": Exposure({})}
    away = render_tile(Window(-900, 0, 64, 64), grid, MAP_FRAME, givers=views, neighbours=views, **args)
    none = render_tile(Window(0, 0, 64, 64), grid, MAP_FRAME, givers=[], neighbours=[], **args)
    assert not away.any() and not none.any()


def test_the_shared_ground_comes_back(shared_data, rng):
    folder = shared_data / "ortho_yellowstone"
    pictures = sorted(folder.glob("*.png"))
    if not pictures:
        pytest.skip("../shared/data/ortho_yellowstone holds no picture")
    ground = cv2.imread(str(pictures[0]))[:700, :900]
    flight = lawnmower(ground, rng, camera=CAMERA, tilt_sigma_rad=math.radians(2))
    grid, rgba = rendered(flight)
    for a, b in patches(rgba, flight.truth(grid), 128):
        assert np.corrcoef(a.ravel(), b.ravel())[0, 1] > 0.98
        assert np.abs(offset_px(a, b)).max() <= 0.1
    assert Trajectory(tuple(flight.placements)).gsd_m_per_px == pytest.approx(GSD_M, rel=0.1)
