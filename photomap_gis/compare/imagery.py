"""Imagery of any kind as colours on any north-up grid, read window by window: memory does not grow with the file."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rasterio
from rasterio.crs import CRS
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.vrt import WarpedVRT
from rasterio.warp import transform as warp_points
from rasterio.warp import transform_bounds

from photomap_gis.core.errors import DataError, NotGeoreferencedError
from photomap_gis.core.grid import MapGrid, Window

BoolImage = npt.NDArray[np.bool_]
Colours = npt.NDArray[np.float32]

STRETCH_PERCENT = (0.5, 99.5)
_LOOK_PX = 768
_COLLAR_PX = 9
"""Pure black this wide is the collar of a picture without a mask, not ground."""
_RGB = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)


@dataclass(frozen=True, slots=True, eq=False)
class ColourPatch:
    """Colours ``(h, w, 3)`` RGB float32, 0 to 1, and where they show ground: ``mask`` ``(h, w)`` bool."""

    rgb: Colours
    mask: BoolImage


class Imagery:
    """A raster and its place, opened for reading; use it as a context manager. Safe among threads.

    Red, green, blue are found by their names, else they are the first three bands; fewer bands are grey; a colour
    table is looked up. Other depths than 8 bits are stretched, by the whole file's percentiles. Transparent pixels,
    nodata and a black collar show no ground. The geotransform may be turned.
    """

    def __init__(self, path: Path) -> None:
        """Open a raster; ``DataError`` where it cannot be read or says not where it lies."""
        self.path = path
        if not path.is_file():
            raise DataError(f"no such file: {path}; name a GeoTIFF or a mission folder")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", NotGeoreferencedWarning)  # told below, with the way out
                self._dataset: Any = rasterio.open(path)
        except (RasterioError, OSError) as error:
            raise DataError(f"{path} cannot be read as imagery: {str(error).splitlines()[0]}") from error
        try:
            self._check()
            self._look()
        except BaseException:
            self._dataset.close()
            raise
        self._lock = Lock()

    def __enter__(self) -> Imagery:
        return self

    def __exit__(self, *_: object) -> None:
        self._dataset.close()

    @property
    def crs_wkt(self) -> str:
        """The raster's own CRS."""
        return str(self._dataset.crs.to_wkt())

    @property
    def is_grey(self) -> bool:
        """Whether it has no colours."""
        return len(self._bands) < 3 and self._table is None

    def gsd_m_per_px(self, crs_wkt: str) -> float:
        """Return what a pixel in the raster's middle measures in a projected CRS in metres (root of its area)."""
        d = self._dataset
        c, r = d.width / 2.0, d.height / 2.0
        xs, ys = zip(*((d.transform * p) for p in ((c, r), (c + 1.0, r), (c, r + 1.0))), strict=True)
        x, y = self._in(crs_wkt, list(xs), list(ys))
        area = abs((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]))
        if not (math.isfinite(area) and area > 0.0):
            raise DataError(f"{self.path} does not lie in this part of the world")
        return math.sqrt(area)

    def bounds(self, crs_wkt: str) -> tuple[float, float, float, float]:
        """Return west, south, east, north in a CRS; ``DataError`` where the raster cannot be brought there."""
        d = self._dataset
        corners = [d.transform * p for p in ((0, 0), (d.width, 0), (0, d.height), (d.width, d.height))]
        xs, ys = zip(*corners, strict=True)
        try:
            box = transform_bounds(d.crs, CRS.from_wkt(crs_wkt), min(xs), min(ys), max(xs), max(ys))
        except RasterioError as error:
            raise self._elsewhere() from error
        if not np.isfinite(box).all():
            raise self._elsewhere()
        west, south, east, north = box
        return west, south, east, north

    def middle_lat_lon(self) -> tuple[float, float]:
        """Return latitude and longitude of the raster's middle in degrees (WGS84)."""
        d = self._dataset
        x, y = d.transform * (d.width / 2.0, d.height / 2.0)
        lon, lat = self._in("EPSG:4326", [x], [y])
        if not (abs(lat[0]) <= 90.0 and abs(lon[0]) <= 360.0):
            raise DataError(f"{self.path} says that it lies at {lat[0]:g}, {lon[0]:g} degrees: mend its CRS")
        return float(lat[0]), (float(lon[0]) + 180.0) % 360.0 - 180.0

    def read(self, grid: MapGrid, window: Window | None = None) -> ColourPatch:
        """Return what a window of a grid shows (default: all of it); windows may overhang the grid."""
        w = window or Window(0, 0, grid.width, grid.height)
        a, _, west, _, e, north = grid.transform
        place = rasterio.Affine(a, 0.0, west + a * w.col_off, 0.0, e, north + e * w.row_off)
        finer = grid.pixel_size / self.gsd_m_per_px(str(grid.crs_wkt))
        resampling = Resampling.average if finer > 1.5 else Resampling.cubic if finer < 0.75 else Resampling.bilinear
        if self._table is not None:
            resampling = Resampling.nearest
        try:
            with self._lock, WarpedVRT(
                self._dataset, crs=CRS.from_wkt(str(grid.crs_wkt)), transform=place, width=w.width, height=w.height,
                resampling=resampling, add_alpha=self._alpha is None,
            ) as vrt:  # fmt: skip
                pixels = vrt.read(self._bands)
                seen = vrt.read(self._alpha if self._alpha is not None else vrt.count) > self._opaque / 2
        except (RasterioError, OSError) as error:
            raise DataError(f"{self.path} cannot be read: {str(error).splitlines()[0]}") from error
        if pixels.dtype.kind == "f":
            seen &= np.isfinite(pixels).all(axis=0)
        elif self._alpha is None and not self._has_mask:
            seen &= ~_collar(pixels)
        return ColourPatch(self._colours(pixels, seen), seen)

    def _check(self) -> None:
        d = self._dataset
        problem = None
        if d.count < 1:
            problem = "has no bands"
        elif d.crs is None:
            problem = "has no CRS: give it one (gdal_edit.py -a_srs EPSG:CODE), or write it anew with one"
        elif d.transform.is_identity or d.transform.determinant == 0:
            problem = "has no geotransform: give a GeoTIFF, or a picture with its world file"
        elif np.dtype(d.dtypes[0]).kind not in "uif" or len(set(d.dtypes[:3])) > 1:
            problem = "has bands of mixed or complex numbers: make an 8-bit copy with gdal_translate -ot Byte"
        elif not (d.crs.is_projected or d.crs.is_geographic):
            raise NotGeoreferencedError(
                f"{self.path} is in local units without a place on Earth: give its map a place by 'photomap "
                "georeference MISSION --pick ...', or map it with --track FILE"
            )
        if problem is not None:
            raise DataError(f"{self.path} {problem}")

    def _look(self) -> None:
        """Find out what the bands mean and which numbers are dark and light."""
        d = self._dataset
        kinds = list(d.colorinterp)
        self._alpha = next((k + 1 for k, c in enumerate(kinds) if c is ColorInterp.alpha), None)
        others = [k + 1 for k in range(d.count) if k + 1 != self._alpha]
        if not others:
            raise DataError(f"{self.path} has nothing but an alpha band: name imagery")
        named = [kinds.index(c) + 1 for c in _RGB if c in kinds]
        self._bands = named if len(named) == 3 else others[:3] if len(others) >= 3 else others[:1]
        self._table: Colours | None = None
        if kinds[self._bands[0] - 1] is ColorInterp.palette:
            self._bands = self._bands[:1]
            table = np.zeros((1 << 16, 3), np.float32)
            for index, entry in d.colormap(self._bands[0]).items():
                table[index] = np.array(entry[:3], np.float32) / 255.0
            self._table = table
        self._has_mask = d.nodata is not None or any("per_dataset" in str(f) for f in d.mask_flag_enums)
        dtype = np.dtype(d.dtypes[0])
        self._opaque = 255.0
        if self._alpha is not None and np.dtype(d.dtypes[self._alpha - 1]).kind in "ui":
            self._opaque = float(np.iinfo(d.dtypes[self._alpha - 1]).max)
        self._low, self._high = 0.0, 255.0
        if dtype != np.uint8 and self._table is None:
            self._low, self._high = self._percentiles()

    def _percentiles(self) -> tuple[float, float]:
        d = self._dataset
        shrink = max(1.0, max(d.width, d.height) / _LOOK_PX)
        shape = (max(1, round(d.height / shrink)), max(1, round(d.width / shrink)))
        try:
            pixels = d.read(self._bands, out_shape=(len(self._bands), *shape), masked=True)
        except (RasterioError, OSError) as error:
            raise DataError(f"{self.path} cannot be read: {str(error).splitlines()[0]}") from error
        values = np.ma.masked_invalid(pixels.astype(np.float64)).compressed()
        if not values.size:
            return 0.0, 1.0
        low, high = np.percentile(values, STRETCH_PERCENT)
        return float(low), float(max(high, low + 1e-9))

    def _colours(self, pixels: npt.NDArray[Any], seen: BoolImage) -> Colours:
        if self._table is not None:
            rgb = self._table[np.clip(pixels[0].astype(np.int64), 0, len(self._table) - 1)]
        else:
            bands = np.nan_to_num(pixels.astype(np.float32))
            bands = np.clip((bands - np.float32(self._low)) / np.float32(self._high - self._low), 0.0, 1.0)
            rgb = np.repeat(bands[0][..., None], 3, axis=2) if len(bands) < 3 else bands.transpose(1, 2, 0)
        return np.ascontiguousarray(np.where(seen[..., None], rgb, np.float32(0.0)))

    def _in(self, crs: str, xs: list[float], ys: list[float]) -> tuple[list[float], list[float]]:
        target = CRS.from_string(crs) if crs.startswith("EPSG:") else CRS.from_wkt(crs)
        try:
            x, y = warp_points(self._dataset.crs, target, xs, ys)
        except RasterioError as error:
            raise self._elsewhere() from error
        if not np.isfinite([*x, *y]).all():
            raise self._elsewhere()
        return x, y

    def _elsewhere(self) -> DataError:
        return DataError(f"{self.path} cannot be brought into the CRS of the comparison: do both lie in one place?")


def _collar(pixels: npt.NDArray[Any]) -> BoolImage:
    """``(h, w)``: wide areas of nothing but zeros."""
    black = (pixels == 0).all(axis=0).astype(np.uint8)
    if not black.any():
        return black > 0
    kernel = np.ones((_COLLAR_PX, _COLLAR_PX), np.uint8)
    return cv2.dilate(cv2.erode(black, kernel, borderValue=1), kernel) > 0
