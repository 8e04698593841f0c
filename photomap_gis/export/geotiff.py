"""The map as one cloud-optimised GeoTIFF: tiled, with alpha and overviews, in the right place."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import rasterio
import rasterio.shutil
from rasterio.errors import RasterioError
from rasterio.windows import Window as RasterWindow
from rio_cogeo.cogeo import cog_validate

from photomap_gis.core.errors import OutputError
from photomap_gis.core.grid import MapGrid
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.area import Area, clipped
from photomap_gis.export.cog import BLOCK_PX, LEVEL, Packing, pack_cog
from photomap_gis.export.publish import file_in_place_of
from photomap_gis.export.warp import target_grid, warped
from photomap_gis.parallel import give_back_memory

COMPRESSIONS = ("DEFLATE", "ZSTD", "LZW", "WEBP", "JPEG", "NONE")
NOT_GEOREFERENCED = "NOT GEOREFERENCED: local units (not metres), no place on Earth; north is arbitrary"
# GeoTIFF writes down metres whatever the unit, so the name must say that they are none.
LOCAL_CRS_WKT = (
    'LOCAL_CS["photomap local frame, units are not metres (NOT GEOREFERENCED)",LOCAL_DATUM["local",0],UNIT["metre",1],'
    'AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
)


SIDE_SUFFIXES = (".aux.xml", ".ovr", ".msk")  # where GDAL and QGIS keep statistics, overviews and masks of a file

_CACHE_BYTES = 96 << 20

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
        packing = Packing(compression.upper(), quality)
        pack_cog(
            source, temporary, packing=packing, crs_wkt=grid.crs_wkt or LOCAL_CRS_WKT, tags=tags,
            on_progress=on_progress,
        )  # fmt: skip
    give_back_memory()
    return grid


@contextlib.contextmanager
def bounded_cache() -> Iterator[None]:
    """Hold GDAL's block cache to a fixed size: by default it takes 5 % of the machine."""
    with rasterio.Env(GDAL_CACHEMAX=_CACHE_BYTES, GDAL_TIFF_INTERNAL_MASK=True):
        yield


def draft_to_cog(draft: Path, cog: Path, *, compression: str, quality: int | None = None) -> None:
    """Turn a GeoTIFF into a COG with all its tags, masks and colour interpretations."""
    options = {
        "BLOCKSIZE": str(BLOCK_PX),
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


def check_cog(temporary: Path, path: Path) -> None:
    """Re-open a COG, validate its layout and read its last blocks at every zoom; ``OutputError`` where that fails."""
    try:
        _, errors, warnings = cog_validate(str(temporary), strict=True, quiet=True)
        # The validator takes a level that is one column of tiles for strips; what is tiled is looked at below.
        wrong = [w for w in (*errors, *warnings) if "is not tiled" not in w]
        if wrong:
            raise OutputError(f"{path} is not a valid COG after writing ({'; '.join(wrong)})")
        with rasterio.open(temporary) as dataset:
            levels = [None, *range(len(dataset.overviews(1)))]
        for level in levels:
            with rasterio.open(temporary, **({} if level is None else {"overview_level": level})) as dataset:
                rows, columns = dataset.block_shapes[0]
                if max(dataset.width, dataset.height) > rows and rows != columns:
                    raise OutputError(f"{path} is not a valid COG after writing (it is not tiled)")
                for window in _probes(dataset.width, dataset.height):
                    dataset.read(window=window)
    except (RasterioError, OSError) as error:
        raise OutputError(f"{path} cannot be read after writing ({error}); check the disk's free space") from error


def _probes(width: int, height: int) -> Iterator[RasterWindow]:
    """Yield a pixel of each corner and of the middle."""
    for x, y in ((0, 0), (width - 1, 0), (0, height - 1), (width - 1, height - 1), (width // 2, height // 2)):
        yield RasterWindow(x, y, 1, 1)
