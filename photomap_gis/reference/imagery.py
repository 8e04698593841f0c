"""Existing imagery, read window by window on any north-up grid of the map: memory does not grow with the file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rasterio
from rasterio.crs import CRS
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import RasterioError
from rasterio.vrt import WarpedVRT
from rasterio.warp import transform as warp_points
from rasterio.warp import transform_bounds

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.grid import MapGrid
from photomap_gis.core.similarity import FloatArray

LUMINANCE = np.array([0.299, 0.587, 0.114], np.float32)
STRETCH_PERCENT = (0.5, 99.5)
MAX_WINDOW_SIDE_PX = 8192


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A grey ``(h, w)`` uint8 picture of a grid, and where it shows ground: ``mask`` ``(h, w)`` bool."""

    grey: ImageArray
    mask: npt.NDArray[np.bool_]

    @property
    def share_seen(self) -> float:
        """Share of the pixels that show ground."""
        return float(self.mask.mean())


class ReferenceImage:
    """Existing imagery and its place, opened for reading; use it as a context manager.

    Bands are read as red, green, blue where there are three or more, else the first as grey; other depths than 8 bits
    are stretched window by window. Transparent pixels and nodata show no ground. The geotransform may be turned.
    """

    def __init__(self, path: Path) -> None:
        """Open a raster; ``DataError`` where it cannot be read or says not where it lies."""
        self.path = path
        if not path.is_file():
            raise DataError(f"no such reference: {path}")
        try:
            self._dataset: Any = rasterio.open(path)
        except (RasterioError, OSError) as error:
            raise DataError(f"cannot read the reference {path}: {str(error).splitlines()[0]}") from error
        d = self._dataset
        problem = None
        if d.count < 1:
            problem = "has no bands"
        elif d.crs is None:
            problem = "has no CRS: give it one (gdal_edit.py -a_srs EPSG:CODE), or write it anew with one"
        elif d.transform.is_identity or d.transform.determinant == 0:
            problem = "has no geotransform: give a GeoTIFF, or a picture with its world file"
        elif np.dtype(d.dtypes[0]).kind == "c":
            problem = "holds complex numbers: give a picture"
        if problem is not None:
            d.close()
            raise DataError(f"the reference {path} {problem}")

    def __enter__(self) -> ReferenceImage:
        return self

    def __exit__(self, *_: object) -> None:
        self._dataset.close()

    def gsd_m_per_px(self, crs_wkt: str) -> float:
        """Return what a pixel in the raster's middle measures in a projected CRS (root of its area)."""
        d = self._dataset
        c, r = d.width / 2.0, d.height / 2.0
        xs, ys = _corners(d.transform, [c, c + 1.0, c], [r, r, r + 1.0])
        try:
            x, y = warp_points(d.crs, CRS.from_wkt(crs_wkt), xs, ys)
        except RasterioError as error:
            raise DataError(f"the reference {self.path} cannot be brought into the map's CRS: {error}") from error
        area = abs((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]))
        if not (math.isfinite(area) and area > 0.0):
            raise DataError(f"the reference {self.path} does not lie in this part of the world")
        return math.sqrt(area)

    def bounds(self, crs_wkt: str) -> tuple[float, float, float, float]:
        """Return west, south, east, north in a CRS; ``DataError`` where the raster cannot be brought there."""
        d = self._dataset
        w, h = float(d.width), float(d.height)
        xs, ys = _corners(d.transform, [0.0, w, 0.0, w], [0.0, 0.0, h, h])
        try:
            box = transform_bounds(d.crs, CRS.from_wkt(crs_wkt), min(xs), min(ys), max(xs), max(ys))
        except RasterioError as error:
            raise DataError(f"the reference {self.path} cannot be brought into the map's CRS: {error}") from error
        if not np.isfinite(box).all():
            raise DataError(f"the reference {self.path} does not lie in this part of the world")
        west, south, east, north = box
        return west, south, east, north

    def middle_lat_lon(self) -> tuple[float, float]:
        """Return latitude and longitude of the raster's middle in degrees (WGS84)."""
        d = self._dataset
        xs, ys = _corners(d.transform, [d.width / 2.0], [d.height / 2.0])
        try:
            lon, lat = warp_points(d.crs, CRS.from_epsg(4326), xs, ys)
        except RasterioError as error:
            raise DataError(f"the reference {self.path} has a CRS without a place on Earth: {error}") from error
        return float(lat[0]), float(lon[0])

    def state(self) -> str:
        """Return a word that changes when the file does: its size in bytes and its time of writing."""
        stat = self.path.stat()
        return f"{stat.st_size} {stat.st_mtime_ns}"

    def shows(self, grid: MapGrid) -> bool:
        """Whether the raster's outline meets a grid's."""
        west, south, east, north = self.bounds(str(grid.crs_wkt))
        w, s, e, n = grid.bounds
        return w < east and e > west and s < north and n > south

    def read(self, grid: MapGrid) -> Patch:
        """Return what a grid in the map's CRS shows; pixels beyond the raster are not seen."""
        if max(grid.width, grid.height) > MAX_WINDOW_SIDE_PX:
            raise ValueError(f"grid must not be longer than {MAX_WINDOW_SIDE_PX} px, got {grid.width} x {grid.height}")
        d = self._dataset
        finer = grid.pixel_size / self.gsd_m_per_px(str(grid.crs_wkt))
        # The alpha band is known by its colour interpretation: a fourth band may as well be near infrared.
        alpha = next((k + 1 for k, c in enumerate(d.colorinterp) if c is ColorInterp.alpha), None)
        bands = [1, 2, 3] if d.count - (alpha is not None) >= 3 else [1]
        try:
            with WarpedVRT(
                d, crs=CRS.from_wkt(str(grid.crs_wkt)), transform=rasterio.Affine(*grid.transform), width=grid.width,
                height=grid.height, resampling=Resampling.average if finer > 1.5 else Resampling.bilinear,
                add_alpha=alpha is None,
            ) as vrt:  # fmt: skip
                pixels = vrt.read(bands)
                seen = vrt.read(alpha if alpha is not None else vrt.count) > 0
        except (RasterioError, OSError) as error:
            raise DataError(f"cannot read the reference {self.path}: {str(error).splitlines()[0]}") from error
        if pixels.dtype.kind == "f":
            seen &= np.isfinite(pixels).all(axis=0)
        return Patch(_as_grey(pixels, seen), seen)


def _corners(transform: Any, columns: list[float], rows: list[float]) -> tuple[list[float], list[float]]:
    """Return x and y of pixel corners by a geotransform, turned ones too."""
    pairs = list(zip(columns, rows, strict=True))
    return (
        [transform.a * c + transform.b * r + transform.c for c, r in pairs],
        [transform.d * c + transform.e * r + transform.f for c, r in pairs],
    )


def _as_grey(pixels: npt.NDArray[Any], seen: npt.NDArray[np.bool_]) -> ImageArray:
    """``(h, w)`` uint8 of ``(bands, h, w)``: luminance, stretched where it is not 8 bits deep."""
    bands = np.nan_to_num(pixels.astype(np.float32))
    grey: FloatArray | npt.NDArray[np.float32]
    grey = bands[0] if len(bands) == 1 else np.tensordot(LUMINANCE, bands, axes=1)
    if pixels.dtype != np.uint8 and seen.any():
        low, high = np.percentile(grey[seen], STRETCH_PERCENT)
        grey = (grey - low) * (255.0 / max(float(high - low), 1e-9))
    out: ImageArray = cv2.add(np.where(seen, grey, 0.0).astype(np.float32), 0.0, dtype=cv2.CV_8U)
    return out
