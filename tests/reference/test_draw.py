"""A drawing shows each place of the grid as the frame that sees it does, whatever the grid's pixels."""

import cv2
import numpy as np
import pytest

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.frame import FrameStatus, level_rotation
from photomap_gis.core.grid import MapFrame, MapGrid
from photomap_gis.core.placement import FramePlacement, PlanePlacement
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.reference.draw import draw_patch
from photomap_gis.reference.match import spread_out
from photomap_gis.reference.pictures import gradient_picture
from photomap_gis.simulate.pose import CameraPose

FRAME = MapFrame("local", 1000.0, 2000.0)
W, H = 400, 300


def brightness(xy_map_m):
    return 120 + 50 * np.sin(xy_map_m[..., 0] / 3.0) + 50 * np.cos(xy_map_m[..., 1] / 4.0)


def placement(frame, x, y, *, gsd=0.1, turn=0.4, tilt=0.0):
    """A frame over the map at (x, y), and what it sees there; ``tilt`` leans its camera."""
    camera = Camera.of_hfov(W, H, 1.1)
    pose = CameraPose.of_body((0, 0), 50.0, roll_rad=tilt, pitch_rad=0.0, yaw_rad=0.0)
    view = PlaneView(camera, level_rotation(pose.R_grid_camera)) if tilt else PlaneView.flat(camera)
    T = Similarity2D(x, y, turn, np.log(gsd))
    return FramePlacement(frame, W, H, PlanePlacement(view, T), np.eye(4) * 1e-6, FrameStatus.REGISTERED, 0)


def picture(p):
    xx, yy = np.meshgrid(np.arange(W, dtype=float), np.arange(H, dtype=float))
    xy = p.camera_to_map.project(np.stack([xx.ravel(), yy.ravel()], axis=1))
    return np.clip(np.rint(brightness(xy)), 0, 255).astype(np.uint8).reshape(H, W)


def grid_about(x, y, pixel, side):
    e, n = FRAME.to_crs(np.array([[x, y]]))[0]
    return MapGrid("local", e - side * pixel / 2 + 0.13, n + side * pixel / 2 - 0.07, pixel, side, side)


def expected(grid):
    cols, rows = np.meshgrid(np.arange(grid.width, dtype=float), np.arange(grid.height, dtype=float))
    xy = FRAME.from_crs(grid.to_crs(np.stack([cols.ravel(), rows.ravel()], axis=1)))
    return brightness(xy).reshape(grid.height, grid.width)


@pytest.mark.parametrize("pixel", [0.1, 0.25, 0.4])
@pytest.mark.parametrize("tilt", [0.0, 0.2])
def test_every_pixel_shows_its_place(pixel, tilt):
    p = placement(0, 30.0, -12.0, tilt=tilt)
    grid = grid_about(*p.centre_xy_map_m, pixel, 64)
    patch = draw_patch([p], FRAME, grid, lambda _: picture(p))
    assert patch.share_seen > 0.9
    error = (patch.grey - expected(grid))[patch.mask]
    assert np.abs(error).max() < 6
    assert abs(error.mean()) < 0.5


def test_neighbours_fill_what_the_first_does_not_see_at_its_brightness():
    first, second = placement(0, 0.0, 0.0), placement(1, 20.0, 5.0, turn=-0.3)
    grid = grid_about(10.0, 2.0, 0.25, 160)
    pictures = {0: picture(first), 1: cv2.subtract(picture(second), 15.0)}
    opened = []

    def read(frame):
        opened.append(frame)
        return pictures[frame]

    alone = draw_patch([first], FRAME, grid, read)
    both = draw_patch([first, second, placement(2, 0.2, 0.0)], FRAME, grid, read)
    assert both.mask.sum() > 1.3 * alone.mask.sum()
    np.testing.assert_array_equal(both.grey[alone.mask], alone.grey[alone.mask])
    assert np.abs(both.grey - expected(grid))[both.mask].max() < 10
    assert opened == [0, 0, 1]  # the third adds nothing and is not opened


def test_what_no_frame_sees_is_masked():
    p = placement(0, 0.0, 0.0)
    patch = draw_patch([p], FRAME, grid_about(500.0, 0.0, 0.25, 32), lambda _: picture(p))
    assert patch.share_seen == 0.0


def test_contrast_turned_over_looks_the_same_by_its_gradient():
    p = placement(0, 0.0, 0.0)
    grid = grid_about(0.0, 0.0, 0.25, 96)
    patch = draw_patch([p], FRAME, grid, lambda _: picture(p))
    turned = draw_patch([p], FRAME, grid, lambda _: 255 - picture(p))
    a, b = gradient_picture(patch), gradient_picture(turned)
    np.testing.assert_array_equal(a.mask, b.mask)
    assert np.corrcoef(a.grey[a.mask], b.grey[b.mask])[0, 1] > 0.99
    assert np.corrcoef(patch.grey[a.mask], turned.grey[a.mask])[0, 1] < -0.99


def test_places_are_spread_over_the_map(rng):
    points = rng.uniform(0, 100, (200, 2))
    taken = spread_out(points, 12)
    assert len(set(taken)) == 12
    chosen = points[taken]
    apart = np.hypot(*(chosen[:, None] - chosen[None]).transpose(2, 0, 1)) + 1e9 * np.eye(12)
    reach = np.hypot(*(points[:, None] - chosen[None]).transpose(2, 0, 1)).min(axis=1).max()
    assert apart.min() > 0.9 * reach  # no two are closer than the largest gap they leave
    assert spread_out(np.zeros((5, 2)), 3) == [0]
