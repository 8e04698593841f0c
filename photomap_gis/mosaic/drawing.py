"""Pixels from a frame's raster, cell by cell of a tile's lattice (``cells``): compiled, each pixel touched once.

A cell's corners are four *nodes*; each holds where the raster shows it and what light lacks there, and in between all
is interpolated. Cells that one frame gives whole are drawn into the tile; of those along seams every frame that has a
share adds it to a sum, from which they are taken in the end.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled
from photomap_gis.mosaic.lattice import STEP_PX
from photomap_gis.mosaic.taps import AT_X, AT_Y, LANES, PATCH_STRIDE, STEP_BITS, STEPS, add, begin_row, put

FEATHER_PX = 4
"""Half the width of a seam; no more than half of ``STEP_PX``: a cell's seams touch its neighbours, and no others."""

ALONE = -1
"""In place of a slot: one frame gives the whole cell."""

_NOWHERE_PX = -1e4  # out of every picture
_HALF = STEP_PX // 2
_FRACTION = STEPS - 1
_AROUND = STEP_PX + 2 * FEATHER_PX

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int32]
Labels = npt.NDArray[np.int16]


@compiled("void(f4[:,::1], f4[:,::1], f8, f4[:,:,::1], f4[:,:,::1], i8, f4[:,:,::1])")
def fill_nodes(
    x_px: Floats, y_px: Floats, scale: float, factor: Floats, offset: Floats, step_px: int, out: Floats
) -> None:
    """Fill ``(rows, columns, LANES)`` nodes: places in a raster ``scale`` times the frame's, and light.

    ``factor`` and ``offset`` are ``(r, c, 3)`` at the nodes of a lattice over the same window, ``step_px`` apart.
    """
    rows, columns = x_px.shape
    for i in range(rows):
        v = (i - 1.5) * STEP_PX / step_px + 1.5
        r = min(max(int(v), 0), factor.shape[0] - 2)
        down = np.float32(v - r)
        for j in range(columns):
            u = (j - 1.5) * STEP_PX / step_px + 1.5
            c = min(max(int(u), 0), factor.shape[1] - 2)
            along = np.float32(u - c)
            for k in range(3):
                upper = factor[r, c, k] + (factor[r, c + 1, k] - factor[r, c, k]) * along
                lower = factor[r + 1, c, k] + (factor[r + 1, c + 1, k] - factor[r + 1, c, k]) * along
                out[i, j, k] = upper + (lower - upper) * down
                upper = offset[r, c, k] + (offset[r, c + 1, k] - offset[r, c, k]) * along
                lower = offset[r + 1, c, k] + (offset[r + 1, c + 1, k] - offset[r + 1, c, k]) * along
                out[i, j, 4 + k] = upper + (lower - upper) * down
            x, y = (x_px[i, j] + 0.5) * scale - 0.5, (y_px[i, j] + 0.5) * scale - 0.5
            # Where a node is not seen no pixel beside it is shown.
            out[i, j, AT_X] = x if math.isfinite(x) else _NOWHERE_PX
            out[i, j, AT_Y] = y if math.isfinite(y) else _NOWHERE_PX


@compiled("UniTuple(i8, 4)(Array(u1, 3, 'C', True), f8, f8, u1[::1])")
def _copied(image: Bytes, x: float, y: float, patch: Bytes) -> tuple[Any, Any, Any, Any]:
    """Copy what the taps of a place read into ``patch``, the picture's edge repeated; return the ``tap`` of it."""
    height, width = image.shape[:2]
    p = math.floor(min(max(x, -4.0), width + 4.0) * STEPS + 0.5)
    q = math.floor(min(max(y, -4.0), height + 4.0) * STEPS + 0.5)
    for j in range(4):
        from_y = min(max((q >> STEP_BITS) - 1 + j, 0), height - 1)
        for i in range(4):
            from_x = min(max((p >> STEP_BITS) - 1 + i, 0), width - 1)
            for k in range(3):
                patch[PATCH_STRIDE * j + 3 * i + k] = image[from_y, from_x, k]
    return 0, PATCH_STRIDE, q & _FRACTION, p & _FRACTION


@compiled("void(Array(u1, 3, 'C', True), f4[:,:,::1], i4[::1], i4[::1], i8, i2[:,::1], i8, i8, u1[:,:,::1], f4[::1])")
def draw(
    image: Bytes,
    nodes: Floats,
    cells: Ints,
    slots: Ints,
    label: int,
    labels: Labels,
    box_x: int,
    box_y: int,
    rgba: Bytes,
    sums: Floats,
) -> None:
    """Draw what a frame gives of a box of the domain: in ``rgba`` where it is alone, in ``sums`` where it is not.

    ``cells`` are numbers of cells, row by row of the lattice; ``slots`` say where in ``sums`` each of them has its
    ``STEP_PX ** 2`` times 4 numbers (BGR times weight, weight), ``ALONE`` of those that the frame gives alone.
    ``labels`` is who gives each pixel of the domain; the box begins at ``(box_x, box_y)`` and is as large as ``rgba``.
    """
    high, wide, width = image.shape[0], image.shape[1], rgba.shape[1]
    picture, flat, out = image.reshape(-1), nodes.reshape(-1), rgba.reshape(-1)
    patch = np.zeros(4 * PATCH_STRIDE, dtype=np.uint8)
    row = np.empty(2 * LANES, dtype=np.float32)
    column = np.zeros(_AROUND, dtype=np.int64)
    part, steps, half = np.float32(1.0 / STEP_PX), np.float32(STEPS), np.float32(0.5)
    for n in range(cells.size):
        i, j = cells[n] // (nodes.shape[1] - 1), cells[n] % (nodes.shape[1] - 1)
        y0, x0 = STEP_PX * i - _HALF, STEP_PX * j - _HALF
        top, bottom = max(y0, box_y), min(y0 + STEP_PX, box_y + rgba.shape[0])
        left, right = max(x0, box_x), min(x0 + STEP_PX, box_x + width)
        inside = True  # all taps, and the bytes that are read beyond them
        for k in range(4):
            u, v = nodes[i + k // 2, j + k % 2, AT_X], nodes[i + k // 2, j + k % 2, AT_Y]
            inside = inside and 1.0 <= u < wide - 5.0 and 1.0 <= v < high - 3.0
        source = picture if inside else patch
        first = LANES * (i * nodes.shape[1] + j)
        corners = (first, first + LANES, first + LANES * nodes.shape[1], first + LANES * (nodes.shape[1] + 1))
        alone = slots[n] == ALONE
        if not alone:
            for u in range(left - x0, right - x0 + 2 * FEATHER_PX):
                column[u] = 0
                for v in range(top - FEATHER_PX, top + FEATHER_PX):
                    column[u] += labels[v, x0 - FEATHER_PX + u] == label
        for y in range(top, bottom):
            begin_row(flat, corners, np.float32(y - y0 + 0.5) * part, row)
            at = 4 * ((y - box_y) * width + left - box_x)
            share = np.float32(left - x0 + 0.5) * part
            count = 1
            if not alone:  # weighs as many as are the frame's of the pixels around
                at = 4 * (STEP_PX * (STEP_PX * np.int64(slots[n]) + y - y0) + left - x0)
                count = 0
                for u in range(left - x0, right - x0 + 2 * FEATHER_PX):
                    column[u] += labels[y + FEATHER_PX, x0 - FEATHER_PX + u] == label
                for u in range(left - x0, left - x0 + 2 * FEATHER_PX):
                    count += column[u]
            for x in range(left, right):
                if not alone:
                    count += column[x - x0 + 2 * FEATHER_PX]
                if count > 0:
                    u, v = row[AT_X] + row[LANES + AT_X] * share, row[AT_Y] + row[LANES + AT_Y] * share
                    if inside:
                        p, q = np.int64(u * steps + half), np.int64(v * steps + half)
                        begin = ((q >> STEP_BITS) - 1) * (3 * wide) + 3 * ((p >> STEP_BITS) - 1)
                        tap = (begin, 3 * wide, q & _FRACTION, p & _FRACTION)
                    else:
                        tap = _copied(image, u, v, patch)
                    if alone:
                        put(source, tap, row, share, out, at)
                    else:
                        add(source, tap, row, share, sums, at, np.float32(count))
                if not alone:
                    count -= column[x - x0]
                share += part
                at += 4
            if not alone:
                for u in range(left - x0, right - x0 + 2 * FEATHER_PX):
                    column[u] -= labels[y - FEATHER_PX, x0 - FEATHER_PX + u] == label


@compiled("void(i4[::1], i8, f4[::1], i2[:,::1], i8, i8, u1[:,:,::1])")
def mix(cells: Ints, columns: int, sums: Floats, labels: Labels, box_x: int, box_y: int, rgba: Bytes) -> None:
    """Draw the weighted means of cells along seams, where somebody gives the pixel; ``cells`` are by slot.

    The lattice has so many ``columns`` of cells; all else is as in ``draw``.
    """
    for slot in range(cells.size):
        y0, x0 = STEP_PX * (cells[slot] // columns) - _HALF, STEP_PX * (cells[slot] % columns) - _HALF
        for y in range(max(y0, box_y), min(y0 + STEP_PX, box_y + rgba.shape[0])):
            for x in range(max(x0, box_x), min(x0 + STEP_PX, box_x + rgba.shape[1])):
                at = 4 * (STEP_PX * (STEP_PX * np.int64(slot) + y - y0) + x - x0)
                if labels[y, x] >= 0 and sums[at + 3] > 0.0:
                    for k in range(3):
                        mean = sums[at + k] / sums[at + 3] + np.float32(0.5)
                        rgba[y - box_y, x - box_x, 2 - k] = np.uint8(min(max(mean, 0.0), 255.0))
                    rgba[y - box_y, x - box_x, 3] = 255
