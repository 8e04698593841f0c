"""From a pose graph to poses: initial guess, robust optimisation, covariances, segments.

``solve`` lays out every component by linear steps, puts it on the map, and optimises everything at once (gtsam, or
SciPy's twin where gtsam is missing). Edges that the robust solver puts aside may split the graph: then the parts are
laid on the map anew.
"""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from photomap_gis.core.posegraph import Edge, Pose, PoseGraph, Solution
from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam import scipy_backend
from photomap_gis.slam.anchor import anchor
from photomap_gis.slam.bridges import contradicted_bridges
from photomap_gis.slam.components import IntArray, by_size, component_labels
from photomap_gis.slam.control import first_trust, laid_on_points
from photomap_gis.slam.initial import RelativePoses, relative_poses
from photomap_gis.slam.lag import lags_by_flight, without_lag
from photomap_gis.slam.linear import cost
from photomap_gis.slam.problem import (
    EdgeTerms,
    PointTerms,
    PositionTerms,
    Problem,
    ScalarTerms,
    State,
    Weights,
    edge_terms,
    point_terms,
    position_terms,
)
from photomap_gis.slam.reweight import Minimise, RobustState, optimise, repetition
from photomap_gis.slam.robust import REJECTED_BELOW

logger = logging.getLogger(__name__)

Backend = Literal["auto", "gtsam", "scipy"]

BIAS_LIMIT = 2.45
"""Sigmas per axis that a flight's bias is believed to reach: 95 % of them stay within."""
MAX_SPLITS = 4
"""How often a graph that falls apart under rejection is laid out anew."""


def solve(graph: PoseGraph, *, backend: Backend = "auto", find_lag: bool = True) -> Solution:
    """Return the poses of every frame that the graph ties to something, with covariances.

    With fixes or two known points of the ground, poses are in map metres, and a component without either is left out;
    without, each component of two
    or more frames lies in the frame (pixels) of its first one. Frames with a fix but no accepted edge are placed by
    their fix alone. Fixes that are late by the same time all along a flight are taken for when they were true, unless
    ``find_lag`` is off (the user told the time).
    """
    minimise = backend_named(backend)
    solution = _solved(graph, minimise)
    if not find_lag:
        return solution
    lags = lags_by_flight(solution, graph.positions)
    believed = {flight: lag.lag_s for flight, lag in lags.items() if lag.believed}
    if believed:
        logger.info("fixes are older than their pictures by (s, by flight): %s", believed)
        solution = _solved(replace(graph, positions=without_lag(solution, graph.positions, believed)), minimise)
    return replace(solution, fix_lags=lags)


def backend_named(backend: Backend) -> Minimise:
    """Return a backend's function; ``auto`` takes gtsam where it is installed."""
    if backend == "scipy" or (backend == "auto" and importlib.util.find_spec("gtsam") is None):
        return scipy_backend.minimise
    if backend not in ("auto", "gtsam"):
        raise ValueError(f"backend must be 'auto', 'gtsam' or 'scipy', got {backend!r}")
    from photomap_gis.slam import gtsam_backend  # optional: no wheel on Windows

    return gtsam_backend.minimise


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """The nodes that could be placed, the problem over them, the rows of the edges in it, and its solution."""

    nodes: IntArray
    problem: Problem
    edges: IntArray
    robust: RobustState


def optimised_poses(graph: PoseGraph, *, backend: Backend = "auto") -> Placed:
    """Return the robustly optimised poses of a graph as arrays, without their covariances (for measurements)."""
    return _optimised(graph, backend_named(backend))[0]


def _solved(graph: PoseGraph, minimise: Minimise) -> Solution:
    """Return the solution of the graph as it is; parts that rejected edges leave alone are laid out anew."""
    placed, labels, rejected = _optimised(graph, minimise)
    frames = np.array(sorted(set(graph.frames)), np.intp)
    return _solution(graph, frames, placed, labels, rejected)


def _optimised(graph: PoseGraph, minimise: Minimise) -> tuple[Placed, IntArray, IntArray]:
    """Return the placed nodes, the labels of all nodes' components, and the rows of the rejected edges."""
    frames = np.array(sorted(set(graph.frames)), np.intp)
    node_of = {int(f): k for k, f in enumerate(frames)}
    usable = _usable(graph.edges, node_of)
    edges = edge_terms([graph.edges[k] for k in usable], node_of)
    kept = np.ones(len(edges), bool)
    positions, _, _ = position_terms(graph.positions, node_of)
    for _ in range(MAX_SPLITS):
        kept, relative = _laid_out(len(frames), edges, kept, positions)
        labels = relative.labels
        active = np.flatnonzero(kept)
        placed = _place(graph, frames, _rows(edges, active), relative, minimise)
        kept[active[placed.edges[placed.robust.trust.edges <= REJECTED_BELOW]]] = False
        before, labels = labels, component_labels(len(frames), edges.a[kept], edges.b[kept])
        if np.array_equal(before, labels):
            break
    return placed, labels, np.setdiff1d(np.arange(len(graph.edges)), usable[kept])


def _laid_out(
    n_nodes: int, edges: EdgeTerms, kept: npt.NDArray[np.bool_], positions: PositionTerms
) -> tuple[npt.NDArray[np.bool_], RelativePoses]:
    """Return which edges are left after the fixes have spoken against false bridges, and the poses by those."""
    kept = kept.copy()
    judged: dict[bytes, float] = {}
    while True:
        active = np.flatnonzero(kept)
        relative = relative_poses(n_nodes, _rows(edges, active))
        against = contradicted_bridges(relative, _rows(edges, active), positions, judged)
        if not len(against):
            break
        logger.info("%d registrations on which a part of the map hangs contradict the GPS", len(against))
        kept[active[against]] = False
    return kept, relative


def _place(graph: PoseGraph, frames: IntArray, edges: EdgeTerms, relative: RelativePoses, minimise: Minimise) -> Placed:
    """Anchor and optimise everything that these edges and the graph's observations tie down."""
    node_of = {int(f): k for k, f in enumerate(frames)}
    positions, _, _ = position_terms(graph.positions, node_of)
    scales, headings = _scalars(graph, node_of, relative.labels)
    w, t, fixed = relative.w, relative.t, np.zeros(0, np.intp)
    by_points = laid_on_points(relative, graph.points, node_of)
    if len(positions) or graph.georeferenced:
        anchored = anchor(relative, positions, scales, headings, by_points)
        w, t = anchored.w, anchored.t
        if anchored.heading_flip:
            logger.warning("reported headings point backwards against the flight's motion: they are turned by 180°")
            headings = replace(headings, value=headings.value + np.pi)
        scales, headings = scales.plus(anchored.scales), headings.plus(anchored.headings)
    else:
        alone = np.bincount(relative.labels, minlength=1)[relative.labels] < 2
        w = np.where(alone, complex(np.nan, np.nan), w)
        fixed = np.unique(relative.labels, return_index=True)[1].astype(np.intp)
        scales = headings = ScalarTerms.of([], [], [])
    nodes = np.flatnonzero(np.isfinite(w) & np.isfinite(t))
    new = np.full(len(frames), -1, np.intp)
    new[nodes] = np.arange(len(nodes))
    inside = np.flatnonzero(new[edges.a] >= 0)
    inner = _rows(edges, inside)
    positions, drift, bias = position_terms(graph.positions, {int(frames[k]): int(new[k]) for k in nodes})
    on_map = not len(fixed)
    points = (
        point_terms(graph.points, {int(frames[k]): int(new[k]) for k in nodes}, np.exp(w.real[nodes]))
        if on_map
        else PointTerms.none()
    ).after(len(bias))
    bias = np.concatenate([bias, points.reference_sigma_m])
    problem = Problem(
        len(nodes), replace(inner, a=new[inner.a], b=new[inner.b]), positions, drift, bias,
        _renumbered(scales, new), _renumbered(headings, new), new[fixed][new[fixed] >= 0], points,
    )  # fmt: skip
    start = State.of_poses(w[nodes], t[nodes], problem)
    trust = Weights.ones(problem).with_edges(relative.edge_weights[inside])
    if len(points):
        start, trust = _before_points(problem, start, trust, relative.labels[nodes], minimise)
    robust = optimise(problem, start, trust, minimise)
    if len(points):
        sigma = _shown_bias_sigma(problem, robust.state, len(problem.bias_sigma_m) - len(points.reference_sigma_m))
        if not np.array_equal(sigma, problem.bias_sigma_m):
            problem = replace(problem, bias_sigma_m=sigma)
            robust = optimise(problem, robust.state, robust.trust, minimise)
    return Placed(nodes, problem, inside, robust)


def _shown_bias_sigma(problem: Problem, state: State, n_flights: int) -> FloatArray:
    """``(F,)`` sigmas of the biases; of a flight whose GPS known points contradict, as large as they show its bias.

    A receiver that is 8 m off says nothing of that, and would pull the map by a share of it if it were believed.
    """
    shown = np.abs(state.bias) / np.sqrt(2.0)
    contradicted = (np.abs(state.bias) > BIAS_LIMIT * problem.bias_sigma_m) & (np.arange(len(shown)) < n_flights)
    return np.where(contradicted, shown, problem.bias_sigma_m)


def _before_points(
    problem: Problem, start: State, trust: Weights, labels: IntArray, minimise: Minimise
) -> tuple[State, Weights]:
    """Return the solution without the known points as the start, and how far each of them is to be trusted at first.

    Components that only the points lay on the Earth are held where they start meanwhile.
    """
    hanging = np.setdiff1d(labels, labels[problem.positions.node])
    gauge = np.array([np.flatnonzero(labels == label)[0] for label in hanging], np.intp)
    without = replace(problem, points=PointTerms.none(), fixed=gauge)
    found = optimise(without, start, replace(trust, points=np.zeros(0)), minimise)
    return found.state, replace(found.trust, points=first_trust(problem, found.state, labels))


def _solution(
    graph: PoseGraph, frames: IntArray, placed: Placed, labels: IntArray, rejected: npt.NDArray[np.intp]
) -> Solution:
    """Put poses, covariances, segments and residuals together."""
    problem, robust = placed.problem, placed.robust
    if not problem.n_nodes:
        return Solution((), 0.0, tuple(int(k) for k in rejected), graph.revision)
    worth = robust.effective.positions / repetition(problem, robust.state)
    covariances = scipy_backend.pose_covariances(problem, robust.state, replace(robust.effective, positions=worth))
    segments = by_size(np.unique(labels[placed.nodes], return_inverse=True)[1])
    poses = tuple(
        Pose(int(frames[node]), robust.state.pose(k), covariances[k], int(segments[k]))
        for k, node in enumerate(placed.nodes)
    )
    return Solution(
        poses,
        cost(problem, robust.state, robust.effective),
        tuple(int(k) for k in rejected),
        graph.revision,
        _fit_to_gps(problem, robust, np.bincount(segments)[segments] > 1),
        rejected_points=tuple(int(k) for k in problem.points.row[robust.trust.points <= REJECTED_BELOW]),
    )


def _fit_to_gps(problem: Problem, robust: RobustState, registered: npt.NDArray[np.bool_]) -> float | None:
    """Horizontal RMS of registered frames against their fixes, blunders left out: a residual, never an accuracy."""
    p = problem.positions
    used = registered[p.node] & (robust.trust.positions > REJECTED_BELOW)
    if not used.any():
        return None
    return float(np.sqrt(np.mean(np.abs(robust.state.t[p.node[used]] - p.z_m[used]) ** 2)))


def _scalars(graph: PoseGraph, node_of: dict[int, int], labels: IntArray) -> tuple[ScalarTerms, ScalarTerms]:
    """Return heights and headings as terms, their sigmas widened to what one flight's readings are worth.

    A flight's heights share one error (take-off is not the ground below), its headings another (the mount, the
    magnetic field): n of them in a component say no more than one, so each sigma grows by the root of n.
    """
    terms = []
    for rows in (
        [(o.frame, np.log(o.gsd_m_per_px), o.sigma_log) for o in graph.scales if o.gsd_m_per_px > 0],
        [(o.frame, o.heading_rad, o.sigma_rad) for o in graph.headings],
    ):
        known = [r for r in rows if r[0] in node_of and np.isfinite(r[1]) and r[2] > 0]
        one = ScalarTerms.of([node_of[r[0]] for r in known], [float(r[1]) for r in known], [r[2] for r in known])
        if len(one):
            count = np.bincount(labels[one.node])[labels[one.node]]
            one = replace(one, sigma=one.sigma * np.sqrt(count))
        terms.append(one)
    return terms[0], terms[1]


def _usable(edges: Sequence[Edge], node_of: dict[int, int]) -> IntArray:
    """Rows of the edges that tie two known frames by finite numbers."""
    tied = np.array([k for k, e in enumerate(edges) if e.a != e.b and e.a in node_of and e.b in node_of], np.intp)
    motions = [edges[k].T_a_b for k in tied]
    numbers = np.array([(t.tx, t.ty, t.angle_rad, t.log_scale) for t in motions]).reshape(-1, 4)
    covariances = np.array([edges[k].covariance for k in tied]).reshape(-1, 4, 4)
    finite = np.isfinite(numbers).all(axis=1) & np.isfinite(covariances).all(axis=(1, 2))
    return tied[finite & (np.diagonal(covariances, axis1=1, axis2=2) > 0).all(axis=1)]


def _rows(edges: EdgeTerms, rows: IntArray) -> EdgeTerms:
    """Return some of the edges."""
    return EdgeTerms(
        edges.a[rows], edges.b[rows], edges.w[rows], edges.t[rows], edges.information[rows], edges.loop[rows]
    )


def _renumbered(terms: ScalarTerms, new: IntArray) -> ScalarTerms:
    """Return the terms whose node is kept, under its new number."""
    keep = new[terms.node] >= 0
    return ScalarTerms(new[terms.node[keep]], terms.value[keep], terms.sigma[keep])
