"""Ties to existing imagery: its constant error is an unknown of its own, so a hundred ties are no surer than it is."""

from dataclasses import replace

import numpy as np
import pytest
from flights import HEIGHT, WIDTH, centres, edges, fixes, graph, lawnmower, rmse
from test_control import control

from photomap_gis.core.posegraph import PointKind, PointObservation
from photomap_gis.slam import solve

REFERENCE_SIGMA_M = 0.4


def ties(rng, flight, *, off=(0.0, 0.0), name="ortho", every=3, sigma_px=0.5, wrong=()):
    """Four points of every third frame where a reference shows them, that is ``off`` by the same everywhere."""
    out = []
    for k in range(0, len(flight.poses), every):
        shift = np.array((9.0, -7.0)) if k in wrong else np.zeros(2)
        for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            plane = np.array([x * WIDTH, y * HEIGHT]) / 4
            place = flight.poses[k].apply(plane + rng.normal(0, sigma_px, 2)) + off + shift
            noise = np.eye(2) * REFERENCE_SIGMA_M**2
            out.append(PointObservation(k, plane, plane, place, noise, sigma_px, name, kind=PointKind.REFERENCE))
    return out


def sigma_m(solution):
    on_map = [np.trace(p.T_map_plane.linear @ p.covariance[:2, :2] @ p.T_map_plane.linear.T) for p in solution.poses]
    return float(np.sqrt(np.mean(on_map) / 2))


@pytest.fixture(scope="module")
def flight():
    return lawnmower(np.random.default_rng(5), strips=5, per_strip=8)


@pytest.fixture(scope="module")
def by_gps(flight):
    rng = np.random.default_rng(8)
    return graph(flight, edges(rng, flight), fixes(rng, flight, bias_m=2.0))


def with_points(g, *points):
    return replace(g, points=tuple(p for several in points for p in several))


def test_both_solvers_agree(rng, flight, by_gps):
    g = with_points(by_gps, ties(rng, flight), ties(rng, flight, off=(0.5, 0.2), name="older"))
    one, other = solve(g, backend="gtsam"), solve(g, backend="scipy")
    for a, b in zip(one.poses, other.poses, strict=True):
        np.testing.assert_allclose(a.T_map_plane.matrix, b.T_map_plane.matrix, atol=2e-3)
        np.testing.assert_allclose(a.covariance, b.covariance, rtol=2e-2, atol=1e-9)


def test_the_map_lies_on_the_reference_and_is_no_surer_than_it(rng, flight, by_gps):
    before, after = solve(by_gps), solve(with_points(by_gps, ties(rng, flight)))
    frames = range(len(flight.poses))
    assert rmse(centres(before, frames), flight.centres_m) > 1.2
    assert rmse(centres(after, frames), flight.centres_m) < REFERENCE_SIGMA_M
    assert sigma_m(before) > 2 * REFERENCE_SIGMA_M
    assert 0.85 * REFERENCE_SIGMA_M < sigma_m(after) < 1.05 * REFERENCE_SIGMA_M


def test_two_references_are_surer_than_one(rng, flight, by_gps):
    one, two = ties(rng, flight, off=(0.3, 0.0)), ties(rng, flight, off=(-0.3, 0.0), name="other")
    both = solve(with_points(by_gps, one, two))
    assert sigma_m(both) < 0.8 * sigma_m(solve(with_points(by_gps, one)))
    assert rmse(centres(both, range(len(flight.poses))), flight.centres_m) < 0.3


def test_control_points_tell_what_the_reference_is_off(rng, flight, by_gps):
    """No tie is put aside for it: all of them are off by what their covariance grants."""
    points = control(rng, flight, ((0, "a"), (7, "b"), (20, "c"), (39, "d")))
    solution = solve(with_points(by_gps, ties(rng, flight, off=(0.6, -0.5)), points))
    assert rmse(centres(solution, range(len(flight.poses))), flight.centres_m) < 0.1
    assert solution.rejected_points == ()
    assert sigma_m(solution) < 0.1


def test_wrong_ties_are_put_aside_and_do_not_bend_the_map(rng, flight, by_gps):
    points = ties(rng, flight, wrong=(6, 21, 30))
    solution = solve(with_points(by_gps, points))
    assert {points[k].frame for k in solution.rejected_points} == {6, 21, 30}
    assert rmse(centres(solution, range(len(flight.poses))), flight.centres_m) < REFERENCE_SIGMA_M


def test_a_gps_that_is_far_off_hardly_pulls_the_map_off_the_reference(rng, flight, by_gps):
    off = np.array([7.0, -5.0])
    far = replace(by_gps, positions=tuple(replace(p, xy_map_m=p.xy_map_m + off) for p in by_gps.positions))
    frames = range(len(flight.poses))
    assert rmse(centres(solve(far), frames), flight.centres_m) > 7
    laid = solve(with_points(far, ties(rng, flight)))
    assert rmse(centres(laid, frames), flight.centres_m) < 0.6 * REFERENCE_SIGMA_M
    assert sigma_m(laid) < 1.05 * REFERENCE_SIGMA_M
