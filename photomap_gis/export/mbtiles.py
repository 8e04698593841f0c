"""All tiles in one file: MBTiles 1.3, a SQLite database that phones and tablets carry."""

from __future__ import annotations

from pathlib import Path

from photomap_gis.core.errors import OutputError
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.area import Area, clipped
from photomap_gis.export.encode import parse_tile_choice
from photomap_gis.export.pieces import kept_pieces
from photomap_gis.export.publish import file_in_place_of
from photomap_gis.export.sqlite import check_tiles, new_database
from photomap_gis.export.webtiles import OnProgress, plan_web_tiles
from photomap_gis.export.words import MapWords

_APPLICATION_ID = 0x4D504258  # "MPBX", MBTiles' mark in SQLite's header
_NO_WORDS = MapWords()
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
    gsd_m: float | None = None,
    area: Area | None = None,
    image_format: str = "auto",
    quality: int | None = None,
    words: MapWords = _NO_WORDS,
    source_key: str | None = None,
    on_progress: OnProgress | None = None,
) -> int:
    """Write the MBTiles file and return how many tiles it holds.

    One format for all tiles, as the specification wants: ``image_format`` is png, jpg or webp; ``auto`` is png. Rows
    are counted from the **south** (TMS). ``source_key`` is as in ``write_tiles``.
    """
    path = Path(path).absolute()
    choice = parse_tile_choice(image_format, mixed=False)
    plan = plan_web_tiles(
        clipped(source, area), "MBTiles", min_zoom=min_zoom, max_zoom=max_zoom, gsd_m=gsd_m, area=area
    )
    lon, lat, zoom = plan.centre
    metadata = {
        "name": words.title,
        "format": choice.value,
        "bounds": ",".join(f"{v:.12f}" for v in plan.bounds_deg),
        "center": f"{lon:.10f},{lat:.10f},{zoom}",
        "minzoom": str(plan.min_zoom),
        "maxzoom": str(plan.max_zoom),
        "type": "overlay",
        "version": "1.0",
        "description": words.paragraph,
        "attribution": words.attribution,
        **words.pairs,
    }
    count = 0
    with (
        kept_pieces(path, source_key, plan.pyramid, choice, quality) as pieces,
        file_in_place_of(path, lambda p: check_tiles(p, path, "tiles", count)) as temporary,
        new_database(temporary, path) as db,
    ):
        db.executescript(_SCHEMA)
        db.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
        db.executemany("INSERT INTO metadata VALUES (?, ?)", metadata.items())
        for tile in plan.encoded(choice, quality, on_progress, pieces):
            key = tile.key
            row = (1 << key.zoom) - 1 - key.y
            db.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", (key.zoom, key.x, row, tile.data))
            count += 1
        if count == 0:
            raise OutputError(f"{path} was not written: the map shows nothing at zooms {plan.zooms}")
        db.commit()
        db.executescript(_INDEXES)
    return count
