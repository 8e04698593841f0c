"""Where the frames lie relative to each other, by linear steps that converge from anywhere.

Angles and log scales come first (linear once a tree has unwrapped them), then translations with those held. A joint
linear solution would shrink the scale; the decoupled one does not. Every step is robust by graduated non-convexity
[1]: plain least squares first, then Geman-McClure's weights ever narrower, so that false edges lose their pull
before any of them is decided upon.

[1] Yang, Antonante, Tzoumas, Carlone: Graduated Non-Convexity for Robust Spatial Perception, IEEE RA-L 5 (2), 2020.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import splu

from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.components import IntArray, component_labels
from photomap_gis.slam.problem import ComplexArray, EdgeTerms
from photomap_gis.slam.robust import geman_mcclure, redescending, spread

NARROWING = 0.6
"""By what the limit of trust shrinks from round to round."""
FINAL_LIMIT = 4.0
FINAL_ROUNDS = 3
LOOP_SHARE = 0.5
"""What a loop weighs beside a sequential edge while nothing else is known: false loops are the commoner."""
MAX_ROUNDS = 60
TRUST_OF_SEQUENTIAL = 0.8
TRUST_OF_LOOP = 0.5
"""What an edge is taken for where no triangle speaks for or against it."""


@dataclass(frozen=True, slots=True, eq=False)
class RelativePoses:
    """Poses ``w``, ``t`` ``(N,)`` in the frame of each component's first node, the components' labels, edge weights."""

    w: ComplexArray
    t: ComplexArray
    labels: IntArray
    edge_weights: FloatArray


def relative_poses(n_nodes: int, edges: EdgeTerms) -> RelativePoses:
    """Return robust relative poses of all nodes, each component in its own frame."""
    labels = component_labels(n_nodes, edges.a, edges.b)
    anchors = np.unique(labels, return_index=True)[1]
    w = np.zeros(n_nodes, complex)
    t = np.zeros(n_nodes, complex)
    if not len(edges):
        return RelativePoses(w, t, labels, np.zeros(0))
    laplacian = _Laplacian(n_nodes, edges, anchors)
    # information of angle and scale with the translation left free, and of the translation with those held
    sigma = np.sqrt(np.maximum(np.linalg.inv(edges.information)[:, [2, 3], [2, 3]], 1e-16))
    w = _unwrapped(n_nodes, edges, anchors)
    prior = np.where(edges.loop, LOOP_SHARE, 1.0)
    weights, limit = np.ones(len(edges)), np.inf
    for _ in range(MAX_ROUNDS):
        w = w + laplacian.solve(prior * weights / (sigma[:, 0] * sigma[:, 1]), _wrapped(edges.w - _step(w, edges)))
        residual = _wrapped(edges.w - _step(w, edges))
        squared = (residual.imag / sigma[:, 0]) ** 2 + (residual.real / sigma[:, 1]) ** 2
        weights, limit, done = _narrowed(squared, limit)
        if done:
            break
    trusted = weights
    # an error of angle or scale moves the far end of the step
    sigma_t = np.sqrt(2.0 / np.trace(edges.information[:, :2, :2], axis1=1, axis2=2))
    sigma_t = np.hypot(sigma_t, np.abs(edges.t) * np.minimum(np.abs(residual), 0.3)) * np.exp(w.real[edges.a])
    step = np.exp(w[edges.a]) * edges.t
    weights, limit = np.ones(len(edges)), np.inf
    for _ in range(MAX_ROUNDS):
        t = laplacian.solve(prior * trusted * weights / sigma_t**2, step)
        weights, limit, done = _narrowed((np.abs(step - _step(t, edges)) / sigma_t) ** 2, limit)
        if done:
            break
    return RelativePoses(w, t, labels, np.clip(trusted * weights, 1e-12, 1.0))


def _step(x: ComplexArray, edges: EdgeTerms) -> ComplexArray:
    """What the nodes' values say of each edge."""
    return x[edges.b] - x[edges.a]


def _narrowed(squared: FloatArray, limit: float) -> tuple[FloatArray, float, bool]:
    """Weights for the next round of graduated non-convexity, its limit, and whether this was the last."""
    final = FINAL_LIMIT * spread(squared, 2)
    if not np.isfinite(limit):
        limit = float(np.sqrt(squared.max()))
    limit = NARROWING * limit
    if limit <= final:
        return redescending(squared, final), limit, limit <= final * NARROWING**FINAL_ROUNDS
    return geman_mcclure(squared, limit), limit, False


class _Laplacian:
    """A plan: least ``sum weight |x_b - x_a - step|^2``, solved for one set of weights after another."""

    def __init__(self, n_nodes: int, edges: EdgeTerms, anchors: IntArray) -> None:
        self._n, self._a, self._b = n_nodes, edges.a, edges.b
        self._anchors = anchors

    def solve(self, weights: FloatArray, step: ComplexArray) -> ComplexArray:
        """Return ``(N,)`` x with the anchors at 0."""
        n, a, b = self._n, self._a, self._b
        # an edge of no weight must not leave its node hanging on nothing
        weights = np.maximum(weights, 1e-9 * weights.max())
        diagonal = np.bincount(a, weights, n) + np.bincount(b, weights, n)
        diagonal[self._anchors] = diagonal[self._anchors] + max(1.0, float(diagonal.max()))
        rows = np.concatenate([a, b, np.arange(n)])
        cols = np.concatenate([b, a, np.arange(n)])
        values = np.concatenate([-weights, -weights, diagonal])
        matrix = sparse.coo_array((values, (rows, cols)), shape=(n, n)).tocsc()
        pull = weights * step
        rhs = np.stack(
            [
                np.bincount(b, part, n) - np.bincount(a, part, n)
                for part in (np.ascontiguousarray(pull.real), np.ascontiguousarray(pull.imag))
            ],
            axis=1,
        )
        options = {"SymmetricMode": True}
        x = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).solve(rhs)
        return x[:, 0] + 1j * x[:, 1]


def _unwrapped(n_nodes: int, edges: EdgeTerms, anchors: IntArray) -> ComplexArray:
    """``(N,)`` log scale + i angle along the tree of the most trusted edges of each component."""
    trust = _support(n_nodes, edges)
    tree = csgraph.minimum_spanning_tree(
        _lightest(n_nodes, np.minimum(edges.a, edges.b), np.maximum(edges.a, edges.b), 1.1 - trust)
    ).tocoo()
    best: dict[tuple[int, int], int] = {}
    for k in np.argsort(trust, kind="stable"):
        a, b = int(edges.a[k]), int(edges.b[k])
        best[min(a, b), max(a, b)] = int(k)
    w = np.zeros(n_nodes, complex)
    links = sparse.coo_array((np.ones(tree.nnz), (tree.row, tree.col)), shape=(n_nodes, n_nodes)).tocsr()
    for anchor in anchors:
        order, predecessor = csgraph.breadth_first_order(links, anchor, directed=False)
        for node in order[1:]:
            parent = int(predecessor[node])
            k = best[min(parent, int(node)), max(parent, int(node))]
            w[node] = w[parent] + (edges.w[k] if edges.a[k] == parent else -edges.w[k])
    return w


def _support(n_nodes: int, edges: EdgeTerms) -> FloatArray:
    """``(E,)`` 0..1: how well the triangles over an edge agree with its angle and scale."""
    prior = np.where(edges.loop, TRUST_OF_LOOP, TRUST_OF_SEQUENTIAL)
    # log scales turn as angles do here: half an octave off is as bad as a right angle
    total, count = np.zeros(len(edges)), np.zeros(len(edges))
    shape = (n_nodes, n_nodes)
    ones = sparse.coo_array((np.ones(len(edges)), (edges.a, edges.b)), shape=shape).tocsr()
    paths = (ones + ones.T) @ (ones + ones.T)
    for phase in (edges.w.imag, 2.0 * edges.w.real):
        turn = sparse.coo_array((np.exp(1j * phase), (edges.a, edges.b)), shape=shape).tocsr()
        turns = turn + turn.conj().T
        detour = turns @ turns
        total += np.real(np.exp(-1j * phase) * detour[edges.a, edges.b])
        count += np.real(paths[edges.a, edges.b])
    return np.clip((total + 2.0 * prior) / (count + 2.0), 0.0, 1.0)


def _lightest(n_nodes: int, low: IntArray, high: IntArray, cost: FloatArray) -> sparse.csr_array:
    """``(N, N)`` cost of the cheapest edge between two nodes (sparse sums would add parallel edges)."""
    order = np.lexsort((cost, high, low))
    low, high, cost = low[order], high[order], cost[order]
    first = np.ones(len(low), bool)
    first[1:] = (np.diff(low) != 0) | (np.diff(high) != 0)
    return sparse.coo_array((cost[first], (low[first], high[first])), shape=(n_nodes, n_nodes)).tocsr()


def _wrapped(w: ComplexArray) -> ComplexArray:
    """The same with its angle within ±pi."""
    return w.real + 1j * (np.remainder(w.imag + np.pi, 2 * np.pi) - np.pi)
