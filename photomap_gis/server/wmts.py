"""WMTS capabilities (OGC 07-057r7, RESTful) of a mission's layers, for QGIS and ArcGIS."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar
from xml.sax.saxutils import escape, quoteattr

from photomap_gis.export.webtiles import TILE_PX
from photomap_gis.server.layers import TileScheme

_SET = "GoogleMapsCompatible"
_HALF_WORLD_M = math.pi * 6378137.0
_ROOM_M = 3000.0
_PIXEL_M = 0.28e-3
"""The standard's pixel: a scale denominator is metres a pixel over this."""


class Shown(Protocol):
    """What there must be of a layer, finished or live."""

    @property
    def id(self) -> str: ...  # noqa: D102

    @property
    def title(self) -> str: ...  # noqa: D102

    @property
    def scheme(self) -> TileScheme: ...  # noqa: D102


L = TypeVar("L", bound=Shown)


def capabilities(
    name: str, shown: Sequence[L], self_url: str, tile_url: Callable[[L], str], *, grows: bool = False
) -> str:
    """Return the XML document; ``tile_url`` gives a layer's template with {TileMatrix}, {TileCol}, {TileRow}.

    What ``grows`` (a flight under way) has no limits of tiles, and room around it: clients read this once, and would
    never ask for ground that comes later.
    """
    layers = [layer for layer in shown if layer.scheme.kind == "webmercator"]
    matrices = max((layer.scheme.max_zoom for layer in layers), default=0) + 1
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<Capabilities xmlns="http://www.opengis.net/wmts/1.0" xmlns:ows="http://www.opengis.net/ows/1.1"
 xmlns:xlink="http://www.w3.org/1999/xlink" version="1.0.0">
<ows:ServiceIdentification><ows:Title>{escape(name)}</ows:Title>
<ows:ServiceType>OGC WMTS</ows:ServiceType><ows:ServiceTypeVersion>1.0.0</ows:ServiceTypeVersion>
</ows:ServiceIdentification>
<Contents>
{"".join(_layer(layer, tile_url(layer), grows=grows) for layer in layers)}<TileMatrixSet>
<ows:Identifier>{_SET}</ows:Identifier><ows:SupportedCRS>urn:ogc:def:crs:EPSG::3857</ows:SupportedCRS>
<WellKnownScaleSet>urn:ogc:def:wkss:OGC:1.0:GoogleMapsCompatible</WellKnownScaleSet>
{"".join(_matrix(zoom) for zoom in range(matrices))}</TileMatrixSet>
</Contents>
<ServiceMetadataURL xlink:href={quoteattr(self_url)}/>
</Capabilities>
"""


def _layer(layer: Shown, url: str, *, grows: bool) -> str:
    west, south, east, north = _with_room(layer.scheme.bounds) if grows else layer.scheme.bounds
    zooms = () if grows else range(layer.scheme.max_zoom + 1)
    limits = "".join(_limits(layer, zoom) for zoom in zooms)
    limits = f"<TileMatrixSetLimits>{limits}</TileMatrixSetLimits>" if limits else ""
    return f"""<Layer><ows:Title>{escape(layer.title)}</ows:Title>
<ows:WGS84BoundingBox><ows:LowerCorner>{west:.9f} {south:.9f}</ows:LowerCorner>
<ows:UpperCorner>{east:.9f} {north:.9f}</ows:UpperCorner></ows:WGS84BoundingBox>
<ows:Identifier>{escape(layer.id)}</ows:Identifier>
<Style isDefault="true"><ows:Identifier>default</ows:Identifier></Style><Format>image/png</Format>
<TileMatrixSetLink><TileMatrixSet>{_SET}</TileMatrixSet>{limits}
</TileMatrixSetLink>
<ResourceURL format="image/png" resourceType="tile" template={quoteattr(url)}/></Layer>
"""


def _with_room(bounds: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return degrees with room for what a flight will see yet."""
    west, south, east, north = bounds
    lat = _ROOM_M / 111_000.0
    lon = lat / max(0.1, math.cos(math.radians((south + north) / 2.0)))
    return max(-180.0, west - lon), max(-85.0, south - lat), min(180.0, east + lon), min(85.0, north + lat)


def _limits(layer: Shown, zoom: int) -> str:
    west, south, east, north = layer.scheme.bounds
    n = 1 << zoom
    rows = [(0.5 - math.asinh(math.tan(math.radians(lat))) / (2.0 * math.pi)) * n for lat in (north, south)]
    cols = [(lon / 360.0 + 0.5) * n for lon in (west, east)]
    (left, right), (top, bottom) = ([min(n - 1, max(0, math.floor(v))) for v in pair] for pair in (cols, rows))
    return (
        f"<TileMatrixLimits><TileMatrix>{zoom}</TileMatrix><MinTileRow>{top}</MinTileRow><MaxTileRow>{bottom}</MaxTileRow>"
        f"<MinTileCol>{left}</MinTileCol><MaxTileCol>{right}</MaxTileCol></TileMatrixLimits>"
    )


def _matrix(zoom: int) -> str:
    n = 1 << zoom
    scale = 2.0 * _HALF_WORLD_M / (TILE_PX * n) / _PIXEL_M
    return f"""<TileMatrix><ows:Identifier>{zoom}</ows:Identifier><ScaleDenominator>{scale!r}</ScaleDenominator>
<TopLeftCorner>{-_HALF_WORLD_M!r} {_HALF_WORLD_M!r}</TopLeftCorner><TileWidth>{TILE_PX}</TileWidth>
<TileHeight>{TILE_PX}</TileHeight><MatrixWidth>{n}</MatrixWidth><MatrixHeight>{n}</MatrixHeight></TileMatrix>
"""
