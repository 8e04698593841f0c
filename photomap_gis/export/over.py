"""The stale imagery replaced: a copy of the user's raster in which the new map takes the place of old pixels."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date as Date
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rasterio
from pyproj import CRS, Geod
from rasterio.enums import ColorInterp
from rasterio.errors import RasterioError
from rasterio.windows import Window as RasterWindow
from shapely.geometry import MultiPolygon

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.grid import Window
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.crs import bounds_in, needs_place, same_crs
from photomap_gis.export.draft import Draft, draft_dataset, strips
from photomap_gis.export.footprint import feature_collection, outline_of, to_wgs84, write_geojson
from photomap_gis.export.geotiff import SIDE_SUFFIXES, bounded_cache, check_cog, draft_to_cog
from photomap_gis.export.old_raster import (
    BandRoles,
    Radiometry,
    channel_of,
    grid_of,
    into_type,
    open_old,
    radiometry_of,
    roles_of,
)
from photomap_gis.export.pixel_grid import AffineGrid
from photomap_gis.export.pixels import Rgba
from photomap_gis.export.publish import file_in_place_of
from photomap_gis.export.warp import Resampler

_SEEN_ALPHA = 128
_OUTLINE_PX = 2048
_BIG_DRAFT_BYTES = 2 << 30
_RGB = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)
_STALE_TAGS = ("STATISTICS_", "OVR_RESAMPLING_ALG", "LAYOUT", "COMPRESSION", "INTERLEAVE")

OnProgress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Replacement:
    """What was replaced: pixels of the old raster, their ground area, their outline in the old raster's CRS."""

    replaced_px: int
    area_m2: float
    outline: MultiPolygon
    footprint_path: Path


def write_over(
    source: TileSource,
    old_path: Path | str,
    out_path: Path | str,
    *,
    feather_px: int = 8,
    date: Date | str | None = None,
    ce90_m: float | None = None,
    footprint_path: Path | str | None = None,
    on_progress: OnProgress | None = None,
) -> Replacement:
    """Write ``out_path``: the old raster on its own grid, CRS, bands and number type, the new map laid over it.

    The new map's edge fades into the old pixels over ``feather_px`` of them; where the old raster has no data it does
    not fade. Pixels that are not replaced keep their values exactly: the copy is a lossless COG, whatever the old
    compression. The outline of what was replaced goes to ``footprint_path`` (default: beside the copy) as GeoJSON with
    ``date`` and ``ce90_m``. The old file is never touched.
    """
    old_path, out_path = Path(old_path).absolute(), Path(out_path).absolute()
    outline_path = (
        Path(footprint_path).absolute()
        if footprint_path is not None
        else out_path.with_name(f"{out_path.stem}-footprint.geojson")
    )
    if out_path.exists() and old_path.exists() and out_path.samefile(old_path):
        raise UsageError(f"{old_path} is never changed in place: name another file for the output")
    if feather_px < 0:
        raise UsageError(f"the feather must not be negative, got {feather_px}")
    needs_place(source.grid.crs_wkt, "replacing imagery")
    with open_old(old_path) as old, bounded_cache():
        overlay = _plan(source, old, feather_px)
        with file_in_place_of(out_path, lambda p: _check(p, out_path, old), side_suffixes=SIDE_SUFFIXES) as temporary:
            draft = temporary.with_name("draft.tif")
            with draft_dataset(draft, _profile(old)) as out:
                _copy_words(old, out.dataset, date, ce90_m)
                replaced_px, outline = _lay_over(overlay, old, out, on_progress)
            if replaced_px == 0:
                raise DataError(f"the map does not overlap {old_path}: nothing to replace")
            draft_to_cog(draft, temporary, compression="DEFLATE")
            draft.unlink()
        name, steps = old.name, 2 * sum(1 for _ in strips(old.width, old.height))
    if on_progress is not None:
        on_progress(steps, steps)
    in_degrees = to_wgs84(outline, overlay.grid.crs_wkt)
    area_m2 = abs(Geod(ellps="WGS84").geometry_area_perimeter(in_degrees)[0])
    properties = {
        "date": date.isoformat() if isinstance(date, Date) else date,
        "ce90_m": ce90_m,
        "area_m2": round(area_m2, 2),
        "replaces": Path(name).name,
        "raster": out_path.name,
        "feather_px": feather_px,
    }
    write_geojson(feature_collection(in_degrees, properties), outline_path)
    return Replacement(replaced_px, area_m2, outline, outline_path)


@dataclass(frozen=True, slots=True)
class _Overlay:
    """How the new map is read on the old raster's pixels: ``reader`` counts them from ``margin_px`` further out."""

    grid: AffineGrid
    reader: Resampler
    margin_px: int
    feather_px: int
    window: Window
    roles: BandRoles
    radiometry: Radiometry

    def read(self, window: Window) -> tuple[Rgba, npt.NDArray[np.float32]]:
        """Return the new map's pixels in a window, and their weights: 1 inside, fading to the map's edge, 0 outside."""
        m = self.margin_px  # how far an edge outside the window reaches into it
        rgba = self.reader.read(Window(window.col_off, window.row_off, window.width + 2 * m, window.height + 2 * m))
        seen = rgba[..., 3] >= _SEEN_ALPHA
        inner = (slice(m, m + window.height), slice(m, m + window.width))
        if self.feather_px == 0 or seen.all() or not seen.any():
            weight = seen.astype(np.float32)
        else:
            distance = cv2.distanceTransform(seen.astype(np.uint8), cv2.DIST_L2, 5)
            weight = np.clip((distance - 0.5) / self.feather_px, 0.0, 1.0).astype(np.float32)
        return rgba[inner], weight[inner]


def _plan(source: TileSource, old: Any, feather_px: int) -> _Overlay:
    grid, roles = grid_of(old), roles_of(old)
    crs, old_crs = str(source.grid.crs_wkt), str(grid.crs_wkt)
    box = source.grid.bounds if same_crs(crs, old_crs) else bounds_in(source.grid.bounds, crs, old_crs)
    corners = grid.to_px([[x, y] for x in box[0::2] for y in box[1::2]])
    left, top = (max(0, math.floor(v) - 2) for v in corners.min(axis=0))
    right, bottom = (
        min(n, math.ceil(v) + 3) for n, v in zip((grid.width, grid.height), corners.max(axis=0), strict=True)
    )
    if right <= left or bottom <= top:
        raise DataError(f"the map does not overlap {old.name}: nothing to replace")
    window = Window(left, top, right - left, bottom - top)
    radiometry = radiometry_of(old, roles, window, _preview(source, grid, window))
    margin = feather_px + 2
    return _Overlay(grid, Resampler(source, grid.grown(margin)), margin, feather_px, window, roles, radiometry)


def _preview(source: TileSource, grid: AffineGrid, window: Window) -> Rgba:
    """Return the new map over a window of the old raster, shrunk to at most 512 pixels."""
    step = max(1, -(-max(window.width, window.height) // 512))
    a, b, c, d, e, f = grid.transform
    x, y = window.col_off, window.row_off
    corner = (a * step, b * step, c + a * x + b * y, d * step, e * step, f + d * x + e * y)
    size = (-(-window.width // step), -(-window.height // step))
    return Resampler(source, AffineGrid(grid.crs_wkt, corner, *size)).read(Window(0, 0, *size))


def _profile(old: Any) -> dict[str, Any]:
    profile = {
        "width": old.width,
        "height": old.height,
        "count": old.count,
        "dtype": old.dtypes[0],
        "crs": old.crs,
        "transform": old.transform,
        "nodata": old.nodata,
        # RGB would name the first three bands red, green, blue whatever they are.
        "photometric": "RGB" if old.colorinterp[:3] == _RGB else "MINISBLACK",
    }
    if old.width * old.height * old.count * np.dtype(old.dtypes[0]).itemsize > _BIG_DRAFT_BYTES:
        profile |= {"compress": "ZSTD", "zstd_level": 1}  # the disk is dearer than the time
    return profile


def _copy_words(old: Any, out: Any, date: Date | str | None, ce90_m: float | None) -> None:
    """Carry over tags, colour interpretation, descriptions, scales and units; statistics would be stale."""
    out.colorinterp = old.colorinterp
    out.descriptions, out.scales, out.offsets, out.units = old.descriptions, old.scales, old.offsets, old.units
    ours = {"PHOTOMAP_REPLACED_DATE": date, "PHOTOMAP_REPLACED_CE90_M": ce90_m}
    fresh = {k: str(v) for k, v in old.tags().items() if not k.startswith(_STALE_TAGS)}
    out.update_tags(**fresh, **{k: str(v) for k, v in ours.items() if v is not None})
    for band in old.indexes:
        out.update_tags(band, **{k: v for k, v in old.tags(band).items() if not k.startswith(_STALE_TAGS)})


def _lay_over(overlay: _Overlay, old: Any, out: Draft, on_progress: OnProgress | None) -> tuple[int, MultiPolygon]:
    """Stream the old raster to ``out`` with the new map over it; return pixels replaced and their outline."""
    near = overlay.window
    # Outline cells must not straddle windows: a power of two up to the blocks' side.
    cell = min(512, 1 << max(0, math.ceil(math.log2(max(near.width, near.height) / _OUTLINE_PX))))
    col0, row0 = near.col_off // 512 * 512, near.row_off // 512 * 512
    cols, rows = -(-(near.col_off + near.width - col0) // cell), -(-(near.row_off + near.height - row0) // cell)
    replaced = np.zeros((rows, cols), bool)
    count = 0
    windows = list(strips(old.width, old.height))
    total = 2 * len(windows)
    for done, window in enumerate(windows, start=1):
        place = RasterWindow(*window)
        bands, mask = _read_old(old, place)
        if _touch(window, near):
            seen = _blend(overlay, window, bands, mask, old.nodatavals)
            count += int(seen.sum())
            _note(replaced, seen, window, (col0, row0), cell)
        out.write(bands, window)
        if overlay.roles.has_mask:
            out.write_mask(mask, window)
        if on_progress is not None:
            on_progress(done, total)
    a, b, c, d, e, f = overlay.grid.transform
    corner = (a * cell, b * cell, c + a * col0 + b * row0, d * cell, e * cell, f + d * col0 + e * row0)
    if count and not replaced.any():
        replaced[:] = True  # a sliver thinner than a cell: the overlap's box is the best that can be said
    return count, outline_of(replaced, corner)


def _read_old(old: Any, place: RasterWindow) -> tuple[npt.NDArray[Any], npt.NDArray[np.uint8]]:
    try:
        return old.read(window=place), old.dataset_mask(window=place)
    except RasterioError as error:
        raise DataError(f"{old.name} is damaged and cannot be read: repair it with gdal_translate first") from error


def _blend(
    overlay: _Overlay,
    window: Window,
    bands: npt.NDArray[Any],
    mask: npt.NDArray[np.uint8],
    nodata: tuple[float | None, ...],
) -> npt.NDArray[np.bool_]:
    """Blend the new map into ``bands`` and ``mask`` in place; return which pixels were touched."""
    rgba, weight = overlay.read(window)
    # Old colour that is no data must not shine through the feather.
    weight = np.where((mask == 0) & (weight > 0), np.float32(1.0), weight)
    seen = weight > 0
    if not seen.any():
        return seen
    roles, radiometry = overlay.roles, overlay.radiometry
    for (band, channel), gain, offset in zip(roles.colours, radiometry.gains, radiometry.offsets, strict=True):
        old = bands[band - 1]
        new = gain * channel_of(rgba, channel)[seen].astype(np.float64) + offset
        w = weight[seen].astype(np.float64)
        before = np.where(w < 1.0, old[seen], 0).astype(np.float64)  # old may be NaN where w is 1
        old[seen] = into_type(before * (1.0 - w) + new * w, bands.dtype, nodata[band - 1])
    if roles.alpha is not None:
        bands[roles.alpha - 1][seen] = np.iinfo(bands.dtype).max if bands.dtype.kind in "ui" else 255
    mask[seen] = 255
    return seen


def _note(
    replaced: npt.NDArray[np.bool_], seen: npt.NDArray[np.bool_], window: Window, origin: tuple[int, int], cell: int
) -> None:
    """Mark the outline's cells that are at least half replaced."""
    height, width = seen.shape
    padded = np.zeros((-(-height // cell) * cell, -(-width // cell) * cell), np.float32)
    padded[:height, :width] = seen
    full = padded.reshape(padded.shape[0] // cell, cell, padded.shape[1] // cell, cell).mean(axis=(1, 3)) >= 0.5
    r, c = (window.row_off - origin[1]) // cell, (window.col_off - origin[0]) // cell
    top, left = max(0, -r), max(0, -c)
    bottom, right = min(full.shape[0], replaced.shape[0] - r), min(full.shape[1], replaced.shape[1] - c)
    if bottom > top and right > left:
        replaced[r + top : r + bottom, c + left : c + right] |= full[top:bottom, left:right]


def _touch(a: Window, b: Window) -> bool:
    return (
        a.col_off < b.col_off + b.width
        and b.col_off < a.col_off + a.width
        and a.row_off < b.row_off + b.height
        and b.row_off < a.row_off + a.height
    )


def _check(temporary: Path, out_path: Path, old: Any) -> None:
    check_cog(temporary, out_path)
    with rasterio.open(temporary) as new:
        same = (new.width, new.height, new.count, new.dtypes, new.colorinterp) == (
            old.width, old.height, old.count, old.dtypes, old.colorinterp,
        )  # fmt: skip
        if not (
            same and new.transform.almost_equals(old.transform) and same_crs(new.crs.to_wkt(), CRS(old.crs).to_wkt())
        ):
            raise DataError(f"{out_path} could not be made like {old.name}: convert that to a plain GeoTIFF first")
