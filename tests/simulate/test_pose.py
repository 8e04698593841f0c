"""The simulator's camera and the product's speak of the same angles, planes and pixels."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.frame import level_rotation
from photomap_gis.core.placement import PlanePlacement
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.simulate.pose import CameraPose

CAMERA = Camera(800, 600, 700.0, k1=-0.05, k2=0.01)
angles = st.floats(-0.3, 0.3)


@given(angles, angles, st.floats(-3.1, 3.1))
def test_there_and_back(roll: float, pitch: float, yaw: float) -> None:
    pose = CameraPose.of_body((1000.0, 2000.0), 90.0, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)
    xy = np.array([[0.0, 0.0], [799.0, 599.0], [400.0, 123.0]])
    ground = pose.ground_points(CAMERA, xy, 5.0)
    back = pose.project(CAMERA, np.concatenate([ground, np.full((3, 1), 5.0)], axis=1))
    assert np.allclose(back, xy, atol=1e-6)


@given(angles, angles, st.floats(-3.1, 3.1))
def test_the_plane_placement_of_the_true_attitude_puts_pixels_where_they_see_the_ground(
    roll: float, pitch: float, yaw: float
) -> None:
    # what the product does with a reported attitude, a height and a GPS fix must be the simulator's own geometry
    pose = CameraPose.of_body((1000.0, 2000.0), 70.0, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)
    attitude = pose.attitude()
    view = PlaneView(CAMERA, level_rotation(attitude.R_ned_camera))
    gsd = 70.0 / 700.0
    T = Similarity2D(1000.0, -2000.0, attitude.heading_rad, math.log(gsd))
    xy = np.array([[0.0, 0.0], [799.0, 0.0], [399.5, 299.5], [10.0, 590.0]])
    mapped = PlanePlacement(view, T).project(xy) * (1.0, -1.0)
    assert np.allclose(mapped, pose.ground_points(CAMERA, xy, 0.0), atol=1e-6)


@given(angles, angles, st.floats(-3.1, 3.1), st.floats(-0.05, 0.05))
def test_attitude_is_the_rotation_turned_to_true_north(roll: float, pitch: float, yaw: float, turn: float) -> None:
    pose = CameraPose.of_body((0.0, 0.0), 1.0, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)
    assert np.allclose(pose.attitude().R_ned_camera, pose.R_grid_camera, atol=1e-6)
    turned = CameraPose.of_body((0.0, 0.0), 1.0, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw + turn)
    assert np.allclose(pose.attitude(turn).R_ned_camera, turned.R_grid_camera, atol=1e-6)


def test_a_level_drone_looks_straight_down_with_its_heading() -> None:
    attitude = CameraPose.of_body((0.0, 0.0), 1.0, roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.7).attitude()
    assert (attitude.yaw_rad, attitude.pitch_rad, attitude.roll_rad) == pytest.approx((0.7, -math.pi / 2, 0.0))


def test_north_is_up_and_east_is_right_for_heading_zero() -> None:
    pose = CameraPose.of_body((50.0, 60.0), 100.0, roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0)
    camera = Camera(100, 100, 100.0)
    x, y = pose.project(camera, [[60.0, 90.0, 0.0]])[0]  # 10 m east, 30 m north
    assert (x, y) == pytest.approx((49.5 + 10.0, 49.5 - 30.0))


def test_higher_points_lean_outward() -> None:
    pose = CameraPose.of_body((0.0, 0.0), 100.0, roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.3)
    foot, top = pose.project(CAMERA, [[20.0, 10.0, 0.0], [20.0, 10.0, 12.0]]) - CAMERA.principal_xy_px
    assert np.hypot(*top) > 1.1 * np.hypot(*foot)


def test_the_footprint_has_the_size_of_the_view() -> None:
    pose = CameraPose.of_body((0.0, 0.0), 100.0, roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0)
    outline = pose.footprint_en_m(Camera(800, 600, 400.0), 0.0)
    assert outline.shape == (16, 2)
    assert np.ptp(outline, axis=0) == pytest.approx([200.0, 150.0])


def test_a_camera_without_focal_length_is_refused() -> None:
    pose = CameraPose.of_body((0.0, 0.0), 1.0, roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0)
    with pytest.raises(ValueError, match="focal"):
        pose.project(Camera(10, 10), [[0.0, 0.0, 0.0]])
