"""The map as a GeoPDF page (ISO 32000 geospatial dictionary): phones with Avenza Maps, Acrobat, and paper.

One page, one picture, and below it a strip with date, accuracy and attribution. A page is for reading: a larger map is
shrunk.
"""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import rasterio
import rasterio.shutil
from PIL import Image, ImageDraw, ImageFont

from photomap_gis.core.errors import OutputError, UsageError
from photomap_gis.core.grid import MapGrid
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.area import Area, clipped
from photomap_gis.export.crs import needs_place
from photomap_gis.export.geotiff import bounded_cache
from photomap_gis.export.picture import write_draft
from photomap_gis.export.publish import file_in_place_of
from photomap_gis.export.warp import overview, target_grid, warped
from photomap_gis.export.words import MapWords

MAX_SIDE_PX = 10_000
"""What phones can still show."""
_DPI = 300  # of print; on pages from A4 to A2
_LONG_SIDE_POINTS = (842.0, 1684.0)
_LEAST_DPI = 72
_FONT_SHARE = 0.018  # of the picture's width
_QUALITY = 85
_NO_WORDS = MapWords()

OnProgress = Callable[[int, int], None]


def write_geopdf(
    source: TileSource,
    path: Path | str,
    *,
    crs: str | None = None,
    pixel_size: float | None = None,
    area: Area | None = None,
    quality: int | None = None,
    words: MapWords = _NO_WORDS,
    on_progress: OnProgress | None = None,
) -> MapGrid:
    """Write the page and return the grid of its picture: shrunk by a whole number where it had more than 10,000 px."""
    path = Path(path).absolute()
    if path.suffix.lower() != ".pdf":
        raise UsageError(f"{path.name} must end in .pdf")
    needs_place(source.grid.crs_wkt, "a GeoPDF")
    source = warped(clipped(source, area), target_grid(source.grid, crs, pixel_size, area))
    source = overview(source, -(-max(source.grid.width, source.grid.height) // MAX_SIDE_PX))
    grid = source.grid
    with file_in_place_of(path, lambda p: _check(p, path)) as temporary, bounded_cache():
        draft = temporary.with_name("draft.tif")
        # on white: what was not seen is paper, and readers on phones are slow with soft masks
        foot = _stamp(grid.width, words)
        write_draft(source, draft, opaque=True, tags=_tags(words, grid), foot=foot, on_progress=on_progress)
        how = {
            "GEO_ENCODING": "ISO32000",
            "COMPRESS": "JPEG",
            "JPEG_QUALITY": str(quality or _QUALITY),
            "DPI": str(_dpi(max(grid.width, grid.height))),
        }
        with rasterio.Env(GDAL_PAM_ENABLED=False):
            rasterio.shutil.copy(str(draft), str(temporary), driver="PDF", **how)
        draft.unlink()
    if on_progress is not None:
        on_progress(1, 1)
    return grid


def _dpi(long_side_px: int) -> int:
    """Return how many pixels an inch has, so that the page is one to print: a point is 1/72 inch."""
    least, most = _LONG_SIDE_POINTS
    points = min(most, max(least, 72.0 * long_side_px / _DPI))
    return max(_LEAST_DPI, round(72.0 * long_side_px / points))


def _tags(words: MapWords, grid: MapGrid) -> dict[str, str]:
    """Return what GDAL writes into the document's information, and the neatline: the map without the strip below."""
    west, south, east, north = grid.bounds
    ring = [(west, north), (west, south), (east, south), (east, north), (west, north)]
    tags = {
        "NEATLINE": f"POLYGON (({','.join(f'{x:.9f} {y:.9f}' for x, y in ring)}))",
        "TITLE": words.title,
        "SUBJECT": words.paragraph,
        "AUTHOR": words.attribution,
        "CREATOR": words.software,
        "PRODUCER": "photomap by GDAL",
        "KEYWORDS": words.provenance_json,
    }
    if words.last_utc:
        tags["CREATION_DATE"] = "D:" + "".join(c for c in words.last_utc[:19] if c.isdigit()) + "Z"
    return {k: v for k, v in tags.items() if v}


def _stamp(width_px: int, words: MapWords) -> npt.NDArray[np.uint8]:
    """``(h, width, 3)`` a white strip with title, date, accuracy and attribution in one line."""
    text = "   |   ".join([words.title, *words.paragraph.splitlines()])
    # Pillow's own font knows no accents: letters without them are better than boxes
    text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    size = max(8.0, width_px * _FONT_SHARE)
    length = ImageFont.load_default(size).getlength(text)
    size = max(6.0, min(size, size * 0.97 * width_px / max(length, 1.0)))
    font = ImageFont.load_default(size)
    strip = Image.new("RGB", (width_px, math.ceil(2.0 * size)), "white")
    ImageDraw.Draw(strip).text((size / 2.0, size), text, fill="black", font=font, anchor="lm")
    return np.asarray(strip, dtype=np.uint8)


def _check(temporary: Path, path: Path) -> None:
    with temporary.open("rb") as file:
        head = file.read(8)
        file.seek(max(0, temporary.stat().st_size - 1024))
        tail = file.read()
    if not head.startswith(b"%PDF-") or b"%%EOF" not in tail:
        raise OutputError(f"{path} is damaged after writing; check the disk")
