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
from typing import Any

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
    # Along an edge nodes are connected with each other only, and the corners are left to choice.
    edge = np.zeros_like(free)
    edge[[first, last], first : last + 1] = edge[first : last + 1, [first, last]] = True
    settled = ~free
    settled[np.ix_((first, last), (first, last))] = True
    on_edge = flood(np.where(edge, height, np.inf), best, edge & ~settled)
    with np.errstate(invalid="ignore"):
        allowed = costs - least <= 2.0 * freedom  # NaN where nobody sees the node
    labels = np.where(edge, _where_allowed(on_edge, best, allowed), best)
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
    number = np.arange(rows * cols).reshape(rows, cols)
    level = np.where(free, height, -1.0)  # settled nodes are sources: it costs nothing to leave them
    level[~np.isfinite(height)] = np.inf
    a = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    b = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    weight = np.maximum(level.ravel()[a], level.ravel()[b])
    is_free = free.ravel()
    use = (is_free[a] | is_free[b]) & np.isfinite(weight)
    sources = np.unique(np.concatenate([a[use], b[use]]))
    sources = sources[~is_free[sources] & (labels.ravel()[sources] != NOBODY)]
    if not len(sources):
        return labels
    nobody = ~is_free & (labels.ravel() == NOBODY)
    use &= ~(nobody[a] | nobody[b])
    root = np.int64(rows * cols)  # joins all sources; cut off again, it leaves a tree a source
    a, b = np.concatenate([a[use], np.full(len(sources), root)]), np.concatenate([b[use], sources])
    w = np.concatenate([weight[use] + 2.0, np.full(len(sources), 0.5)])
    graph = sparse.csr_matrix((w, (a, b)), (rows * cols + 1, rows * cols + 1))
    tree = csgraph.minimum_spanning_tree(graph).tocoo()
    keep = (tree.row != root) & (tree.col != root)
    forest = sparse.coo_matrix((tree.data[keep], (tree.row[keep], tree.col[keep])), graph.shape)
    _, component = csgraph.connected_components(forest, directed=False)
    owner = np.full(len(component), NOBODY, dtype=np.int16)
    owner[component[sources]] = labels.ravel()[sources]
    found = owner[component[:-1]].reshape(rows, cols)
    return np.where(free & (found != NOBODY), found, labels)


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
    two: npt.NDArray[Any] = np.argpartition(costs, 1, axis=0)[:2]
    pair = np.take_along_axis(costs, two, axis=0)
    slopes = [np.take_along_axis(slope, two, axis=0) for slope in np.gradient(costs, axis=(1, 2))]
    # Of two frames alike the difference of costs rises evenly, by 2 s a half diagonal, s being their spacing in these.
    half_diagonal = np.asarray(half_diagonals_nodes, dtype=np.float32)[two].mean(axis=0)
    spacing = 0.5 * half_diagonal * np.hypot(*(slope[1] - slope[0] for slope in slopes))
    freedom = 2.0 * spacing * np.minimum(BAND, BAND_OF_SPACING * spacing)
    gap = np.abs(pair[1] - pair[0])
    free = gap <= freedom  # NaN is not
    grey, rough = (np.take_along_axis(np.stack(a), two, axis=0) for a in (greys, roughness))
    harm = _DISAGREE * np.abs(grey[1] - grey[0]) + _ROUGH * rough.mean(axis=0)
    straight = 1.0 - np.divide(gap, freedom, out=np.ones_like(gap), where=free & (freedom > 0.0))
    height = _HIGHEST - np.minimum(harm, _HIGHEST) + _MIDDLE * straight
    return height.astype(np.float32), freedom, free
