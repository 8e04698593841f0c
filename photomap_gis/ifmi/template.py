"""The pixels of a frame that carry its detail: what refinement compares, chosen once a frame and floor.

Points live in *field coordinates* q: the frame's centre is (0, 0) and ``reach_px`` frame pixels are the unit, so that
they are the same on every floor of the pyramid and every parameter of a motion is of the order of 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.ifmi.descent import write_derivative
from photomap_gis.ifmi.kernels import Image32, Mask8
from photomap_gis.ifmi.steepest import Pixels, choose, describe

GRID = 12
BLOCKS = GRID * GRID
NO_MASK = np.empty((0, 0), np.uint8)


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


class _Cells(NamedTuple):
    """How a floor is cut: ``cell`` pixels a side, ``rows`` by ``columns`` of them, from (``top``, ``left``)."""

    cell: int
    rows: int
    columns: int
    top: int
    left: int


@lru_cache(maxsize=32)
def _cells_of(shape: tuple[int, int], points: int) -> _Cells:
    h, w = shape
    n = max(1, math.ceil(math.sqrt(h * w / points)))
    rows, columns = (max(1, (side - 4) // n // GRID) * GRID for side in (h, w))
    if min(h - rows * n, w - columns * n) < 0:
        raise ValueError(f"a floor of {shape} is too small for {GRID} by {GRID} blocks")
    return _Cells(n, rows, columns, (h - rows * n) // 2, (w - columns * n) // 2)


def steepest_pixels(values: Image32, mask: Mask8 | None, points: int) -> Pixels:
    """Return, as numbers in the flat picture, the steepest pixel of each of at most about ``points`` cells.

    ``(BLOCKS, n)``, block by block.
    """
    c = _cells_of(values.shape, points)
    flat = np.empty((c.rows, c.columns), np.intp)
    choose(values, NO_MASK if mask is None else mask, c.cell, c.top, c.left, flat)
    return flat.reshape(GRID, c.rows // GRID, GRID, c.columns // GRID).swapaxes(1, 2).reshape(BLOCKS, -1)


def make_template(
    values: Image32, mask: Mask8 | None, flat: Pixels, *, factor: int, size_px: tuple[int, int]
) -> Template:
    """Return the template of the pixels ``flat``, which lie two or more from the border.

    ``size_px`` is the frame's width and height.
    """
    usable_mask = NO_MASK if mask is None else cv2.erode(mask, np.ones((5, 5), np.uint8), borderValue=255)
    n, (width, height), reach_px = flat.size, size_px, max(size_px) / 2.0
    Q, A, usable = np.empty((3, n), np.float32), np.empty((9, n), np.float32), np.empty(n, np.bool_)
    centre_x_px, centre_y_px = (width - 1) / 2.0, (height - 1) / 2.0
    describe(
        values, usable_mask, flat.ravel(), factor, centre_x_px, centre_y_px, reach_px, reach_px / factor, Q, A, usable
    )
    write_derivative(Q, A[1:])
    return Template(Q.reshape(3, *flat.shape), A.reshape(9, *flat.shape), usable.reshape(flat.shape))
