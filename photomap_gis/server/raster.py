"""Rasters on disk as the pictures that a page shows: any GeoTIFF becomes RGBA, at its own size or an overview's.

Colours of 8 bits stay as they are, wider numbers are stretched over what the file holds, and a single band of numbers
that mean something (metres, seconds, counts) becomes a ramp of colours with a legend.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import rasterio
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import RasterioError
from rasterio.windows import Window as RasterWindow

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.export.crs import parse_crs
from photomap_gis.export.pixel_grid import AffineGrid
from photomap_gis.server.ramp import Ramp

Rgba = npt.NDArray[np.uint8]

_LOOK_PX = 512  # statistics are taken from a picture of about this side
_STRETCH_PERCENT = (2.0, 98.0)
_SQUARE = 1e-9
_PACKED_HERE = ("DEFLATE", "ZSTD", "JPEG", "WEBP")
"""Compressions whose overviews we make; GDAL makes the others'."""


class RasterFile:
    """A GeoTIFF (or anything that GDAL reads) opened for showing; safe among threads, closed with ``close``.

    ``levels`` are its own pixels and then its overviews, each a ``TileSource`` of RGBA.
    """

    def __init__(self, path: Path, *, local: bool = False, ramp: bool = False) -> None:
        """Open a raster; ``DataError`` where it cannot be read, or says not where it lies and is not ``local``.

        ``ramp`` shows the first band, where it holds numbers of more than 8 bits, as colours with a legend.
        """
        self.path = path
        self._lock = threading.Lock()
        self._datasets: list[Any] = [self._opened()]
        base = self._datasets[0]
        try:
            crs_wkt = _crs_of(base, path, local=local)
            self._bands = _Bands.of(base, ramp=ramp)
            self._datasets += [self._opened(overview_level=n) for n in range(len(base.overviews(1)))]
        except BaseException:
            self.close()
            raise
        grid = _grid(crs_wkt, base, base)
        self.levels = tuple(
            RasterLevel(self, n, _grid(crs_wkt, base, d, 1 << n if _is_ours(base) else None))
            for n, d in enumerate(self._datasets)
        )
        self.grid = grid
        self.tags: dict[str, str] = dict(base.tags()) | {k: v for k, v in base.tags(1).items() if v}

    @property
    def ramp(self) -> Ramp | None:
        """The colours that stand for numbers, ``None`` where the file is a picture."""
        return self._bands.ramp

    @property
    def units(self) -> str:
        """What its numbers are in, as the file says; empty where it does not."""
        with self._lock:
            units = self._datasets[0].units[0]
        return str(units or self.tags.get("UNITS") or self.tags.get("units") or "")

    @property
    def band_name(self) -> str:
        """What its first band is called, where it has several; else empty."""
        with self._lock:
            names = self._datasets[0].descriptions
        return str(names[0] or "") if len(names) > 1 else ""

    def value_at(self, xy_px: tuple[float, float]) -> float | None:
        """Return the first band's number at a pixel-centre coordinate, ``None`` where there is none."""
        col, row = (math.floor(v + 0.5) for v in xy_px)
        with self._lock:
            d = self._datasets[0]
            if not (0 <= col < d.width and 0 <= row < d.height):
                return None
            window = RasterWindow(col, row, 1, 1)
            if d.dataset_mask(window=window)[0, 0] == 0:
                return None
            value = float(d.read(1, window=window)[0, 0])
        return value if math.isfinite(value) else None

    def read_rgba(self, level: int, window: Window) -> Rgba:
        """``(height, width, 4)`` RGBA of a window of a level, transparent beyond its edges."""
        out = np.zeros((window.height, window.width, 4), np.uint8)
        with self._lock:
            d = self._datasets[level]
            left, top = max(0, window.col_off), max(0, window.row_off)
            right = min(d.width, window.col_off + window.width)
            bottom = min(d.height, window.row_off + window.height)
            if right <= left or bottom <= top:
                return out
            inner = RasterWindow(left, top, right - left, bottom - top)
            try:
                values = d.read(list(self._bands.numbers), window=inner)
                mask = d.dataset_mask(window=inner)
            except RasterioError as error:
                raise DataError(f"{self.path} cannot be read here: it is damaged or was replaced") from error
        rgba = self._bands.to_rgba(values, mask)
        y, x = top - window.row_off, left - window.col_off
        out[y : y + rgba.shape[0], x : x + rgba.shape[1]] = rgba
        return out

    def close(self) -> None:
        """Close the file."""
        for d in self._datasets:
            d.close()

    def _opened(self, **options: int) -> Any:
        try:
            return rasterio.open(self.path, **options)
        except (RasterioError, OSError) as error:
            why = "is no raster that can be read" if self.path.is_file() else "does not exist"
            raise DataError(f"{self.path} {why}: name a GeoTIFF") from error


@dataclass(frozen=True, slots=True, eq=False)
class RasterLevel:
    """One level of a raster, read as a ``TileSource``."""

    file: RasterFile
    level: int
    grid: MapGrid
    revision: int = 0

    def read(self, window: Window) -> Rgba:
        """``(height, width, 4)`` RGBA, transparent beyond the grid."""
        return self.file.read_rgba(self.level, window)


class _PlacedGrid(AffineGrid):
    """A raster that is turned, or whose pixels are not square, as the transform path reads its sources."""

    __slots__ = ()

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north."""
        w, h = self.width, self.height
        xy = self.to_crs(np.array([[0, 0], [w, 0], [0, h], [w, h]]) - 0.5)
        (west, south), (east, north) = xy.min(axis=0), xy.max(axis=0)
        return float(west), float(south), float(east), float(north)


@dataclass(frozen=True, slots=True, eq=False)
class _Bands:
    """Which bands are looked at, and how their numbers become colours."""

    numbers: tuple[int, ...]
    gain: npt.NDArray[np.float32]
    offset: npt.NDArray[np.float32]
    ramp: Ramp | None = None
    palette: npt.NDArray[np.uint8] | None = None

    @classmethod
    def of(cls, dataset: Any, *, ramp: bool) -> _Bands:
        kinds = dataset.colorinterp
        colours = [i for i in dataset.indexes if kinds[i - 1] != ColorInterp.alpha]
        if not colours or any(np.dtype(t).kind == "c" for t in dataset.dtypes):
            raise DataError(f"{dataset.name} holds no picture: name an image with 1 or 3 bands")
        ramp = ramp and np.dtype(dataset.dtypes[0]) != np.uint8
        numbers = (colours[0],) if ramp or len(colours) < 3 else tuple(colours[:3])
        none = np.zeros(len(numbers), np.float32)
        if ColorInterp.palette in kinds:
            table = np.zeros((256, 4), np.uint8)
            for k, colour in dataset.colormap(colours[0]).items():
                if 0 <= k < 256:
                    table[k] = colour
            return cls((colours[0],), none + 1, none, palette=table)
        if np.dtype(dataset.dtypes[0]) == np.uint8:
            return cls(numbers, none + 1, none)
        seen = _look(dataset, numbers)
        if ramp:
            return cls(numbers, none + 1, none, ramp=Ramp.over(seen[0]))
        limits = [np.percentile(v, _STRETCH_PERCENT) if v.size else np.array([0.0, 1.0]) for v in seen]
        low = np.array([v[0] for v in limits], np.float32)
        gain = 255.0 / np.maximum(np.array([v[1] for v in limits], np.float32) - low, 1e-12)
        return cls(numbers, gain.astype(np.float32), -low * gain.astype(np.float32))

    def to_rgba(self, values: npt.NDArray[Any], mask: npt.NDArray[np.uint8]) -> Rgba:
        if self.palette is not None:
            rgba = self.palette[values[0].astype(np.uint8)]
            return np.where(mask[..., None] > 0, rgba, 0).astype(np.uint8)
        if self.ramp is not None:
            return self.ramp.colours(values[0], mask > 0)
        if values.dtype != np.uint8:
            scaled = values.astype(np.float32) * self.gain[:, None, None] + self.offset[:, None, None]
            values = np.nan_to_num(scaled).clip(0, 255).astype(np.uint8)
        planes = [values[min(k, len(values) - 1)] for k in range(3)]
        return np.stack([*planes, mask], axis=-1)


def _look(dataset: Any, numbers: tuple[int, ...]) -> list[npt.NDArray[np.float64]]:
    """Return the finite numbers of each band, from a small picture of the raster."""
    shrink = max(1.0, max(dataset.width, dataset.height) / _LOOK_PX)
    shape = (max(1, int(dataset.height / shrink)), max(1, int(dataset.width / shrink)))
    read = dataset.read(list(numbers), out_shape=(len(numbers), *shape), resampling=Resampling.nearest, masked=True)
    found = [band.compressed().astype(np.float64) for band in read]
    return [v[np.isfinite(v)] for v in found]


def _crs_of(dataset: Any, path: Path, *, local: bool) -> str | None:
    if local:
        return None
    if dataset.crs is None or dataset.transform.is_identity or dataset.transform.determinant == 0:
        raise DataError(f"{path} has no georeference: name a raster with a coordinate reference system")
    try:
        return parse_crs(dataset.crs.to_wkt()).to_wkt()
    except UsageError as error:
        raise DataError(
            f"{path} has no place on Earth (its CRS is a local one): name a georeferenced raster"
        ) from error


def _is_ours(dataset: Any) -> bool:
    """Whether an overview halves the level above exactly: those of others cover just what the file covers."""
    return (
        str(dataset.tags().get("TIFFTAG_SOFTWARE", "")).startswith("photomap")
        and dataset.compression is not None
        and dataset.compression.value in _PACKED_HERE
    )


def _grid(crs_wkt: str | None, base: Any, level: Any, times: float | None = None) -> MapGrid:
    """Return the grid of a level, whose pixels are ``times`` as large as the file's own.

    Where that is not known it covers what the file covers, so its pixels may be slightly off square.
    """
    a, b, c, d, e, f = tuple(base.transform)[:6]
    along, down = (times, times) if times else (base.width / level.width, base.height / level.height)
    a, d, b, e = a * along, d * along, b * down, e * down
    if b == 0 and d == 0 and a > 0 and abs(a + e) <= _SQUARE * a:
        return MapGrid(crs_wkt, c, f, a, level.width, level.height)
    # The transform path asks a source's grid for its points, size and bounds only, and this one tells them.
    return cast(MapGrid, _PlacedGrid(crs_wkt, (a, b, c, d, e, f), level.width, level.height))
