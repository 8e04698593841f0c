"""A folder of tiles that opens in QGIS, in a browser from the disk, and on any web server.

``FOLDER/z/x/y.png`` (row 0 in the north; in the south for TMS), ``tiles.json`` (TileJSON 3.0), for TMS
``tilemapresource.xml`` too, and ``index.html``, a viewer without a network.
"""

from __future__ import annotations

import json
import math
from importlib import resources
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from photomap_gis.core.errors import OutputError
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.area import Area, clipped
from photomap_gis.export.encode import TileChoice, parse_tile_choice
from photomap_gis.export.pieces import kept_pieces
from photomap_gis.export.publish import folder_in_place_of
from photomap_gis.export.webtiles import TILE_PX, OnProgress, WebTiles, plan_web_tiles
from photomap_gis.export.words import MapWords

_GENERATOR = "photomap"
_HALF_WORLD_M = math.pi * 6378137.0
_NO_WORDS = MapWords()


def write_tiles(
    source: TileSource,
    folder: Path | str,
    *,
    min_zoom: int | None = None,
    max_zoom: int | None = None,
    gsd_m: float | None = None,
    area: Area | None = None,
    image_format: str = "auto",
    quality: int | None = None,
    tms: bool = False,
    words: MapWords = _NO_WORDS,
    source_key: str | None = None,
    on_progress: OnProgress | None = None,
) -> int:
    """Write the folder of tiles and return how many there are.

    Clients know one suffix for all tiles: ``image_format`` is png, webp or jpg; ``auto`` is png, which keeps what was
    not seen transparent and opens in every client. ``mixed`` is JPG where a tile is opaque and PNG elsewhere, under
    the suffix png: browsers and GIS look at the bytes. A folder that an earlier export wrote is replaced in whole.
    Where ``source_key`` names the map's pixels, a long export that was killed is continued by the next one like it.
    """
    folder = Path(folder).absolute()
    choice = parse_tile_choice(image_format)
    plan = plan_web_tiles(
        clipped(source, area), "a tile map", min_zoom=min_zoom, max_zoom=max_zoom, gsd_m=gsd_m, area=area
    )
    document = _tile_json(plan, choice, tms, words)
    count = 0
    with (
        kept_pieces(folder, source_key, plan.pyramid, choice, quality) as pieces,
        folder_in_place_of(folder, ours=_is_ours) as fresh,
    ):
        made: set[Path] = set()
        for tile in plan.encoded(choice, quality, on_progress, pieces):
            zoom, x, y = tile.key
            column = fresh / str(zoom) / str(x)
            if column not in made:
                column.mkdir(parents=True, exist_ok=True)
                made.add(column)
            path = column / f"{(1 << zoom) - 1 - y if tms else y}.{choice.suffix}"
            path.write_bytes(tile.data)
            if path.stat().st_size != len(tile.data):
                raise OutputError(f"{folder} cannot be written: a tile is cut short; check the disk")
            count += 1
        if count == 0:
            raise OutputError(f"{folder} was not written: the map shows nothing at zooms {plan.zooms}")
        if tms:
            (fresh / "tilemapresource.xml").write_text(_tile_map_resource(plan, choice, words), encoding="utf-8")
        (fresh / "tiles.json").write_text(json.dumps(document, indent=2, ensure_ascii=False), encoding="utf-8")
        (fresh / "index.html").write_text(_viewer({**document, "bounds": list(plan.box_deg)}), encoding="utf-8")
    return count


def _tile_json(plan: WebTiles, choice: TileChoice, tms: bool, words: MapWords) -> dict[str, Any]:
    return {
        "tilejson": "3.0.0",
        "name": words.title,
        "description": words.paragraph,
        "attribution": words.attribution,
        "version": "1.0.0",
        "scheme": "tms" if tms else "xyz",
        # Relative to this file, so that the folder can be moved or served from anywhere.
        "tiles": [f"./{{z}}/{{x}}/{{y}}.{choice.suffix}"],
        "minzoom": plan.min_zoom,
        "maxzoom": plan.max_zoom,
        "bounds": list(plan.bounds_deg),
        "center": list(plan.centre),
        "format": choice.suffix,
        **words.pairs,
        "provenance": dict(words.provenance),
        "generator": _GENERATOR,
    }


def _tile_map_resource(plan: WebTiles, choice: TileChoice, words: MapWords) -> str:
    """Return the document of the OSGeo Tile Map Service specification 1.0.0, profile global-mercator."""
    west, south, east, north = plan.bounds_deg
    x0, x1 = (math.radians(lon) * 6378137.0 for lon in (west, east))
    y0, y1 = (math.asinh(math.tan(math.radians(lat))) * 6378137.0 for lat in (south, north))
    sets = "".join(
        f'    <TileSet href="{z}" units-per-pixel="{2.0 * _HALF_WORLD_M / (TILE_PX << z):.14g}" '
        f'order="{z - plan.min_zoom}"/>\n'
        for z in range(plan.min_zoom, plan.max_zoom + 1)
    )
    mime = "image/jpeg" if choice.suffix == "jpg" else f"image/{choice.suffix}"
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<TileMap version="1.0.0" '
        'tilemapservice="http://tms.osgeo.org/1.0.0">\n'
        f"  <Title>{escape(words.title)}</Title>\n  <Abstract>{escape(words.paragraph)}</Abstract>\n"
        f"  <Metadata type={quoteattr('application/json')}>{escape(words.provenance_json)}</Metadata>\n"
        "  <SRS>EPSG:3857</SRS>\n"
        f'  <BoundingBox minx="{x0:.6f}" miny="{y0:.6f}" maxx="{x1:.6f}" maxy="{y1:.6f}"/>\n'
        f'  <Origin x="{-_HALF_WORLD_M:.6f}" y="{-_HALF_WORLD_M:.6f}"/>\n'
        f'  <TileFormat width="{TILE_PX}" height="{TILE_PX}" mime-type="{mime}" extension="{choice.suffix}"/>\n'
        f'  <TileSets profile="global-mercator">\n{sets}  </TileSets>\n</TileMap>\n'
    )


def _is_ours(folder: Path) -> bool:
    try:
        document = json.loads((folder / "tiles.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(document, dict) and document.get("generator") == _GENERATOR


def _viewer(document: dict[str, Any]) -> str:
    page = resources.files("photomap_gis.export").joinpath("viewer.html").read_text(encoding="utf-8")
    # "<" must not close the script that holds the document.
    return page.replace("/*TILEJSON*/null", json.dumps(document).replace("<", "\\u003c"))
