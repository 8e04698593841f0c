"""A solution in space laid on ties: the map's shape is kept, its place is the ties', its middle as sure as they say."""

import numpy as np
import pytest

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.ground import HeightField
from photomap_gis.core.placement import FramePlacement, PlanePlacement, PosedPlacement
from photomap_gis.core.posegraph import PointKind, PointObservation, Trajectory
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.pipeline.laid import _middle_jacobian, laid_on_ties
from photomap_gis.pipeline.solve import Solved
from photomap_gis.simulate.pose import CameraPose

W, H = 640, 480
CAMERA = Camera.of_hfov(W, H, 1.2)
MOTION = Similarity2D(3.0, -2.0, 0.01, 0.004)
SURE_M2 = np.array([[0.3, 0.05], [0.05, 0.2]])


def spread(rng):
    root = rng.normal(size=(6, 6)) * ([2.0] * 3 + [0.02] * 3)
    return root @ root.T + np.diag([0.5] * 3 + [1e-5] * 3)


def frames(rng, ground):
    """Leaning cameras over the ground, and the flat frames that lie elsewhere by a motion of the whole."""
    posed, flat = [], []
    for k in range(9):
        x, y = 25.0 * (k % 3), 20.0 * (k // 3)
        pose = CameraPose.of_body((0, 0), 0.0, roll_rad=rng.normal(0, 0.05), pitch_rad=rng.normal(0, 0.05), yaw_rad=0.3)
        R = pose.R_grid_camera[[1, 0, 2]] * np.array([[1.0], [-1.0], [1.0]])  # north, east, down to east, south, down
        where = PosedPlacement(CAMERA, np.array([x, y, 60.0]), R, ground)
        posed.append(FramePlacement(k, W, H, where, spread(rng), FrameStatus.REGISTERED, 0))
        middle = MOTION.apply(where.project(posed[-1].centre_xy_px))[0]
        gsd = 60.0 / CAMERA.focal_px
        T = Similarity2D(float(middle[0]), float(middle[1]), 0.3, float(np.log(gsd)))
        C = np.eye(4) * 1e-8
        C[:2, :2] = np.linalg.inv(T.linear) @ SURE_M2 @ np.linalg.inv(T.linear).T
        view = PlaneView.flat(CAMERA)
        flat.append(FramePlacement(k, W, H, PlanePlacement(view, T), C, FrameStatus.REGISTERED, 0))
    return posed, flat


def solved(placements):
    return Solved((), MapFrame("local"), Trajectory(tuple(placements)), {}, {})


def ties(flat, count=9):
    xy = flat[0].centre_xy_px[0]
    return [
        PointObservation(p.frame, xy, xy * 0, p.centre_xy_map_m, np.eye(2), kind=PointKind.REFERENCE)
        for p in flat[:count]
    ]


@pytest.fixture(params=["level", "hilly"])
def ground(request, rng):
    return (
        HeightField.level() if request.param == "level" else HeightField((-50.0, -50.0), 30.0, rng.normal(0, 2, (6, 6)))
    )


def test_the_whole_moves_to_its_ties_and_keeps_its_shape(rng, ground):
    posed, flat = frames(rng, ground)
    laid = laid_on_ties(solved(posed), solved(flat), ties(flat))
    px = np.array([[100.0, 80.0], [600.0, 400.0]])
    for before, after in zip(posed, laid.trajectory.placements, strict=True):
        tolerance = 1e-6 if ground.is_level else 0.3  # a turned lattice cannot hold every bend of the first
        np.testing.assert_allclose(after.centre_xy_map_m, flat[after.frame].centre_xy_map_m, atol=tolerance)
        expected = MOTION.apply(before.camera_to_map.project(px))
        np.testing.assert_allclose(after.camera_to_map.project(px), expected, atol=2 * tolerance)


def test_the_middle_is_as_sure_as_the_flat_solution_says(rng, ground):
    posed, flat = frames(rng, ground)
    laid = laid_on_ties(solved(posed), solved(flat), ties(flat))
    for before, after in zip(posed, laid.trajectory.placements, strict=True):
        covariance = after.pose_covariance
        assert np.linalg.eigvalsh(covariance).min() > 0
        if ground.is_level:
            np.testing.assert_allclose(after.position_covariance_m2()[0], SURE_M2, rtol=1e-3)
        turns = np.diag(covariance)[3:].sum() / np.diag(before.pose_covariance)[3:].sum()
        assert turns == pytest.approx(1.0, rel=1e-6)


def test_the_jacobian_is_the_one_that_placements_use(rng):
    posed, _ = frames(rng, HeightField.level())
    for p in posed[:3]:
        j = _middle_jacobian(p, p.camera_to_map)
        np.testing.assert_allclose(j @ p.pose_covariance @ j.T, p.position_covariance_m2()[0], rtol=1e-5)


def test_a_tie_that_the_others_contradict_moves_nothing(rng):
    posed, flat = frames(rng, HeightField.level())
    flat[4] = FramePlacement(
        4, W, H, PlanePlacement(PlaneView.flat(CAMERA), Similarity2D(500.0, 0.0, 0.0, -2.0)), np.eye(4) * 1e-4
    )
    laid = laid_on_ties(solved(posed), solved(flat), ties(flat))
    for k in (0, 8):
        after = laid.trajectory.placements[k]
        np.testing.assert_allclose(after.centre_xy_map_m, flat[k].centre_xy_map_m, atol=1e-6)


def test_too_few_frames_with_ties_tell_nothing(rng):
    posed, flat = frames(rng, HeightField.level())
    assert laid_on_ties(solved(posed), solved(flat), ties(flat, 2)) is None
