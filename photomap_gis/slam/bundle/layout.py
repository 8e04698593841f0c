"""How the unknowns of the full solution lie: which views meet in the equations, and in which order they are taken out.

Views that share a spot meet; a flight's views share spots with near ones only. Cut across its longer side the map falls
into slices that touch the next slice and no other, and the equations into a chain of dense blocks. What touches all
(lenses, the surface's bends, a flight's bias, the error of a known place) is kept apart as a border.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.bundle.problem import BundleProblem, IntArray, TieSet

POSE = 6
LEAST_SLICE = 16
"""Views that a slice has at least: smaller ones spend their time in Python."""


@dataclass(frozen=True, slots=True, eq=False)
class Border:
    """Columns of the border: two a lens, the surface's bends, x and y of each flight's bias and each shared place."""

    lenses: int
    bends: int
    flights: IntArray
    places: int

    @property
    def seen(self) -> int:
        """How many columns ties and surface touch: the first ones."""
        return 2 * self.lenses + self.bends

    @property
    def size(self) -> int:
        """All columns."""
        return self.seen + 2 * len(self.flights) + 2 * self.places

    def bias(self, flight: IntArray) -> IntArray:
        """Return the column of the bias's x of each flight."""
        return np.asarray(self.seen + 2 * np.searchsorted(self.flights, flight), np.intp)

    def place(self, group: int) -> int:
        """Return the column of the x of a shared place's error."""
        return self.seen + 2 * len(self.flights) + 2 * group


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """What a slice's rows are put together from: its own columns and the next slice's, counted from its first.

    ``slot``, ``row``, ``column`` ``(E,)`` say which block comes where, ``turned`` that it comes transposed; likewise
    ``scalar``, ``scalar_row``, ``scalar_column`` of the single numbers of drifts: their own, those with their view, and
    those with the next drift, ``F``, ``F`` and ``C`` of them along x.
    """

    begin: int
    size: int
    width: int
    slot: IntArray
    row: IntArray
    column: IntArray
    turned: npt.NDArray[np.bool_]
    scalar: IntArray
    scalar_row: IntArray
    scalar_column: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Where each part of the equations lies.

    ``slots`` are the S pairs of views ``(S, 2)``, ``i <= j``, that have a 6 x 6 block; the first N are the views with
    themselves. Ties of one spot lie together in ``tie_order``, from ``spot_start[p]`` on; ``own_slot`` ``(M,)`` is the
    slot of a tie's two views, ``met_slot`` that of the views of two ties of one spot, spot by spot, first with later.
    ``first`` ``(N,)`` is where a view's unknowns begin, ``width`` where the border does; behind a pose stand the drifts
    of its fix, at ``drift`` ``(F,)`` (-1: none). ``steps`` are as ``FixNoise.steps``.
    """

    border: Border
    slots: IntArray
    tie_order: IntArray
    spot_start: IntArray
    own_slot: IntArray
    met_slot: IntArray
    slices: tuple[Slice, ...]
    first: IntArray
    drift: IntArray
    steps: tuple[IntArray, IntArray, FloatArray]

    @property
    def width(self) -> int:
        """Unknowns before the border."""
        return sum(s.size for s in self.slices)

    @property
    def bytes(self) -> int:
        """Memory that the factored equations take, about."""
        return 8 * (sum(s.size * s.width for s in self.slices) + 3 * max(s.size * s.width for s in self.slices))

    @classmethod
    def of(cls, problem: BundleProblem, bends: int) -> Layout:
        """Return the layout of a problem whose surface has so many bends."""
        ties, n, noise = problem.ties, len(problem.views), problem.fix_noise
        order = np.argsort(ties.spot, kind="stable")
        start = np.searchsorted(ties.spot[order], np.arange(ties.spots + 1))
        met_a, met_b = _met(ties, order, start)
        low = np.concatenate([np.arange(n), np.minimum(ties.a, ties.b), np.minimum(met_a, met_b)])
        high = np.concatenate([np.arange(n), np.maximum(ties.a, ties.b), np.maximum(met_a, met_b)])
        keys, inverse = np.unique(low * n + high, return_inverse=True)
        itself = keys // n == keys % n
        number = np.empty(len(keys), np.intp)
        number[itself], number[~itself] = np.arange(n), n + np.arange(len(keys) - n)
        slots = np.empty((len(keys), 2), np.intp)
        slots[number] = np.stack([keys // n, keys % n], axis=1)
        slot = number[inverse]
        m = len(ties)
        steps = noise.steps
        fix_of = problem.fix_of
        pairs = np.concatenate([slots, np.stack([fix_of[steps[0]], fix_of[steps[1]]], axis=1)])
        slices = _slices(pairs, np.array([v.centre[:2] for v in problem.views]).reshape(-1, 2))
        drifting = np.flatnonzero(noise.drift_sigma > 0.0)
        size = POSE + 2 * np.bincount(fix_of[drifting], minlength=n)
        along = np.concatenate(slices)
        ends = np.cumsum(size[along])
        first = np.empty(n, np.intp)
        first[along] = ends - size[along]
        drift = np.full(len(noise), -1, np.intp)
        behind = np.zeros(n, np.intp)
        for f in drifting.tolist():
            view = int(fix_of[f])
            drift[f] = first[view] + POSE + behind[view]
            behind[view] += 2
        cuts = np.cumsum([0, *(int(size[s].sum()) for s in slices)])
        biased = np.unique(noise.flight[noise.bias_sigma > 0.0])
        border = Border(len(problem.lenses), bends, biased, len(problem.marks.place))
        parts = _rows_of_slices(cuts, slots, first, drift, fix_of, steps)
        return cls(border, slots, order, start, slot[n : n + m], slot[n + m :], parts, first, drift, steps)


def _met(ties: TieSet, order: IntArray, start: IntArray) -> tuple[IntArray, IntArray]:
    """Return the views of every two ties of one spot, spot by spot, the first tie with all later ones."""
    count = np.diff(start)
    within = np.arange(len(order)) - np.repeat(start[:-1], count)
    later = np.repeat(count, count) - within - 1
    first = np.repeat(np.arange(len(order)), later)
    second = first + 1 + np.arange(len(first)) - np.repeat(np.cumsum(later) - later, later)
    return ties.a[order[first]], ties.a[order[second]]


def _rows_of_slices(
    cuts: IntArray,
    slots: IntArray,
    first: IntArray,
    drift: IntArray,
    fix_of: IntArray,
    steps: tuple[IntArray, IntArray, FloatArray],
) -> tuple[Slice, ...]:
    """Say which block and which number goes where; ``cuts`` are where slices begin, and the end."""
    number = np.arange(len(slots))
    slot, row, column, turned = _both_ways(number, first[slots[:, 0]], first[slots[:, 1]], cuts)
    f = np.flatnonzero(drift >= 0)
    early, late, _ = steps
    own, view, following = drift[f], first[fix_of[f]], np.arange(len(early)) + 2 * len(drift)
    told = [
        _both_ways(which, i + axis, j + axis, cuts)
        for axis in (0, 1)
        for which, i, j in ((f, own, own), (f + len(drift), own, view), (following, drift[early], drift[late]))
    ]
    scalar, scalar_row, scalar_column, _ = (np.concatenate(part) for part in zip(*told, strict=True))
    of, scalar_of = (np.searchsorted(cuts, r, side="right") - 1 for r in (row, scalar_row))
    out = []
    for k in range(len(cuts) - 1):
        begin, end, here, there = cuts[k], cuts[k + 1], of == k, scalar_of == k
        out.append(
            Slice(
                int(begin), int(end - begin), int(cuts[min(k + 2, len(cuts) - 1)] - begin),
                slot[here], row[here] - begin, column[here] - begin, turned[here],
                scalar[there], scalar_row[there] - begin, scalar_column[there] - begin,
            )
        )  # fmt: skip
    return tuple(out)


def _both_ways(
    what: IntArray, i: IntArray, j: IntArray, cuts: IntArray
) -> tuple[IntArray, IntArray, IntArray, npt.NDArray[np.bool_]]:
    """Return what comes at ``(i, j)`` and, turned, at ``(j, i)``, as far as the column is not of an earlier slice."""
    what, row, column = np.tile(what, 2), np.concatenate([i, j]), np.concatenate([j, i])
    turned = np.arange(len(row)) >= len(i)
    of_row, of_column = (np.searchsorted(cuts, r, side="right") for r in (row, column))
    kept = (of_column >= of_row) & ~(turned & (row == column))
    return what[kept], row[kept], column[kept], turned[kept]


def _slices(pairs: IntArray, xy: FloatArray) -> tuple[IntArray, ...]:
    """Cut views into slices of which pairs join neighbours at most, from one end of the longer side to the other."""
    n = len(xy)
    link = sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n)).tocsr()
    pieces, piece = csgraph.connected_components(link, directed=False)
    middle = xy - xy.mean(axis=0)
    along = middle @ np.linalg.svd(middle, full_matrices=False)[2][0] if n > 1 else np.zeros(n)
    hop = np.abs(along[pairs[:, 0]] - along[pairs[:, 1]])
    reach = float(np.percentile(hop[hop > 0.0], 90)) if (hop > 0.0).any() else 0.0
    link = link + link.T
    levels: list[IntArray] = []
    for k in range(pieces):
        left = piece == k
        front = left & (along <= along[left].min() + reach)
        while front.any():
            levels.append(np.flatnonzero(front))
            left &= ~front
            front = left & (link @ front.astype(np.float64) > 0.0)
    slices: list[list[IntArray]] = [[]]
    for views in levels:
        if slices[-1] and sum(map(len, slices[-1])) >= LEAST_SLICE:
            slices.append([])
        slices[-1].append(views)
    return tuple(np.concatenate(s) for s in slices if s)
