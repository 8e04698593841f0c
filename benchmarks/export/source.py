"""A GeoTIFF read as a map: what both sides of a comparison start from."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rasterio
from rasterio.windows import Window as RasterWindow

from photomap_gis.core.grid import MapGrid, Window


class GeoTiffSource:
    """A ``TileSource`` over an RGBA GeoTIFF, one open dataset a thread."""

    revision = 1

    def __init__(self, path: Path) -> None:
        self._path, self._local = path, threading.local()
        with rasterio.open(path) as d:
            t = d.transform
            self.grid = MapGrid(d.crs.to_wkt(), t.c, t.f, t.a, d.width, d.height)

    def read(self, window: Window) -> npt.NDArray[np.uint8]:
        """``(height, width, 4)`` RGBA, transparent beyond the raster."""
        dataset = self._dataset()
        c, r, w, h = window
        left, top = max(0, c), max(0, r)
        right, bottom = min(c + w, self.grid.width), min(r + h, self.grid.height)
        out = np.zeros((h, w, 4), np.uint8)
        if right > left and bottom > top:
            bands = dataset.read(window=RasterWindow(left, top, right - left, bottom - top))
            out[top - r : bottom - r, left - c : right - c] = cv2.merge(list(bands))
        return out

    def _dataset(self) -> Any:
        if not hasattr(self._local, "dataset"):
            self._local.dataset = rasterio.open(self._path)
        return self._local.dataset
