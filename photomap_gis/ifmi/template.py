"""The pixels of a frame that carry its detail: what refinement compares, chosen once a frame and floor.

Points live in *field coordinates* q: the frame's centre is (0, 0) and ``reach_px`` frame pixels are the unit, so that
they are the same on every floor of the pyramid and every parameter of a motion is of the order of 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.ifmi.kernels import Image32, Mask8

GRID = 12
BLOCKS = GRID * GRID


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """The pixel of the steepest slope in every cell of a regular grid: detail, evenly spread over the frame.

    All arrays are ``(BLOCKS, n)``, the points block by block of a ``GRID`` by ``GRID`` division of the frame: place
    ``qx``, ``qy`` (field coordinates), the floor's ``value`` there, its slopes ``gx``, ``gy`` by qx and qy (both 0
    where the frame must not be used). ``J`` ``(8, BLOCKS * n)`` is the derivative of the value by the field's
    parameters.
    """

    qx: Image32
    qy: Image32
    value: Image32
    gx: Image32
    gy: Image32
    J: Image32

    def of_blocks(self, blocks: npt.NDArray[np.intp]) -> Template:
        """Return the template of some blocks only."""
        if len(blocks) == BLOCKS:
            return self
        J = self.J.reshape(8, BLOCKS, -1)[:, blocks].reshape(8, -1)
        return Template(self.qx[blocks], self.qy[blocks], self.value[blocks], self.gx[blocks], self.gy[blocks], J)


@dataclass(frozen=True, slots=True)
class _Cells:
    """How a floor is cut: ``cell`` pixels a side, ``rows`` by ``columns`` of them, from (``top``, ``left``)."""

    cell: int
    rows: int
    columns: int
    top: int
    left: int


@lru_cache(maxsize=32)
def _cells_of(shape: tuple[int, int], points: int) -> _Cells:
    h, w = shape
    cell = max(1, math.ceil(math.sqrt(h * w / points)))
    rows, columns = (max(1, (side - 4) // cell // GRID) * GRID for side in (h, w))
    if min(h - rows * cell, w - columns * cell) < 0:
        raise ValueError(f"a floor of {shape} is too small for {GRID} by {GRID} blocks")
    return _Cells(cell, rows, columns, (h - rows * cell) // 2, (w - columns * cell) // 2)


def slopes(values: Image32, mask: Mask8 | None) -> tuple[Image32, Image32]:
    """Return the slopes of a floor along x and y, a pixel; 0 where the mask is, and beside it."""
    # The five-point derivative that is exact to fourth order: slopes of fine detail are not underestimated.
    kernel = np.array([1.0, -8.0, 0.0, 8.0, -1.0], np.float32) / np.float32(12.0)
    one = np.ones(1, np.float32)
    gx = cv2.sepFilter2D(values, cv2.CV_32F, kernel, one, borderType=cv2.BORDER_REFLECT)
    gy = cv2.sepFilter2D(values, cv2.CV_32F, one, kernel, borderType=cv2.BORDER_REFLECT)
    if mask is not None:
        usable = cv2.erode(mask, np.ones((5, 5), np.uint8), borderValue=255) > 0
        gx, gy = np.where(usable, gx, np.float32(0)), np.where(usable, gy, np.float32(0))
    return gx, gy


def make_template(
    values: Image32, slope_x: Image32, slope_y: Image32, *, factor: int, size_px: tuple[int, int], points: int
) -> Template:
    """Return the template, of at most about ``points``, of a floor of a frame of ``size_px`` (width, height)."""
    c = _cells_of(values.shape, points)
    reach = max(size_px) / 2.0
    y, x = _steepest(slope_x * slope_x + slope_y * slope_y, c)
    flat = y * values.shape[1] + x
    qx = ((x * factor - (size_px[0] - 1) / 2.0) / reach).astype(np.float32)
    qy = ((y * factor - (size_px[1] - 1) / 2.0) / reach).astype(np.float32)
    unit = np.float32(reach / factor)
    gx, gy = slope_x.ravel()[flat] * unit, slope_y.ravel()[flat] * unit
    return Template(qx, qy, values.ravel()[flat], gx, gy, derivative(qx, qy, gx, gy))


def derivative(qx: Image32, qy: Image32, gx: Image32, gy: Image32) -> Image32:
    """``(8, N)`` derivative by the field's parameters of values with slopes ``gx``, ``gy`` at field coordinates."""
    J = np.empty((8, *qx.shape), np.float32)
    radial, turning = gx * qx + gy * qy, gy * qx - gx * qy
    J[0], J[1], J[2], J[3] = gx, gy, turning, radial
    J[4], J[5] = gx * qx - gy * qy, gx * qy + gy * qx
    J[6], J[7] = radial * qx, radial * qy
    return J.reshape(8, -1)


def _steepest(slope: Image32, c: _Cells) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return row and column, each ``(BLOCKS, n)``, of the steepest pixel in every cell."""
    n = c.cell
    inner = slope[c.top : c.top + c.rows * n, c.left : c.left + c.columns * n]
    # The lowest bits of a slope give way to the pixel's place in its cell: the maximum then tells where it was found.
    bits = (n * n - 1).bit_length()
    keyed = inner.view(np.int32) >> bits << bits  # floats >= 0 are ordered as their bit patterns are
    keyed |= _places(n, c.rows, c.columns)
    tallest = keyed[::n]
    for k in range(1, n):
        tallest = np.maximum(tallest, keyed[k::n])
    widest = tallest[:, ::n]
    for k in range(1, n):
        widest = np.maximum(widest, tallest[:, k::n])
    best = (widest & ((1 << bits) - 1)).astype(np.intp)
    y = c.top + n * np.arange(c.rows)[:, None] + best // n
    x = c.left + n * np.arange(c.columns)[None, :] + best % n

    def by_block(grid: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
        split = grid.reshape(GRID, c.rows // GRID, GRID, c.columns // GRID).swapaxes(1, 2)
        return np.ascontiguousarray(split.reshape(BLOCKS, -1))

    return by_block(y), by_block(x)


@lru_cache(maxsize=32)
def _places(n: int, rows: int, columns: int) -> npt.NDArray[np.int32]:
    """``(rows * n, columns * n)`` every pixel's place in its cell."""
    places = np.tile(np.arange(n * n, dtype=np.int32).reshape(n, n), (rows, columns))
    places.setflags(write=False)
    return places
