"""An elevation model asked at places: any raster, any CRS, read block by block; what it does not know is NaN."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import ArrayLike, NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError
from rasterio.errors import RasterioError
from rasterio.windows import Window

from photomap_gis.core.errors import DataError
from photomap_gis.elevation.vertical import VerticalDatum, datum_of

FloatArray = NDArray[np.float64]

_BLOCK_PX = 1024
_LOWEST_M, _HIGHEST_M = -600.0, 9000.0  # what is outside of this is an unmarked hole, as -32768 often is
_METRES = {"": 1.0, "m": 1.0, "metre": 1.0, "meter": 1.0, "metres": 1.0, "meters": 1.0}
_FEET = {"ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "us survey foot": 1200 / 3937, "ftus": 1200 / 3937}


@dataclass(frozen=True, slots=True, eq=False)
class Dem:
    """Elevations in metres above ``vertical``, bilinear between pixel centres; ``cell_m`` is about a pixel's side.

    ``stated`` is whether the file or the user said what the heights are above.
    """

    path: Path
    vertical: VerticalDatum
    stated: bool
    cell_m: float
    _to_crs: Transformer
    _blocks: dict[tuple[int, int], FloatArray] = field(default_factory=dict)

    def elevation_m(self, lat_lon_deg: ArrayLike) -> FloatArray:
        """Return ``(N,)`` elevations at ``(N, 2)`` latitudes and longitudes in degrees; NaN where there is none."""
        places = np.atleast_2d(np.asarray(lat_lon_deg, np.float64))
        x, y = self._to_crs.transform(places[:, 1], places[:, 0])
        found = np.full(len(places), np.nan)
        try:
            with rasterio.open(self.path) as raster:
                col, row = _pixels(raster.transform, x, y)
                inside = np.isfinite(col) & np.isfinite(row)
                inside &= (col >= -0.5) & (row >= -0.5) & (col <= raster.width - 0.5) & (row <= raster.height - 0.5)
                col = np.clip(col, 0, raster.width - 1)
                row = np.clip(row, 0, raster.height - 1)
                ids = np.column_stack((np.nan_to_num(row) // _BLOCK_PX, np.nan_to_num(col) // _BLOCK_PX)).astype(int)
                for block in {(int(r), int(c)) for r, c in ids[inside]}:
                    here = inside & (ids[:, 0] == block[0]) & (ids[:, 1] == block[1])
                    values = self._block(raster, block)
                    found[here] = _bilinear(values, row[here] - block[0] * _BLOCK_PX, col[here] - block[1] * _BLOCK_PX)
        except RasterioError as error:
            raise DataError(f"the elevation model {self.path} cannot be read: {error}") from error
        return found

    def _block(self, raster: rasterio.DatasetReader, block: tuple[int, int]) -> FloatArray:
        if block not in self._blocks:
            if len(self._blocks) >= 64:  # half a gigabyte; the planner goes over the ground in order
                self._blocks.pop(next(iter(self._blocks)))
            top, left = block[0] * _BLOCK_PX, block[1] * _BLOCK_PX
            # one pixel more to the right and below, to interpolate across the block's edge
            window = Window(left, top, min(_BLOCK_PX + 1, raster.width - left), min(_BLOCK_PX + 1, raster.height - top))
            self._blocks[block] = _read(raster, window)
        return self._blocks[block]


def open_dem(path: Path | str, vertical: VerticalDatum | None = None) -> Dem:
    """Open an elevation model; ``vertical`` overrides what the file says of its heights.

    Raises ``DataError`` where it is no raster with a place on Earth, or its heights are in an unknown unit.
    """
    path = Path(path)
    if not path.is_file():
        raise DataError(f"the elevation model {path} cannot be read: no such file; name a raster with heights")
    try:
        with rasterio.open(path) as raster:
            if raster.crs is None or raster.transform.is_identity:
                raise DataError(f"{path} says not where on Earth it lies: give an elevation model with a CRS")
            _unit(raster, path)
            crs = CRS.from_wkt(raster.crs.to_wkt())
            width, height, affine = raster.width, raster.height, raster.transform
    except RasterioError as error:
        raise DataError(f"the elevation model {path} cannot be read: {error}") from error
    except CRSError as error:
        raise DataError(f"the CRS of {path} is not known: {error}") from error
    said = datum_of(crs)
    horizontal = crs.sub_crs_list[0] if crs.is_compound else crs.to_2d() if len(crs.axis_info) == 3 else crs
    to_crs = Transformer.from_crs("EPSG:4326", horizontal, always_xy=True)
    used = vertical or said or VerticalDatum.MSL
    stated = vertical is not None or said is not None
    return Dem(path, used, stated, _cell_m(to_crs, affine, width, height), to_crs)


def _read(raster: rasterio.DatasetReader, window: Window) -> FloatArray:
    raw = raster.read(1, window=window, masked=True)
    values = np.ma.filled(raw.astype(np.float64), np.nan)
    values = (values * raster.scales[0] + raster.offsets[0]) * _unit(raster, Path(raster.name))
    values[~((values >= _LOWEST_M) & (values <= _HIGHEST_M))] = np.nan
    return values


def _unit(raster: rasterio.DatasetReader, path: Path) -> float:
    name = (raster.units[0] or "").strip().lower()
    factor = {**_METRES, **_FEET}.get(name)
    if factor is None:
        raise DataError(f"the heights of {path} are in {name[:30]!r}, which is not known: convert them to metres")
    return factor


def _pixels(affine: rasterio.Affine, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Columns and rows, 0 at the centre of the first pixel."""
    inverse = ~affine
    px, py = np.asarray(x, np.float64), np.asarray(y, np.float64)
    col = inverse.a * px + inverse.b * py + inverse.c - 0.5
    row = inverse.d * px + inverse.e * py + inverse.f - 0.5
    return col, row


def _bilinear(values: FloatArray, row: FloatArray, col: FloatArray) -> FloatArray:
    """NaN where any neighbour that has a weight is NaN."""
    r0 = np.clip(np.floor(row).astype(int), 0, values.shape[0] - 1)
    c0 = np.clip(np.floor(col).astype(int), 0, values.shape[1] - 1)
    r1, c1 = np.minimum(r0 + 1, values.shape[0] - 1), np.minimum(c0 + 1, values.shape[1] - 1)
    fr, fc = row - r0, col - c0
    total = np.zeros(len(row))
    for r, c, weight in (
        (r0, c0, (1 - fr) * (1 - fc)),
        (r0, c1, (1 - fr) * fc),
        (r1, c0, fr * (1 - fc)),
        (r1, c1, fr * fc),
    ):
        total += np.where(weight > 0, values[r, c] * weight, 0.0)
    return total


def _cell_m(to_crs: Transformer, affine: rasterio.Affine, width: int, height: int) -> float:
    """About how long a pixel's side is on the ground, in the raster's middle."""
    cols = np.array([width / 2, width / 2 + 1, width / 2])
    rows = np.array([height / 2, height / 2, height / 2 + 1])
    x = affine.a * cols + affine.b * rows + affine.c
    y = affine.d * cols + affine.e * rows + affine.f
    lon, lat = to_crs.transform(x, y, direction="INVERSE")
    north = np.radians(lat[1:] - lat[0]) * 6.371e6
    east = np.radians(lon[1:] - lon[0]) * 6.371e6 * math.cos(math.radians(float(lat[0])))
    sides = np.hypot(north, east)
    cell = float(sides.min())
    if not (math.isfinite(cell) and cell > 0):
        raise DataError("the elevation model's pixels have no size on the ground: check its CRS and transform")
    return cell
