"""The pixels of a frame that carry its detail: what refinement compares, chosen once a frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from photomap_gis.ifmi.kernels import Image32, Mask8

POINTS = 12_000
GRID = 6
BLOCKS = GRID * GRID


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """The pixel of the steepest slope in every cell of a regular grid: detail, evenly spread over the frame.

    All arrays are ``(BLOCKS, n)``, the points block by block of a ``GRID`` by ``GRID`` division of the frame: pixel
    ``x``, ``y``, the floor's ``value`` there, its slopes ``gx``, ``gy`` (both 0 where the frame must not be used).
    """

    x: Image32
    y: Image32
    value: Image32
    gx: Image32
    gy: Image32


def make_template(values: Image32, mask: Mask8 | None) -> Template:
    """Return the template of one floor's values."""
    h, w = values.shape
    cell = max(1, math.ceil(math.sqrt(h * w / POINTS)))
    rows, columns = (max(1, (side - 4) // cell // GRID) * GRID for side in (h, w))
    if min(h - rows * cell, w - columns * cell) < 0:
        raise ValueError(f"a floor of {values.shape} is too small for {GRID} by {GRID} blocks")
    top, left = (h - rows * cell) // 2, (w - columns * cell) // 2
    # The five-point derivative that is exact to fourth order: slopes of fine detail are not underestimated.
    kernel = np.array([1.0, -8.0, 0.0, 8.0, -1.0], np.float32) / 12.0
    one = np.ones(1, np.float32)
    gx = cv2.sepFilter2D(values, cv2.CV_32F, kernel, one, borderType=cv2.BORDER_REFLECT)
    gy = cv2.sepFilter2D(values, cv2.CV_32F, one, kernel, borderType=cv2.BORDER_REFLECT)
    if mask is not None:
        usable = cv2.erode(mask, np.ones((5, 5), np.uint8), borderValue=255) > 0
        gx, gy = np.where(usable, gx, np.float32(0)), np.where(usable, gy, np.float32(0))

    def cells(image: Image32) -> Image32:
        inner = image[top : top + rows * cell, left : left + columns * cell]
        return inner.reshape(rows, cell, columns, cell).swapaxes(1, 2).reshape(rows, columns, cell * cell)

    def by_block(grid: Image32) -> Image32:
        split = grid.reshape(GRID, rows // GRID, GRID, columns // GRID).swapaxes(1, 2)
        return np.ascontiguousarray(split.reshape(BLOCKS, -1), np.float32)

    slope = gx * gx + gy * gy
    best = np.argmax(cells(slope), axis=2)

    def pick(image: Image32) -> Image32:
        return by_block(image[y, x])

    x = left + cell * np.arange(columns)[None, :] + best % cell
    y = top + cell * np.arange(rows)[:, None] + best // cell
    return Template(by_block(x), by_block(y), pick(values), pick(gx), pick(gy))
