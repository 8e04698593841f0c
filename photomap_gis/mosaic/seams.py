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

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled
from photomap_gis.mosaic.lattice import FloatImage
from photomap_gis.mosaic.watershed import flood_along, flood_plane

BAND = 0.08
"""How far from the straight line a seam may run, in half diagonals of a frame."""

BAND_OF_SPACING = 0.25
"""And in distances of the two frames' middles: every frame keeps the heart of its cell."""

SLIVER_NODES = 4
"""A frame that gives a tile fewer nodes than this, none on its edge, leaves them to others that see them."""

NOBODY = -1

_DISAGREE = 6.0  # steps of the flood for a grey level by which two frames differ
_ROUGH = 1.5  # and for one of local contrast in them: a seam along an edge shows where it runs through
_MIDDLE = 60.0  # and from the straight line to the band's border: where all is even, seams are straight
_HIGHEST = 255.0

Labels = npt.NDArray[np.int16]
Flags = npt.NDArray[np.bool_]


class Contest(NamedTuple):
    """Who contends for the nodes: ``two`` is ``(2, rows, columns)`` the cheapest frame and the next, -1 where none is.

    ``gap`` is what the next costs more; up to ``freedom`` of it a node is ``free`` to go to either.
    """

    two: Labels
    gap: FloatImage
    freedom: FloatImage
    free: Flags


Looks = Callable[[Contest], tuple[FloatImage, FloatImage]]
"""Returns ``(2, rows, columns)`` grey levels and roughness of the two frames that contend, where a node is free."""


def node_labels(
    costs: FloatImage, looks: Looks, *, edges: tuple[int, int], half_diagonals_nodes: Sequence[float]
) -> Labels:
    """``(rows, columns)`` index of the frame that gives each node of a tile's lattice, -1 where none sees it.

    ``costs`` is ``(K, rows, columns)``, infinite where a frame does not see the node; ``looks`` tells of pictures of
    the frames at the nodes, levelled. ``edges`` are the first and the last row, and column, that the tile shares with
    its neighbours; ``half_diagonals_nodes`` are half of each frame's diagonal, in nodes.
    """
    costs = np.ascontiguousarray(costs, dtype=np.float32)
    contest = _contest_of(costs, half_diagonals_nodes)
    if not contest.free.any():
        return contest.two[0]
    grey, rough = looks(contest)
    labels = np.empty_like(contest.two[0])
    _settle(costs, contest.two, contest.gap, contest.freedom, contest.free, grey, rough, *edges, labels)
    return labels


def without_slivers(labels: Labels, costs: FloatImage, edges: tuple[int, int]) -> Labels:
    """Return the labels of nodes without those of frames that give a few only (``SLIVER_NODES``), if others see them.

    Frames on the tile's edge stay: there the neighbouring tile must agree.
    """
    counts = np.bincount((labels + 1).reshape(-1), minlength=len(costs) + 1)[1:]
    few = (counts > 0) & (counts < SLIVER_NODES)
    if not few.any():
        return labels
    first, last = edges
    rim = np.ones(labels.shape, dtype=bool)
    rim[first + 2 : last - 2, first + 2 : last - 2] = False
    at_rim = labels[rim]
    few[at_rim[at_rim >= 0]] = False
    rest = costs.copy()
    rest[few] = np.inf
    others = np.argmin(rest, axis=0)
    mine = (labels >= 0) & few[labels] & np.isfinite(rest.min(axis=0))
    return np.where(mine, others, labels).astype(np.int16)


def flood(height: FloatImage, labels: Labels, free: Flags) -> Labels:
    """Return the labels with those of ``free`` nodes found anew by a flood of ``height`` from the others.

    Nodes of infinite height are walls. Each free node goes to the settled one from which the least height must be
    overcome; where nobody reaches it, it keeps its label. That is the cut of a minimum spanning forest [2].
    """
    out = np.empty_like(labels)
    flood_plane(height, labels, free, out)
    return out


def flood_line(height: FloatImage, labels: Labels, free: Flags) -> Labels:
    """Return what ``flood`` does for the nodes of a line, ``(N,)`` each: a run of free nodes is cut at its highest."""
    out = np.empty_like(labels)
    flood_along(height, labels, free, out)
    return out


def _contest_of(costs: FloatImage, half_diagonals_nodes: Sequence[float]) -> Contest:
    shape = costs.shape[1:]
    contest = Contest(
        np.empty((2, *shape), np.int16), np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, bool)
    )
    _rank(costs, np.asarray(half_diagonals_nodes, dtype=np.float32), *contest)
    return contest


@compiled("void(f4[:,:,::1], f4[::1], i2[:,:,::1], f4[:,::1], f4[:,::1], b1[:,::1])")
def _rank(
    costs: FloatImage, half_diagonals: FloatImage, two: Labels, gap: FloatImage, freedom: FloatImage, free: Flags
) -> None:
    count, rows, columns = costs.shape
    for i in range(rows):
        for j in range(columns):
            first = second = NOBODY
            for k in range(count):
                cost = costs[k, i, j]
                if cost < np.inf and (first == NOBODY or cost < costs[first, i, j]):
                    first, second = k, first
                elif cost < np.inf and (second == NOBODY or cost < costs[second, i, j]):
                    second = k
            two[0, i, j], two[1, i, j] = first, second
            gap[i, j], freedom[i, j], free[i, j] = np.inf, 0.0, False
            if second == NOBODY:
                continue
            # Of two frames alike the difference of costs rises evenly, by 2 s a half diagonal, s being their spacing.
            a, b = costs[first], costs[second]
            up, down, left, right = max(i - 1, 0), min(i + 1, rows - 1), max(j - 1, 0), min(j + 1, columns - 1)
            steep_y = ((b[down, j] - a[down, j]) - (b[up, j] - a[up, j])) / (down - up)
            steep_x = ((b[i, right] - a[i, right]) - (b[i, left] - a[i, left])) / (right - left)
            half = 0.5 * (half_diagonals[first] + half_diagonals[second])
            spacing = 0.5 * half * np.sqrt(steep_x * steep_x + steep_y * steep_y)
            gap[i, j] = b[i, j] - a[i, j]
            if np.isfinite(spacing):  # not where one of them does not see the node beside
                freedom[i, j] = 2.0 * spacing * min(BAND, BAND_OF_SPACING * spacing)
                free[i, j] = gap[i, j] <= freedom[i, j]


@compiled("b1(f4[:,:,::1], i2[:,:,::1], f4[:,::1], i8, i8, i8)")
def _may(costs: FloatImage, two: Labels, freedom: FloatImage, label: int, i: int, j: int) -> bool:
    """Whether a frame may give a node: if it costs little more than the cheapest."""
    if label < 0 or two[0, i, j] < 0:
        return False
    return label == two[0, i, j] or costs[label, i, j] - costs[two[0, i, j], i, j] <= 2.0 * freedom[i, j]


@compiled(
    "void(f4[:,:,::1], i2[:,:,::1], f4[:,::1], f4[:,::1], b1[:,::1], f4[:,:,::1], f4[:,:,::1], i8, i8, i2[:,::1])"
)
def _settle(
    costs: FloatImage,
    two: Labels,
    gap: FloatImage,
    freedom: FloatImage,
    free: Flags,
    grey: FloatImage,
    rough: FloatImage,
    first: int,
    last: int,
    labels: Labels,
) -> None:
    rows, columns = gap.shape
    height = np.empty((rows, columns), dtype=np.float32)
    for i in range(rows):
        for j in range(columns):
            harm = straight = 0.0
            if free[i, j]:  # late where a seam does no harm
                harm = _DISAGREE * abs(grey[1, i, j] - grey[0, i, j]) + 0.5 * _ROUGH * (rough[0, i, j] + rough[1, i, j])
                straight = 1.0 - gap[i, j] / freedom[i, j] if freedom[i, j] > 0.0 else 0.0
            height[i, j] = _HIGHEST - min(harm, _HIGHEST) + _MIDDLE * straight
    labels[:] = two[0]
    # Along an edge nodes are connected with each other only, and the corners are left to choice.
    length = last + 1 - first
    settled = np.empty(length, dtype=np.int16)
    for n in range(4):
        line = first if n % 2 == 0 else last
        along = height[line, first : last + 1].copy() if n < 2 else height[first : last + 1, line].copy()
        before = two[0, line, first : last + 1].copy() if n < 2 else two[0, first : last + 1, line].copy()
        loose = free[line, first : last + 1].copy() if n < 2 else free[first : last + 1, line].copy()
        loose[0] = loose[-1] = False
        flood_along(along, before, loose, settled)
        for k in range(length):
            i, j = (line, first + k) if n < 2 else (first + k, line)
            if _may(costs, two, freedom, settled[k], i, j):
                labels[i, j] = settled[k]
    # The nodes just beyond an edge go with it: pixels between are interpolated from both.
    for k in range(first, last + 1):
        labels[first - 1, k], labels[last - 1, k] = labels[first, k], labels[last, k]
    for k in range(first, last + 1):
        labels[k, first - 1], labels[k, last - 1] = labels[k, first], labels[k, last]
    inner = free.copy()
    for line in (first - 1, first, last - 1, last):
        inner[line, :] = False
        inner[:, line] = False
    settled_edges = labels.copy()
    flood_plane(height, settled_edges, inner, labels)
    for i in range(rows):
        for j in range(columns):
            if labels[i, j] != two[0, i, j] and not _may(costs, two, freedom, labels[i, j], i, j):
                labels[i, j] = two[0, i, j]
