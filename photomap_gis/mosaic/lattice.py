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

_ROW = 256

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

    def within(self, other: Box) -> tuple[slice, slice]:
        """Rows and columns of ``other``'s pixels that are these."""
        return Box(self.x - other.x, self.y - other.y, self.width, self.height).slices

    def cut(self, other: Box) -> Box | None:
        """Return what two boxes have in common, ``None`` where that is nothing."""
        x, y = max(self.x, other.x), max(self.y, other.y)
        right = min(self.x + self.width, other.x + other.width)
        bottom = min(self.y + self.height, other.y + other.height)
        return Box(x, y, right - x, bottom - y) if right > x and bottom > y else None


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

    def box_in(self, coarser: Lattice, box: Box) -> Box:
        """Return where a box of this domain lies in that of a coarser lattice over the same window."""
        shift = coarser.step_px - self.step_px
        return Box(box.x + shift, box.y + shift, box.width, box.height)

    def nodes_under(self, box: Box) -> tuple[slice, slice]:
        """Return the rows and columns of the nodes from which the pixels of ``box`` are interpolated."""
        x, y, w, h, n = *box, self.step_px
        return slice(y // n, -(-(y + h) // n) + 2), slice(x // n, -(-(x + w) // n) + 2)

    def dense(self, values: FloatImage, box: Box | None = None, *, every: int = 1) -> FloatImage:
        """Interpolate ``(rows, columns)`` or ``(rows, columns, k)`` node values to the pixels of ``box`` (all).

        With ``every`` to one pixel in so many a side; it divides the nodes' distance and the box's place and size.
        """
        x, y, w, h = self.domain if box is None else box
        rows, cols = self.nodes_under(Box(x, y, w, h))
        # Node k is the centre of block k - 1: enlarged, its block begins at pixel (k - 1) * step_px.
        part = values[rows, cols]
        step = self.step_px // every
        large: FloatImage = cv2.resize(
            part, (part.shape[1] * step, part.shape[0] * step), interpolation=cv2.INTER_LINEAR
        )
        left, top = x // every - (cols.start - 1) * step, y // every - (rows.start - 1) * step
        return large[top : top + h // every, left : left + w // every]

    def at(self, values: FloatImage, places_px: FloatImage) -> FloatImage:
        """``(rows, columns, k)`` what ``dense`` of node values is at ``(rows, columns, 2)`` pixels of the domain.

        ``k`` is 4 at most.
        """
        nodes = (places_px + 0.5) * np.float32(1.0 / self.step_px) + 0.5  # node k is the centre of block k - 1
        # Steps of 1/32 of a node's distance, to which OpenCV rounds coordinates, are half pixels or finer.
        return np.asarray(cv2.remap(values, nodes, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def in_rows(x: npt.NDArray[np.int32], y: npt.NDArray[np.int32]) -> FloatImage:
    """``(rows, 256, 2)`` the N points and zeros after them: OpenCV takes no row of more than 32767."""
    rows = -(-len(x) // _ROW)
    out = np.zeros((rows * _ROW, 2), dtype=np.float32)
    out[: len(x), 0], out[: len(x), 1] = x, y
    return out.reshape(rows, _ROW, 2)
