"""A user's raster, read for what its bands mean: which take colour, which says what was seen, and in what range."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rasterio
from rasterio.enums import ColorInterp, MaskFlags
from rasterio.errors import RasterioError
from rasterio.windows import Window as RasterWindow

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.grid import Window
from photomap_gis.export.crs import parse_crs
from photomap_gis.export.pixel_grid import AffineGrid
from photomap_gis.export.pixels import Rgba

_LUMINANCE = (0.299, 0.587, 0.114)
_LOW_PERCENT, _HIGH_PERCENT = 2.0, 98.0


@dataclass(frozen=True, slots=True)
class BandRoles:
    """What each band is: ``colours`` are (band number, channel 0-2 of RGB or ``None`` for grey); ``alpha`` a number."""

    colours: tuple[tuple[int, int | None], ...]
    alpha: int | None
    has_mask: bool


@dataclass(frozen=True, slots=True)
class Radiometry:
    """How 8-bit colour enters the old raster's numbers: ``old = gain * new + offset``, one pair a colour band."""

    gains: tuple[float, ...]
    offsets: tuple[float, ...]


@contextlib.contextmanager
def open_old(path: Path) -> Iterator[Any]:
    """Open the old raster; ``DataError`` where it cannot be read or lies nowhere."""
    try:
        dataset = rasterio.open(path)
    except RasterioError as error:
        reason = "no such file" if not path.exists() else "it is no raster that can be read"
        raise DataError(f"{path} cannot be opened: {reason}; name a georeferenced image") from error
    with dataset:
        if dataset.crs is None or dataset.transform.is_identity:
            raise DataError(f"{path} has no georeference: name a raster with a coordinate reference system")
        yield dataset


def grid_of(dataset: Any) -> AffineGrid:
    """Return the raster's grid."""
    try:
        wkt = parse_crs(dataset.crs.to_wkt()).to_wkt()
    except UsageError as error:
        raise DataError(
            f"{dataset.name} has a coordinate reference system without a place on Earth: assign one"
        ) from error
    return AffineGrid(wkt, tuple(dataset.transform)[:6], dataset.width, dataset.height)


def roles_of(dataset: Any) -> BandRoles:
    """Return what each band is; ``DataError`` with the way out for rasters that a photo map cannot replace."""
    name, kinds = dataset.name, dataset.colorinterp
    if len(set(dataset.dtypes)) != 1 or np.dtype(dataset.dtypes[0]).kind not in "uif":
        raise DataError(
            f"{name} has bands of mixed or complex numbers: make an 8-bit copy with gdal_translate -ot Byte"
        )
    if ColorInterp.palette in kinds:
        raise DataError(f"{name} has a colour table: expand it with gdal_translate -expand rgb OLD.tif RGB.tif")
    alphas = [i for i, kind in enumerate(kinds, start=1) if kind == ColorInterp.alpha]
    others = [i for i in dataset.indexes if i not in alphas]
    has_mask = not alphas and any(MaskFlags.per_dataset in flags for flags in dataset.mask_flag_enums)
    alpha = alphas[0] if alphas else None
    if len(alphas) > 1 or len(others) not in (1, 3):
        raise DataError(
            f"{name} has {dataset.count} bands and a photo map only red, green and blue: "
            "make a copy with gdal_translate -b 1 -b 2 -b 3 OLD.tif RGB.tif"
        )
    if len(others) == 1:
        return BandRoles(((others[0], None),), alpha, has_mask)
    order = {ColorInterp.red: 0, ColorInterp.green: 1, ColorInterp.blue: 2}
    named = [order.get(kinds[i - 1]) for i in others]
    channels = named if sorted(c for c in named if c is not None) == [0, 1, 2] else [0, 1, 2]
    return BandRoles(tuple(zip(others, channels, strict=True)), alpha, has_mask)


def channel_of(rgba: Rgba, channel: int | None) -> npt.NDArray[np.float32]:
    """``(H, W)`` one channel, or the luminance."""
    if channel is not None:
        return rgba[..., channel].astype(np.float32)
    return np.asarray(rgba[..., :3].astype(np.float32) @ np.array(_LUMINANCE, np.float32), dtype=np.float32)


def radiometry_of(dataset: Any, roles: BandRoles, window: Window, new: Rgba) -> Radiometry:
    """Return how the new colours enter the old numbers.

    8-bit colours stay as they are. For wider numbers nothing says what white is (11-bit sensors fill 16-bit files): the
    2nd and 98th percentiles of old and new over the overlap ``window`` are brought together, the new map's pixels
    ``new`` covering it in any resolution; where the old raster is empty there, white is the type's largest number.
    """
    dtype = np.dtype(dataset.dtypes[0])
    count = len(roles.colours)
    if dtype == np.uint8:
        return Radiometry((1.0,) * count, (0.0,) * count)
    shape = (min(512, window.height), min(512, window.width))
    seen = new[..., 3] >= 128
    gains, offsets = [], []
    for band, channel in roles.colours:
        old = dataset.read(band, window=RasterWindow(*window), out_shape=shape, masked=True).compressed()
        old = old[np.isfinite(old)]
        white = float(np.iinfo(dtype).max) if dtype.kind in "ui" else 1.0
        gain, offset = white / 255.0, 0.0
        fresh = channel_of(new, channel)[seen]
        if old.size >= 100 and fresh.size >= 100:
            low, high = np.percentile(old, (_LOW_PERCENT, _HIGH_PERCENT))
            dark, light = np.percentile(fresh, (_LOW_PERCENT, _HIGH_PERCENT))
            if high > low and light > dark:
                gain = float((high - low) / (light - dark))
                offset = float(low - gain * dark)
        gains.append(gain)
        offsets.append(offset)
    return Radiometry(tuple(gains), tuple(offsets))


def into_type(values: npt.NDArray[Any], dtype: np.dtype, nodata: float | None) -> npt.NDArray[Any]:
    """Round and clip to a number type; values that would read as "no data" move by the smallest step."""
    if dtype.kind == "f":
        out = values.astype(dtype)
        if nodata is not None and np.isfinite(nodata):
            out[out == dtype.type(nodata)] = np.nextafter(dtype.type(nodata), dtype.type(np.inf))
        return np.asarray(out)
    limits = np.iinfo(dtype)
    out = np.rint(values).clip(limits.min, limits.max).astype(dtype)
    if nodata is not None and limits.min <= nodata <= limits.max and float(nodata).is_integer():
        hole = int(nodata)
        out[out == hole] = hole + 1 if hole < limits.max else hole - 1
    return np.asarray(out)
