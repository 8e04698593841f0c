"""The pose graph as arrays: what the solvers, the initial guess and the covariances all compute on.

A similarity of the plane is a pair of complex numbers: ``p_map = exp(w) p_plane + t`` with ``w = log_s + i theta``
and x + iy for a point. All of the group's geometry is then complex-linear, and thousands of edges are one array.

Unknowns, in this order: the poses (4 each, order ``DOF``), the slowly drifting GPS errors (2 each, metres), one
constant GPS bias a flight and one constant error a reference (2 each, metres).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from photomap_gis.core.posegraph import Edge, EdgeKind, PointKind, PointObservation, PositionObservation
from photomap_gis.core.similarity import FloatArray, Similarity2D

ComplexArray = npt.NDArray[np.complex128]
IntArray = npt.NDArray[np.intp]

MIN_WHITE_SIGMA_M = 0.01
"""No fix is trusted beyond this per axis: a zero would be an infinite weight."""
MIN_DRIFT_STEP_M = 0.01
"""The same for the step of the drift between two fixes."""
MIN_POINT_SIGMA_M = 0.002
"""The same for a known point of the ground."""


@dataclass(frozen=True, slots=True, eq=False)
class EdgeTerms:
    """E edges: nodes ``a``, ``b``; measured ``w``, ``t`` of ``T_a_b``; ``(E, 4, 4)`` information; loop or not."""

    a: IntArray
    b: IntArray
    w: ComplexArray
    t: ComplexArray
    information: FloatArray
    loop: npt.NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.a)


@dataclass(frozen=True, slots=True, eq=False)
class PositionTerms:
    """P fixes: node, measured position (x + iy, metres), ``(P, 2, 2)`` **white** information, drift and bias index.

    ``drift`` and ``bias`` are -1 where the fix has none; ``sigma_m`` is the whole marginal one-sigma per axis.
    """

    node: IntArray
    z_m: ComplexArray
    information: FloatArray
    drift: IntArray
    bias: IntArray
    flight: IntArray
    sigma_m: FloatArray

    def __len__(self) -> int:
        return len(self.node)


@dataclass(frozen=True, slots=True, eq=False)
class DriftTerms:
    """D Gauss-Markov states: ``d_k = phi d_previous + N(0, step_sigma_m^2)``; ``previous`` -1 starts a chain."""

    previous: IntArray
    phi: FloatArray
    step_sigma_m: FloatArray

    def __len__(self) -> int:
        return len(self.previous)


@dataclass(frozen=True, slots=True, eq=False)
class ScalarTerms:
    """Observations of one degree of freedom of a pose (its log scale or its angle): node, value, sigma."""

    node: IntArray
    value: FloatArray
    sigma: FloatArray

    @classmethod
    def of(cls, node: Sequence[int], value: Sequence[float], sigma: Sequence[float]) -> ScalarTerms:
        """Return the terms of three lists."""
        return cls(np.asarray(node, np.intp), np.asarray(value, np.float64), np.asarray(sigma, np.float64))

    def plus(self, other: ScalarTerms) -> ScalarTerms:
        """Return both, one after the other."""
        return ScalarTerms(
            np.concatenate([self.node, other.node]),
            np.concatenate([self.value, other.value]),
            np.concatenate([self.sigma, other.sigma]),
        )

    def __len__(self) -> int:
        return len(self.node)


@dataclass(frozen=True, slots=True, eq=False)
class PointTerms:
    """K known points seen in frames: node, place in its plane (x + iy), place on the map (x + iy, metres).

    ``information`` is ``(K, 2, 2)`` of the place on the map, the picture's side included; ``kind`` counts the kinds,
    ``row`` is the observation's index in the graph. ``bias`` is which of the ``reference_sigma_m`` (one a reference)
    is the point's constant error, -1 for none; in a ``Problem`` they are numbered behind the flights' biases.
    """

    node: IntArray
    plane: ComplexArray
    z_m: ComplexArray
    information: FloatArray
    kind: IntArray
    row: IntArray
    bias: IntArray
    reference_sigma_m: FloatArray

    @classmethod
    def none(cls) -> PointTerms:
        """Return no points."""
        i, z = np.zeros(0, np.intp), np.zeros(0, complex)
        return cls(i, z, z, np.zeros((0, 2, 2)), i, i, i, np.zeros(0))

    def after(self, n_flights: int) -> PointTerms:
        """Return the terms with their biases numbered behind those of the flights."""
        return replace(self, bias=np.where(self.bias >= 0, self.bias + n_flights, -1).astype(np.intp))

    def __len__(self) -> int:
        return len(self.node)


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """A value for every unknown: poses ``w``, ``t`` ``(N,)``; ``drift`` ``(D,)``, ``bias`` ``(F,)``, x + iy metres."""

    w: ComplexArray
    t: ComplexArray
    drift: ComplexArray
    bias: ComplexArray

    @classmethod
    def of_poses(cls, w: ComplexArray, t: ComplexArray, problem: Problem) -> State:
        """Return the state with these poses and no GPS error."""
        return cls(w, t, np.zeros(len(problem.drift), complex), np.zeros(len(problem.bias_sigma_m), complex))

    def moved(self, step: FloatArray) -> State:
        """Return ``T Exp(xi)`` for every pose, and the other unknowns plus their part of the ``(n,)`` step."""
        n, d = len(self.t), len(self.drift)
        xi = step[: 4 * n].reshape(n, 4)
        rest = step[4 * n :].reshape(-1, 2) @ (1, 1j)
        u, dw = xi[:, 0] + 1j * xi[:, 1], xi[:, 3] + 1j * xi[:, 2]
        w = self.w + dw
        return State(
            w.real + 1j * np.remainder(w.imag + np.pi, 2 * np.pi) - 1j * np.pi,
            self.t + np.exp(self.w) * left_jacobian(dw) * u,
            self.drift + rest[:d],
            self.bias + rest[d:],
        )

    def pose(self, node: int) -> Similarity2D:
        """Return one pose as a value."""
        w, t = complex(self.w[node]), complex(self.t[node])
        return Similarity2D(t.real, t.imag, w.imag, w.real)


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """A pose graph in arrays; ``fixed`` nodes are held where they start (the gauge of a map without a fix)."""

    n_nodes: int
    edges: EdgeTerms
    positions: PositionTerms
    drift: DriftTerms
    bias_sigma_m: FloatArray
    scales: ScalarTerms
    headings: ScalarTerms
    fixed: IntArray
    points: PointTerms = field(default_factory=PointTerms.none)

    @property
    def size(self) -> int:
        """The number of unknowns."""
        return 4 * self.n_nodes + 2 * len(self.drift) + 2 * len(self.bias_sigma_m)


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """What the robust solver grants each term: a factor on its information, 0 (put aside) to 1."""

    edges: FloatArray
    positions: FloatArray
    scales: FloatArray
    headings: FloatArray
    points: FloatArray = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def ones(cls, problem: Problem) -> Weights:
        """Return full trust in everything."""
        p = problem
        return cls(*(np.ones(len(terms)) for terms in (p.edges, p.positions, p.scales, p.headings, p.points)))

    def with_edges(self, edges: FloatArray) -> Weights:
        """Return these weights with other ones for the edges."""
        return replace(self, edges=edges)


def left_jacobian(w: ComplexArray) -> ComplexArray:
    """``V(w) = (e^w - 1) / w``, by its series near 0 (where the quotient would lose all digits)."""
    small = np.abs(w) < 1e-3
    safe = np.where(small, 1.0, w)
    return np.where(small, 1 + w / 2 * (1 + w / 3 * (1 + w / 4)), np.expm1(safe) / safe)


def edge_terms(edges: Sequence[Edge], node_of: dict[int, int]) -> EdgeTerms:
    """Return the edges as arrays; ``node_of`` maps frame index to node index."""
    information = np.array([e.covariance for e in edges]).reshape(-1, 4, 4)
    return EdgeTerms(
        np.array([node_of[e.a] for e in edges], np.intp),
        np.array([node_of[e.b] for e in edges], np.intp),
        np.array([complex(e.T_a_b.log_scale, e.T_a_b.angle_rad) for e in edges], complex),
        np.array([complex(e.T_a_b.tx, e.T_a_b.ty) for e in edges], complex),
        _inverse_spd(information),
        np.array([e.kind is EdgeKind.LOOP for e in edges], bool),
    )


def position_terms(
    observations: Iterable[PositionObservation], node_of: dict[int, int]
) -> tuple[PositionTerms, DriftTerms, FloatArray]:
    """Return the fixes, their Gauss-Markov chains (one a flight, in order of time) and one bias sigma a flight."""
    kept = sorted(
        (
            o
            for o in observations
            if o.frame in node_of and np.isfinite([*o.xy_map_m, *np.ravel(o.covariance_m2)]).all()
        ),
        key=lambda o: (o.flight, math.inf if o.time_s is None else o.time_s, o.frame),
    )
    previous: list[int] = []
    drift: list[int] = []
    phi: list[float] = []
    step: list[float] = []
    last: PositionObservation | None = None
    for o in kept:
        if o.time_s is None or o.correlated_sigma_m <= 0.0:
            drift.append(-1)
            continue
        f, sigma = 0.0, o.correlated_sigma_m
        if last is not None and last.flight == o.flight and last.time_s is not None:
            f = math.exp(-max(o.time_s - last.time_s, 0.0) / max(o.correlation_time_s, 1e-3))
            sigma = max(sigma * math.sqrt(1.0 - f * f), MIN_DRIFT_STEP_M)
        drift.append(len(previous))
        previous.append(len(previous) - 1 if f > 0.0 else -1)
        phi.append(f)
        step.append(sigma)
        last = o
    covariance = np.array([o.covariance_m2 for o in kept]).reshape(-1, 2, 2)
    shared = np.array([o.correlated_sigma_m**2 if d >= 0 else 0.0 for o, d in zip(kept, drift, strict=True)])
    flights = sorted({o.flight for o in kept if o.bias_sigma_m > 0.0})
    bias_of = {flight: k for k, flight in enumerate(flights)}
    sigmas = [float(np.median([o.bias_sigma_m for o in kept if o.flight == f and o.bias_sigma_m > 0])) for f in flights]
    terms = PositionTerms(
        np.array([node_of[o.frame] for o in kept], np.intp),
        np.array([complex(*o.xy_map_m) for o in kept], complex),
        _inverse_spd(covariance - shared[:, None, None] * np.eye(2), floor=MIN_WHITE_SIGMA_M**2),
        np.array(drift, np.intp),
        np.array([bias_of[o.flight] if o.bias_sigma_m > 0.0 else -1 for o in kept], np.intp),
        np.array([o.flight for o in kept], np.intp),
        np.sqrt(np.trace(covariance, axis1=1, axis2=2) / 2.0),
    )
    chains = DriftTerms(np.array(previous, np.intp), np.array(phi, np.float64), np.array(step, np.float64))
    return terms, chains, np.maximum(np.array(sigmas, np.float64), 1e-3)


def point_terms(
    observations: Sequence[PointObservation], node_of: dict[int, int], gsd_m_per_px: FloatArray
) -> PointTerms:
    """Return the points that enter the fit; ``gsd_m_per_px`` is ``(N,)`` what a pixel of each node's plane measures.

    Where a point was surveyed a hand's breadth off, it is so in every picture: n observations of a name say no more
    of its place than one, so each carries n times that covariance beside its own error in the picture. A reference
    is off by one and the same vector everywhere: that is an unknown of its own, of the covariance's sigma.
    """
    numbers = ((*o.xy_plane, *o.xy_map_m, *np.ravel(o.covariance_m2), o.sigma_px) for o in observations)
    finite = [bool(np.isfinite(n).all()) for n in numbers]
    rows = [k for k, o in enumerate(observations) if not o.check and o.frame in node_of and finite[k]]
    kept = [observations[k] for k in rows]
    seen = Counter((o.kind, o.name) for o in kept if o.name)
    references = sorted({o.name for o in kept if o.kind is PointKind.REFERENCE})
    biased = [o.kind is PointKind.REFERENCE for o in kept]
    node = np.array([node_of[o.frame] for o in kept], np.intp)
    share = [0 if b else seen.get((o.kind, o.name), 1) for o, b in zip(kept, biased, strict=True)]
    place = np.array([o.covariance_m2 * n for o, n in zip(kept, share, strict=True)]).reshape(-1, 2, 2)
    picture = np.array([o.sigma_px for o in kept]) * gsd_m_per_px[node]
    kinds = list(PointKind)
    return PointTerms(
        node,
        np.array([complex(*o.xy_plane) for o in kept], complex),
        np.array([complex(*o.xy_map_m) for o in kept], complex),
        _inverse_spd(place + (picture**2)[:, None, None] * np.eye(2), floor=MIN_POINT_SIGMA_M**2),
        np.array([kinds.index(o.kind) for o in kept], np.intp),
        np.array(rows, np.intp),
        np.array([references.index(o.name) if b else -1 for o, b in zip(kept, biased, strict=True)], np.intp),
        np.array([_constant_sigma([o for o, b in zip(kept, biased, strict=True) if b and o.name == r])
                  for r in references]),
    )  # fmt: skip


def _constant_sigma(observations: Sequence[PointObservation]) -> float:
    """Return the sigma per axis of a reference's constant error."""
    covariance = np.mean([o.covariance_m2 for o in observations], axis=0)
    return max(math.sqrt(float(np.trace(covariance)) / 2.0), MIN_POINT_SIGMA_M)


def _inverse_spd(covariance: FloatArray, floor: float = 0.0) -> FloatArray:
    """Invert ``(n, k, k)`` covariances that may be all but singular: eigenvalues are held above ``floor`` and 1e-12."""
    if not len(covariance):
        return covariance
    # Angles (1e-4 rad) and pixels (1) meet in one matrix: bring it to unit diagonal before eigenvalues are compared.
    scale = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), max(floor, 1e-30)))
    unit = covariance / scale[:, :, None] / scale[:, None, :]
    values, vectors = np.linalg.eigh((unit + unit.transpose(0, 2, 1)) / 2.0)
    values = np.maximum(values, np.maximum(1e-9, floor / scale.max(axis=1, keepdims=True) ** 2))
    inverse = np.einsum("nij,nj,nkj->nik", vectors, 1.0 / values, vectors)
    return inverse / scale[:, :, None] / scale[:, None, :]
