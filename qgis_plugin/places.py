"""Places on Earth: between coordinate systems, and metres east and north on the grid that a map is solved in."""

from __future__ import annotations

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsCsException,
    QgsPointXY,
    QgsProject,
)

WGS84 = "EPSG:4326"


class PlaceError(Exception):
    """A point is no place on Earth in the coordinate system that it is given in."""


def to_lonlat(point: QgsPointXY, crs: QgsCoordinateReferenceSystem) -> QgsPointXY:
    """Return longitude and latitude (WGS 84, degrees) of a point; ``PlaceError`` where it has none."""
    if not crs.isValid():
        raise PlaceError("the project has no coordinate system: choose one at the bottom right of the window")
    place = _changed(point, crs, QgsCoordinateReferenceSystem(WGS84))
    if not (abs(place.y()) <= 90.0 and abs(place.x()) <= 360.0):
        raise PlaceError("that is no place on Earth")
    return place


def from_lonlat(lonlat: QgsPointXY, crs: QgsCoordinateReferenceSystem) -> QgsPointXY:
    """Return a point in a coordinate system of what is given in degrees; ``PlaceError`` where it has none there."""
    return _changed(lonlat, QgsCoordinateReferenceSystem(WGS84), crs)


def utm_of(lonlat: QgsPointXY) -> QgsCoordinateReferenceSystem:
    """Return the UTM zone of a place: metres east and north, the grid in which photomap states misses and nudges."""
    zone = min(60, max(1, int((lonlat.x() + 180.0) // 6.0) + 1))
    return QgsCoordinateReferenceSystem(f"EPSG:{(32600 if lonlat.y() >= 0.0 else 32700) + zone}")


def moved_m(lonlat: QgsPointXY, east_m: float, north_m: float) -> QgsPointXY:
    """Return the place (degrees) that lies so many metres of the grid east and north of another one."""
    grid = utm_of(lonlat)
    at = from_lonlat(lonlat, grid)
    return to_lonlat(QgsPointXY(at.x() + east_m, at.y() + north_m), grid)


def metres_between(a: QgsPointXY, b: QgsPointXY) -> tuple[float, float]:
    """Return metres of the grid east and north from one place (degrees) to another."""
    grid = utm_of(a)
    p, q = from_lonlat(a, grid), from_lonlat(b, grid)
    return q.x() - p.x(), q.y() - p.y()


def _changed(point: QgsPointXY, source, target) -> QgsPointXY:
    try:
        place = QgsCoordinateTransform(source, target, QgsProject.instance().transformContext()).transform(point)
    except QgsCsException as error:
        raise PlaceError(f"that place cannot be told in {target.authid()}: {error}") from error
    if not (abs(place.x()) < 1e12 and abs(place.y()) < 1e12):  # infinite, or not a number
        raise PlaceError(f"that place cannot be told in {target.authid()}")
    return place
