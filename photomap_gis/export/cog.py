"""The blocks of a cloud-optimised GeoTIFF, packed on all cores while the map is read once, overviews and all.

Every level of the pyramid is a GeoTIFF of its own that GDAL writes (tags, georeference, JPEG tables); ``tiff_file``
lays the levels out as one file. DEFLATE, ZSTD, JPEG and WEBP blocks are packed here, where the pyramid makes them,
DEFLATE by a library that takes a fifth of the time of GDAL's for the same size; the other compressions are GDAL's.
"""

from __future__ import annotations

import contextlib
import errno
import io
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rasterio
import zstandard
from isal import isal_zlib
from PIL import Image
from rasterio.enums import ColorInterp
from rasterio.errors import NotGeoreferencedWarning
from rasterio.windows import Window as RasterWindow

from photomap_gis.core.errors import OutputError
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.pixels import Rgba
from photomap_gis.export.pyramid import Pyramid, Tile, TileKey
from photomap_gis.export.tiff_file import MASK, REDUCED, Directory, read_directories, write_cog
from photomap_gis.parallel import usable_cpus

BLOCK_PX = 512
_BRANCH_PX = 1024  # read by one job: a map's own tiles are whole blocks, larger pieces only take more memory
LEVEL = 3
"""Of GDAL's DEFLATE and ZSTD; measured on photos: half the time of level 6 for 7 % more bytes."""
_ISAL_LEVEL = 2
_JPEG_TABLES = 347
JPEG_QUALITY = WEBP_QUALITY = 88
_WEBP_EFFORT = 2  # seven tenths of the time of libtiff's 4, for 1 % more bytes; 1 takes as long, 0 costs 12 %
OnProgress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Packing:
    """A compression by its name in capitals, and the quality (1-100) of lossy ones."""

    compression: str
    quality: int | None = None

    @property
    def profile(self) -> dict[str, Any]:
        """GDAL's options; JPEG knows no alpha and has a mask instead."""
        if self.compression == "JPEG":
            return {
                "count": 3,
                "compress": "JPEG",
                "photometric": "YCBCR",
                "JPEG_QUALITY": str(self.quality or JPEG_QUALITY),
            }
        options: dict[str, Any] = {"count": 4, "compress": self.compression, "alpha": "UNSPECIFIED"}
        options |= {"photometric": "RGB"}
        if self.compression in ("DEFLATE", "ZSTD", "LZW"):
            options["PREDICTOR"] = "2"
        if self.compression == "ZSTD":
            options["ZSTD_LEVEL"] = str(LEVEL)
        if self.compression == "WEBP":
            options["WEBP_LEVEL"] = str(self.quality or WEBP_QUALITY)
        return options


def pack_cog(
    source: TileSource,
    path: Path,
    *,
    packing: Packing,
    crs_wkt: str,
    tags: Mapping[str, str],
    on_progress: OnProgress | None = None,
) -> None:
    """Write the map as a COG in ``crs_wkt``; scratch files lie beside ``path`` while it is made."""
    g = source.grid
    top = max(0, math.ceil(math.log2(max(g.width, g.height) / BLOCK_PX)))
    pyramid = Pyramid(source, Window(0, 0, g.width, g.height), top, 0, None, BLOCK_PX, _BRANCH_PX)
    names = [path.with_name(f"level-{k}.tif") for k in range(top + 1)]
    written: list[TileKey] = []
    with contextlib.ExitStack() as stack:
        levels = [stack.enter_context(_level(n, g, k, packing, crs_wkt, tags)) for k, n in enumerate(names)]
        if packing.compression not in _PACKED_HERE:
            for tile in pyramid.made(_itself, on_progress):
                _write_tile(levels[top - tile.key.zoom], tile)
                written.append(tile.key)
    blocks = path.with_name("blocks")
    pictures = [_as_overview(read_directories(name), k) for k, name in enumerate(names)]
    for key in written:
        level = top - key.zoom
        # GDAL writes the last blocks when it closes a file, and nobody is told if the disk does not take them
        if not pictures[level][0].counts[key.y * -(-g.width // (BLOCK_PX << level)) + key.x]:
            raise OSError(errno.EIO, "not all of it reached the disk, which may be full")
    if packing.compression in _PACKED_HERE:
        pictures = _packed(pyramid, pictures, blocks, packing, on_progress)
    directories = [d for level in pictures for d in level]
    write_cog(directories, path)
    for name in (*names, blocks):
        name.unlink(missing_ok=True)


def planes_of(rgba: Rgba) -> npt.NDArray[np.uint8]:
    """``(4, H, W)``; black where nothing was seen, for programs that do not look at alpha."""
    planes = np.empty((4, *rgba.shape[:2]), np.uint8)
    cv2.split(rgba, list(planes))  # numpy's own transposing takes eight times as long
    if not planes[3].all():
        planes[:3, planes[3] == 0] = 0
    return planes


@contextlib.contextmanager
def _level(
    path: Path, grid: MapGrid, level: int, packing: Packing, crs_wkt: str, tags: Mapping[str, str]
) -> Iterator[Any]:
    """Yield one level of the pyramid, open for writing, as a GeoTIFF of its own; only the finest has place and tags."""
    profile: dict[str, Any] = {
        "driver": "GTiff", "tiled": True, "blockxsize": BLOCK_PX, "blockysize": BLOCK_PX, "interleave": "pixel",
        "BIGTIFF": "YES", "ENDIANNESS": "LITTLE", "SPARSE_OK": True, "dtype": "uint8",
        "width": -(-grid.width // (1 << level)), "height": -(-grid.height // (1 << level)),
        "NUM_THREADS": str(usable_cpus()), **packing.profile,
    }  # fmt: skip
    if level == 0:
        profile |= {"crs": crs_wkt, "transform": rasterio.Affine(*grid.transform)}
    with (
        warnings.catch_warnings(action="ignore", category=NotGeoreferencedWarning),
        rasterio.open(path, "w", **profile) as out,
    ):
        if profile["count"] == 4:
            out.colorinterp = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
        if packing.compression == "JPEG":  # one pixel, for GDAL to describe the mask
            out.write_mask(np.zeros((1, 1), np.uint8), window=RasterWindow(0, 0, 1, 1))
        if level == 0:
            out.update_tags(**tags)
        yield out


def _itself(tile: Tile) -> Tile:
    return tile


def _write_tile(level: Any, tile: Tile) -> None:
    """Let GDAL pack a tile's part of its level; what is never written stays sparse and reads as transparent."""
    x, y = tile.key.x * BLOCK_PX, tile.key.y * BLOCK_PX
    width, height = min(BLOCK_PX, level.width - x), min(BLOCK_PX, level.height - y)
    level.write(planes_of(tile.rgba[:height, :width]), window=RasterWindow(x, y, width, height))


def _packed(
    pyramid: Pyramid,
    pictures: Sequence[Sequence[Directory]],
    blocks: Path,
    packing: Packing,
    on_progress: OnProgress | None,
) -> list[list[Directory]]:
    """Pack every block into one file, and return the levels' directories (their own files hold none) over it."""
    pack = _PACKED_HERE[packing.compression]
    places = [[[(0, 0)] * len(d.offsets) for d in level] for level in pictures]
    columns = [-(-pyramid.extent.width // (BLOCK_PX << k)) for k in range(len(pictures))]

    def make(tile: Tile) -> tuple[TileKey, tuple[bytes, ...]]:
        return tile.key, pack(tile.rgba, packing.quality)

    with blocks.open("wb") as file:
        for key, parts in pyramid.made(make, on_progress):
            level = pyramid.max_zoom - key.zoom
            for picture, data in zip(places[level], parts, strict=True):
                picture[key.y * columns[level] + key.x] = (file.tell(), len(data))
                file.write(data)
    return [
        [
            replace(d, path=blocks, offsets=tuple(o for o, _ in where), counts=tuple(n for _, n in where))
            for d, where in zip(level, known, strict=True)
        ]
        for level, known in zip(pictures, places, strict=True)
    ]


def _differences(rgba: Rgba) -> Rgba:
    """Return TIFF's predictor 2: each sample less that of the pixel on its left; nothing where nothing was seen."""
    if not rgba[..., 3].all():
        rgba = cv2.bitwise_and(rgba, rgba, mask=rgba[..., 3])
    rows = rgba.reshape(rgba.shape[0], -1)
    differences = rows.copy()
    np.subtract(rows[:, 4:], rows[:, :-4], out=differences[:, 4:])
    return differences


def _deflate(rgba: Rgba, _: int | None) -> tuple[bytes, ...]:
    return (isal_zlib.compress(_differences(rgba), _ISAL_LEVEL),)


def _zstd(rgba: Rgba, _: int | None) -> tuple[bytes, ...]:
    return (zstandard.compress(_differences(rgba).data, LEVEL),)


def _jpeg(rgba: Rgba, quality: int | None) -> tuple[bytes, ...]:
    """Return the picture with tables of its own, and the mask: a bit a pixel."""
    bgr = cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGR)
    done, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality or JPEG_QUALITY])
    if not done:
        raise OutputError("this installation cannot write JPEG: choose another --compress")
    return data.tobytes(), isal_zlib.compress(np.packbits(rgba[..., 3] >= 128, axis=1), _ISAL_LEVEL)


def _webp(rgba: Rgba, quality: int | None) -> tuple[bytes, ...]:
    """Return the picture with its alpha."""
    if not rgba[..., 3].all():
        rgba = cv2.bitwise_and(rgba, rgba, mask=rgba[..., 3])
    out = io.BytesIO()
    Image.fromarray(rgba).save(out, "WEBP", quality=quality or WEBP_QUALITY, method=_WEBP_EFFORT)
    return (out.getvalue(),)


_PACKED_HERE: dict[str, Callable[[Rgba, int | None], tuple[bytes, ...]]] = {
    "DEFLATE": _deflate,
    "ZSTD": _zstd,
    "JPEG": _jpeg,
    "WEBP": _webp,
}


def _as_overview(pictures: Sequence[Directory], level: int) -> list[Directory]:
    """Return a level's picture, and its mask, as what they are in the whole file."""
    reduced = REDUCED if level else 0
    for d in pictures:
        d.fields.pop(_JPEG_TABLES, None)  # every block has its own
    return [d.as_kind(kind) for d, kind in zip(pictures, (reduced, reduced | MASK), strict=False)]
