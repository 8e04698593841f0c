"""The pixels of a frame that carry its detail: what refinement compares, chosen once a frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from photomap_gis.ifmi.kernels import Image32, Mask8

POINTS = 12_000


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """The pixel of the steepest slope in every cell of a regular grid: detail, evenly spread over the frame.

    All arrays are ``(rows, columns)`` of the grid: pixel ``x``, ``y``, the floor's ``value`` there, its slopes ``gx``,
    ``gy`` (both 0 where the frame must not be used).
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
    rows, columns = max(1, (h - 4) // cell), max(1, (w - 4) // cell)
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

    slope = gx * gx + gy * gy
    best = np.argmax(cells(slope), axis=2)[..., None]

    def pick(image: Image32) -> Image32:
        return np.ascontiguousarray(np.take_along_axis(cells(image), best, axis=2)[..., 0])

    x = (left + cell * np.arange(columns)[None, :] + best[..., 0] % cell).astype(np.float32)
    y = (top + cell * np.arange(rows)[:, None] + best[..., 0] // cell).astype(np.float32)
    return Template(x, y, pick(values), pick(gx), pick(gy))
