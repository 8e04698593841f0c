"""Choosing and describing the points of a template, compiled: see ``template``."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled
from photomap_gis.ifmi.kernels import Image32, Mask8

Pixels = npt.NDArray[np.intp]


@compiled("void(f4[:, ::1], u1[:, ::1], i8, i8, i8, i8[:, ::1])")
def choose(values: Image32, mask: Mask8, cell: int, top: int, left: int, flat: Pixels) -> None:
    """Write, as its number in the flat picture, the steepest pixel of every square cell of ``cell`` pixels a side.

    ``flat`` is ``(rows, columns)`` of cells, which begin at ``top`` and ``left``. An empty mask masks nothing.
    """
    h, w = values.shape
    rows, columns = flat.shape
    wide = columns * cell
    slope2, best = np.empty(wide, np.float32), np.empty(wide, np.int32)
    # The lowest bits of a slope give way to the pixel's place in its cell: the maximum then tells where it was found.
    # Floats >= 0 are ordered as their bit patterns are.
    keys, places = slope2.view(np.int32), 1
    while places < cell * cell:
        places *= 2
    low = np.int32(places - 1)
    place = np.empty(wide, np.int32)
    for c in range(wide):
        place[c] = c % cell
    for i in range(rows):
        best[:] = -1
        for k in range(cell):
            r = top + i * cell + k
            above = values[r - 1 if r > 0 else 1, left : left + wide]  # at the border there is no slope across it
            below = values[r + 1 if r < h - 1 else h - 2, left : left + wide]
            first, last = max(1 - left, 0), min(wide, w - 1 - left)
            west, east = values[r, left + first - 1 : left + last - 1], values[r, left + first + 1 : left + last + 1]
            for c in range(wide):
                gy = below[c] - above[c]
                slope2[c] = gy * gy
            inner = slope2[first:last]
            for c in range(len(inner)):
                gx = east[c] - west[c]
                inner[c] += gx * gx
            if mask.size > 0:
                for c in range(wide):
                    if mask[r, left + c] == 0:
                        slope2[c] = 0.0
            behind = np.int32(k * cell)
            for c in range(wide):
                best[c] = max(best[c], (keys[c] & ~low) | (place[c] + behind))
        for j in range(columns):
            key = best[j * cell]
            for k in range(1, cell):
                key = max(key, best[j * cell + k])
            found = key & low
            flat[i, j] = (top + i * cell + found // cell) * w + left + j * cell + found % cell


@compiled("void(f4[:, ::1], u1[:, ::1], i8[::1], f8, f8, f8, f8, f8, f4[:, ::1], f4[:, ::1], b1[::1])")
def describe(
    values: Image32,
    usable_mask: Mask8,
    flat: Pixels,
    factor: float,
    centre_x_px: float,
    centre_y_px: float,
    reach_px: float,
    unit: float,
    Q: Image32,
    A: Image32,
    usable: npt.NDArray[np.bool_],
) -> None:
    """Write the field coordinates ``(3, N)`` of pixels, and value and slopes by them into the first rows of A.

    Slopes are five-point derivatives, exact to fourth order, times ``unit``. An empty mask masks nothing.
    """
    w, last, picture = values.shape[1], values.size - 1, values.ravel()
    near, far = np.float32(8.0 / 12.0), np.float32(1.0 / 12.0)
    for n in range(len(flat)):
        at = flat[n]
        Q[0, n] = ((at % w) * factor - centre_x_px) / reach_px
        Q[1, n] = ((at // w) * factor - centre_y_px) / reach_px
        Q[2, n] = 1.0
        gx = near * (picture[min(at + 1, last)] - picture[max(at - 1, 0)])
        gx -= far * (picture[min(at + 2, last)] - picture[max(at - 2, 0)])
        gy = near * (picture[min(at + w, last)] - picture[max(at - w, 0)])
        gy -= far * (picture[min(at + 2 * w, last)] - picture[max(at - 2 * w, 0)])
        can = usable_mask.size == 0 or usable_mask[at // w, at % w] > 0
        A[0, n] = picture[at]
        A[1, n] = gx * np.float32(unit) if can else np.float32(0.0)
        A[2, n] = gy * np.float32(unit) if can else np.float32(0.0)
        usable[n] = A[1, n] != 0.0 or A[2, n] != 0.0
