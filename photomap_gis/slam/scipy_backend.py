"""The second solver: Levenberg-Marquardt on the arrays themselves, for machines without gtsam, and gtsam's twin."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.blocktri import BlockFactor, factor
from photomap_gis.slam.linear import cost, normal_equations
from photomap_gis.slam.problem import Problem, State, Weights

LAMBDA_MAX = 1e8


def minimise(problem: Problem, weights: Weights, start: State, *, max_iterations: int = 20) -> State:
    """Return the state of least weighted squares that Levenberg-Marquardt reaches from ``start``."""
    state, best = start, cost(problem, start, weights)
    damping = 0.0
    for _ in range(max_iterations):
        equations = normal_equations(problem, state, weights)
        while True:
            H = equations.H if damping == 0.0 else _damped(equations.H, damping)
            candidate, value, step = state, np.inf, np.zeros(0)
            try:
                step = -factor_of(problem, H).solve(equations.g)
                candidate = state.moved(step)
                value = cost(problem, candidate, weights)
            except np.linalg.LinAlgError:
                pass
            if value <= best * (1.0 + 1e-12) + 1e-12:
                break
            damping = max(10.0 * damping, 1e-6)
            if damping > LAMBDA_MAX:
                return state
        gained, state, best = best - value, candidate, value
        damping = damping / 10.0 if damping > 1e-6 else 0.0
        if gained <= 1e-6 * best + 1e-9 and float(np.abs(step @ equations.g)) < 1e-6 * (1.0 + best):
            break
    return state


def factor_of(problem: Problem, H: sparse.csc_array) -> BlockFactor:
    """Factor the normal matrix of a problem; the flights' biases are the border."""
    poses = 4 * problem.n_nodes
    group = np.concatenate([np.arange(poses) // 4, np.arange(poses, problem.size)]).astype(np.intp)
    border = np.arange(problem.size - 2 * len(problem.bias_sigma_m), problem.size, dtype=np.intp)
    return factor(H, border, group=group)


def pose_covariances(problem: Problem, state: State, weights: Weights) -> FloatArray:
    """``(N, 4, 4)`` covariance of every pose: the diagonal blocks of the inverse normal matrix."""
    H = normal_equations(problem, state, weights).H
    first = (4 * np.arange(problem.n_nodes)).astype(np.intp)
    return factor_of(problem, H).inverse_diagonal(4, first)


def _damped(H: sparse.csc_array, damping: float) -> sparse.csc_array:
    """``H`` with its diagonal grown by the factor ``1 + damping`` (Marquardt's scaling)."""
    return sparse.csc_array(H + sparse.diags_array(damping * H.diagonal()))
