"""Cameras, planes and attitudes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.frame import Attitude, level_rotation
from photomap_gis.core.measurement import Registration
from photomap_gis.core.placement import FramePlacement, PlanePlacement
from photomap_gis.core.similarity import Similarity2D

ANGLE = st.floats(-0.5, 0.5)
PIXELS = np.array([[0.0, 0.0], [799.0, 599.0], [200.0, 450.0], [399.5, 299.5]])


@given(ANGLE, ANGLE, st.floats(-3, 3), st.floats(-0.1, 0.1))
def test_plane_round_trip(tilt, roll, yaw, k1):
    camera = Camera(800, 600, 700.0, k1=k1, k2=0.01)
    view = PlaneView(camera, level_rotation(Attitude(yaw, -math.pi / 2 + tilt, roll).R_ned_camera))
    np.testing.assert_allclose(view.to_pixel(view.to_plane(PIXELS)), PIXELS, atol=1e-4)


def test_nadir_image_top_is_the_heading():
    for yaw in (-2.0, 0.0, 0.5, 3.0):
        a = Attitude(yaw, -math.pi / 2)
        assert a.off_nadir_rad == pytest.approx(0.0, abs=1e-7)
        assert math.remainder(a.heading_rad - yaw, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
        up = a.R_ned_camera @ np.array([0.0, -1.0, 0.0])
        np.testing.assert_allclose(up, [math.cos(yaw), math.sin(yaw), 0.0], atol=1e-9)
        right = a.R_ned_camera @ np.array([1.0, 0.0, 0.0])
        np.testing.assert_allclose(right, [-math.sin(yaw), math.cos(yaw), 0.0], atol=1e-9)


def test_a_camera_that_looks_ahead_sees_the_plumb_point_below_its_centre():
    """Pitched up from nadir, the plane's origin (below the drone) lies towards the image's lower edge."""
    a = Attitude(1.0, -math.radians(70))
    view = PlaneView(Camera(800, 600, 700.0), level_rotation(a.R_ned_camera))
    plumb = view.to_pixel([[0.0, 0.0]])[0]
    assert plumb[0] == pytest.approx(399.5)
    assert plumb[1] == pytest.approx(299.5 + 700 * math.tan(math.radians(20)))


@given(ANGLE, ANGLE, st.floats(-3, 3))
def test_body_camera_keeps_the_rotation(roll, pitch, yaw):
    a = Attitude.of_body_camera(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)
    # belly camera: optical axis is body down, image up is body forward
    cr, sr, cp, sp, cy, sy = (f(v) for v in (roll, pitch, yaw) for f in (math.cos, math.sin))
    forward = [cy * cp, sy * cp, -sp]
    down = [cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr]
    np.testing.assert_allclose(a.R_ned_camera @ [0.0, -1.0, 0.0], forward, atol=1e-7)
    np.testing.assert_allclose(a.R_ned_camera @ [0.0, 0.0, 1.0], down, atol=1e-7)


def test_placement_heading_gsd_and_outline():
    view = PlaneView.flat(Camera(800, 600, 700.0))
    T = Similarity2D(10, 20, math.radians(90), math.log(0.05))
    p = FramePlacement(0, 800, 600, PlanePlacement(view, T), np.diag([4.0, 4.0, 0, 0]))
    assert math.degrees(p.heading_rad) == pytest.approx(90)
    assert p.gsd_m_per_px == pytest.approx(0.05)
    np.testing.assert_allclose(p.centre_xy_map_m, [10, 20], atol=1e-9)
    ring = p.outline_xy_map_m()
    assert len(ring) == 16
    np.testing.assert_allclose(ring.min(axis=0), [10 - 15, 20 - 20], atol=1e-9)
    np.testing.assert_allclose(p.position_covariance_m2()[0], np.eye(2) * 4 * 0.05**2, atol=1e-9)


def test_registration_covariance_is_transported(rng):
    """Samples of the perturbed motion, seen from other frames, scatter as the transported covariance says."""
    cov = np.diag([0.5, 0.3, 1e-4, 1e-4]) ** 2
    reg = Registration(Similarity2D(30, -12, 0.4, 0.1), cov, 1.0, size_b_px=(256, 192))
    A, B = Similarity2D(-400, -300, 0, math.log(3.2)), Similarity2D(-410, -290, 0, math.log(3.1))
    T, moved = reg.seen_from(A, B)
    centre = Similarity2D.translation_of(127.5, 95.5)
    xis = []
    for xi in rng.multivariate_normal(np.zeros(4), cov, size=4000):
        noisy = reg.T_a_b @ centre @ Similarity2D.exp(xi) @ centre.inverse()
        xis.append((T.inverse() @ (A @ noisy @ B.inverse())).log())
    got = np.cov(np.array(xis).T)
    d = np.sqrt(np.diag(moved))
    np.testing.assert_allclose(got / np.outer(d, d), moved / np.outer(d, d), atol=0.08)
