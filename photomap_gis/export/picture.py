"""The map as one plain picture with a world file, for programs that know no GeoTIFF: PNG with alpha, or JPEG.

Beside ``map.png`` lie ``map.pgw`` (six lines: the pixel's size and turn, the **centre** of the upper-left pixel) and
``map.prj`` (the CRS as Esri's WKT).
"""

from __future__ import annotations

import shutil
import struct
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rasterio
import rasterio.shutil
from pyproj import CRS
from pyproj.enums import WktVersion
from rasterio.enums import ColorInterp
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.windows import Window as RasterWindow

from photomap_gis.core.errors import DataError, OutputError, UsageError
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.area import Area, clipped
from photomap_gis.export.cog import planes_of
from photomap_gis.export.draft import draft_dataset, strips
from photomap_gis.export.geotiff import bounded_cache
from photomap_gis.export.publish import file_in_place_of
from photomap_gis.export.warp import target_grid, warped
from photomap_gis.export.words import MapWords
from photomap_gis.publish import write_file

WORLD_SUFFIXES = {".png": ".pgw", ".jpg": ".jgw", ".jpeg": ".jgw"}
_JPEG_LIMIT_PX = 65_500
_QUALITY = 90
_PNG = {"driver": "PNG", "ZLEVEL": "3", "WRITE_METADATA_AS_TEXT": "YES"}
_NO_WORDS = MapWords()

OnProgress = Callable[[int, int], None]


def write_picture(
    source: TileSource,
    path: Path | str,
    *,
    crs: str | None = None,
    pixel_size: float | None = None,
    area: Area | None = None,
    quality: int | None = None,
    words: MapWords = _NO_WORDS,
    on_progress: OnProgress | None = None,
) -> list[Path]:
    """Write the picture, its world file and, for a map with a place, its .prj; return the files.

    The suffix of ``path`` says the format. What was not seen is transparent in PNG and white in JPEG.
    """
    path = Path(path).absolute()
    suffix = path.suffix.lower()
    if suffix not in WORLD_SUFFIXES:
        raise UsageError(f"{path.name} must end in {', '.join(WORLD_SUFFIXES)}")
    source = warped(clipped(source, area), target_grid(source.grid, crs, pixel_size, area))
    grid, opaque = source.grid, suffix != ".png"
    if opaque and max(grid.width, grid.height) > _JPEG_LIMIT_PX:
        raise DataError(
            f"a JPEG holds at most {_JPEG_LIMIT_PX} pixels a side and this map has {grid.width} x {grid.height}: "
            "choose a larger --gsd, a --bbox, or .png"
        )
    with file_in_place_of(path, lambda p: _check(p, path, grid)) as temporary, bounded_cache():
        draft = temporary.with_name("draft.tif")
        write_draft(source, draft, opaque=opaque, tags=_tags(words), on_progress=on_progress)
        how = {"driver": "JPEG", "QUALITY": str(quality or _QUALITY)} if opaque else _PNG
        with rasterio.Env(GDAL_PAM_ENABLED=False):
            rasterio.shutil.copy(str(draft), str(temporary), **how)
        draft.unlink()
        if opaque:
            _add_comment(temporary, words)
    world = path.with_suffix(WORLD_SUFFIXES[suffix])
    p = grid.pixel_size
    numbers = (p, 0.0, 0.0, -p, grid.west + p / 2.0, grid.north - p / 2.0)
    write_file(world, "".join(f"{v:.12f}\n" for v in numbers).encode())
    files = [path, world]
    if grid.crs_wkt is not None:
        wkt = CRS.from_user_input(grid.crs_wkt).to_wkt(WktVersion.WKT1_ESRI)
        write_file(path.with_suffix(".prj"), wkt.encode())
        files.append(path.with_suffix(".prj"))
    if on_progress is not None:
        on_progress(1, 1)
    return files


def write_draft(
    source: TileSource,
    draft: Path,
    *,
    opaque: bool,
    tags: Mapping[str, str] | None = None,
    foot: npt.NDArray[np.uint8] | None = None,
    on_progress: OnProgress | None = None,
) -> None:
    """Write the map as an uncompressed GeoTIFF for GDAL to copy; ``opaque`` on white, without alpha.

    ``foot``, ``(h, width, 3)``, is a strip below the map. ``tags`` are for drivers that read their words from the
    copied dataset: as options of rasterio's copy they would come out in capitals.
    """
    grid = source.grid
    below = 0 if foot is None else foot.shape[0]
    profile: dict[str, Any] = {
        "width": grid.width, "height": grid.height + below, "count": 3 if opaque else 4, "dtype": "uint8",
        "transform": rasterio.Affine(*grid.transform), "photometric": "RGB",
    }  # fmt: skip
    if grid.crs_wkt is not None:
        profile["crs"] = grid.crs_wkt
    if not opaque:
        profile["alpha"] = "UNSPECIFIED"
    windows = list(strips(grid.width, grid.height))
    with draft_dataset(draft, profile) as out:
        out.dataset.update_tags(**(tags or {}))
        if foot is not None:
            out.write(foot.transpose(2, 0, 1), Window(0, grid.height, grid.width, below))
        if not opaque:
            out.dataset.colorinterp = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
        for done, window in enumerate(windows, start=1):
            rgba = source.read(window)
            out.write(_on_white(rgba) if opaque else planes_of(rgba), window)
            if on_progress is not None:
                on_progress(done, len(windows) + 1)


def _on_white(rgba: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """``(3, H, W)``."""
    alpha = rgba[..., 3:].astype(np.uint16)
    white = (rgba[..., :3] * alpha + 255 * (255 - alpha) + 127) // 255
    return np.ascontiguousarray(white.astype(np.uint8).transpose(2, 0, 1))


def _tags(words: MapWords) -> dict[str, str]:
    """Return the keywords of PNG's text chunks."""
    tags = {
        "Title": words.title, "Description": words.paragraph, "Copyright": words.attribution,
        "Software": words.software, "Creation Time": words.last_utc or "", "Comment": words.provenance_json,
    }  # fmt: skip
    return {k: v for k, v in tags.items() if v}


def _add_comment(jpeg: Path, words: MapWords) -> None:
    """Put the words into the JPEG's comment, right after its first marker."""
    text = "\n".join(t for t in (words.title, words.paragraph, words.provenance_json) if t)
    comment = text.encode()[:65_000]  # a segment's length is 16 bits
    bare = jpeg.with_name("bare.jpg")
    jpeg.rename(bare)
    with bare.open("rb") as source, jpeg.open("wb") as out:
        out.write(source.read(2) + b"\xff\xfe" + struct.pack(">H", len(comment) + 2) + comment)
        shutil.copyfileobj(source, out)
    bare.unlink()


def _check(temporary: Path, path: Path, grid: MapGrid) -> None:
    try:
        # its place lies in the files beside it, which are not there yet
        with (
            warnings.catch_warnings(action="ignore", category=NotGeoreferencedWarning),
            rasterio.open(temporary) as dataset,
        ):
            size = (dataset.width, dataset.height)
            dataset.read(1, window=RasterWindow(grid.width - 1, grid.height - 1, 1, 1))
    except RasterioError as error:
        raise OutputError(f"{path} cannot be read after writing ({error}); check the disk's free space") from error
    if size != (grid.width, grid.height):
        raise OutputError(f"{path} is damaged after writing; check the disk")
