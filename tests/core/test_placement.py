"""Cameras in space over the ground: there and back, over level ground the same as planes, honest covariances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.ground import HeightField
from photomap_gis.core.placement import PlanePlacement, PosedPlacement
from photomap_gis.core.similarity import Similarity2D

CAMERA = Camera(1600, 1200, 1200.0, k1=-0.05, k2=0.01)


def turned(x: float, y: float, heading: float) -> np.ndarray:
    """``R_map_camera`` of a camera that leans by small angles about the map's axes and has a heading."""
    cx, sx, cy, sy, ch, sh = np.cos(x), np.sin(x), np.cos(y), np.sin(y), np.cos(heading), np.sin(heading)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return about_x @ about_y @ np.array([[ch, -sh, 0], [sh, ch, 0], [0, 0, 1]])


def hills(sigma: float = 0.0) -> HeightField:
    y, x = np.mgrid[0:13, 0:17]
    return HeightField((-200.0, -150.0), 25.0, 6.0 * np.sin(x / 2.0) * np.cos(y / 2.5), sigma)


angles = st.floats(-0.25, 0.25)


@given(angles, angles, st.floats(-3.1, 3.1), st.integers(0, 2**31))
@settings(max_examples=40)
def test_there_and_back(x, y, heading, seed):
    placement = PosedPlacement(CAMERA, np.array([20.0, -30.0, 120.0]), turned(x, y, heading), hills())
    pixels = np.random.default_rng(seed).uniform((0, 0), (1599, 1199), (50, 2))
    assert placement.unproject(placement.project(pixels)) == pytest.approx(pixels, abs=0.05)


def test_over_level_ground_it_is_the_plane_that_leans():
    R = turned(0.05, -0.08, 0.0)
    posed = PosedPlacement(CAMERA, np.array([10.0, 5.0, 90.0]), turned(0, 0, 0.7) @ R, HeightField.level())
    plane = PlanePlacement(PlaneView(CAMERA, R), Similarity2D(10.0, 5.0, 0.7, np.log(90.0 / 1200.0)))
    pixels = np.random.default_rng(1).uniform((0, 0), (1599, 1199), (200, 2))
    assert posed.project(pixels) == pytest.approx(plane.project(pixels), abs=1e-9)
    assert posed.unproject(plane.project(pixels)) == pytest.approx(pixels, abs=1e-6)
    assert posed.jacobian(pixels) == pytest.approx(plane.jacobian(pixels), abs=1e-9)


def test_what_looks_up_sees_no_ground():
    sideways = PosedPlacement(CAMERA, np.array([0.0, 0.0, 50.0]), turned(np.pi / 2, 0, 0), HeightField.level())
    seen = sideways.project([[800.0, 100.0], [800.0, 1100.0]])
    assert np.isnan(seen).any(axis=1).sum() == 1, "the sky has no place on the map, the ground below has"


def test_position_covariance_is_that_of_perturbed_cameras():
    rng = np.random.default_rng(2)
    centre, R = np.array([3.0, 4.0, 100.0]), turned(0.1, 0.05, 1.0)
    L = np.diag([0.3, 0.2, 0.4, 0.002, 0.003, 0.001]) @ (np.eye(6) + 0.3 * np.tril(rng.normal(size=(6, 6)), -1))
    ground = HeightField.level(sigma=0.5)
    pixels = np.array([[100.0, 100.0], [1500.0, 700.0]])
    predicted = PosedPlacement(CAMERA, centre, R, ground).position_covariance(pixels, L @ L.T)
    drawn = []
    for _ in range(4000):
        step = L @ rng.normal(size=6)
        w = step[3:]
        angle = np.linalg.norm(w)
        K = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        turn = np.eye(3) + np.sin(angle) / angle * K + (1 - np.cos(angle)) / angle**2 * K @ K
        lifted = HeightField((0, 0), 1.0, np.full((1, 1), 0.5 * rng.normal()))
        drawn.append(PosedPlacement(CAMERA, centre + step[:3] * (1, 1, -1), turn @ R, lifted).project(pixels))
    drawn = np.array(drawn)
    for k in range(2):
        assert np.cov(drawn[:, k].T) == pytest.approx(predicted[k], rel=0.12, abs=0.01)


def test_heights_are_linear_between_the_lattice_and_level_beyond():
    field = HeightField((10.0, 20.0), 2.0, np.array([[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]))
    assert field.at([[10, 20], [12, 20], [10, 24], [11, 21]]) == pytest.approx([0.0, 1.0, 4.0, 1.5])
    assert field.at([[-50, -50], [500, 500]]) == pytest.approx([0.0, 5.0])
    assert not field.is_level and HeightField.level().is_level
    with pytest.raises(ValueError, match="lattice"):
        HeightField((0, 0), 0.0, np.zeros((2, 2)))
