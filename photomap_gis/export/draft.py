"""A GeoTIFF that is written window by window for GDAL to copy: uncompressed, sparse, and proven before it is read.

GDAL keeps blocks in memory and writes the last of them when a file is closed; that the disk took them is then not told
to anybody, and a sparse file reads as empty where one is missing. So it is noted which blocks were given something, and
the closed file must hold each of them.
"""

from __future__ import annotations

import contextlib
import errno
import math
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rasterio
from rasterio.windows import Window as RasterWindow

from photomap_gis.core.errors import OutputError
from photomap_gis.core.grid import Window
from photomap_gis.export.tiff_file import read_directories

BLOCK_PX = 512
_STRIP_PX = 2048  # maps are copied in windows of this width and one block's height


class Draft:
    """A draft open for writing; ``dataset`` takes its tags and bands' words."""

    def __init__(self, dataset: Any) -> None:
        self.dataset = dataset
        self._columns = -(-dataset.width // BLOCK_PX)
        self._given: set[int] = set()

    def write(self, pixels: npt.NDArray[Any], window: Window) -> None:
        """Write ``(bands, height, width)``, or ``(height, width)`` of a draft of one band."""
        bands = pixels if pixels.ndim == 3 else pixels[None]
        for row in range(window.row_off // BLOCK_PX, -(-(window.row_off + window.height) // BLOCK_PX)):
            top, bottom = (max(0, (row + k) * BLOCK_PX - window.row_off) for k in (0, 1))
            for col in range(window.col_off // BLOCK_PX, -(-(window.col_off + window.width) // BLOCK_PX)):
                left, right = (max(0, (col + k) * BLOCK_PX - window.col_off) for k in (0, 1))
                if not self._is_empty(bands[:, top:bottom, left:right]):
                    self._given.add(row * self._columns + col)
        self.dataset.write(bands, window=RasterWindow(*window))

    def write_mask(self, mask: npt.NDArray[np.uint8], window: Window) -> None:
        """Write ``(height, width)`` of the mask."""
        self.dataset.write_mask(mask, window=RasterWindow(*window))

    def _is_empty(self, pixels: npt.NDArray[Any]) -> bool:
        """Whether GDAL leaves a block away that holds only these."""
        nodata = self.dataset.nodata
        if nodata is None:
            return not pixels.any()
        return bool(np.isnan(pixels).all() if math.isnan(nodata) else (pixels == nodata).all())

    def check(self, path: Path) -> None:
        """Raise ``OSError`` where a block that was given something did not reach the closed file."""
        size = path.stat().st_size
        try:
            directories = read_directories(path)
            whole = all(o >= 0 and o + n <= size for d in directories for o, n in zip(d.offsets, d.counts, strict=True))
            whole = whole and all(directories[0].counts[block] for block in self._given)
        except (OutputError, KeyError, IndexError, struct.error):
            whole = False
        if not whole:
            raise OSError(errno.EIO, "not all of it reached the disk, which may be full")


@contextlib.contextmanager
def draft_dataset(path: Path, profile: Mapping[str, Any]) -> Iterator[Draft]:
    """Yield a new, uncompressed, sparse GeoTIFF open for writing: pixels are compressed once, in the output.

    On leaving, ``OSError`` where the disk did not take all of it.
    """
    options = {
        "driver": "GTiff", "tiled": True, "blockxsize": BLOCK_PX, "blockysize": BLOCK_PX, "interleave": "pixel",
        "BIGTIFF": "YES", "ENDIANNESS": "LITTLE", "SPARSE_OK": True,
    }  # fmt: skip
    with rasterio.open(path, "w", **options, **profile) as dataset:
        draft = Draft(dataset)
        yield draft
    draft.check(path)


def strips(width: int, height: int) -> Iterator[Window]:
    """Yield windows of whole blocks that cover a raster once, row by row."""
    for row in range(0, height, BLOCK_PX):
        for col in range(0, width, _STRIP_PX):
            yield Window(col, row, min(_STRIP_PX, width - col), min(BLOCK_PX, height - row))
