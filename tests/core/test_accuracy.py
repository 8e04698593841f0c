"""The accuracy statement: the standard's numbers, and predicted sigmas that are those of the best-placed frame."""

import math

import numpy as np
import pytest

from photomap_gis.core.accuracy import PointMiss, checked_accuracy, predicted_covariance_m2, predicted_sigma_m
from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.placement import FramePlacement, PlanePlacement
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.core.similarity import Similarity2D


def placed(frame, T, sigma):
    view = PlaneView.flat(Camera(200, 100, 180.0))
    return FramePlacement(frame, 200, 100, PlanePlacement(view, T), np.diag(np.square(sigma)))


def test_the_standards_numbers():
    a = checked_accuracy([PointMiss("a", 0.3, 0.4, 0.2, 3.0), PointMiss("b", -0.3, 0.4, 0.2, 1.0)])
    assert (a.n, a.mean_east_m, a.mean_north_m) == (2, 0.0, 0.4)
    assert (a.rmse_x_m, a.rmse_y_m, a.rmse_r_m) == pytest.approx((0.3, 0.4, 0.5))
    assert a.ce90_m == pytest.approx(1.5175 * 0.5)
    assert a.nssda_95_m == pytest.approx(1.7308 * 0.5)
    assert a.nees_per_dof == pytest.approx(1.0)
    assert "2 check points" in a.method
    assert "20 or more" in a.method
    assert checked_accuracy([]) is None
    many = checked_accuracy([PointMiss(str(k), 1.0, 0.0, 1.0, 1.0) for k in range(20)])
    assert many.meets_standard
    assert "demands" not in many.method


def test_ninety_and_ninety_five_percent_lie_within(rng):
    d = rng.normal(0, 0.7, (20000, 2))
    a = checked_accuracy([PointMiss("p", e, n, 0.7, (e * e + n * n) / 0.49) for e, n in d.tolist()])
    r = np.hypot(*d.T)
    assert np.mean(r < a.ce90_m) == pytest.approx(0.90, abs=0.01)
    assert np.mean(r < a.nssda_95_m) == pytest.approx(0.95, abs=0.01)
    assert a.nees_per_dof == pytest.approx(1.0, abs=0.03)


def test_the_best_placed_frame_tells_the_sigma():
    sharp = placed(0, Similarity2D(0, 0, 0.3, math.log(0.1)), (0.5, 0.5, 1e-3, 1e-3))
    vague = placed(1, Similarity2D(5, 0, 0.3, math.log(0.1)), (9.0, 9.0, 1e-3, 1e-3))
    points = np.array([[1.0, 1.0], [13.5, 3.5], [400.0, 0.0]])
    sigma = predicted_sigma_m(Trajectory((vague, sharp)), points)
    assert sigma[0] == pytest.approx(0.05, rel=0.05)
    assert sigma[1] == pytest.approx(0.9, rel=0.05)  # beyond the sharp frame's edge
    assert np.isnan(sigma[2])


def test_the_predicted_covariance_is_the_scatter_of_simulated_poses(rng):
    T, sigma = Similarity2D(40.0, -20.0, 0.7, math.log(0.08)), np.array([2.0, 1.0, 8e-3, 5e-3])
    frame = placed(0, T, sigma)
    at = frame.camera_to_map.project([[180.0, 10.0]])
    there = np.array([180.0, 10.0]) - frame.camera_to_map.view.camera.principal_xy_px
    seen = np.array([(T @ Similarity2D.exp(rng.normal(size=4) * sigma)).apply(there) for _ in range(6000)])
    predicted = predicted_covariance_m2(Trajectory((frame,)), at)[0]
    np.testing.assert_allclose(np.cov(seen.T), predicted, rtol=0.08, atol=0.03 * np.trace(predicted))
