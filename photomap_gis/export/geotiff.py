"""The map as one cloud-optimised GeoTIFF: tiled, with alpha and overviews, in the right place."""

from __future__ import annotations

import contextlib
import math
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rasterio
import rasterio.shutil
from rasterio.enums import ColorInterp
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.windows import Window as RasterWindow
from rio_cogeo.cogeo import cog_validate

from photomap_gis.core.errors import OutputError
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.area import Area, clipped
from photomap_gis.export.pixels import Rgba
from photomap_gis.export.publish import file_in_place_of
from photomap_gis.export.pyramid import Pyramid, Tile
from photomap_gis.export.tiff_file import MASK, REDUCED, Directory, read_directories, write_cog
from photomap_gis.export.warp import target_grid, warped
from photomap_gis.parallel import usable_cpus

COMPRESSIONS = ("DEFLATE", "ZSTD", "LZW", "WEBP", "JPEG", "NONE")
NOT_GEOREFERENCED = "NOT GEOREFERENCED: local units (not metres), no place on Earth; north is arbitrary"
# GeoTIFF writes down metres whatever the unit, so the name must say that they are none.
LOCAL_CRS_WKT = (
    'LOCAL_CS["photomap local frame, units are not metres (NOT GEOREFERENCED)",LOCAL_DATUM["local",0],UNIT["metre",1],'
    'AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
)

SIDE_SUFFIXES = (".aux.xml", ".ovr", ".msk")  # where GDAL and QGIS keep statistics, overviews and masks of a file

_BLOCK_PX = 512
LEVEL = 3  # of DEFLATE and ZSTD; measured on photos: half the time of level 6 for 7 % more bytes
_CACHE_BYTES = 96 << 20
_STRIP_PX = 2048  # the map is copied in windows of this width and one block's height

OnProgress = Callable[[int, int], None]


def write_geotiff(
    source: TileSource,
    path: Path | str,
    *,
    crs: str | None = None,
    pixel_size: float | None = None,
    area: Area | None = None,
    compression: str = "DEFLATE",
    quality: int | None = None,
    metadata: Mapping[str, str] | None = None,
    on_progress: OnProgress | None = None,
) -> MapGrid:
    """Write the map as a COG (RGB and alpha, 512-pixel tiles, averaged overviews) and return the grid written.

    ``crs`` and ``pixel_size`` (in its units) default to the map's own: then every pixel is copied, not resampled. JPEG
    and WEBP lose detail for a tenth of the size; JPEG keeps a mask in place of alpha. A map without a place on Earth
    gets an engineering CRS and says so in its tags, never an EPSG code. ``area`` keeps a part of the map.
    """
    path = Path(path).absolute()
    if compression.upper() not in COMPRESSIONS:
        raise ValueError(f"compression must be one of {', '.join(COMPRESSIONS)}, got {compression!r}")
    source = warped(clipped(source, area), target_grid(source.grid, crs, pixel_size, area))
    grid = source.grid
    tags = {"TIFFTAG_SOFTWARE": "photomap", "AREA_OR_POINT": "Area", **(metadata or {})}
    if grid.crs_wkt is None:
        tags |= {"GEOREFERENCE": NOT_GEOREFERENCED, "TIFFTAG_IMAGEDESCRIPTION": NOT_GEOREFERENCED}
    with (
        file_in_place_of(path, lambda p: check_cog(p, path), side_suffixes=SIDE_SUFFIXES) as temporary,
        bounded_cache(),
    ):
        pyramid = _pyramid(source)
        names = [temporary.with_name(f"level-{k}.tif") for k in range(pyramid.max_zoom + 1)]
        options = _packing(compression.upper(), quality)
        with contextlib.ExitStack() as stack:
            levels = [
                stack.enter_context(_level(name, grid, k, options, tags if k == 0 else {}))
                for k, name in enumerate(names)
            ]
            for tile in pyramid.made(_itself, on_progress):
                _write_tile(levels[pyramid.max_zoom - tile.key.zoom], tile, masked="photometric" in options)
        directories = [d for k, name in enumerate(names) for d in _as_overview(read_directories(name), k)]
        write_cog(directories, temporary)
        for name in names:
            name.unlink()
    return grid


def _pyramid(source: TileSource) -> Pyramid:
    """Return the map's own pixels and the overviews above them, down to one that fits into a block."""
    g = source.grid
    levels = max(0, math.ceil(math.log2(max(g.width, g.height) / _BLOCK_PX)))
    return Pyramid(source, Window(0, 0, g.width, g.height), levels, 0, None, _BLOCK_PX)


def _itself(tile: Tile) -> Tile:
    return tile


@contextlib.contextmanager
def _level(path: Path, grid: MapGrid, level: int, options: Mapping[str, Any], tags: Mapping[str, str]) -> Iterator[Any]:
    """Yield one level of the pyramid, open for writing, as a GeoTIFF of its own; only the finest has a place."""
    profile: dict[str, Any] = {
        "driver": "GTiff", "tiled": True, "blockxsize": _BLOCK_PX, "blockysize": _BLOCK_PX, "interleave": "pixel",
        "BIGTIFF": "YES", "ENDIANNESS": "LITTLE", "SPARSE_OK": True, "dtype": "uint8",
        "width": -(-grid.width // (1 << level)), "height": -(-grid.height // (1 << level)),
        "NUM_THREADS": str(usable_cpus()), **options,
    }  # fmt: skip
    if level == 0:
        profile |= {"crs": grid.crs_wkt or LOCAL_CRS_WKT, "transform": rasterio.Affine(*grid.transform)}
    with (
        warnings.catch_warnings(action="ignore", category=NotGeoreferencedWarning),
        rasterio.open(path, "w", **profile) as out,
    ):
        if profile["count"] == 4:
            out.colorinterp = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
        out.update_tags(**tags)
        yield out


def _packing(compression: str, quality: int | None) -> dict[str, Any]:
    """Return GDAL's options of a compression; JPEG knows no alpha and has a mask instead."""
    if compression == "JPEG":
        return {"count": 3, "compress": "JPEG", "photometric": "YCBCR", "JPEG_QUALITY": str(quality or 88)}
    options: dict[str, Any] = {"count": 4, "compress": compression, "alpha": "UNSPECIFIED"}
    if compression in ("DEFLATE", "ZSTD", "LZW"):
        options["PREDICTOR"] = "2"
    if compression == "DEFLATE":
        options["ZLEVEL"] = str(LEVEL)
    if compression == "ZSTD":
        options["ZSTD_LEVEL"] = str(LEVEL)
    if compression == "WEBP":
        options["WEBP_LEVEL"] = str(quality or 88)
    return options


def _write_tile(level: Any, tile: Tile, *, masked: bool) -> None:
    """Write a tile's part of its level; what is never written stays sparse and reads as transparent."""
    x, y = tile.key.x * _BLOCK_PX, tile.key.y * _BLOCK_PX
    width, height = min(_BLOCK_PX, level.width - x), min(_BLOCK_PX, level.height - y)
    planes = planes_of(tile.rgba[:height, :width])
    window = RasterWindow(x, y, width, height)
    if masked:
        level.write(planes[:3], window=window)
        level.write_mask(np.where(planes[3] >= 128, np.uint8(255), np.uint8(0)), window=window)
    else:
        level.write(planes, window=window)


def _as_overview(pictures: Sequence[Directory], level: int) -> list[Directory]:
    """Return a level's picture, and its mask, as what they are in the whole file."""
    reduced = REDUCED if level else 0
    kinds = [reduced, reduced | MASK]
    return [d.as_kind(kind) for d, kind in zip(pictures, kinds, strict=False)]


def planes_of(rgba: Rgba) -> npt.NDArray[np.uint8]:
    """``(4, H, W)``; black where nothing was seen, for programs that do not look at alpha."""
    planes = np.ascontiguousarray(rgba.transpose(2, 0, 1))
    hidden = planes[3] == 0
    if hidden.any():
        planes[:3, hidden] = 0
    return planes


@contextlib.contextmanager
def bounded_cache() -> Iterator[None]:
    """Hold GDAL's block cache to a fixed size: by default it takes 5 % of the machine."""
    with rasterio.Env(GDAL_CACHEMAX=_CACHE_BYTES, GDAL_TIFF_INTERNAL_MASK=True):
        yield


@contextlib.contextmanager
def draft_dataset(path: Path, profile: Mapping[str, Any]) -> Iterator[Any]:
    """Yield a new, uncompressed, sparse GeoTIFF open for writing: pixels are compressed once, in the COG."""
    options = {
        "driver": "GTiff", "tiled": True, "blockxsize": _BLOCK_PX, "blockysize": _BLOCK_PX, "interleave": "pixel",
        "BIGTIFF": "IF_SAFER", "SPARSE_OK": True,
    }  # fmt: skip
    with rasterio.open(path, "w", **options, **profile) as dataset:
        yield dataset


def draft_to_cog(draft: Path, cog: Path, *, compression: str, quality: int | None = None) -> None:
    """Turn a GeoTIFF into a COG with all its tags, masks and colour interpretations."""
    options = {
        "BLOCKSIZE": str(_BLOCK_PX),
        "COMPRESS": compression,
        "OVERVIEWS": "IGNORE_EXISTING",
        "OVERVIEW_RESAMPLING": "AVERAGE",
        "BIGTIFF": "IF_SAFER",
        "SPARSE_OK": "YES",
        "NUM_THREADS": str(min(8, os.cpu_count() or 1)),
    }
    if compression in ("DEFLATE", "ZSTD", "LZW"):
        options["PREDICTOR"] = "YES"
    if compression in ("DEFLATE", "ZSTD"):
        options["LEVEL"] = str(LEVEL)
    if compression in ("WEBP", "JPEG"):
        options["QUALITY"] = str(quality or 88)
    rasterio.shutil.copy(str(draft), str(cog), driver="COG", **options)


def strips(width: int, height: int) -> Iterator[Window]:
    """Yield windows of whole blocks that cover a raster once, row by row."""
    for row in range(0, height, _BLOCK_PX):
        for col in range(0, width, _STRIP_PX):
            yield Window(col, row, min(_STRIP_PX, width - col), min(_BLOCK_PX, height - row))


def check_cog(temporary: Path, path: Path) -> None:
    """Re-open a COG, validate its layout and read its last blocks at every zoom; ``OutputError`` where that fails."""
    try:
        valid, errors, warnings = cog_validate(str(temporary), strict=True, quiet=True)
        if not valid:
            raise OutputError(f"{path} is not a valid COG after writing ({'; '.join([*errors, *warnings])})")
        with rasterio.open(temporary) as dataset:
            levels = [None, *range(len(dataset.overviews(1)))]
        for level in levels:
            with rasterio.open(temporary, **({} if level is None else {"overview_level": level})) as dataset:
                for window in _probes(dataset.width, dataset.height):
                    dataset.read(window=window)
    except (RasterioError, OSError) as error:
        raise OutputError(f"{path} cannot be read after writing ({error}); check the disk's free space") from error


def _probes(width: int, height: int) -> Iterator[RasterWindow]:
    """Yield a pixel of each corner and of the middle."""
    for x, y in ((0, 0), (width - 1, 0), (0, height - 1), (width - 1, height - 1), (width // 2, height // 2)):
        yield RasterWindow(x, y, 1, 1)
