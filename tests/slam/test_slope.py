"""Sloping ground: the model is exact for level cameras, and tells tilt apart."""

import math

import numpy as np
import pytest

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.posegraph import Edge, EdgeKind
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.slam.slope import fit_slope, slopes_of_frames

FOCAL_PX = 1000.0
HEIGHT_M = 100.0


def seen(ground_xy, camera_xy, heading, slope, tilt=(0.0, 0.0), height=HEIGHT_M):
    """Return ``(N, 2)`` plane points of a camera over the plane z = slope . x, by exact perspective; y is south."""
    camera_z = height + slope @ camera_xy
    d = np.column_stack([ground_xy - camera_xy, camera_z - ground_xy @ slope])
    c, s = math.cos(heading), math.sin(heading)
    in_camera = np.column_stack([c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1], d[:, 2]])
    (a, b), f = tilt, FOCAL_PX
    turn_y = np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]])
    turn_x = np.array([[1, 0, 0], [0, math.cos(b), -math.sin(b)], [0, math.sin(b), math.cos(b)]])
    r = in_camera @ (turn_x @ turn_y).T
    return f * r[:, :2] / r[:, 2:]


def ground_grid():
    x, y = np.meshgrid(np.linspace(0, 60, 9), np.linspace(-40, 40, 9))
    return np.column_stack([x.ravel(), y.ravel()])


@pytest.mark.parametrize("heading_b", [0.0, 0.4, math.pi])
def test_level_cameras_over_a_slope_are_explained_exactly(heading_b):
    slope = np.array([0.05, -0.03])
    a_xy, b_xy = np.zeros(2), np.array([55.0, 10.0])
    a, b = (seen(ground_grid(), xy, h, slope) for xy, h in ((a_xy, 0.0), (b_xy, heading_b)))
    motion = fit_slope(a, b, FOCAL_PX, FOCAL_PX, noise_px=1e-3)
    assert motion is not None
    np.testing.assert_allclose(motion.slope, slope, atol=1e-5)
    assert motion.left_px < 1e-3
    assert motion.flat_px > 0.5
    np.testing.assert_allclose(motion.T_a_b.translation, FOCAL_PX * (b_xy - a_xy) / HEIGHT_M, atol=0.02)
    assert motion.T_a_b.log_scale == pytest.approx(0.0, abs=1e-5)  # both fly 100 m above the ground below them
    assert math.remainder(motion.T_a_b.angle_rad - heading_b, 2 * math.pi) == pytest.approx(0.0, abs=1e-5)


def test_a_view_that_knows_the_slope_is_true_to_the_ground():
    slope = (0.08, 0.02)
    view = PlaneView(Camera(800, 600, FOCAL_PX), np.eye(3), slope)
    ground = np.array([[10.0, 5.0], [-20.0, 15.0], [0.0, 0.0]])
    pixels = seen(ground, np.zeros(2), 0.0, np.array(slope)) + np.array([399.5, 299.5])
    np.testing.assert_allclose(view.to_plane(pixels) * HEIGHT_M / FOCAL_PX, ground, atol=1e-9)
    np.testing.assert_allclose(view.to_pixel(view.to_plane(pixels)), pixels, atol=1e-9)


def test_a_frames_slope_is_the_median_of_its_edges_along_its_own_axes():
    def edge(a, b, angle, slope):
        return Edge(a, b, Similarity2D(0, 0, angle, 0), np.eye(4), EdgeKind.LOOP, ground_slope=slope)

    found = slopes_of_frames([edge(0, 1, math.pi / 2, (0.1, 0.0)), edge(0, 2, 0.0, (0.1, 0.02)), edge(3, 4, 0.0, None)])
    assert found[0] == pytest.approx((0.1, 0.01))
    assert found[1] == pytest.approx((0.0, -0.1))  # x of a is -y of a frame turned by a quarter
    assert found.keys() == {0, 1, 2}
