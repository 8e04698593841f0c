"""A folder of XYZ tiles that opens in QGIS, in a browser from the disk, and on any web server.

``FOLDER/z/x/y.png`` (row 0 in the north), ``tiles.json`` (TileJSON 3.0) and ``index.html``, a viewer without a network.
"""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Any

from photomap_gis.core.errors import OutputError
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.encode import TileFormat
from photomap_gis.export.publish import folder_in_place_of
from photomap_gis.export.webtiles import OnProgress, WebTiles, plan_web_tiles

_GENERATOR = "photomap"


def write_tiles(
    source: TileSource,
    folder: Path | str,
    *,
    min_zoom: int | None = None,
    max_zoom: int | None = None,
    image_format: str = "auto",
    name: str = "photomap",
    description: str = "",
    attribution: str = "",
    on_progress: OnProgress | None = None,
) -> int:
    """Write the folder of tiles and return how many there are.

    Clients know one suffix for all tiles: ``image_format`` is png, webp or jpg; ``auto`` is png, which keeps what was
    not seen transparent and opens in every client. A folder that an earlier export wrote is replaced in whole.
    """
    folder = Path(folder).absolute()
    tile_format = parse_tile_format(image_format)
    plan = plan_web_tiles(source, "a tile map", min_zoom=min_zoom, max_zoom=max_zoom)
    document = _tile_json(plan, tile_format, name, description, attribution)
    count, sample_name = 0, ""
    with folder_in_place_of(folder, ours=_is_ours) as fresh:
        made: set[Path] = set()
        for key, data in plan.encoded(tile_format, on_progress):
            column = fresh / str(key.zoom) / str(key.x)
            if column not in made:
                column.mkdir(parents=True, exist_ok=True)
                made.add(column)
            tile = column / f"{key.y}.{tile_format.value}"
            tile.write_bytes(data)
            if tile.stat().st_size != len(data):
                raise OutputError(f"{folder} cannot be written: a tile is cut short; check the disk")
            count, sample_name = count + 1, str(tile)
        if not sample_name:
            raise OutputError(f"{folder} was not written: the map shows nothing")
        (fresh / "tiles.json").write_text(json.dumps(document, indent=2, ensure_ascii=False), encoding="utf-8")
        (fresh / "index.html").write_text(_viewer(document), encoding="utf-8")
    return count


def parse_tile_format(text: str) -> TileFormat:
    """Return the format of a name; ``auto`` is png, jpeg is jpg."""
    known = {"auto": TileFormat.PNG, "jpeg": TileFormat.JPG, **{f.value: f for f in TileFormat}}
    if text.lower() not in known:
        raise ValueError(f"image_format must be one of {', '.join(known)}, got {text!r}")
    return known[text.lower()]


def _tile_json(
    plan: WebTiles, tile_format: TileFormat, name: str, description: str, attribution: str
) -> dict[str, Any]:
    return {
        "tilejson": "3.0.0",
        "name": name,
        "description": description,
        "attribution": attribution,
        "version": "1.0.0",
        "scheme": "xyz",
        # Relative to this file, so that the folder can be moved or served from anywhere.
        "tiles": [f"./{{z}}/{{x}}/{{y}}.{tile_format.value}"],
        "minzoom": plan.min_zoom,
        "maxzoom": plan.max_zoom,
        "bounds": list(plan.bounds_deg),
        "center": list(plan.centre),
        "format": tile_format.value,
        "generator": _GENERATOR,
    }


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
