"""A known pair laid on each other as the product does, without files."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from benchmarks.compare.pairs import KnownPair
from photomap_gis.compare.align import LaidPair, fine_field
from photomap_gis.compare.field import ShiftField
from photomap_gis.compare.imagery import ColourPatch, Colours
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.grid import MapGrid, Window


class ArrayImagery:
    """A picture in memory, read like imagery on its own grid."""

    def __init__(self, colour_bgr: ImageArray, pixel_m: float) -> None:
        h, w = colour_bgr.shape[:2]
        self.grid = MapGrid("EPSG:32632", 0.0, h * pixel_m, pixel_m, w, h)
        self._rgb = np.ascontiguousarray(colour_bgr[..., ::-1]).astype(np.float32) / np.float32(255.0)

    def read(self, grid: MapGrid, window: Window | None = None) -> ColourPatch:
        """Return a window's colours; nothing is seen beyond the picture."""
        w = window or Window(0, 0, grid.width, grid.height)
        out, seen = np.zeros((w.height, w.width, 3), np.float32), np.zeros((w.height, w.width), bool)
        x0, y0 = max(0, w.col_off), max(0, w.row_off)
        x1, y1 = min(self.grid.width, w.col_off + w.width), min(self.grid.height, w.row_off + w.height)
        if x1 > x0 and y1 > y0:
            there = np.s_[y0 - w.row_off : y1 - w.row_off, x0 - w.col_off : x1 - w.col_off]
            out[there], seen[there] = self._rgb[y0:y1, x0:x1], True
        return ColourPatch(out, seen)


def laid_on(pair: KnownPair) -> tuple[Colours, Colours, npt.NDArray[np.bool_]]:
    """Return the old colours laid on the new ones, the new ones, and where both show ground."""
    old, new = (ArrayImagery(g.colour, g.pixel_size_m) for g in (pair.old, pair.new))
    laid = LaidPair(old, new, new.grid, ShiftField.none(new.grid))
    field = fine_field(laid, workers=2)
    return LaidPair(old, new, new.grid, field).read(Window(0, 0, new.grid.width, new.grid.height))
