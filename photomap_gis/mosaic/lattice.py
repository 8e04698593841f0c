"""A coarse lattice over a window of the map, and the way back to every pixel.

Placements are asked on the lattice only; in between they are so nearly linear that bilinear interpolation is exact to
a few hundredths of a pixel, however costly the camera model behind them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.grid import CrsFrame, MapGrid, Window
from photomap_gis.core.similarity import FloatArray

STEP_PX = 8
"""Distance of the nodes, where nothing else is said. Each lies in the middle of a block of this many pixels a side."""

FloatImage = npt.NDArray[np.float32]


class Box(NamedTuple):
    """A rectangle of pixels of a lattice's domain."""

    x: int
    y: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns, to index an image with."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Nodes over a window and a margin of ``step_px`` around it (the *domain*), one more ring of nodes outside that.

    ``shape`` is the nodes' (rows, columns); ``nodes_xy_map_m`` is ``(rows * columns, 2)``.
    """

    width: int
    height: int
    shape: tuple[int, int]
    nodes_xy_map_m: FloatArray
    step_px: int = STEP_PX

    @classmethod
    def over(cls, window: Window, grid: MapGrid, map_frame: CrsFrame, *, step_px: int = STEP_PX) -> Lattice:
        """Return the lattice over a window of ``grid``."""
        blocks_x, blocks_y = (-(-(side + 2 * step_px) // step_px) for side in (window.width, window.height))
        x = window.col_off + (np.arange(-1, blocks_x + 1) - 0.5) * step_px - 0.5
        y = window.row_off + (np.arange(-1, blocks_y + 1) - 0.5) * step_px - 0.5
        xy_px = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return cls(
            width=blocks_x * step_px,
            height=blocks_y * step_px,
            shape=(blocks_y + 2, blocks_x + 2),
            nodes_xy_map_m=map_frame.from_crs(grid.to_crs(xy_px)),
            step_px=step_px,
        )

    @property
    def domain(self) -> Box:
        """All pixels of the domain; the window's first pixel is at (``step_px``, ``step_px``)."""
        return Box(0, 0, self.width, self.height)

    def dense(self, values: FloatImage, box: Box | None = None) -> FloatImage:
        """Interpolate ``(rows, columns)`` or ``(rows, columns, k)`` node values to the pixels of ``box`` (all)."""
        x, y, w, h = self.domain if box is None else box
        n = self.step_px
        rows, cols = slice(y // n, -(-(y + h) // n) + 2), slice(x // n, -(-(x + w) // n) + 2)
        # Node k is the centre of block k - 1: enlarged, its block begins at pixel (k - 1) * step_px.
        part = values[rows, cols]
        large: FloatImage = cv2.resize(part, (part.shape[1] * n, part.shape[0] * n), interpolation=cv2.INTER_LINEAR)
        left, top = x - (cols.start - 1) * n, y - (rows.start - 1) * n
        return large[top : top + h, left : left + w]
