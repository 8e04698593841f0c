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

from photomap_gis.ifmi.descent import write_derivative
from photomap_gis.ifmi.kernels import Image32, Mask8

Pixels = npt.NDArray[np.intp]

GRID = 12
BLOCKS = GRID * GRID


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """The pixel of the steepest slope in every cell of a regular grid: detail, evenly spread over the frame.

    The points lie block by block of a ``GRID`` by ``GRID`` division of the frame. ``Q`` ``(3, BLOCKS, n)`` holds their
    places, homogeneous field coordinates; ``A`` ``(9, BLOCKS, n)`` the floor's values there and their derivatives by
    the field's parameters, of which the first two are the slopes by qx and qy; ``usable`` ``(BLOCKS, n)`` where the
    frame may be used and has a slope at all.
    """

    Q: Image32
    A: Image32
    usable: npt.NDArray[np.bool_]

    @property
    def value(self) -> Image32:
        """``(BLOCKS, n)`` the floor's values."""
        return self.A[0]

    @property
    def gx(self) -> Image32:
        """``(BLOCKS, n)`` slopes by qx, 0 where the frame must not be used."""
        return self.A[1]

    @property
    def gy(self) -> Image32:
        """``(BLOCKS, n)`` slopes by qy."""
        return self.A[2]


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """How a floor is cut: ``cell`` pixels a side, ``rows`` by ``columns`` of them, from (``top``, ``left``).

    ``places`` ``(rows * cell, columns * cell)`` is every pixel's number in its cell; in the flat picture ``corner``
    ``(rows, columns)`` is each cell's first pixel, ``offset`` ``(cell * cell,)`` how far every other lies behind it.
    """

    cell: int
    rows: int
    columns: int
    top: int
    left: int
    places: npt.NDArray[np.int32]
    corner: Pixels
    offset: Pixels


@lru_cache(maxsize=32)
def _cells_of(shape: tuple[int, int], points: int) -> _Cells:
    h, w = shape
    n = max(1, math.ceil(math.sqrt(h * w / points)))
    rows, columns = (max(1, (side - 4) // n // GRID) * GRID for side in (h, w))
    if min(h - rows * n, w - columns * n) < 0:
        raise ValueError(f"a floor of {shape} is too small for {GRID} by {GRID} blocks")
    top, left = (h - rows * n) // 2, (w - columns * n) // 2
    number = np.arange(n * n)
    places = np.tile(number.astype(np.int32).reshape(n, n), (rows, columns))
    corner = (top + n * np.arange(rows))[:, None] * w + left + n * np.arange(columns)[None, :]
    offset = number // n * w + number % n
    for made in (places, corner, offset):
        made.setflags(write=False)
    return _Cells(n, rows, columns, top, left, places, corner, offset)


def steepest_pixels(values: Image32, mask: Mask8 | None, points: int) -> Pixels:
    """Return, as numbers in the flat picture, the steepest pixel of each of at most about ``points`` cells.

    ``(BLOCKS, n)``, block by block.
    """
    c = _cells_of(values.shape, points)
    gx, gy = cv2.Sobel(values, cv2.CV_32F, 1, 0, ksize=1), cv2.Sobel(values, cv2.CV_32F, 0, 1, ksize=1)
    gx *= gx
    gy *= gy
    gx += gy
    if mask is not None:
        gx[mask == 0] = 0.0
    n = c.cell
    inner = gx[c.top : c.top + c.rows * n, c.left : c.left + c.columns * n]
    # The lowest bits of a slope give way to the pixel's place in its cell: the maximum then tells where it was found.
    low = (1 << (n * n - 1).bit_length()) - 1
    keyed = inner.view(np.int32) & ~low  # floats >= 0 are ordered as their bit patterns are
    keyed |= c.places
    tallest = keyed[::n]
    for k in range(1, n):
        tallest = np.maximum(tallest, keyed[k::n])
    widest = tallest[:, ::n]
    for k in range(1, n):
        widest = np.maximum(widest, tallest[:, k::n])
    flat = c.corner + c.offset[widest & low]
    return flat.reshape(GRID, c.rows // GRID, GRID, c.columns // GRID).swapaxes(1, 2).reshape(BLOCKS, -1)


def make_template(
    values: Image32, mask: Mask8 | None, flat: Pixels, *, factor: int, size_px: tuple[int, int]
) -> Template:
    """Return the template of the pixels ``flat``, which lie two or more from the border.

    ``size_px`` is the frame's width and height.
    """
    w = values.shape[1]
    Q = np.ones((3, *flat.shape), np.float32)
    _field_coordinates(values.shape, factor, size_px).take(flat, axis=1, out=Q[:2], mode="clip")
    A = np.empty((9, *flat.shape), np.float32)
    values.take(flat, out=A[0], mode="clip")
    unit = np.float32(max(size_px) / (2.0 * factor))
    gx, gy = _slope(values, flat, 1) * unit, _slope(values, flat, w) * unit
    if mask is not None:
        usable = cv2.erode(mask, np.ones((5, 5), np.uint8), borderValue=255).take(flat) > 0
        gx *= usable
        gy *= usable
    A[1], A[2] = gx, gy
    write_derivative(Q.reshape(3, -1), A[1:].reshape(8, -1))
    return Template(Q, A, (gx != 0) | (gy != 0))


def _slope(values: Image32, flat: Pixels, step: int) -> Image32:
    """Return the slope per ``step`` in the flat picture, by the five-point derivative: exact to fourth order."""
    near = values.take(flat + step, mode="clip") - values.take(flat - step, mode="clip")
    far = values.take(flat + 2 * step, mode="clip") - values.take(flat - 2 * step, mode="clip")
    return near * np.float32(8.0 / 12.0) - far * np.float32(1.0 / 12.0)


@lru_cache(maxsize=16)
def _field_coordinates(shape: tuple[int, int], factor: int, size_px: tuple[int, int]) -> Image32:
    """``(2, h * w)`` field coordinates of every pixel of a floor of a frame of ``size_px`` (width, height)."""
    reach = max(size_px) / 2.0
    y, x = np.mgrid[: shape[0], : shape[1]]
    table = np.stack([(v * factor - (side - 1) / 2.0) / reach for v, side in ((x, size_px[0]), (y, size_px[1]))])
    flat: Image32 = table.reshape(2, -1).astype(np.float32)
    flat.setflags(write=False)
    return flat
