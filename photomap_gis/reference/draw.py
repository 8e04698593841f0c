"""What the frames show of a piece of the map, drawn at the reference's pixels by their present poses."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.grid import MapFrame, MapGrid
from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.similarity import FloatArray
from photomap_gis.reference.imagery import Patch

LATTICE_PX = 8
"""Pixels between the points that are taken through the camera; in between its road is straight enough."""
BORDER_PX = 1.0
LEAST_NEW = 0.05
"""Share of the grid that a further frame must add."""

ReadGrey = Callable[[int], ImageArray]
"""Returns a frame's ``(H, W)`` uint8 raster at full resolution."""


def draw_patch(
    placements: Sequence[FramePlacement],
    map_frame: MapFrame,
    grid: MapGrid,
    read_grey: ReadGrey,
    *,
    least_new: float = LEAST_NEW,
) -> Patch:
    """Return a grid as the frames show it, the first where it sees the ground, the next ones where it does not.

    A further frame is opened only where it adds ``least_new`` of the grid. Each frame is first freed of the detail
    that the grid's pixels cannot hold, and brought to the brightness of what is drawn already, where both see the
    ground.
    """
    grey = np.zeros((grid.height, grid.width), np.float32)
    mask = np.zeros((grid.height, grid.width), bool)
    covered: npt.NDArray[np.bool_] | None = None
    for p in placements:
        nodes = _nodes(p, map_frame, grid)
        sees = _inside(nodes[..., 0], nodes[..., 1], (p.height_px, p.width_px))
        # A frame that adds hardly any ground is not worth opening.
        if covered is not None and (sees & ~covered).mean() < least_new:
            continue
        covered = sees if covered is None else covered | sees
        pixels, seen = _drawn(p, nodes, grid, read_grey(p.frame))
        fresh, both = seen & ~mask, seen & mask
        if both.sum() > 100:
            pixels = pixels + np.float32(np.median(grey[both]) - np.median(pixels[both]))
        grey[fresh] = pixels[fresh]
        mask |= fresh
    return Patch(cv2.add(grey, 0.0, dtype=cv2.CV_8U), mask)


def _drawn(
    p: FramePlacement, nodes: FloatArray, grid: MapGrid, image: ImageArray
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """``(h, w)`` float32 grey of a frame on the grid, and where it sees it."""
    x, y = (_between(nodes[..., k], (grid.height, grid.width)) for k in range(2))
    h, w = image.shape[:2]
    seen = _inside(x, y, (h, w))
    # Whole blocks of pixels are averaged: the last columns and rows that make no block are lost.
    factor = max(1, int(grid.pixel_size / p.gsd_m_per_px))
    small = image[: h // factor * factor, : w // factor * factor]
    if factor > 1:
        small = cv2.resize(small, (w // factor, h // factor), interpolation=cv2.INTER_AREA)
    rest = grid.pixel_size / p.gsd_m_per_px / factor
    if rest > 1.2:
        small = cv2.GaussianBlur(small, (0, 0), 0.45 * math.sqrt(rest**2 - 1.0))
    at_x, at_y = (np.nan_to_num((v + 0.5) / factor - 0.5, nan=-9.0).astype(np.float32) for v in (x, y))
    pixels = cv2.remap(small, at_x, at_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return pixels.astype(np.float32), seen


def _inside(x: FloatArray, y: FloatArray, shape: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """Whether pixels lie in a raster of a shape; NaN do not."""
    h, w = shape
    with np.errstate(invalid="ignore"):
        return (x > BORDER_PX) & (x < w - 1 - BORDER_PX) & (y > BORDER_PX) & (y < h - 1 - BORDER_PX)


def _nodes(p: FramePlacement, map_frame: MapFrame, grid: MapGrid) -> FloatArray:
    """``(rows, columns, 2)`` pixels in the frame of every ``LATTICE_PX``-th pixel of the grid; NaN where not seen."""
    # The lattice goes one step beyond the grid: between its points nothing is extrapolated.
    cols, rows = (np.arange(0, n - 1 + 2 * LATTICE_PX, LATTICE_PX, dtype=np.float64) for n in (grid.width, grid.height))
    xx, yy = np.meshgrid(cols, rows)
    en = grid.to_crs(np.stack([xx.ravel(), yy.ravel()], axis=1))
    return p.camera_to_map.unproject(map_frame.from_crs(en)).reshape(*xx.shape, 2)


def _between(nodes: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """Return ``shape`` values between the nodes: first down the columns, then along the rows."""
    h, w = shape
    y, x = np.arange(h) / LATTICE_PX, np.arange(w) / LATTICE_PX
    y0, x0 = y.astype(np.intp), x.astype(np.intp)
    fy, fx = (y - y0)[:, None], x - x0
    down = nodes[y0] * (1.0 - fy) + nodes[y0 + 1] * fy
    return down[:, x0] * (1.0 - fx) + down[:, x0 + 1] * fx
