"""Residuals, their derivatives, and the normal equations of a pose graph: all edges at once.

Edge (a, b): ``E = M^-1 A^-1 B``, residual ``log E`` (DOF order, b's axes and pixels). With ``log E = (u, w)``, a
perturbation ``(du, dw)`` on the right gives ``u' = u + (e^w / V) du - u (V' / V) dw`` and ``w' = w + dw``: the
inverse right Jacobian is upper triangular and complex-linear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse

from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.problem import ComplexArray, Problem, State, Weights, left_jacobian

GAUGE_SIGMA = np.array([1e-3, 1e-3, 1e-7, 1e-7])
"""How firmly a fixed pose is held, in the order DOF: far below any measurement, far above rounding."""


def edge_residuals(problem: Problem, state: State) -> FloatArray:
    """``(E, 4)`` ``log(M^-1 A^-1 B)`` of every edge."""
    u, w = _edge_logs(problem, state)
    return np.stack([u.real, u.imag, w.imag, w.real], axis=1)


def position_residuals(problem: Problem, state: State) -> FloatArray:
    """``(P, 2)`` modelled minus measured position, drift and bias taken into account, metres."""
    p = problem.positions
    r = state.t[p.node] - p.z_m + _optional(state.drift, p.drift) + _optional(state.bias, p.bias)
    return np.stack([r.real, r.imag], axis=1)


def point_residuals(problem: Problem, state: State) -> FloatArray:
    """``(K, 2)`` ``T_map_plane p_plane - xy_map`` of every known point, its reference's error added, metres."""
    p = problem.points
    r = np.exp(state.w[p.node]) * p.plane + state.t[p.node] - p.z_m + _optional(state.bias, p.bias)
    return np.stack([r.real, r.imag], axis=1)


def point_jacobians(problem: Problem, state: State) -> FloatArray:
    """``(K, 2, 4)`` derivatives of the points' residuals by their poses: ``e^w (u + p dw)``."""
    p = problem.points
    z = np.exp(state.w[p.node])
    zp = z * p.plane
    by_turn_and_growth = np.stack([np.stack([-zp.imag, zp.real], -1), np.stack([zp.real, zp.imag], -1)], -1)
    return np.concatenate([_complex_blocks(z), by_turn_and_growth], axis=-1)


def scale_residuals(problem: Problem, state: State) -> FloatArray:
    """``(S,)`` log scale minus its observation."""
    return state.w.real[problem.scales.node] - problem.scales.value


def heading_residuals(problem: Problem, state: State) -> FloatArray:
    """``(H,)`` angle minus its observation, within ±pi."""
    difference = state.w.imag[problem.headings.node] - problem.headings.value
    return np.remainder(difference + np.pi, 2 * np.pi) - np.pi


def drift_residuals(problem: Problem, state: State) -> ComplexArray:
    """``(D,)`` ``d_k - phi d_previous``, x + iy metres."""
    d = problem.drift
    return state.drift - d.phi * _optional(state.drift, d.previous)


def squared_distances(residuals: FloatArray, information: FloatArray) -> FloatArray:
    """``(n,)`` ``r^T information r`` for ``(n, k)`` residuals."""
    return np.einsum("ni,nij,nj->n", residuals, information, residuals)


def cost(problem: Problem, state: State, weights: Weights) -> float:
    """Return the weighted sum of squares (chi squared) of everything but the gauge."""
    rd, rb = drift_residuals(problem, state), state.bias
    return float(
        weights.edges @ squared_distances(edge_residuals(problem, state), problem.edges.information)
        + weights.positions @ squared_distances(position_residuals(problem, state), problem.positions.information)
        + weights.points @ squared_distances(point_residuals(problem, state), problem.points.information)
        + weights.scales @ (scale_residuals(problem, state) / problem.scales.sigma) ** 2
        + weights.headings @ (heading_residuals(problem, state) / problem.headings.sigma) ** 2
        + np.sum((np.abs(rd) / problem.drift.step_sigma_m) ** 2)
        + np.sum((np.abs(rb) / problem.bias_sigma_m) ** 2)
    )


def edge_jacobians(problem: Problem, state: State) -> tuple[FloatArray, FloatArray]:
    """``(E, 4, 4)`` derivatives of the edges' residuals by the poses of a and of b."""
    e = problem.edges
    u, w = _edge_logs(problem, state)
    v = left_jacobian(w)
    alpha, beta = np.exp(w) / v, -u * _log_derivative(w, v)
    # T_b_a = B^-1 A = (c, d): its adjoint takes a's perturbation into b's axes
    c = np.exp(state.w[e.a] - state.w[e.b])
    d = (state.t[e.a] - state.t[e.b]) * np.exp(-state.w[e.b])
    one = np.ones_like(c)
    return -_real_blocks(alpha * c, -alpha * d + beta, one), _real_blocks(alpha, beta, one)


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """``H step = -g`` for the step that ``State.moved`` takes."""

    H: sparse.csc_array
    g: FloatArray


def normal_equations(problem: Problem, state: State, weights: Weights) -> NormalEquations:
    """Return Gauss-Newton's normal equations at ``state``; the order of the unknowns is ``problem``'s."""
    builder = _Assembly(problem)
    builder.add_edges(problem, state, weights.edges)
    builder.add_positions(problem, state, weights.positions)
    builder.add_points(problem, state, weights.points)
    n4, d, f = 4 * problem.n_nodes, len(problem.drift), len(problem.bias_sigma_m)
    s, h = problem.scales, problem.headings
    builder.add_scalars(4 * s.node + 3, weights.scales / s.sigma**2, scale_residuals(problem, state))
    builder.add_scalars(4 * h.node + 2, weights.headings / h.sigma**2, heading_residuals(problem, state))
    builder.add_drift(problem, state)
    bias_index = (n4 + 2 * d + np.arange(2 * f)).astype(np.intp)
    bias = np.stack([state.bias.real, state.bias.imag], axis=1).ravel()
    builder.add_scalars(bias_index, np.repeat(problem.bias_sigma_m**-2.0, 2), bias)
    gauge_index = (4 * problem.fixed[:, None] + np.arange(4)).ravel()
    builder.add_scalars(gauge_index, np.tile(GAUGE_SIGMA**-2.0, len(problem.fixed)), np.zeros(len(gauge_index)))
    return builder.finish()


class _Assembly:
    """A builder of the sparse normal matrix: triplets gathered here, summed once."""

    def __init__(self, problem: Problem) -> None:
        self._n = problem.size
        self._rows: list[npt.NDArray[np.intp]] = []
        self._cols: list[npt.NDArray[np.intp]] = []
        self._values: list[FloatArray] = []
        self._g = np.zeros(self._n)

    def add_blocks(self, i: npt.NDArray[np.intp], j: npt.NDArray[np.intp], blocks: FloatArray) -> None:
        """Add ``(n, p, q)`` blocks at first rows ``i`` and first columns ``j``."""
        p, q = blocks.shape[1:]
        rows = i[:, None, None] + np.arange(p)[:, None]
        cols = j[:, None, None] + np.arange(q)
        self._rows.append(np.broadcast_to(rows, blocks.shape).ravel())
        self._cols.append(np.broadcast_to(cols, blocks.shape).ravel())
        self._values.append(blocks.ravel())

    def add_gradient(self, i: npt.NDArray[np.intp], parts: FloatArray) -> None:
        """Add ``(n, p)`` parts of the gradient at first rows ``i``."""
        np.add.at(self._g, i[:, None] + np.arange(parts.shape[1]), parts)

    def add_edges(self, problem: Problem, state: State, weights: FloatArray) -> None:
        e = problem.edges
        if not len(e):
            return
        ja, jb = edge_jacobians(problem, state)
        information = weights[:, None, None] * e.information
        left_a, left_b = ja.transpose(0, 2, 1) @ information, jb.transpose(0, 2, 1) @ information
        # Diagonal blocks meet in few places: summing them here halves the triplets.
        diagonal = np.zeros((problem.n_nodes, 4, 4))
        np.add.at(diagonal, e.a, left_a @ ja)
        np.add.at(diagonal, e.b, left_b @ jb)
        off = left_a @ jb
        nodes = 4 * np.arange(problem.n_nodes, dtype=np.intp)
        self.add_blocks(nodes, nodes, diagonal)
        self.add_blocks(4 * e.a, 4 * e.b, off)
        self.add_blocks(4 * e.b, 4 * e.a, off.transpose(0, 2, 1))
        r = edge_residuals(problem, state)[:, :, None]
        self.add_gradient(4 * e.a, (left_a @ r)[:, :, 0])
        self.add_gradient(4 * e.b, (left_b @ r)[:, :, 0])

    def add_positions(self, problem: Problem, state: State, weights: FloatArray) -> None:
        p = problem.positions
        if not len(p):
            return
        information = weights[:, None, None] * p.information
        r = (information @ position_residuals(problem, state)[:, :, None])[:, :, 0]
        to_pose = _complex_blocks(np.exp(state.w[p.node]))
        n4 = 4 * problem.n_nodes
        eye = np.broadcast_to(np.eye(2), to_pose.shape)
        parts = [(4 * p.node, to_pose, np.ones(len(p), bool))]
        parts.append((n4 + 2 * p.drift, eye, p.drift >= 0))
        parts.append((n4 + 2 * len(problem.drift) + 2 * p.bias, eye, p.bias >= 0))
        for i, ji, has_i in parts:
            self.add_gradient(i[has_i], np.einsum("nij,ni->nj", ji, r)[has_i])
            for j, jj, has_j in parts:
                both = has_i & has_j
                blocks = ji[both].transpose(0, 2, 1) @ information[both] @ jj[both]
                self.add_blocks(i[both], j[both], blocks)

    def add_points(self, problem: Problem, state: State, weights: FloatArray) -> None:
        p = problem.points
        if not len(p):
            return
        j = point_jacobians(problem, state)
        information = weights[:, None, None] * p.information
        r = (information @ point_residuals(problem, state)[:, :, None])[:, :, 0]
        left = j.transpose(0, 2, 1) @ information
        self.add_blocks(4 * p.node, 4 * p.node, left @ j)
        self.add_gradient(4 * p.node, np.einsum("nij,ni->nj", j, r))
        has = p.bias >= 0
        node, bias = 4 * p.node[has], 4 * problem.n_nodes + 2 * len(problem.drift) + 2 * p.bias[has]
        self.add_blocks(node, bias, left[has])
        self.add_blocks(bias, node, left[has].transpose(0, 2, 1))
        self.add_blocks(bias, bias, information[has])
        self.add_gradient(bias, r[has])

    def add_drift(self, problem: Problem, state: State) -> None:
        d = problem.drift
        if not len(d):
            return
        information = d.step_sigma_m**-2.0
        r = drift_residuals(problem, state)
        r2 = np.stack([r.real, r.imag], axis=1) * information[:, None]
        here = (4 * problem.n_nodes + 2 * np.arange(len(d))).astype(np.intp)
        linked = d.previous >= 0
        there = 4 * problem.n_nodes + 2 * d.previous[linked]
        eye, phi, q = np.eye(2), d.phi[linked, None, None], information[linked, None, None]
        self.add_blocks(here, here, information[:, None, None] * eye)
        self.add_blocks(there, there, phi * phi * q * eye)
        self.add_blocks(here[linked], there, -phi * q * eye)
        self.add_blocks(there, here[linked], -phi * q * eye)
        self.add_gradient(here, r2)
        self.add_gradient(there, -d.phi[linked, None] * r2[linked])

    def add_scalars(self, index: npt.NDArray[np.intp], information: FloatArray, residual: FloatArray) -> None:
        self.add_blocks(index, index, information[:, None, None])
        self.add_gradient(index, (information * residual)[:, None])

    def finish(self) -> NormalEquations:
        triplets = (np.concatenate(self._values), (np.concatenate(self._rows), np.concatenate(self._cols)))
        return NormalEquations(sparse.coo_array(triplets, shape=(self._n, self._n)).tocsc(), self._g)


def _edge_logs(problem: Problem, state: State) -> tuple[ComplexArray, ComplexArray]:
    """``u``, ``w`` of ``log(M^-1 A^-1 B)`` for every edge."""
    e = problem.edges
    wa, wb = state.w[e.a], state.w[e.b]
    w = wb - wa - e.w
    w = w.real + 1j * (np.remainder(w.imag + np.pi, 2 * np.pi) - np.pi)
    t = ((state.t[e.b] - state.t[e.a]) * np.exp(-wa) - e.t) * np.exp(-e.w)
    return t / left_jacobian(w), w


def _log_derivative(w: ComplexArray, v: ComplexArray) -> ComplexArray:
    """``V'(w) / V(w)`` where ``V' = (e^w - V) / w``; its series near 0."""
    small = np.abs(w) < 1e-3
    safe = np.where(small, 1.0, w)
    return np.where(small, 0.5 + w / 12.0, (np.exp(safe) / np.where(small, 1.0, v) - 1.0) / safe)


def _complex_blocks(z: ComplexArray) -> FloatArray:
    """``(n, 2, 2)`` real matrices of multiplication by z on (x, y)."""
    return np.stack([np.stack([z.real, -z.imag], -1), np.stack([z.imag, z.real], -1)], -2)


def _real_blocks(du: ComplexArray, dw: ComplexArray, one: ComplexArray) -> FloatArray:
    """``(n, 4, 4)`` real matrices of ``(u, w) -> (du u + dw w, one w)`` in the order DOF (theta before log s)."""
    m = np.zeros((len(du), 4, 4))
    m[:, :2, :2] = _complex_blocks(du)
    # w = log s + i theta, and theta comes first in DOF
    m[:, 0, 2], m[:, 0, 3] = -dw.imag, dw.real
    m[:, 1, 2], m[:, 1, 3] = dw.real, dw.imag
    m[:, 2, 2] = m[:, 3, 3] = one.real
    return m


def _optional(values: ComplexArray, index: npt.NDArray[np.intp]) -> ComplexArray:
    """``values[index]``, 0 where the index is -1."""
    if not len(values):
        return np.zeros(len(index), complex)
    return np.where(index >= 0, values[index], 0.0)
