"""Areas, lines and zones from files or words: whatever GDAL reads as vectors, WKT, or ``lat,lon;lat,lon;...``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import pyogrio
import shapely
from pyogrio.errors import DataLayerError, DataSourceError
from pyproj import Transformer
from pyproj.exceptions import ProjError
from shapely.geometry import LineString, MultiLineString, Polygon
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.plan import GeoPolygon

_MOST_VERTICES = 100_000


@dataclass(frozen=True, slots=True)
class Places:
    """Polygons, and the first line, of (longitude, latitude) in degrees."""

    polygons: tuple[GeoPolygon, ...] = ()
    line: tuple[tuple[float, float], ...] = ()


def read_places(source: str) -> Places:
    """Return what a file, a WKT text or a list of places holds.

    Three or more places in a list are a polygon. Raises ``DataError`` for a file that cannot be used, ``UsageError``
    for words that mean no place.
    """
    text = source.strip()
    if Path(text).suffix and Path(text).exists():
        return _places(_from_file(Path(text)), text)
    if text[:1].isalpha() and "(" in text:
        try:
            return _places(
                [shapely.from_wkt(text.split(";", 1)[-1] if text.upper().startswith("SRID") else text)], text
            )
        except shapely.errors.ShapelyError as error:
            raise UsageError(f"the WKT cannot be read: {str(error)[:100]}") from error
    if ";" in text:
        return _places([_from_list(text)], text)
    raise DataError(f"{text[:80]} is no file that exists, no WKT, and no list of places LAT,LON;LAT,LON;...")


def _from_file(path: Path) -> list[BaseGeometry]:
    found: list[BaseGeometry] = []
    try:
        for layer, _ in pyogrio.list_layers(path):
            meta, _, wkb, _ = pyogrio.raw.read(path, layer=layer, columns=[], max_features=10_000)
            if wkb is None or not len(wkb):
                continue
            geometries = [g for g in shapely.force_2d(shapely.from_wkb(wkb)) if g is not None]
            if meta["crs"]:
                move = Transformer.from_crs(meta["crs"], "EPSG:4326", always_xy=True, allow_ballpark=False)
                geometries = [
                    shapely.transform(g, lambda x, y, m=move: m.transform(x, y), interleaved=False) for g in geometries
                ]
            found += geometries
    except (DataSourceError, DataLayerError, shapely.errors.ShapelyError, ProjError, ValueError) as error:
        raise DataError(f"{path} cannot be read as areas: {str(error)[:200]}") from error
    return found


def _from_list(text: str) -> BaseGeometry:
    points = []
    for pair in text.strip(" ;").split(";"):
        try:
            lat, lon = (float(part) for part in pair.split(","))
        except ValueError:
            raise UsageError(f"{pair.strip()[:40]!r} is no place: LAT,LON;LAT,LON;... in degrees") from None
        points.append((lon, lat))
    return Polygon(points) if len(points) > 2 else LineString(points)


def _places(geometries: list[BaseGeometry], name: str) -> Places:
    polygons, line = [], None
    parts = [part for geometry in geometries for part in shapely.get_parts(shapely.get_parts(geometry))]
    if sum(shapely.get_num_coordinates(p) for p in parts) > _MOST_VERTICES:
        raise DataError(f"{name[:80]} has more than {_MOST_VERTICES} vertices: simplify it first")
    for part in parts:
        coordinates = shapely.get_coordinates(part)
        if not all(math.isfinite(x) and abs(x) <= 360 and abs(y) <= 90 for x, y in coordinates):
            raise DataError(f"{name[:80]} has places that are not on Earth: is its CRS right, is latitude first?")
        if isinstance(part, Polygon) and not part.is_empty:  # a bow-tie has an area of 0: the planner repairs it
            rings = (part.exterior, *part.interiors)
            polygons.append(GeoPolygon(tuple(tuple((x, y) for x, y in ring.coords) for ring in rings)))
        elif isinstance(part, LineString | MultiLineString) and line is None and part.length > 0:
            line = tuple((float(x), float(y)) for x, y in coordinates)
    if not polygons and line is None:
        raise DataError(f"{name[:80]} holds neither a polygon nor a line")
    return Places(tuple(polygons), line or ())
