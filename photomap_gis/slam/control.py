"""Known points of the ground: how they lay a map without fixes on the Earth, and which of them to believe at first.

A handful of points decides where a whole map lies, and one of them may be another street corner. Which ones agree is
found before any of them can bend the map: every pair of them says how the map solved without them would have to move,
the motion that most of them (and the GPS, as sure as it is) can live with is taken, and what it misses widely starts
without trust.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.posegraph import PointObservation
from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.anchor import Fit, align, far_pairs
from photomap_gis.slam.components import IntArray
from photomap_gis.slam.initial import RelativePoses
from photomap_gis.slam.linear import position_residuals, squared_distances
from photomap_gis.slam.problem import ComplexArray, Problem, State, point_terms
from photomap_gis.slam.robust import MEDIAN_CHI2, redescending, spread

LIMIT = 3.5
"""Sigmas beyond which a point does not agree with a motion of the map."""
BEND_SHARE = 1.0 / 6.0
"""By how much of what its GPS may be off a map may bend besides."""
BEND_SHARE_OF_RADIUS = 0.01
"""The same of the points' radius for a map without GPS."""
SAMPLES = 300
ROUNDS = 4


def laid_on_points(
    relative: RelativePoses, points: Sequence[PointObservation], node_of: dict[int, int]
) -> dict[int, Fit]:
    """Return how each component with two or more known points lies on the map, by its label."""
    n = len(relative.w)
    near = point_terms(points, node_of, np.full(n, 1e-6))  # as if the pictures had no error
    found: dict[int, Fit] = {}
    for label in np.unique(relative.labels[near.node]):
        rows = np.flatnonzero(relative.labels[near.node] == label)
        if len({tuple(points[near.row[k]].xy_map_m) for k in rows}) < 2:
            continue
        node = near.node[rows]
        q = np.exp(relative.w[node]) * near.plane[rows] + relative.t[node]
        rough = align(q, near.z_m[rows], _sigma(near.information[rows]))
        if rough is None:
            continue
        terms = point_terms(points, node_of, abs(rough.z) * np.exp(relative.w.real))
        fit = align(q, terms.z_m[rows], _sigma(terms.information[rows]))
        found[int(label)] = fit or rough
    return found


def first_trust(problem: Problem, state: State, labels: IntArray) -> FloatArray:
    """``(K,)`` trust in the known points by a solution that they had no part in; ``labels`` are the nodes' components.

    What the points say is weighed against the fixes of their component: as far as these may be off, the map may move.
    """
    p = problem.points
    q = np.exp(state.w[p.node]) * p.plane + state.t[p.node]
    sigma = _sigma(p.information)
    out = np.ones(len(p))
    for label in np.unique(labels[p.node]):
        rows = np.flatnonzero(labels[p.node] == label)
        prior = _prior(problem, state, np.flatnonzero(labels[problem.positions.node] == label))
        out[rows] = _agreement(q[rows], p.z_m[rows], sigma[rows], prior)
    return out


@dataclass(frozen=True, slots=True)
class _Prior:
    """How far GPS lets a component move: sigma of the shift per axis, and the fixes' radius about their middle."""

    shift_m: float
    radius_m: float


def _prior(problem: Problem, state: State, rows: IntArray) -> _Prior | None:
    """Return what the fixes ``rows`` leave open; ``None`` where there is no fix."""
    p = problem.positions
    if not len(rows):
        return None
    bias = np.zeros(len(rows))
    biased = p.bias[rows] >= 0
    bias[biased] = problem.bias_sigma_m[p.bias[rows][biased]]
    squared = squared_distances(position_residuals(problem, state), p.information)[rows]
    shift = float(np.median(np.hypot(p.sigma_m[rows], bias))) * spread(squared, 2)
    radius = float(np.sqrt(np.mean(np.abs(p.z_m[rows] - p.z_m[rows].mean()) ** 2)))
    return _Prior(shift, max(radius, shift))


def _agreement(q: ComplexArray, z_m: ComplexArray, sigma_m: FloatArray, prior: _Prior | None) -> FloatArray:
    """``(k,)`` trust in points at ``q`` on the map and at ``z_m`` in truth, by the motion that most of them share."""
    n = len(q)
    u, r = q - q.mean(), z_m - q
    radius = float(np.sqrt(np.mean(np.abs(u) ** 2)))
    bend = BEND_SHARE_OF_RADIUS * radius if prior is None else BEND_SHARE * prior.shift_m
    sigma = np.hypot(sigma_m, bend)
    seeds = np.zeros((0, n), bool)
    if prior is None:
        if n < 3:
            return np.ones(n)  # nothing that could contradict
        chosen = far_pairs(q, SAMPLES)
    else:
        alone = np.linspace(0, n - 1, min(n, SAMPLES)).astype(np.intp)
        chosen = np.concatenate([far_pairs(q, SAMPLES), np.stack([alone, alone], axis=1)])
        seeds = np.zeros((1, n), bool)  # no motion at all
    picked = np.zeros((len(chosen), n), bool)
    picked[np.arange(len(chosen))[:, None], chosen] = True
    seeds = np.concatenate([seeds, picked])
    motions = [_motion(u, r, seed / sigma**2, prior) for seed in seeds]
    squared = np.array([np.abs(a + b * u - r) ** 2 for a, b in motions]) / sigma**2
    pulled = np.array([_pull(a, b, prior) for a, b in motions])
    # Points may be worse than they say, all alike: but two that any motion fits excuse nothing.
    widened = max(1.0, float(np.sort(squared, axis=1)[:, n // 2].min()) / MEDIAN_CHI2[2])
    cost = np.minimum(squared / widened, LIMIT**2).sum(axis=1) + pulled
    best = int(np.argmin(cost))
    miss2 = squared[best]
    for _ in range(ROUNDS):
        a, b = _motion(u, r, redescending(miss2 / widened, LIMIT) / (sigma**2 * widened), prior)
        miss2 = np.abs(a + b * u - r) ** 2 / sigma**2
    return redescending(miss2 / widened, LIMIT)


def _motion(u: ComplexArray, r: ComplexArray, weights: FloatArray, prior: _Prior | None) -> tuple[complex, complex]:
    """Return shift ``a`` and turn with growth ``b`` of least ``sum weights |a + b u - r|^2`` and of the prior."""
    hold_a = 1e-12 if prior is None else prior.shift_m**-2.0
    hold_b = 1e-12 if prior is None else (prior.radius_m / prior.shift_m) ** 2
    cross = complex(weights @ u)
    matrix = np.array([[weights.sum() + hold_a, cross], [np.conj(cross), weights @ np.abs(u) ** 2 + hold_b]])
    a, b = np.linalg.solve(matrix, np.array([weights @ r, weights @ (np.conj(u) * r)]))
    return complex(a), complex(b)


def _pull(a: complex, b: complex, prior: _Prior | None) -> float:
    """Squared sigmas by which a motion strains the prior."""
    if prior is None:
        return 0.0
    return (abs(a) ** 2 + abs(b) ** 2 * prior.radius_m**2) / prior.shift_m**2


def _sigma(information: FloatArray) -> FloatArray:
    """``(k,)`` sigma per axis of ``(k, 2, 2)`` information."""
    return np.asarray(np.sqrt(2.0 / np.trace(information, axis1=1, axis2=2)))
