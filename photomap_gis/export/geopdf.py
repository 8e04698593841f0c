"""The map as a GeoPDF page (ISO 32000 geospatial dictionary): phones with Avenza Maps, Acrobat, and paper.

One page, one picture, a line with date, accuracy and attribution below. A page is for reading: a larger map is shrunk.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import rasterio
import rasterio.shutil

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
_LONG_SIDE_POINTS = 1191.0  # A2: 594 mm
_FOOT_PX, _FONT_PX = 3.2, 1.6  # of a hundred of the picture's width
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
        write_draft(source, draft, opaque=True, on_progress=on_progress)
        with rasterio.Env(GDAL_PAM_ENABLED=False):
            rasterio.shutil.copy(str(draft), str(temporary), driver="PDF", **_options(grid, quality, words))
        draft.unlink()
    if on_progress is not None:
        on_progress(1, 1)
    return grid


def _options(grid: MapGrid, quality: int | None, words: MapWords) -> dict[str, str]:
    # A point is 1/72 inch: this many pixels an inch bring the longer side to A2's, smaller maps to fewer.
    dpi = max(72, round(max(grid.width, grid.height) / _LONG_SIDE_POINTS * 72.0))
    points = 72.0 / dpi  # margins and text are in points
    foot, font = max(14.0, grid.width * points * _FOOT_PX / 100), max(6.0, grid.width * points * _FONT_PX / 100)
    line = "  |  ".join([words.title, *words.paragraph.splitlines()])
    fits = max(20, int(grid.width * points / (font * 0.5)))
    stamp = line if len(line) <= fits else f"{line[: fits - 3]}..."
    options = {
        "GEO_ENCODING": "ISO32000",
        "COMPRESS": "JPEG",
        "JPEG_QUALITY": str(quality or _QUALITY),
        "DPI": str(dpi),
        "MARGIN": "0",
        "BOTTOM_MARGIN": f"{round(foot)}",
        "EXTRA_STREAM": f"BT 0 0 0 rg /FTimesRoman {font:.1f} Tf 4 {foot / 3:.1f} Td ({_pdf(stamp)}) Tj ET",
        "LAYER_NAME": "map",
        "EXTRA_LAYER_NAME": "stamp",
        "TITLE": words.title,
        "SUBJECT": words.paragraph,
        "AUTHOR": words.attribution,
        "CREATOR": words.software,
        "PRODUCER": "photomap by GDAL",
        "KEYWORDS": words.provenance_json,
    }
    if words.last_utc:
        options["CREATION_DATE"] = "D:" + "".join(c for c in words.last_utc[:19] if c.isdigit()) + "Z"
    return {k: v for k, v in options.items() if v}


def _pdf(text: str) -> str:
    """Return text for a PDF string in a base font: Latin-1 only, with brackets escaped."""
    plain = text.encode("ascii", "replace").decode()
    return plain.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")


def _check(temporary: Path, path: Path) -> None:
    with temporary.open("rb") as file:
        head = file.read(8)
        file.seek(max(0, temporary.stat().st_size - 1024))
        tail = file.read()
    if not head.startswith(b"%PDF-") or b"%%EOF" not in tail:
        raise OutputError(f"{path} is damaged after writing; check the disk")
