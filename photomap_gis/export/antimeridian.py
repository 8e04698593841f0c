"""Geometries in degrees that lie across 180 degrees of longitude: cut there, as RFC 7946 (section 3.1.9) asks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely
from shapely import affinity
from shapely.geometry.base import BaseGeometry

_KINDS = {
    "LineString": shapely.MultiLineString,
    "Polygon": shapely.MultiPolygon,
    "MultiLineString": shapely.MultiLineString,
    "MultiPolygon": shapely.MultiPolygon,
}


def near(lon_lat_deg: npt.NDArray[np.float64], middle_deg: float) -> npt.NDArray[np.float64]:
    """Return ``(N, 2)`` places with longitudes within half a turn of ``middle_deg``, beyond ±180 where need be."""
    out = lon_lat_deg.copy()
    out[:, 0] = middle_deg + (out[:, 0] - middle_deg + 180.0) % 360.0 - 180.0
    return out


def cut(geometry: BaseGeometry) -> BaseGeometry:
    """Return a geometry less than half a turn wide, in degrees, with longitudes within ±180: in parts where it crosses.

    Longitudes may jump by a turn between neighbouring points, or run on beyond ±180.
    """
    if geometry.is_empty:
        return geometry
    middle = float(shapely.get_coordinates(geometry)[0, 0])
    whole = shapely.transform(geometry, lambda p: near(p, middle))
    west, _, east, _ = whole.bounds
    if west >= -180.0 and east <= 180.0:
        return whole
    if geometry.geom_type not in _KINDS:
        return shapely.transform(whole, lambda p: near(p, 0.0))
    dimension, parts = shapely.get_dimensions(geometry), []
    for turn in (-360.0, 0.0, 360.0):
        within = whole & shapely.box(turn - 180.0, -90.0, turn + 180.0, 90.0)
        for part in shapely.get_parts(affinity.translate(within, -turn)):
            if shapely.get_dimensions(part) == dimension and not part.is_empty:  # not what only touches the edge
                parts.append(part)
    return _KINDS[geometry.geom_type](parts)


def bounds(geometry: BaseGeometry) -> tuple[float, float, float, float]:
    """Return west, south, east, north of a geometry that was cut; west > east across 180 (RFC 7946, section 5.2)."""
    west, south, east, north = geometry.bounds
    if east - west > 180.0:
        lon = shapely.get_coordinates(geometry)[:, 0]
        west, east = float(lon[lon > 0].min()), float(lon[lon <= 0].max())
    return west, south, east, north
