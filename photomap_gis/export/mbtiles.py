"""All tiles in one file: MBTiles 1.3, a SQLite database that phones and tablets carry."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from photomap_gis.core.errors import OutputError
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.publish import file_in_place_of
from photomap_gis.export.tiles import parse_tile_format
from photomap_gis.export.webtiles import OnProgress, plan_web_tiles

_APPLICATION_ID = 0x4D504258  # "MPBX", MBTiles' mark in SQLite's header
_SCHEMA = """
CREATE TABLE metadata (name text NOT NULL, value text);
CREATE TABLE tiles (zoom_level integer NOT NULL, tile_column integer NOT NULL, tile_row integer NOT NULL,
                    tile_data blob NOT NULL);
"""
_INDEXES = """
CREATE UNIQUE INDEX tile_index ON tiles (zoom_level, tile_column, tile_row);
CREATE UNIQUE INDEX metadata_index ON metadata (name);
"""


def write_mbtiles(
    source: TileSource,
    path: Path | str,
    *,
    min_zoom: int | None = None,
    max_zoom: int | None = None,
    image_format: str = "auto",
    name: str = "photomap",
    description: str = "",
    attribution: str = "",
    on_progress: OnProgress | None = None,
) -> int:
    """Write the MBTiles file and return how many tiles it holds.

    One format for all tiles, as the specification wants: ``image_format`` is png, jpg or webp; ``auto`` is png. Rows
    are counted from the **south** (TMS).
    """
    path = Path(path).absolute()
    tile_format = parse_tile_format(image_format)
    plan = plan_web_tiles(source, "MBTiles", min_zoom=min_zoom, max_zoom=max_zoom)
    lon, lat, zoom = plan.centre
    metadata = {
        "name": name,
        "format": tile_format.value,
        "bounds": ",".join(f"{v:.12f}" for v in plan.bounds_deg),
        "center": f"{lon:.10f},{lat:.10f},{zoom}",
        "minzoom": str(plan.min_zoom),
        "maxzoom": str(plan.max_zoom),
        "type": "overlay",
        "version": "1.0",
        "description": description,
        "attribution": attribution,
    }
    count = 0
    with file_in_place_of(path, lambda p: _check(p, path, count)) as temporary, _database(temporary, path) as db:
        db.executescript(_SCHEMA)
        db.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
        db.executemany("INSERT INTO metadata VALUES (?, ?)", metadata.items())
        for key, data in plan.encoded(tile_format, on_progress):
            row = (1 << key.zoom) - 1 - key.y
            db.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", (key.zoom, key.x, row, data))
            count += 1
        if count == 0:
            raise OutputError(f"{path} was not written: the map shows nothing")
        db.commit()
        db.executescript(_INDEXES)
    return count


@contextlib.contextmanager
def _database(temporary: Path, path: Path) -> Iterator[sqlite3.Connection]:
    db = sqlite3.connect(temporary)
    try:
        # The file is new and moved into place when whole: a journal would only write everything twice.
        db.execute("PRAGMA journal_mode = OFF")
        db.execute("PRAGMA synchronous = OFF")
        yield db
        db.commit()
    except sqlite3.Error as error:
        advice = "free some space or choose another place" if "full" in str(error) else "check the disk"
        raise OutputError(f"{path} cannot be written: {error}; {advice}") from error
    finally:
        db.close()


def _check(temporary: Path, path: Path, count: int) -> None:
    db = sqlite3.connect(temporary)
    try:
        (found,) = db.execute("SELECT count(*) FROM tiles").fetchone()
        (state,) = db.execute("PRAGMA quick_check").fetchone()
    except sqlite3.Error as error:
        raise OutputError(f"{path} is damaged after writing ({error}); check the disk") from error
    finally:
        db.close()
    if found != count or state != "ok":
        raise OutputError(f"{path} is damaged after writing ({found} of {count} tiles, {state}); check the disk")
