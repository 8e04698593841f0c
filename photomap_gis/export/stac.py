"""A STAC item (1.0.0, with the extensions projection and file): the catalogue's card of a map and of its files."""

from __future__ import annotations

import hashlib
import mimetypes
import os
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from shapely.geometry import mapping

from photomap_gis.core.errors import OutputError, UsageError
from photomap_gis.core.grid import MapGrid
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.antimeridian import bounds
from photomap_gis.export.area import Area, clipped
from photomap_gis.export.crs import needs_place, parse_crs
from photomap_gis.export.footprint import footprint, to_wgs84, write_geojson
from photomap_gis.export.warp import ground_pixel_m
from photomap_gis.export.words import MapWords

_EXTENSIONS = [
    "https://stac-extensions.github.io/projection/v1.1.0/schema.json",
    "https://stac-extensions.github.io/file/v2.1.0/schema.json",
]
_MEDIA_TYPES = {
    ".tif": "image/tiff; application=geotiff; profile=cloud-optimized",
    ".kmz": "application/vnd.google-earth.kmz",
    ".kml": "application/vnd.google-earth.kml+xml",
    ".gpkg": "application/geopackage+sqlite3",
    ".pmtiles": "application/vnd.pmtiles",
    ".mbtiles": "application/vnd.mapbox-mbtiles",
    ".geojson": "application/geo+json",
    ".csv": "text/csv",
    ".zip": "application/zip",
    ".pdf": "application/pdf",
}
_SHA256_MULTIHASH = "1220"  # multihash: code of SHA-256, length 32
_NO_WORDS = MapWords()


def write_stac_item(
    source: TileSource,
    path: Path | str,
    assets: Sequence[Path],
    *,
    now: datetime,
    asset_grid: MapGrid | None = None,
    area: Area | None = None,
    words: MapWords = _NO_WORDS,
) -> None:
    """Write the item; ``assets`` are files that exist, told by paths relative to it, with size and checksum.

    ``asset_grid`` is the grid of the GeoTIFF among them (default: the map's). Without the frames' times the item's
    ``datetime`` is ``now``, since the standard demands one.
    """
    path = Path(path).absolute()
    if path.suffix.lower() not in (".json", ".geojson"):
        raise UsageError(f"{path.name} must end in .json")
    wkt = needs_place(source.grid.crs_wkt, "a STAC item")
    # a folder of tiles has a document that stands for it, any other is the files in it
    assets = [f for a in assets for f in (sorted(a.glob("*.tif")) if _is_plain_folder(a) else [a])]
    if not assets:
        raise UsageError("a STAC item describes files: ask for another format in the same command, e.g. --geotiff")
    outline = to_wgs84(footprint(clipped(source, area)), wkt)
    if outline.is_empty:
        raise OutputError(f"{path} was not written: the map shows nothing")
    grid = asset_grid or source.grid
    crs = parse_crs(str(grid.crs_wkt))
    properties: dict[str, Any] = {
        "title": words.title,
        "description": words.paragraph or words.title,
        "datetime": words.last_utc or now.strftime("%Y-%m-%dT%H:%M:%SZ"),
        "gsd": round(ground_pixel_m(grid), 6),
        "proj:epsg": crs.to_epsg(min_confidence=70),
        "proj:shape": [grid.height, grid.width],
        "proj:transform": [*grid.transform, 0.0, 0.0, 1.0],
    }
    if properties["proj:epsg"] is None:
        properties["proj:wkt2"] = crs.to_wkt()
    if words.first_utc and words.last_utc:
        properties |= {"start_datetime": words.first_utc, "end_datetime": words.last_utc}
    if words.attribution:
        properties["providers"] = [{"name": words.attribution, "roles": ["producer"]}]
    if words.ce90_m is not None:
        properties["photomap:predicted_ce90_m"] = round(words.ce90_m, 3)
    if words.provenance:
        properties["photomap:provenance"] = dict(words.provenance)
    item = {
        "type": "Feature",
        "stac_version": "1.0.0",
        "stac_extensions": _EXTENSIONS,
        "id": path.stem,
        "bbox": list(bounds(outline)),
        "geometry": mapping(outline),
        "properties": properties,
        "links": [],
        "assets": {_key(asset, assets): _asset(asset, path.parent) for asset in assets},
    }
    write_geojson(item, path)


def _is_plain_folder(asset: Path) -> bool:
    return asset.is_dir() and not (asset / "tiles.json").is_file()


def _key(asset: Path, assets: Sequence[Path]) -> str:
    """Return a short name that is unique among the assets."""
    same = sum(other.stem == asset.stem for other in assets)
    return asset.stem if same == 1 else asset.name


def _asset(asset: Path, folder: Path) -> dict[str, Any]:
    suffix = asset.suffix.lower()
    media = _MEDIA_TYPES.get(".tif" if suffix == ".tiff" else suffix) or mimetypes.guess_type(asset.name)[0]
    is_map = suffix in (".tif", ".tiff", ".gpkg", ".pmtiles", ".mbtiles", ".kmz", ".png", ".jpg", ".pdf")
    described: dict[str, Any] = {
        "href": Path(os.path.relpath(asset.absolute(), folder)).as_posix(),
        "title": asset.name,
        "roles": ["data"] if is_map else ["metadata"],
    }
    if asset.is_dir():  # a folder of tiles: its TileJSON stands for it
        return described | {"href": f"{described['href']}/tiles.json", "type": "application/json"}
    if media:
        described["type"] = media
    with asset.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return described | {"file:size": asset.stat().st_size, "file:checksum": _SHA256_MULTIHASH + digest}
