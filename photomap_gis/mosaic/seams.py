"""Where neighbouring frames meet: seams that go around objects, found at the nodes of a tile's lattice.

Left to ``choice``, two frames meet on a straight line, whatever stands there; a roof that leans to the left in one and
to the right in the other is cut. Within a band about that line the seam is free. The band is flooded from both its
sides, where frames disagree first (what stands out is swallowed whole by one of them), where they agree last: there the
floods meet, as a watershed [1] on the picture of what two frames have in common.

Neighbouring tiles agree without knowing each other: who gives the nodes along a common edge is settled by these nodes
alone (the same flood along a line, between corners that are left to ``choice``), and the inside of a tile then fits.

[1] F. Meyer and S. Beucher: Morphological segmentation. J. Visual Communication and Image Representation 1 (1990).
[2] J. Cousty et al.: Watershed cuts: minimum spanning forests and the drop of water principle. IEEE PAMI 31 (2009).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

from photomap_gis.mosaic.lattice import FloatImage

BAND = 0.08
"""How far from the straight line a seam may run, in half diagonals of a frame."""

BAND_OF_SPACING = 0.25
"""And in distances of the two frames' middles: every frame keeps the heart of its cell."""

NOBODY = -1

_DISAGREE = 6.0  # steps of the flood for a grey level by which two frames differ
_ROUGH = 1.5  # and for one of local contrast in them: a seam along an edge shows where it runs through
_MIDDLE = 60.0  # and from the straight line to the band's border: where all is even, seams are straight
_HIGHEST = 255.0

Labels = npt.NDArray[np.int16]


def node_labels(
    costs: FloatImage,
    greys: Sequence[FloatImage],
    roughness: Sequence[FloatImage],
    *,
    edges: tuple[int, int],
    half_diagonals_nodes: Sequence[float],
) -> Labels:
    """``(rows, columns)`` index of the frame that gives each node of a tile's lattice, -1 where none sees it.

    ``costs`` is ``(K, rows, columns)``, infinite where a frame does not see the node; ``greys`` and ``roughness`` are K
    pictures of the frames at the nodes, levelled. ``edges`` are the first and the last row, and column, that the tile
    shares with its neighbours; ``half_diagonals_nodes`` are half of each frame's diagonal, in nodes.
    """
    best = np.argmin(costs, axis=0).astype(np.int16)
    least = np.min(costs, axis=0)
    best[~np.isfinite(least)] = NOBODY
    if len(costs) < 2 or (best == best.flat[0]).all():
        return best
    with np.errstate(invalid="ignore"):  # where a frame does not see a node its cost is infinite
        height, freedom, free = _relief(costs, greys, roughness, half_diagonals_nodes)
    first, last = edges
    with np.errstate(invalid="ignore"):
        allowed = costs - least <= 2.0 * freedom  # NaN where nobody sees the node
    labels = best.copy()
    # Along an edge nodes are connected with each other only, and the corners are left to choice.
    along = slice(first, last + 1)
    for line in ((first, along), (last, along), (along, first), (along, last)):
        settled = free[line].copy()
        settled[[0, -1]] = False
        labels[line] = flood_line(height[line], best[line], settled)
    edge = np.zeros_like(free)
    edge[[first, last], along] = edge[along, [first, last]] = True
    labels = np.where(edge, _where_allowed(labels, best, allowed), best)
    # The nodes just beyond an edge go with it: pixels between are interpolated from both.
    labels[[first - 1, last - 1], first : last + 1] = labels[[first, last], first : last + 1]
    labels[first : last + 1, [first - 1, last - 1]] = labels[first : last + 1, [first, last]]
    free[:, [first - 1, first, last - 1, last]] = free[[first - 1, first, last - 1, last], :] = False
    return _where_allowed(flood(height, labels, free), best, allowed)


def flood(height: FloatImage, labels: Labels, free: npt.NDArray[np.bool_]) -> Labels:
    """Return the labels with those of ``free`` nodes found anew by a flood of ``height`` from the others.

    Nodes of infinite height are walls. Each free node goes to the settled one from which the least height must be
    overcome; where nobody reaches it, it keeps its label. That is the cut of a minimum spanning forest [2].
    """
    rows, cols = labels.shape
    is_free, label = free.reshape(-1), labels.reshape(-1)
    level = np.where(is_free, height.reshape(-1), -1.0)  # settled nodes are sources: it costs nothing to leave them
    passable = np.isfinite(height).reshape(-1) & (is_free | (label != NOBODY))
    beside = np.zeros((2, rows, cols), dtype=bool)  # pairs that a free node has part in, by their left or upper node
    np.logical_or(free[:, :-1], free[:, 1:], out=beside[0, :, :-1])
    np.logical_or(free[:-1], free[1:], out=beside[1, :-1])
    right, below = np.flatnonzero(beside[0]), np.flatnonzero(beside[1])
    a, b = np.concatenate([right, below]), np.concatenate([right + 1, below + cols])
    use = passable[a] & passable[b]
    a, b = a[use], b[use]
    touched = np.zeros(rows * cols, dtype=bool)
    touched[a] = touched[b] = True
    nodes = np.flatnonzero(touched)
    number = np.empty(rows * cols, dtype=np.int32)
    number[nodes] = np.arange(len(nodes), dtype=np.int32)
    sources = nodes[~is_free[nodes]]
    if not len(sources):
        return labels
    root = len(nodes)  # joins all sources; cut off again, it leaves a tree a source
    first = np.concatenate([number[a], np.full(len(sources), root, dtype=np.int32)])
    second = np.concatenate([number[b], number[sources]])
    weight = np.concatenate([np.maximum(level[a], level[b]) + 2.0, np.full(len(sources), 0.5)])
    order = np.argsort(first, kind="stable")
    starts = np.zeros(root + 2, dtype=np.int32)
    np.cumsum(np.bincount(first, minlength=root + 1), out=starts[1:])
    graph = sparse.csr_matrix((weight[order], second[order], starts), (root + 1, root + 1))
    tree = csgraph.minimum_spanning_tree(graph)
    kept = int(tree.indptr[root])  # the root's ties stand in the last row
    forest = sparse.csr_matrix((tree.data[:kept], tree.indices[:kept], tree.indptr[:-1]), (root, root))
    _, component = csgraph.connected_components(forest, directed=False)
    owner = np.full(len(component), NOBODY, dtype=np.int16)
    owner[component[number[sources]]] = label[sources]
    out = labels.copy()
    found, mine = owner[component], is_free[nodes] & (owner[component] != NOBODY)
    out.reshape(-1)[nodes[mine]] = found[mine]
    return out


def flood_line(height: FloatImage, labels: Labels, free: npt.NDArray[np.bool_]) -> Labels:
    """Return what ``flood`` does for the nodes of a line, ``(N,)`` each: a run of free nodes is cut at its highest."""
    out = labels.copy()
    ends = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(np.int8)))
    for start, stop in zip(ends[::2], ends[1::2], strict=True):
        left = NOBODY if start == 0 else labels[start - 1]
        right = NOBODY if stop == len(labels) else labels[stop]
        if left == NOBODY or right == NOBODY:
            if left != right:
                out[start:stop] = max(left, right)
            continue
        highest = start + int(np.argmax(height[start:stop]))
        out[start : highest + 1], out[highest + 1 : stop] = left, right
    return out


def _where_allowed(labels: Labels, best: Labels, allowed: npt.NDArray[np.bool_]) -> Labels:
    """Return the labels; where a frame may not give its node, the cheapest does."""
    may = np.take_along_axis(allowed, np.maximum(labels, 0)[None].astype(np.intp), axis=0)[0]
    return np.where(may, labels, best)


def _relief(
    costs: FloatImage,
    greys: Sequence[FloatImage],
    roughness: Sequence[FloatImage],
    half_diagonals_nodes: Sequence[float],
) -> tuple[FloatImage, FloatImage, npt.NDArray[np.bool_]]:
    """Return when each node is to be flooded, late where a seam does no harm; its freedom in cost; who is free."""
    cheapest = np.argmin(costs, axis=0)
    others = costs.copy()
    np.put_along_axis(others, cheapest[None], np.inf, axis=0)
    two = np.stack([cheapest, np.argmin(others, axis=0)])
    # Where one frame alone sees a node, what comes second costs infinitely much, whoever it is.
    pair = np.stack([costs.min(axis=0), others.min(axis=0)])
    slopes = [np.take_along_axis(slope, two, axis=0) for slope in _gradients(costs)]
    # Of two frames alike the difference of costs rises evenly, by 2 s a half diagonal, s being their spacing in these.
    half_diagonal = np.asarray(half_diagonals_nodes, dtype=np.float32)[two].mean(axis=0)
    spacing = 0.5 * half_diagonal * np.hypot(*(slope[1] - slope[0] for slope in slopes))
    freedom = 2.0 * spacing * np.minimum(BAND, BAND_OF_SPACING * spacing)
    gap = np.abs(pair[1] - pair[0])
    free = (gap <= freedom) & (gap < np.inf)  # NaN is not
    grey, rough = (np.take_along_axis(np.stack(a), two, axis=0) for a in (greys, roughness))
    harm = _DISAGREE * np.abs(grey[1] - grey[0]) + 0.5 * _ROUGH * (rough[0] + rough[1])
    straight = 1.0 - np.divide(gap, freedom, out=np.ones_like(gap), where=free & (freedom > 0.0))
    height = _HIGHEST - np.minimum(harm, _HIGHEST) + _MIDDLE * straight
    return height.astype(np.float32), freedom, free


def _gradients(costs: FloatImage) -> tuple[FloatImage, FloatImage]:
    """Return the slopes of ``(K, rows, columns)`` along rows and along columns, as ``np.gradient`` takes them."""
    out = np.empty_like(costs), np.empty_like(costs)
    for slope, c in zip(out, (costs, costs.swapaxes(1, 2)), strict=True):
        s = slope if c is costs else slope.swapaxes(1, 2)
        np.subtract(c[:, 2:], c[:, :-2], out=s[:, 1:-1])
        s[:, 1:-1] *= 0.5
        s[:, 0], s[:, -1] = c[:, 1] - c[:, 0], c[:, -1] - c[:, -2]
    return out
