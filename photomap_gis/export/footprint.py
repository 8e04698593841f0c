"""The outline of what a map shows, as polygons."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from rasterio import Affine
from rasterio.features import shapes
from shapely.geometry import MultiPolygon, Polygon, mapping, shape
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.errors import OutputError
from photomap_gis.core.grid import Window
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.antimeridian import cut, near
from photomap_gis.export.crs import WGS84, needs_place, point_map
from photomap_gis.export.publish import file_in_place_of
from photomap_gis.export.warp import read_shrunk

_STRIP_ROWS = 64


def footprint(source: TileSource, *, max_px: int = 2048) -> MultiPolygon:
    """Return what the map shows, in its CRS: valid polygons with holes, empty where it shows nothing.

    The alpha is looked at in pixels so coarse that the longer side has at most ``max_px``: outlines are true to about
    one such pixel.
    """
    g = source.grid
    factor = max(1, -(-max(g.width, g.height) // max_px))
    width, height = -(-g.width // factor), -(-g.height // factor)
    seen = np.zeros((height, width), bool)
    for row in range(0, height, _STRIP_ROWS):
        rows = min(_STRIP_ROWS, height - row)
        seen[row : row + rows] = read_shrunk(source, Window(0, row, width, rows), factor)[..., 3] >= 128
    a, _, west, _, e, north = g.transform
    return outline_of(seen, (a * factor, 0.0, west, 0.0, e * factor, north))


def outline_of(seen: npt.NDArray[np.bool_], transform: tuple[float, float, float, float, float, float]) -> MultiPolygon:
    """Return the outline of a ``(H, W)`` mask placed by an affine from pixel corners, simplified to about a pixel."""
    if not seen.any():
        return MultiPolygon()
    parts = [shape(s) for s, v in shapes(seen.astype(np.uint8), mask=seen, transform=Affine(*transform)) if v == 1]
    pixel = math.sqrt(abs(transform[0] * transform[4] - transform[1] * transform[3]))
    simplified = shapely.union_all(parts).simplify(1.5 * pixel, preserve_topology=True)
    return _polygons(simplified)


def to_wgs84(geometry: MultiPolygon, crs_wkt: str | None) -> MultiPolygon:
    """Return polygons of a CRS in longitude and latitude, each ring densified so that straight edges stay where they
    are."""
    crs = needs_place(crs_wkt, "a footprint in degrees")
    if geometry.is_empty:
        return geometry
    west, south, east, north = geometry.bounds
    dense = shapely.segmentize(geometry, max(east - west, north - south) / 50.0)
    to_degrees = point_map(crs, WGS84, around_xy=[[west, south], [east, north]])
    middle = float(to_degrees([[(west + east) / 2.0, (south + north) / 2.0]])[0, 0])
    return _polygons(cut(_polygons(shapely.transform(dense, lambda p: near(to_degrees(p), middle)))))


def feature_collection(geometry: MultiPolygon, properties: Mapping[str, Any]) -> dict[str, Any]:
    """Return GeoJSON (RFC 7946: longitude, latitude; outer rings counter-clockwise) of one feature."""
    oriented = MultiPolygon([shapely.geometry.polygon.orient(p, 1.0) for p in geometry.geoms])
    feature = {"type": "Feature", "properties": dict(properties), "geometry": mapping(oriented)}
    return {"type": "FeatureCollection", "features": [feature]}


def write_geojson(document: Mapping[str, Any], path: Path | str) -> None:
    """Write a GeoJSON document."""
    path = Path(path).absolute()

    def check(temporary: Path) -> None:
        try:
            json.loads(temporary.read_text(encoding="utf-8"))
        except ValueError as error:
            raise OutputError(f"{path} is damaged after writing ({error}); check the disk") from error

    with file_in_place_of(path, check) as temporary:
        temporary.write_text(json.dumps(document, ensure_ascii=False, allow_nan=False), encoding="utf-8")


def _polygons(geometry: BaseGeometry) -> MultiPolygon:
    """Return the polygons of any geometry, made valid."""
    valid = geometry if geometry.is_valid else shapely.make_valid(geometry)
    parts = [g for g in getattr(valid, "geoms", [valid]) if not g.is_empty]
    polygons: list[Polygon] = []
    for part in parts:
        if isinstance(part, Polygon):
            polygons.append(part)
        elif isinstance(part, MultiPolygon):
            polygons.extend(part.geoms)
    return MultiPolygon(polygons)
