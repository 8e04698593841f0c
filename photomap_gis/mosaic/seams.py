"""Where neighbouring frames meet: seams that go around objects, found at the nodes of a tile's lattice.

Left to ``choice``, two frames meet on a straight line, whatever stands there; a roof that leans to the left in one and
to the right in the other is cut. Within a band about that line the seam is free. The band is flooded from both its
sides, where frames disagree first (what stands out is swallowed whole by one of them), where they agree last: there the
floods meet, as a watershed [1] on the picture of what two frames have in common.

Neighbouring tiles agree without knowing each other: who gives the nodes along a common edge is settled by these nodes
alone (the same flood along a line, between corners that are left to ``choice``), and the inside of a tile then fits.

[1] F. Meyer and S. Beucher: Morphological segmentation. J. Visual Communication and Image Representation 1 (1990).
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from photomap_gis.mosaic.lattice import FloatImage

FREEDOM = 0.05
"""How much dearer (in units of ``choice_cost``) than the cheapest frame another may be and still give a node."""

NOBODY = -1

_DISAGREE = 6.0  # steps of the flood for a grey level by which two frames differ
_ROUGH = 1.5  # and for one of local contrast in them: a seam along an edge shows where it runs through
_MIDDLE = 60.0  # and from the straight line to the band's border: where all is even, seams are straight
_HIGHEST = 255.0

Labels = npt.NDArray[np.int16]


def node_labels(
    costs: FloatImage, greys: Sequence[FloatImage], roughness: Sequence[FloatImage], *, edges: tuple[int, int]
) -> Labels:
    """``(rows, columns)`` index of the frame that gives each node of a tile's lattice, -1 where none sees it.

    ``costs`` is ``(K, rows, columns)``, infinite where a frame does not see the node; ``greys`` and ``roughness`` are K
    pictures of the frames at the nodes, levelled. ``edges`` are the first and the last row, and column, that the tile
    shares with its neighbours.
    """
    best = np.argmin(costs, axis=0).astype(np.int16)
    least = np.min(costs, axis=0)
    best[~np.isfinite(least)] = NOBODY
    if len(costs) < 2 or (best == best.flat[0]).all():
        return best
    height, free = _relief(costs, least, greys, roughness)
    with np.errstate(invalid="ignore"):
        allowed = costs - least <= 2.0 * FREEDOM  # NaN where nobody sees the node
    labels = best.copy()
    first, last = edges
    corners = np.ix_((first, last), (first, last))
    for at in (first, last):
        for line in (np.s_[at : at + 1, first : last + 1], np.s_[first : last + 1, at : at + 1]):
            free_here = free[line].copy()
            free_here.flat[0] = free_here.flat[-1] = False
            # Along an edge only frames that are the cheapest somewhere on it: both tiles know of these.
            known = np.isin(np.arange(len(costs)), best[line])[:, None, None]
            labels[line] = flood(height[line], best[line], free_here, allowed[(slice(None), *line)] & known)
    labels[corners] = best[corners]
    # The nodes just beyond an edge go with it: pixels between are interpolated from both.
    free[:, [first - 1, first, last - 1, last]] = free[[first - 1, first, last - 1, last], :] = False
    labels[[first - 1, last - 1], first : last + 1] = labels[[first, last], first : last + 1]
    labels[first : last + 1, [first - 1, last - 1]] = labels[first : last + 1, [first, last]]
    return flood(height, labels, free, allowed)


def flood(height: FloatImage, labels: Labels, free: npt.NDArray[np.bool_], allowed: npt.NDArray[np.bool_]) -> Labels:
    """Return the labels with those of ``free`` nodes found anew by a flood of ``height`` from the others.

    ``allowed`` is ``(K, rows, columns)``: who may give a node. A free node that nobody reaches keeps its label.
    """
    out = labels.copy()
    rows, cols = labels.shape
    waiting = free.copy()
    if not waiting.any():
        return out
    # Flat Python lists: the loop is over single nodes, where these are ten times as fast as arrays.
    level, found, still = height.ravel().tolist(), out.ravel().tolist(), waiting.ravel().tolist()
    may = [a.ravel().tolist() for a in allowed]
    queue: list[tuple[float, int, int, int]] = []
    order = 0

    def spread(node: int, label: int, at_least: float) -> None:
        nonlocal order
        r, c = divmod(node, cols)
        for other in (
            node - 1 if c else -1, node + 1 if c + 1 < cols else -1,
            node - cols if r else -1, node + cols if r + 1 < rows else -1,
        ):  # fmt: skip
            if other >= 0 and still[other] and may[label][other]:
                order += 1
                heapq.heappush(queue, (max(level[other], at_least), order, other, label))

    for node in _shores(labels, waiting):
        spread(node, found[node], -np.inf)
    while queue:
        height_here, _, node, label = heapq.heappop(queue)
        if still[node]:
            still[node], found[node] = False, label
            spread(node, label, height_here)
    return np.array(found, dtype=np.int16).reshape(rows, cols)


def _shores(labels: Labels, waiting: npt.NDArray[np.bool_]) -> list[int]:
    """Return the settled nodes beside free ones, row by row."""
    near = np.zeros_like(waiting)
    near[1:] |= waiting[:-1]
    near[:-1] |= waiting[1:]
    near[:, 1:] |= waiting[:, :-1]
    near[:, :-1] |= waiting[:, 1:]
    nodes: list[int] = np.flatnonzero(near & ~waiting & (labels != NOBODY)).tolist()
    return nodes


def _relief(
    costs: FloatImage, least: FloatImage, greys: Sequence[FloatImage], roughness: Sequence[FloatImage]
) -> tuple[FloatImage, npt.NDArray[np.bool_]]:
    """Return when each node is to be flooded, late where a seam does no harm, and which nodes are free."""
    two: npt.NDArray[Any] = np.argpartition(costs, 1, axis=0)[:2]
    pair = np.take_along_axis(costs, two, axis=0)
    with np.errstate(invalid="ignore"):
        gap = np.abs(pair[1] - pair[0])
        free = gap <= FREEDOM  # NaN and infinite are not
    grey, rough = (np.take_along_axis(np.stack(a), two, axis=0) for a in (greys, roughness))
    harm = _DISAGREE * np.abs(grey[1] - grey[0]) + _ROUGH * rough.mean(axis=0)
    straight = np.where(free, 1.0 - gap / FREEDOM, 0.0)
    return (_HIGHEST - np.minimum(harm, _HIGHEST) + _MIDDLE * straight).astype(np.float32), free
