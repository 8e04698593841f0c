"""The twin: gtsam's own factors, points in space as unknowns, come to the same cameras and to the same sigmas."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import make_world

from photomap_gis.core.camera import Camera
from photomap_gis.slam.bundle.equations import SpotPrior, reduced_equations, spots_settled
from photomap_gis.slam.bundle.layout import Layout
from photomap_gis.slam.bundle.model import cameras_of, linearise, sight
from photomap_gis.slam.bundle.problem import BundleState

gtsam = pytest.importorskip("gtsam", reason="gtsam has no wheel for this platform")

RELIEF = 2.0
ANCHOR_PX = 3e-3
FREE = 1e3


@pytest.fixture
def world(rng):
    return make_world(rng, strips=2, a_strip=4, relief=RELIEF, camera=Camera(1600, 1200, 1200.0, k1=-0.03))


def ours(problem):
    P = problem.ties.spots
    lenses = np.log([lens.focal_px for lens in problem.lenses])
    prior = SpotPrior(np.zeros(P), np.full(P, RELIEF**-2.0), np.zeros((P, 0)), np.zeros(0), np.zeros(P, int), lenses)
    state, free, W = BundleState.start(problem), np.zeros((1, 2), bool), problem.ties.information
    layout = Layout.of(problem, 0)
    for _ in range(12):
        e = reduced_equations(layout, problem, state, linearise(problem, state), W, prior, free)
        step = e.normal.step()
        state = spots_settled(problem, state.moved(step, e.spots_for(problem, step)), W, prior)
    e = reduced_equations(layout, problem, state, linearise(problem, state), W, prior, free)
    return state, e.normal.pose_covariances()


def theirs(problem, state):
    """Return gtsam's values and marginals of the same problem, fixes and attitudes and all.

    It begins at ``state``: from afar its steps end before they are there, anchors being all but exact.
    """
    X, L, K = (lambda k, c=c: gtsam.symbol(c, k) for c in "xlk")
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    camera = problem.lenses[0].camera
    lens = gtsam.Cal3Bundler(camera.focal_px, camera.k1, camera.k2, *camera.principal_xy_px)
    values.insert(K(0), lens)
    held = gtsam.noiseModel.Diagonal.Sigmas(np.array([1e-3, 1e-7, 1e-7]))
    graph.add(gtsam.PriorFactorCal3Bundler(K(0), lens, held))
    for k, v in enumerate(problem.views):
        values.insert(X(k), gtsam.Pose3(gtsam.Rot3(state.R[k]), state.centre[k]))
        turn = gtsam.noiseModel.Diagonal.Sigmas(np.array([v.tilt_sigma_rad, v.tilt_sigma_rad, FREE, FREE, FREE, FREE]))
        graph.add(gtsam.PriorFactorPose3(X(k), gtsam.Pose3(gtsam.Rot3(v.R_prior), v.centre), turn))
    for k, xy, information in zip(
        problem.fix_of.tolist(), problem.fix_xy, np.diag(problem.fix_noise.information), strict=True
    ):
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([information**-0.5, information**-0.5, FREE]))
        graph.add(gtsam.GPSFactor(X(k), np.array([*xy, 0.0]), noise))
    t = problem.ties
    places = sight(problem, state, cameras_of(problem, state)).spot
    exact, height = (gtsam.noiseModel.Isotropic.Sigma(2, ANCHOR_PX),
                     gtsam.noiseModel.Diagonal.Sigmas(np.array([FREE, FREE, RELIEF])))  # fmt: skip
    known = set()
    for a, b, xy_a, xy_b, covariance, spot, place in zip(
        t.a, t.b, t.xy_a_px, t.xy_b_px, t.covariance, t.spot, places, strict=True
    ):
        spot = int(spot)
        if spot not in known:
            known.add(spot)
            values.insert(L(spot), place)
            graph.add(gtsam.PriorFactorPoint3(L(spot), np.array([*place[:2], 0.0]), height))
            graph.add(gtsam.GeneralSFMFactor2Cal3Bundler(xy_b, exact, X(int(b)), L(spot), K(0)))
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        graph.add(gtsam.GeneralSFMFactor2Cal3Bundler(xy_a, noise, X(int(a)), L(spot), K(0)))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-12)
    parameters.setMaxIterations(100)
    found = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    assert graph.error(found) > graph.error(values) - 0.1, "there was nothing left to gain"
    return found, gtsam.Marginals(graph, found), X


def test_cameras_and_their_covariances_are_those_of_gtsam(world):
    problem = replace(world.problem, fix_noise=world.problem.fix_noise.times(0.25))
    state, covariance = ours(problem)
    found, marginals, X = theirs(problem, state)
    for k in range(len(problem.views)):
        pose = found.atPose3(X(k))
        assert state.centre[k] == pytest.approx(pose.translation(), abs=5e-3)
        assert state.R[k] == pytest.approx(pose.rotation().matrix(), abs=1e-4)
        R, of_theirs = state.R[k], marginals.marginalCovariance(X(k))
        centre, turn = R @ of_theirs[3:, 3:] @ R.T, R @ of_theirs[:3, :3] @ R.T
        assert covariance[k][:3, :3] == pytest.approx(centre, rel=0.03, abs=0.02 * np.trace(centre))
        assert covariance[k][3:, 3:] == pytest.approx(turn, rel=0.03, abs=0.02 * np.trace(turn))
