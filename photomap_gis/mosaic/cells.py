"""Who gives which pixels, told by the cells of a tile's lattice: most have one giver, few must be looked at closely.

A *cell* lies between four nodes, ``STEP_PX`` pixels a side; cell ``(i, j)`` begins at pixel
``STEP_PX * i - STEP_PX / 2`` of the domain, and the outermost hang over it. Compiled.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled
from photomap_gis.mosaic.drawing import ALONE, FEATHER_PX
from photomap_gis.mosaic.lattice import STEP_PX

NOBODY = -1
UNSETTLED = -2
"""A node that is left to the cheapest frame, pixel by pixel; and a cell that has more than one giver."""

_HALF = STEP_PX // 2
_UNSEEN = 1e9  # a cost where a frame does not see a corner, but sees pixels

Labels = npt.NDArray[np.int16]
Floats = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int32]
Longs = npt.NDArray[np.int64]


@compiled("i8(f4[:,:,:,::1], f4[:,::1], i8, i8, i8[::1], b1[::1])")
def _who_sees(sights: Floats, sizes_px: Floats, i: int, j: int, able: Longs, whole: npt.NDArray[np.bool_]) -> int:
    """Put those who may see pixels of a cell into ``able`` and return how many; ``whole`` says of each if all."""
    many = 0
    for k in range(sights.shape[0]):
        least_x = least_y = least_border = np.float32(np.inf)
        most_x = most_y = np.float32(-np.inf)
        unseen = False
        for n in range(4):
            x, y = sights[k, 0, i + n // 2, j + n % 2], sights[k, 1, i + n // 2, j + n % 2]
            border = sights[k, 3, i + n // 2, j + n % 2]
            unseen = unseen or np.isnan(x + y)
            least_x, most_x, least_y, most_y = min(least_x, x), max(most_x, x), min(least_y, y), max(most_y, y)
            least_border = min(least_border, border)
        if unseen or most_x < -0.5 or most_y < -0.5 or least_x > sizes_px[k, 0] or least_y > sizes_px[k, 1]:
            continue
        able[many], whole[k] = k, least_border > 0.0  # the raster is convex: what lies between its points is in it
        many += 1
    return many


@compiled("b1(f4[:,:,:,::1], i8, i8, i8, f4[::1], f4[:,::1])")
def _sees(sights: Floats, k: int, i: int, j: int, weight: Floats, sizes_px: Floats) -> bool:
    """Whether a place between four nodes lies in a frame's raster."""
    x = y = np.float32(0.0)
    for n in range(4):
        x += weight[n] * sights[k, 0, i + n // 2, j + n % 2]
        y += weight[n] * sights[k, 1, i + n // 2, j + n % 2]
    return -0.5 <= x <= sizes_px[k, 0] - 0.5 and -0.5 <= y <= sizes_px[k, 1] - 0.5


@compiled("void(i2[:,::1], f4[:,:,:,::1], f4[:,:,::1], f4[:,::1], i2[:,::1], i2[:,::1])")
def label_cells(
    at_nodes: Labels, sights: Floats, costs: Floats, sizes_px: Floats, labels: Labels, givers: Labels
) -> None:
    """Carry the nodes' labels to the pixels: ``labels`` of the domain and ``givers`` of the cells are filled.

    Between nodes of several frames a pixel goes to the one nearest to it (borders become smooth), if that sees it, else
    to the cheapest frame that does, ``NOBODY`` where none does. ``sights`` is ``(K, 4, rows, columns)`` x, y, cost and
    distance from the raster's edge of each frame (``sighting``), ``costs`` ``(K, rows, columns)`` with its tier,
    infinite where it does not see; ``sizes_px`` is ``(K, 2)``. ``givers`` is ``(rows - 1, columns - 1)``.
    """
    height, width = labels.shape
    corner = np.empty(4, dtype=np.int64)
    able, whole = np.empty(sights.shape[0], dtype=np.int64), np.empty(sights.shape[0], dtype=np.bool_)
    near = np.empty(4, dtype=np.int64)
    weight = np.empty(4, dtype=np.float32)
    for i in range(givers.shape[0]):
        top, bottom = max(STEP_PX * i - _HALF, 0), min(STEP_PX * i + _HALF, height)
        for j in range(givers.shape[1]):
            left, right = max(STEP_PX * j - _HALF, 0), min(STEP_PX * j + _HALF, width)
            giver: Any = np.int64(at_nodes[i, j])
            safe: Any = True
            for n in range(4):
                corner[n] = at_nodes[i + n // 2, j + n % 2]
                if corner[n] != giver:
                    giver = UNSETTLED
            for n in range(4):
                safe = safe and (giver < 0 or sights[giver, 3, i + n // 2, j + n % 2] > 0.0)
            many = 0
            if giver == UNSETTLED or not safe:
                giver = UNSETTLED
                many = _who_sees(sights, sizes_px, i, j, able, whole)
                if many == 0:
                    giver = NOBODY
            if giver != UNSETTLED:
                for y in range(top, bottom):
                    for x in range(left, right):
                        labels[y, x] = giver
                givers[i, j] = giver
                continue
            distinct = 0
            for m in range(many):
                for n in range(4):
                    if corner[n] == able[m]:
                        near[distinct] = able[m]
                        distinct += 1
                        break
            same = True
            for y in range(top, bottom):
                down = np.float32((y - STEP_PX * i + _HALF + 0.5) / STEP_PX)
                for x in range(left, right):
                    along = np.float32((x - STEP_PX * j + _HALF + 0.5) / STEP_PX)
                    weight[3] = down * along
                    weight[0], weight[1], weight[2] = 1 - down - along + weight[3], along - weight[3], down - weight[3]
                    best, most = NOBODY, np.float32(0.0)
                    for d in range(distinct):
                        share = np.float32(0.0)
                        for n in range(4):
                            if corner[n] == near[d]:
                                share += weight[n]
                        if share > most and (whole[near[d]] or _sees(sights, near[d], i, j, weight, sizes_px)):
                            best, most = near[d], share
                    if best == NOBODY:
                        least = np.inf
                        for m in range(many):
                            if whole[able[m]] or _sees(sights, able[m], i, j, weight, sizes_px):
                                cost = 0.0
                                for n in range(4):
                                    cost += weight[n] * min(costs[able[m], i + n // 2, j + n % 2], _UNSEEN)
                                if cost < least:
                                    best, least = able[m], cost
                    labels[y, x] = best
                    same = same and best == labels[top, left]
            givers[i, j] = labels[top, left] if same else UNSETTLED


@compiled("i8(i2[:,::1], i2[:,::1], i8, i8, i8, i8, i8, i8, i8[::1], i8[::1])")
def _found_around(
    labels: Labels, givers: Labels, i: int, j: int, top: int, bottom: int, left: int, right: int, found: Longs,
    seen_in: Longs
) -> int:  # fmt: skip
    """Put those who give pixels from ``top`` to ``bottom``, ``left`` to ``right`` into ``found``; return how many.

    These are a cell and some pixels around it. Minus as many where somewhere is nobody.
    """
    rows, columns = givers.shape
    many, cell, nobody = 0, i * columns + j, False
    for v in range(max(i - 1, 0), min(i + 2, rows)):
        y0, y1 = max(STEP_PX * v - _HALF, top), min(STEP_PX * v + _HALF, bottom)
        for u in range(max(j - 1, 0), min(j + 2, columns)):
            x0, x1 = max(STEP_PX * u - _HALF, left), min(STEP_PX * u + _HALF, right)
            if y1 <= y0 or x1 <= x0:
                continue
            settled = givers[v, u] != UNSETTLED  # one pixel tells of all
            for y in range(y0, y0 + 1 if settled else y1):
                for x in range(x0, x0 + 1 if settled else x1):
                    k = labels[y, x]
                    if k < 0:
                        nobody = True
                    elif seen_in[k] != cell:
                        seen_in[k] = cell
                        found[many] = k
                        many += 1
    return -many if nobody else many


@compiled("Tuple((i4[::1], i4[::1], i8[::1], i4[::1]))(i2[:,::1], i2[:,::1], i8, i8, i8, i8, i8)")
def shares_of(
    labels: Labels, givers: Labels, count: int, box_x: int, box_y: int, box_width: int, box_height: int
) -> tuple[Ints, Ints, Longs, Ints]:
    """Return what each of ``count`` frames has a share in, of a box of the domain: its cells, alone or with others.

    That is: numbers of cells and their slots (``drawing.draw``), those of frame k from ``starts[k]`` to
    ``starts[k + 1]``, these ``(count + 1,)`` starts, and the cell of each slot. A frame has a share where one of the
    pixels within ``FEATHER_PX`` is its own. The box lies so far inside the domain.
    """
    columns = givers.shape[1]
    first_row, last_row = (box_y + _HALF) // STEP_PX, (box_y + box_height - 1 + _HALF) // STEP_PX
    first_col, last_col = (box_x + _HALF) // STEP_PX, (box_x + box_width - 1 + _HALF) // STEP_PX
    seen_in, found = np.full(count, -1, dtype=np.int64), np.empty(count, dtype=np.int64)
    starts = np.zeros(count + 1, dtype=np.int64)
    noted, size = 0, (last_row - first_row + 1) * (last_col - first_col + 1)
    notes = np.empty((2 * size + count, 3), dtype=np.int32)  # of each share: frame, cell, slot
    slot_cells = np.empty(size, dtype=np.int32)
    slot = 0
    for i in range(first_row, last_row + 1):
        top, bottom = max(STEP_PX * i - _HALF, box_y), min(STEP_PX * i + _HALF, box_y + box_height)
        for j in range(first_col, last_col + 1):
            left, right = max(STEP_PX * j - _HALF, box_x), min(STEP_PX * j + _HALF, box_x + box_width)
            giver = givers[i, j]
            alone = giver != UNSETTLED
            for v in range(max(i - 1, 0), min(i + 2, givers.shape[0])):
                for u in range(max(j - 1, 0), min(j + 2, columns)):
                    alone = alone and givers[v, u] == giver
            if alone:
                found[0] = max(giver, 0)
                many = 1 if giver >= 0 else 0
            else:
                many = _found_around(labels, givers, i, j, top - FEATHER_PX, bottom + FEATHER_PX, left - FEATHER_PX,
                                     right + FEATHER_PX, found, seen_in)  # fmt: skip
            if many == 0:
                continue
            if noted + count > len(notes):
                notes = np.concatenate((notes, np.empty_like(notes)))
            mixed = many != 1
            for n in range(abs(many)):
                notes[noted, 0], notes[noted, 1] = found[n], i * columns + j
                notes[noted, 2] = slot if mixed else ALONE
                starts[found[n] + 1] += 1
                noted += 1
            if mixed:
                slot_cells[slot] = i * columns + j
                slot += 1
    for k in range(count):
        starts[k + 1] += starts[k]
    cells, slots = np.empty(noted, dtype=np.int32), np.empty(noted, dtype=np.int32)
    next_ = starts.copy()
    for n in range(noted):
        k = notes[n, 0]
        cells[next_[k]], slots[next_[k]] = notes[n, 1], notes[n, 2]
        next_[k] += 1
    return cells, slots, starts, slot_cells[:slot].copy()


@compiled("void(i2[:,::1], i4[::1], i8, i8, i4[:,::1])")
def name_frames(labels: Labels, frames: Ints, box_x: int, box_y: int, out: Ints) -> None:
    """Fill ``out``, as large as a box of the domain, with the frame of each label; its last one is nobody's."""
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            k = labels[box_y + y, box_x + x]
            out[y, x] = frames[k] if k >= 0 else frames[frames.size - 1]
