"""The map as a GeoPackage (OGC 12-128r18): tiles of all zooms in one SQLite file, in any CRS, with overviews.

In Web Mercator the tiles are those of web maps, which phones and ATAK know; in any other CRS they are the map's own
pixels, each level half as fine as the next.
"""

from __future__ import annotations

import math
import sqlite3
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from pyproj import CRS
from pyproj.enums import WktVersion

from photomap_gis.core.errors import OutputError
from photomap_gis.core.grid import Window
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.area import Area, Bounds, clipped
from photomap_gis.export.crs import WEB_MERCATOR, parse_crs, same_crs
from photomap_gis.export.encode import TileChoice, TileFormat, parse_tile_choice
from photomap_gis.export.pieces import EncodedTile, kept_pieces
from photomap_gis.export.publish import file_in_place_of
from photomap_gis.export.pyramid import Pyramid
from photomap_gis.export.sqlite import check_tiles, new_database
from photomap_gis.export.warp import Resampler, ground_pixel_m, target_grid
from photomap_gis.export.webtiles import OnProgress, encoded_tiles, plan_web_tiles
from photomap_gis.export.words import MapWords

_APPLICATION_ID, _VERSION = 0x47504B47, 10300  # "GPKG", 1.3.0
_TILE_PX = 256
_TABLE = "map"
_HALF_WORLD_M = math.pi * 6378137.0
_NO_WORDS = MapWords()
_EPOCH = "1970-01-01T00:00:00.000Z"
_SCHEMA = """
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY,
  organization TEXT NOT NULL, organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
  description TEXT DEFAULT '', last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
  CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_tile_matrix_set (table_name TEXT NOT NULL PRIMARY KEY, srs_id INTEGER NOT NULL,
  min_x DOUBLE NOT NULL, min_y DOUBLE NOT NULL, max_x DOUBLE NOT NULL, max_y DOUBLE NOT NULL,
  CONSTRAINT fk_gtms_table_name FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
  CONSTRAINT fk_gtms_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_tile_matrix (table_name TEXT NOT NULL, zoom_level INTEGER NOT NULL, matrix_width INTEGER NOT NULL,
  matrix_height INTEGER NOT NULL, tile_width INTEGER NOT NULL, tile_height INTEGER NOT NULL,
  pixel_x_size DOUBLE NOT NULL, pixel_y_size DOUBLE NOT NULL,
  CONSTRAINT pk_ttm PRIMARY KEY (table_name, zoom_level),
  CONSTRAINT fk_tmm_table_name FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name));
CREATE TABLE gpkg_extensions (table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL,
  definition TEXT NOT NULL, scope TEXT NOT NULL,
  CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name));
CREATE TABLE gpkg_metadata (id INTEGER CONSTRAINT m_pk PRIMARY KEY ASC NOT NULL,
  md_scope TEXT NOT NULL DEFAULT 'dataset', md_standard_uri TEXT NOT NULL, mime_type TEXT NOT NULL DEFAULT 'text/xml',
  metadata TEXT NOT NULL DEFAULT '');
CREATE TABLE gpkg_metadata_reference (reference_scope TEXT NOT NULL, table_name TEXT, column_name TEXT,
  row_id_value INTEGER, timestamp DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  md_file_id INTEGER NOT NULL, md_parent_id INTEGER,
  CONSTRAINT crmr_mfi_fk FOREIGN KEY (md_file_id) REFERENCES gpkg_metadata(id),
  CONSTRAINT crmr_mpi_fk FOREIGN KEY (md_parent_id) REFERENCES gpkg_metadata(id));
CREATE TABLE map (id INTEGER PRIMARY KEY AUTOINCREMENT, zoom_level INTEGER NOT NULL, tile_column INTEGER NOT NULL,
  tile_row INTEGER NOT NULL, tile_data BLOB NOT NULL, UNIQUE (zoom_level, tile_column, tile_row));
"""
_METADATA_EXTENSION = "http://www.geopackage.org/spec121/#extension_metadata"
_WEBP_EXTENSION = "http://www.geopackage.org/spec121/#extension_tiles_webp"


def write_geopackage(
    source: TileSource,
    path: Path | str,
    *,
    crs: str | None = None,
    pixel_size: float | None = None,
    area: Area | None = None,
    image_format: str = "auto",
    quality: int | None = None,
    words: MapWords = _NO_WORDS,
    source_key: str | None = None,
    on_progress: OnProgress | None = None,
) -> int:
    """Write the map as a table of tiles and return how many there are.

    ``image_format``: ``auto`` is mixed, JPG where a tile is opaque and PNG at the map's border, as the standard allows;
    png keeps every pixel; webp is an extension of the standard. ``pixel_size`` is in units of ``crs``. ``source_key``
    is as in ``write_tiles``.
    """
    path = Path(path).absolute()
    choice = parse_tile_choice(image_format, auto=TileChoice.MIXED)
    layout = _layout(clipped(source, area), crs, pixel_size, area)
    count, stored = 0, set()
    with (
        kept_pieces(
            path, source_key, layout.pyramid, choice, quality, layout.crs_wkt, layout.pixel, layout.matrix_bounds
        ) as pieces,
        file_in_place_of(path, lambda p: check_tiles(p, path, "map", count)) as temporary,
        new_database(temporary, path) as db,
    ):
        db.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
        db.execute(f"PRAGMA user_version = {_VERSION}")
        db.executescript(_SCHEMA)
        for tile in encoded_tiles(layout.pyramid, choice, quality, on_progress, pieces):
            _insert(db, tile)
            stored.add(tile.format)
            count += 1
        if count == 0:
            raise OutputError(f"{path} was not written: the map shows nothing")
        _describe(db, layout, words, TileFormat.WEBP in stored)
        db.commit()
    return count


@dataclass(frozen=True, slots=True)
class _Layout:
    """A pyramid and where its tiles lie: ``matrix_bounds`` of whole tiles, ``bounds`` of what is shown.

    ``columns`` and ``rows`` count the tiles of the widest level, ``pixel`` is that of the pyramid's finest.
    """

    pyramid: Pyramid
    crs_wkt: str | None
    pixel: float
    columns: int
    rows: int
    matrix_bounds: Bounds
    bounds: Bounds


def _layout(source: TileSource, crs: str | None, pixel_size: float | None, area: Area | None) -> _Layout:
    target = source.grid.crs_wkt if crs is None else parse_crs(crs).to_wkt()
    if target is not None and same_crs(target, parse_crs(WEB_MERCATOR).to_wkt()):
        return _web_layout(source, pixel_size, area)
    grid = target_grid(source.grid, crs, pixel_size, area)
    levels = max(0, math.ceil(math.log2(max(grid.width, grid.height) / _TILE_PX)))
    pyramid = Pyramid(Resampler(source, grid), Window(0, 0, grid.width, grid.height), levels, 0, None, _TILE_PX)
    span = (_TILE_PX << levels) * grid.pixel_size
    whole = (grid.west, grid.north - span, grid.west + span, grid.north)
    return _Layout(pyramid, grid.crs_wkt, grid.pixel_size, 1, 1, whole, grid.bounds)


def _web_layout(source: TileSource, pixel_size: float | None, area: Area | None) -> _Layout:
    gsd_m = None
    if pixel_size is not None:
        gsd_m = pixel_size / target_grid(source.grid, WEB_MERCATOR).pixel_size * ground_pixel_m(source.grid)
    plan = plan_web_tiles(source, "a GeoPackage in EPSG:3857", gsd_m=gsd_m, area=area)
    p, half = plan.pyramid, _HALF_WORLD_M
    step, size = 1 << (p.max_zoom - plan.max_zoom), 2.0 * half / (_TILE_PX << plan.max_zoom)
    c, r, w, h = p.extent
    left, top, right, bottom = c // step, r // step, -(-(c + w) // step), -(-(r + h) // step)
    bounds = (-half + left * size, half - bottom * size, -half + right * size, half - top * size)
    tiles = 1 << plan.min_zoom
    world = (-half, -half, half, half)
    return _Layout(p, parse_crs(WEB_MERCATOR).to_wkt(), size / step, tiles, tiles, world, bounds)


def _insert(db: sqlite3.Connection, tile: EncodedTile) -> None:
    zoom, x, y = tile.key
    db.execute(
        "INSERT INTO map (zoom_level, tile_column, tile_row, tile_data) VALUES (?, ?, ?, ?)",
        (zoom, x % (1 << zoom), y, tile.data),
    )


def _describe(db: sqlite3.Connection, layout: _Layout, words: MapWords, has_webp: bool) -> None:
    srs_id = _add_crs(db, layout.crs_wkt)
    changed = datetime.fromisoformat(words.last_utc or _EPOCH).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.000Z")
    db.execute(
        "INSERT INTO gpkg_contents VALUES (?, 'tiles', ?, ?, ?, ?, ?, ?, ?, ?)",
        (_TABLE, words.title, words.paragraph, changed, *layout.bounds, srs_id),
    )
    db.execute("INSERT INTO gpkg_tile_matrix_set VALUES (?, ?, ?, ?, ?, ?)", (_TABLE, srs_id, *layout.matrix_bounds))
    p = layout.pyramid
    for zoom in range(p.min_zoom, (p.max_zoom if p.keep_zoom is None else p.keep_zoom) + 1):
        n, size = 1 << (zoom - p.min_zoom), layout.pixel * (1 << (p.max_zoom - zoom))
        db.execute(
            "INSERT INTO gpkg_tile_matrix VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            (_TABLE, zoom, layout.columns * n, layout.rows * n, _TILE_PX, _TILE_PX, size, size),
        )
    extensions: list[tuple[str, str | None, str, str, str]] = [
        (table, None, "gpkg_metadata", _METADATA_EXTENSION, "read-write")
        for table in ("gpkg_metadata", "gpkg_metadata_reference")
    ]
    if has_webp:
        extensions.append((_TABLE, "tile_data", "gpkg_webp", _WEBP_EXTENSION, "read-write"))
    db.executemany("INSERT INTO gpkg_extensions VALUES (?, ?, ?, ?, ?)", extensions)
    pairs = {**words.pairs, "attribution": words.attribution}
    for number, (key, value) in enumerate(((k, v) for k, v in pairs.items() if v), start=1):
        mime = "application/json" if key == "provenance" else "text/plain"
        text = value if key == "provenance" else f"{key}: {value}"
        db.execute("INSERT INTO gpkg_metadata VALUES (?, 'dataset', ?, ?, ?)", (number, "urn:photomap", mime, text))
        db.execute(
            "INSERT INTO gpkg_metadata_reference VALUES ('table', ?, NULL, NULL, ?, ?, NULL)", (_TABLE, changed, number)
        )


def _add_crs(db: sqlite3.Connection, crs_wkt: str | None) -> int:
    """Add the rows that every GeoPackage must have and the map's own; return its number."""
    wgs84 = CRS.from_epsg(4326).to_wkt(WktVersion.WKT1_GDAL)
    rows = [
        ("Undefined cartesian SRS", -1, "NONE", -1, "undefined", "undefined cartesian coordinate reference system"),
        ("Undefined geographic SRS", 0, "NONE", 0, "undefined", "undefined geographic coordinate reference system"),
        ("WGS 84 geodetic", 4326, "EPSG", 4326, wgs84, "longitude and latitude in degrees on WGS 84"),
    ]
    srs_id = -1
    if crs_wkt is not None:
        crs = parse_crs(crs_wkt)
        code = crs.to_epsg(min_confidence=70)
        srs_id = code if code is not None else 100_000
        wkt = crs.to_wkt(WktVersion.WKT1_GDAL)
        if srs_id != 4326:
            rows.append((crs.name, srs_id, "EPSG" if code else "NONE", srs_id, wkt, crs.name))
    db.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", rows)
    return srs_id
