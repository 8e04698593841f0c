"""Floods of a picture, compiled: who reaches a place first when the water rises from several springs at once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled

Labels = npt.NDArray[np.int16]
Floats = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int32]
Flags = npt.NDArray[np.bool_]

NOBODY = -1
LEVELS = 2048
"""Water rises in so many steps."""


@compiled("i8(i8, i8, i8, i8, f4[:,::1], f8, f8, b1[:,::1], i4[::1], i4[::1], i4[::1], i4[::1], i2[::1], i8)")
def _line_up(
    row: int,
    column: int,
    level: int,
    label: int,
    height: Floats,
    low: float,
    steps: float,
    waiting: Flags,
    first: Ints,
    last: Ints,
    behind: Ints,
    node: Ints,
    giver: Labels,
    comers: int,
) -> int:
    """Let a node's water stand before the free ones beside it; return how many have come so far."""
    for n in range(4):
        i, j = row + (n == 2) - (n == 0), column + (n == 3) - (n == 1)
        if not (0 <= i < height.shape[0] and 0 <= j < height.shape[1]):
            continue
        if not (waiting[i, j] and np.isfinite(height[i, j])):
            continue
        at = max(level, int((height[i, j] - low) * steps))
        node[comers], giver[comers], behind[comers] = i * height.shape[1] + j, label, -1
        if first[at] < 0:
            first[at] = comers
        else:
            behind[last[at]] = comers
        last[at] = comers
        comers += 1
    return comers


@compiled("void(f4[:,::1], i2[:,::1], b1[:,::1], i2[:,::1])")
def flood_plane(height: Floats, labels: Labels, free: Flags, out: Labels) -> None:
    """Fill ``(rows, columns)`` labels: those of free nodes are of the settled one whose water comes first.

    Water rises; it comes over nodes side by side, each at its height, and where it comes over a ridge it fills what
    lies behind. Nodes of infinite height are walls, settled ones of ``NOBODY`` have no water; free ones that it does
    not reach keep theirs. Heights that differ by less than a part in ``LEVELS`` of their range may pass for the same.
    That is Prim's way to a minimum spanning forest, from all springs at once.
    """
    rows, columns = height.shape
    out[:] = labels
    waiting = free.copy()
    low, high = np.inf, -np.inf
    for i in range(rows):
        for j in range(columns):
            if free[i, j] and np.isfinite(height[i, j]):
                low, high = min(low, height[i, j]), max(high, height[i, j])
    if not low <= high:
        return
    steps = (LEVELS - 1) / (high - low) if high > low else 0.0
    # Who waits at a level stands in a line: in these arrays a number a comer, who is named in two others.
    first, last = np.full(LEVELS, -1, dtype=np.int32), np.full(LEVELS, -1, dtype=np.int32)
    behind = np.empty(4 * rows * columns, dtype=np.int32)
    node, giver = np.empty(4 * rows * columns, dtype=np.int32), np.empty(4 * rows * columns, dtype=np.int16)
    comers = 0
    for at in range(rows * columns):
        i, j = at // columns, at % columns
        if not free[i, j] and labels[i, j] != NOBODY and np.isfinite(height[i, j]):
            comers = _line_up(i, j, 0, labels[i, j], height, low, steps, waiting, first, last, behind, node, giver,
                              comers)  # fmt: skip
    level = 0
    while level < LEVELS:
        n = first[level]
        if n < 0:
            level += 1
            continue
        first[level] = behind[n]
        i, j = node[n] // columns, node[n] % columns
        if waiting[i, j]:
            waiting[i, j] = False
            out[i, j] = giver[n]
            own, before = int((height[i, j] - low) * steps), comers
            comers = _line_up(i, j, own, giver[n], height, low, steps, waiting, first, last, behind, node, giver,
                              comers)  # fmt: skip
            for m in range(before, comers):  # a hollow is filled by who comes to it first, whole
                level = min(level, max(own, int((height[node[m] // columns, node[m] % columns] - low) * steps)))


@compiled("void(f4[::1], i2[::1], b1[::1], i2[::1])")
def flood_along(height: Floats, labels: Labels, free: Flags, out: Labels) -> None:
    """Do what ``flood_plane`` does for nodes of a line, ``(N,)`` each: a run of free ones is cut at its highest."""
    count = len(labels)
    out[:] = labels
    start = 0
    while start < count:
        if not free[start]:
            start += 1
            continue
        stop = start
        while stop < count and free[stop]:
            stop += 1
        left = labels[start - 1] if start > 0 else NOBODY
        right = labels[stop] if stop < count else NOBODY
        if left == NOBODY or right == NOBODY:
            if left != right:
                out[start:stop] = max(left, right)
        else:
            highest = start
            for n in range(start, stop):
                if height[n] > height[highest]:
                    highest = n
            out[start : highest + 1] = left
            out[highest + 1 : stop] = right
        start = stop
