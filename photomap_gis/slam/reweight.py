"""Robust optimisation around a least-squares backend: judge every term by its residual, weigh, minimise, repeat.

Residuals are judged against the spread found in their kind (edges; fixes, flight by flight; known points): what is
worse than it says all alike is widened, and only what stands out of its kind is put aside. The spread shrinks as the
solution improves, which grades the rejection by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.linear import (
    edge_residuals,
    heading_residuals,
    point_residuals,
    position_residuals,
    squared_distances,
)
from photomap_gis.slam.problem import Problem, State, Weights
from photomap_gis.slam.robust import REJECTED_BELOW, redescending, spread

EDGE_LIMIT = 4.0
POSITION_LIMIT = 3.5
POINT_LIMIT = 3.5
HEADING_LIMIT = 3.0
"""Sigmas (of the spread found) beyond which a term loses its weight."""
MIN_JUDGED = 8
"""A flight of fewer fixes says nothing of their spread."""
BEYOND_MODEL = 1.5
"""Spread from which fixes miss the map by more than noise, drift and bias explain."""
MAX_ALIKE = 0.95
"""Correlation of neighbouring misses that is believed at most."""
LEAST_EDGE_SPREAD = 0.5
"""Edges that agree among each other far better than they claim, in a graph full of loops, are believed that far."""
MAX_ROUNDS = 16
ITERATIONS_A_ROUND = 2
"""Weights and poses converge together: perfect poses for weights that will change are time lost."""
SETTLED_PX = 0.2
"""Poses that new weights move by less than this have settled: what is left to move is a tenth of it."""


class Minimise(Protocol):
    """What a backend offers: weighted least squares from a start."""

    def __call__(self, problem: Problem, weights: Weights, start: State, *, max_iterations: int = 20) -> State:
        """Return the state of least weighted squares."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class RobustState:
    """A robust solution: ``trust`` are weights 0..1 of the terms; ``effective`` also holds the spread found."""

    state: State
    trust: Weights
    effective: Weights


def optimise(problem: Problem, start: State, trust: Weights, minimise: Minimise) -> RobustState:
    """Return the robust solution that re-weighting reaches from ``start``, beginning with these trusts."""
    if not problem.n_nodes:
        return RobustState(start, trust, trust)
    redundancy = _redundancy(problem)
    trust = replace(trust, positions=_first_trust(problem, start))
    state, effective = start, trust
    for round_ in range(MAX_ROUNDS):
        last = state
        state = minimise(problem, effective, state, max_iterations=ITERATIONS_A_ROUND)
        moved_px = float((np.abs(state.t - last.t) / np.exp(state.w.real)).max())
        edges = squared_distances(edge_residuals(problem, state), problem.edges.information)
        fixes = squared_distances(position_residuals(problem, state), problem.positions.information)
        points = squared_distances(point_residuals(problem, state), problem.points.information)
        headings = (heading_residuals(problem, state) / problem.headings.sigma) ** 2
        edge_spread = spread(edges, 4, redundancy, least=LEAST_EDGE_SPREAD if redundancy > 0.5 else 1.0)
        fix_spread = _spread_by_flight(problem, fixes)
        point_spread = _spread_by_kind(problem, points, trust.points)
        renewed = Weights(
            redescending(edges / edge_spread**2, EDGE_LIMIT),
            redescending(fixes / fix_spread**2, POSITION_LIMIT),
            trust.scales,
            redescending(headings, HEADING_LIMIT),
            redescending(points / point_spread**2, POINT_LIMIT),
        )
        trust = renewed
        effective = Weights(
            trust.edges / edge_spread**2,
            trust.positions / fix_spread**2,
            trust.scales,
            trust.headings,
            trust.points / point_spread**2,
        )
        if round_ and moved_px < SETTLED_PX:
            break
    return RobustState(state, trust, effective)


def _first_trust(problem: Problem, start: State) -> FloatArray:
    """``(P,)`` trust in the fixes by how far they lie from the start, before any of them could bend it."""
    residuals = position_residuals(problem, start)
    squared = np.einsum("ni,ni->n", residuals, residuals) / problem.positions.sigma_m**2
    return redescending(squared / _spread_by_flight(problem, squared) ** 2, POSITION_LIMIT)


def _redundancy(problem: Problem) -> float:
    """Share of the edges that a spanning forest does not use up."""
    return 1.0 - min(1.0, (problem.n_nodes - 1) / max(len(problem.edges), 1))


def _spread_by_flight(problem: Problem, squared: FloatArray) -> FloatArray:
    """``(P,)`` spread of each fix's flight; flights of few fixes are judged together."""
    flight = problem.positions.flight
    out = np.full(len(squared), spread(squared, 2))
    for f in np.unique(flight):
        rows = flight == f
        if rows.sum() >= MIN_JUDGED:
            out[rows] = spread(squared[rows], 2)
    return out


def _spread_by_kind(problem: Problem, squared: FloatArray, trust: FloatArray) -> FloatArray:
    """``(K,)`` spread of each known point's kind, by those that are trusted; where none is, it excuses none of them."""
    kind = problem.points.kind
    out = np.ones(len(squared))
    for k in np.unique(kind):
        rows = kind == k
        trusted = rows & (trust > REJECTED_BELOW)
        out[rows] = spread(squared[trusted], 2)
    return out


def repetition(problem: Problem, state: State) -> FloatArray:
    """``(P,)`` by what factor a fix's flight has fewer independent fixes than it has fixes, where they miss the map.

    Fixes that miss by more than they say, neighbours alike (an unlevelled camera that banks, a receiver that lags),
    do not average out: with correlation r of neighbours, n of them are worth ``n (1 - r) / (1 + r)``. Fixes that fit
    as well as they say have their drift modelled, and count in full.
    """
    residuals = position_residuals(problem, state)
    squared = squared_distances(residuals, problem.positions.information)
    out = np.ones(len(squared))
    for f in np.unique(problem.positions.flight):
        rows = np.flatnonzero(problem.positions.flight == f)
        if len(rows) < MIN_JUDGED or spread(squared[rows], 2) < BEYOND_MODEL:
            continue
        rows = rows[np.argsort(problem.positions.node[rows])]
        miss = residuals[rows]
        alike = float(np.sum(miss[1:] * miss[:-1]) / np.sum(miss * miss))
        alike = min(max(alike, 0.0), MAX_ALIKE)
        out[rows] = (1.0 + alike) / (1.0 - alike)
    return out
