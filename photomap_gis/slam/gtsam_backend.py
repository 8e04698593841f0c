"""The first solver: one gtsam factor graph of ``Similarity2`` poses. The only door of gtsam into the house.

Edges are native ``BetweenFactorSimilarity2``. What is known of a pose alone, and the drift and bias of the GPS, enter
as linear factors about the present estimate (``LinearContainerFactor``), renewed each time the solver is called: a
``PriorFactorSimilarity2`` far from its mean would pull at angle and scale through the second-order terms of its
logarithm, and the GPS's two metres are "far" from every pose. A position in metres is divided by the pose's scale and
turned into its axes by the Jacobian.

gtsam keeps ``[R t; 0 1/s]`` and maps ``p -> s (R p + t)``: its translation is ours divided by the scale.
"""

from __future__ import annotations

import math
from typing import Any

import gtsam
import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.linear import (
    GAUGE_SIGMA,
    drift_residuals,
    heading_residuals,
    point_jacobians,
    point_residuals,
    position_residuals,
    scale_residuals,
)
from photomap_gis.slam.problem import Problem, State, Weights

ITERATIONS_A_LINEARISATION = 4
"""After so many iterations the linear factors are renewed about the new poses."""
RELATIVE_ERROR_TOL = 1e-4
"""Steps shrink quadratically: one that gains less than this is followed by none that matters."""


def minimise(problem: Problem, weights: Weights, start: State, *, max_iterations: int = 20) -> State:
    """Return the state of least weighted squares that Levenberg-Marquardt reaches from ``start``."""
    edges = _edge_factors(problem, weights, start)
    state = start
    left = max_iterations
    while left > 0:
        graph = edges.clone()
        values = _values(state)
        _add_unary(graph, values, problem, weights, state)
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(min(left, ITERATIONS_A_LINEARISATION))
        parameters.setRelativeErrorTol(RELATIVE_ERROR_TOL)
        parameters.setlambdaInitial(1e-9)
        moved = _state(gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize(), problem)
        left -= ITERATIONS_A_LINEARISATION
        # The linear factors are exact at the pose they were taken at: renew them while scales and angles still move.
        settled = not len(state.w) or float(np.abs(np.exp(moved.w - state.w) - 1.0).max()) < 1e-4
        state = moved
        if settled:
            break
    return state


def _similarity(w: complex, t: complex) -> gtsam.Similarity2:
    s = math.exp(w.real)
    return gtsam.Similarity2(gtsam.Rot2(w.imag), np.array([t.real / s, t.imag / s]), s)


def _pose_key(node: int) -> int:
    return int(gtsam.symbol("x", node))


def _drift_key(k: int) -> int:
    return int(gtsam.symbol("d", k))


def _bias_key(k: int) -> int:
    return int(gtsam.symbol("f", k))


def _edge_factors(problem: Problem, weights: Weights, state: State) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    e = problem.edges
    information = weights.edges[:, None, None] * e.information
    # thousands of edges: numbers leave numpy all at once, keys are made once a pose
    keys = [_pose_key(k) for k in range(problem.n_nodes)]
    for a, b, w, t, one in zip(e.a.tolist(), e.b.tolist(), e.w.tolist(), e.t.tolist(), information, strict=True):
        noise = gtsam.noiseModel.Gaussian.Information(one, False)
        graph.push_back(gtsam.BetweenFactorSimilarity2(keys[a], keys[b], _similarity(w, t), noise))
    for node in problem.fixed.tolist():
        at = _similarity(complex(state.w[node]), complex(state.t[node]))
        graph.push_back(gtsam.PriorFactorSimilarity2(keys[node], at, gtsam.noiseModel.Diagonal.Sigmas(GAUGE_SIGMA)))
    return graph


def _values(state: State) -> gtsam.Values:
    values = gtsam.Values()
    for k, (w, t) in enumerate(zip(state.w, state.t, strict=True)):
        values.insert(_pose_key(k), _similarity(complex(w), complex(t)))
    for key, points in ((_drift_key, state.drift), (_bias_key, state.bias)):
        for k, z in enumerate(points):
            values.insert(key(k), np.array([z.real, z.imag]))
    return values


def _state(values: gtsam.Values, problem: Problem) -> State:
    n, d, f = problem.n_nodes, len(problem.drift), len(problem.bias_sigma_m)
    w, t = np.empty(n, complex), np.empty(n, complex)
    for k in range(n):
        pose = values.atSimilarity2(_pose_key(k))
        s = pose.scale()
        w[k] = complex(math.log(s), pose.rotation().theta())
        t[k] = s * complex(*pose.translation())
    drift = np.array([complex(*values.atPoint2(_drift_key(k))) for k in range(d)], complex)
    bias = np.array([complex(*values.atPoint2(_bias_key(k))) for k in range(f)], complex)
    return State(w, t, drift, bias)


def _add_unary(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, problem: Problem, weights: Weights, state: State
) -> None:
    """Add fixes, drift, bias, points, scales and headings, linear about ``state`` in the tangent space of each pose."""

    def add(blocks: list[tuple[int, FloatArray]], rhs: FloatArray) -> None:
        flat: list[Any] = [part for block in blocks for part in block]
        flat += [rhs, gtsam.noiseModel.Unit.Create(len(rhs))]
        graph.push_back(gtsam.LinearContainerFactor(gtsam.JacobianFactor(*flat), values))

    p = problem.positions
    linear = np.exp(state.w[p.node])
    residual = position_residuals(problem, state)
    for k in range(len(p)):
        root = np.linalg.cholesky(weights.positions[k] * p.information[k]).T
        z = linear[k]
        to_pose = np.zeros((2, 4))
        to_pose[:, :2] = [[z.real, -z.imag], [z.imag, z.real]]
        blocks = [(_pose_key(int(p.node[k])), root @ to_pose)]
        if p.drift[k] >= 0:
            blocks.append((_drift_key(int(p.drift[k])), root))
        if p.bias[k] >= 0:
            blocks.append((_bias_key(int(p.bias[k])), root))
        add(blocks, -root @ residual[k])
    jacobian, miss = point_jacobians(problem, state), point_residuals(problem, state)
    for k in range(len(problem.points)):
        root = np.linalg.cholesky(weights.points[k] * problem.points.information[k]).T
        blocks = [(_pose_key(int(problem.points.node[k])), root @ jacobian[k])]
        if problem.points.bias[k] >= 0:
            blocks.append((_bias_key(int(problem.points.bias[k])), root))
        add(blocks, -root @ miss[k])
    for terms, residuals, weight, column in (
        (problem.scales, scale_residuals(problem, state), weights.scales, 3),
        (problem.headings, heading_residuals(problem, state), weights.headings, 2),
    ):
        for k in range(len(terms)):
            precision = math.sqrt(weight[k]) / terms.sigma[k]
            row = np.zeros((1, 4))
            row[0, column] = precision
            add([(_pose_key(int(terms.node[k])), row)], np.array([-precision * residuals[k]]))
    step = drift_residuals(problem, state)
    for k in range(len(problem.drift)):
        precision = 1.0 / problem.drift.step_sigma_m[k]
        blocks = [(_drift_key(k), precision * np.eye(2))]
        if problem.drift.previous[k] >= 0:
            blocks.append((_drift_key(int(problem.drift.previous[k])), -precision * problem.drift.phi[k] * np.eye(2)))
        add(blocks, -precision * np.array([step[k].real, step[k].imag]))
    for k, sigma in enumerate(problem.bias_sigma_m.tolist()):
        z = complex(state.bias[k])
        add([(_bias_key(k), np.eye(2) / sigma)], -np.array([z.real, z.imag]) / sigma)
