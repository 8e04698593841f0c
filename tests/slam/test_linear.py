"""The arrays' geometry against the values' own, and the derivatives against differences."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.posegraph import Edge, EdgeKind, PointKind, PointObservation, PositionObservation
from photomap_gis.core.similarity import Similarity2D, transform_jacobian
from photomap_gis.slam.linear import (
    cost,
    edge_jacobians,
    edge_residuals,
    normal_equations,
    point_jacobians,
    point_residuals,
)
from photomap_gis.slam.problem import (
    Problem,
    ScalarTerms,
    State,
    Weights,
    edge_terms,
    left_jacobian,
    point_terms,
    position_terms,
)

STEP = 1e-6


def random_problem(rng, n=5):
    def motion():
        return Similarity2D.exp(rng.normal(size=4) * (5, 5, 0.5, 0.3))

    def covariance():
        root = rng.normal(size=(4, 4))
        return root @ root.T + 0.1 * np.eye(4)

    edges = [Edge(k, k + 1, motion(), covariance(), EdgeKind.SEQUENTIAL) for k in range(n - 1)]
    edges.append(Edge(0, n - 1, motion(), covariance(), EdgeKind.LOOP))
    node_of = {k: k for k in range(n)}
    fixes = [
        PositionObservation(k, rng.normal(size=2) * 10, np.eye(2) * 5.0, k % 2, 3.0 * k, 2.0, 60.0, 1.0)
        for k in range(n)
    ]
    positions, drift, bias = position_terms(fixes, node_of)
    scalars = ScalarTerms.of([1], [0.3], [0.1]), ScalarTerms.of([2], [0.3], [0.2])
    known = [
        PointObservation(k, np.zeros(2), rng.normal(size=2) * 3, rng.normal(size=2) * 10, np.diag([2.0, 0.5]), 0.7)
        for k in (1, 1, n - 1)
    ]
    known += [
        PointObservation(k, np.zeros(2), rng.normal(size=2) * 3, rng.normal(size=2) * 10, np.eye(2) * 0.25, 0.7,
                         name, kind=PointKind.REFERENCE)
        for k, name in ((0, "new"), (2, "old"), (2, "new"))
    ]  # fmt: skip
    points = point_terms(known, node_of, np.ones(n)).after(len(bias))
    bias = np.concatenate([bias, points.reference_sigma_m])
    terms = edge_terms(edges, node_of), positions, drift, bias, *scalars, np.zeros(0, np.intp), points
    problem = Problem(n, *terms)

    def numbers(size):
        return rng.normal(size=size) + 1j * rng.normal(size=size)

    state = State(0.3 * numbers(n), 9.0 * numbers(n), numbers(len(drift)), numbers(len(bias)))
    weights = Weights(*(rng.random(k) for k in (len(edges), len(fixes), 1, 1, len(known))))
    return edges, problem, state, weights


def test_residuals_are_those_of_the_values(rng):
    edges, problem, state, _ = random_problem(rng)
    for e, r in zip(edges, edge_residuals(problem, state), strict=True):
        expected = (e.T_a_b.inverse() @ state.pose(e.a).inverse() @ state.pose(e.b)).log()
        np.testing.assert_allclose(r, expected, atol=1e-12)


def test_a_step_moves_poses_as_exp_does(rng):
    _, problem, state, _ = random_problem(rng)
    step = rng.normal(size=problem.size) * 0.3
    moved = state.moved(step)
    for k in range(problem.n_nodes):
        expected = state.pose(k) @ Similarity2D.exp(step[4 * k : 4 * k + 4])
        np.testing.assert_allclose(moved.pose(k).matrix, expected.matrix, atol=1e-12)


def test_jacobians_are_derivatives(rng):
    edges, problem, state, _ = random_problem(rng)
    ja, jb = edge_jacobians(problem, state)
    for k, e in enumerate(edges):
        for node, jacobian in ((e.a, ja[k]), (e.b, jb[k])):
            for column in range(4):
                d = np.zeros(problem.size)
                d[4 * node + column] = STEP
                ahead, behind = edge_residuals(problem, state.moved(d))[k], edge_residuals(problem, state.moved(-d))[k]
                np.testing.assert_allclose((ahead - behind) / (2 * STEP), jacobian[:, column], atol=1e-6)


def test_points_are_where_the_poses_put_them(rng):
    _, problem, state, _ = random_problem(rng)
    p = problem.points
    for k, (r, j) in enumerate(zip(point_residuals(problem, state), point_jacobians(problem, state), strict=True)):
        pose = state.pose(p.node[k])
        at = np.array([p.plane[k].real, p.plane[k].imag])
        off = p.z_m[k] - (state.bias[p.bias[k]] if p.bias[k] >= 0 else 0.0)
        np.testing.assert_allclose(r, pose.apply(at) - [off.real, off.imag], atol=1e-12)
        np.testing.assert_allclose(j, transform_jacobian(pose, at)[0], atol=1e-12)
        for column in range(4):
            d = np.zeros(problem.size)
            d[4 * p.node[k] + column] = STEP
            ahead, behind = (point_residuals(problem, state.moved(s * d))[k] for s in (1, -1))
            np.testing.assert_allclose((ahead - behind) / (2 * STEP), j[:, column], atol=1e-6)


def test_points_seen_often_are_no_better_surveyed():
    def seen(frame, name, **more):
        return PointObservation(frame, np.zeros(2), np.zeros(2), np.zeros(2), np.eye(2) * 0.04, 2.0, name, **more)

    known = [seen(0, "a"), seen(1, "a"), seen(1, "b"), seen(1, "c", check=True), seen(7, "d")]
    terms = point_terms(known, {0: 0, 1: 1}, np.array([0.1, 0.2]))
    np.testing.assert_array_equal(terms.row, [0, 1, 2])
    variances = [2 * 0.04 + 0.2**2, 2 * 0.04 + 0.4**2, 0.04 + 0.4**2]
    np.testing.assert_allclose(terms.information[:, 0, 0], 1 / np.array(variances), rtol=1e-9)


def test_the_gradient_is_that_of_the_cost(rng):
    _, problem, state, weights = random_problem(rng)
    equations = normal_equations(problem, state, weights)
    for k in range(problem.size):
        d = np.zeros(problem.size)
        d[k] = STEP
        slope = (cost(problem, state.moved(d), weights) - cost(problem, state.moved(-d), weights)) / (4 * STEP)
        assert slope == pytest.approx(equations.g[k], rel=1e-5, abs=1e-4)
    dense = equations.H.toarray()
    np.testing.assert_allclose(dense, dense.T, atol=1e-9)
    assert np.linalg.eigvalsh(dense).min() > 0


@given(x=st.floats(-2, 2), y=st.floats(-3, 3))
def test_left_jacobian_has_no_step_at_the_series(x, y):
    w = np.array([complex(x, y)])
    series = sum(w**k / math.factorial(k + 1) for k in range(30))
    np.testing.assert_allclose(left_jacobian(w), series, rtol=1e-9)


def test_fixes_without_a_clock_or_drift_stand_alone():
    fixes = [
        PositionObservation(0, np.zeros(2), np.eye(2)),
        PositionObservation(1, np.zeros(2), np.eye(2) * 5, 0, None, 2.0, 60.0, 1.0),
        PositionObservation(2, np.full(2, np.nan), np.eye(2)),
        PositionObservation(9, np.zeros(2), np.eye(2)),
    ]
    positions, drift, bias = position_terms(fixes, {0: 0, 1: 1, 2: 2})
    assert len(positions) == 2 and len(drift) == 0 and len(bias) == 1
    # what does not drift is all white
    np.testing.assert_allclose(positions.information[:, 0, 0], [1.0, 0.2])
    np.testing.assert_array_equal(positions.bias, [-1, 0])


def test_each_flight_has_its_own_chain():
    fixes = [PositionObservation(k, np.zeros(2), np.eye(2) * 5, k % 2, float(k), 2.0, 60.0, 1.0) for k in range(6)]
    _, drift, bias = position_terms(fixes, {k: k for k in range(6)})
    assert (drift.previous == [-1, 0, 1, -1, 3, 4]).all() and len(bias) == 2
