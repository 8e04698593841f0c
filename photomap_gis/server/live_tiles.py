"""Tiles and numbers of a flight that is under way."""

from __future__ import annotations

import math
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

from photomap_gis.core.errors import UsageError
from photomap_gis.export.crs import WGS84, point_map
from photomap_gis.export.encode import TileFormat
from photomap_gis.server.live_layers import LiveLayer
from photomap_gis.server.live_mission import LiveMission
from photomap_gis.server.live_view import RasterKind
from photomap_gis.server.protocol import ValueDocument


def live_tile(mission: LiveMission, request: Request) -> Response:
    """Answer with a tile, or with 304 where the asker has it already: each tile has an ETag of its own."""
    zoom, x, y = (_whole(request.path_params[k]) for k in "zxy")
    wanted = request.path_params["format"].lower()
    if wanted not in [f.value for f in TileFormat]:
        raise HTTPException(404, f"tiles are {', '.join(f.value for f in TileFormat)}")
    epoch = mission.session.state.epoch
    try:
        layer = mission.layer(request.path_params.get("layer", "map"))
        stamp = f"{epoch}-{layer.generation}"
        version = layer.version_of(zoom, x, y)
        headers = {"etag": f'"{stamp}-{version}"', "cache-control": "private, no-cache"}
        if request.headers.get("if-none-match") == headers["etag"]:
            return Response(status_code=304, headers=headers)
        tile = layer.tile(zoom, x, y, TileFormat(wanted))
    except KeyError:
        raise HTTPException(404, "no such layer") from None
    except UsageError as error:
        raise HTTPException(404, str(error)) from error
    headers["etag"] = f'"{stamp}-{tile.version}"'
    return Response(tile.data, media_type=TileFormat(wanted).mime, headers=headers)


def live_tile_json(mission: LiveMission, layer: LiveLayer, url: str) -> dict[str, Any]:
    """Return TileJSON 3.0 of a layer as it is now."""
    scheme = layer.scheme
    west, south, east, north = scheme.bounds
    return {
        "tilejson": "3.0.0",
        "name": f"{mission.session.state.name}: {layer.title}",
        "description": "a map that is being flown",
        "version": "1.0.0",
        "scheme": "xyz",
        "tiles": [url],
        "minzoom": scheme.min_zoom,
        "maxzoom": scheme.max_zoom,
        "bounds": [west, south, east, north],
        "center": [(west + east) / 2.0, (south + north) / 2.0, max(scheme.min_zoom, scheme.max_zoom - 3)],
        "format": "png",
    }


def live_value(mission: LiveMission, layer: LiveLayer, place: tuple[float, float]) -> ValueDocument:
    """Return the number of a layer at a place of the documents' coordinates; of the age layer, how long ago."""
    units = "s ago" if layer.raster.kind is RasterKind.AGE else layer.units
    lattice = layer.raster.lattice
    if lattice.crs_wkt is not None:
        if not (abs(place[0]) <= 360.0 and abs(place[1]) <= 90.0):
            return ValueDocument(value=None, units=units)
        x, y = (float(v) for v in point_map(WGS84, lattice.crs_wkt)([place])[0])
        place = (x, y)
    if not all(math.isfinite(v) for v in place):
        return ValueDocument(value=None, units=units)
    value = layer.value_at(place)
    if value is not None and layer.raster.kind is RasterKind.AGE:
        value = max(0.0, mission.session.state.elapsed_s - value)
    return ValueDocument(value=value, units=units)


def _whole(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= 9):
        raise HTTPException(404, "no such tile")
    return int(text)
