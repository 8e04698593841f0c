"""The fence of a flight: round the area and the way there and back, and out of every zone to avoid."""

from __future__ import annotations

import math

import shapely
from shapely.geometry import LineString, MultiPolygon, Point, Polygon
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.mission import FencePolygon
from photomap_gis.core.plan import GeoPolygon, Sortie, SurveyPlan
from photomap_gis.mission_planner.local_frame import LocalFrame

MOST_VERTICES = 40
"""Of one polygon: small controllers store some 80 fence points in all."""


def fence_around(plan: SurveyPlan, sortie: Sortie, *, margin_m: float) -> tuple[FencePolygon, tuple[FencePolygon, ...]]:
    """Return the polygon to stay in and those to stay out of.

    All that the sortie flies, with home and the area, lies inside by at least ``margin_m``. One polygon, since
    ArduPilot asks for the inside of *every* inclusion polygon. Zones lose vertices only outwards, and only where no
    leg comes to lie in them.
    """
    if not (math.isfinite(margin_m) and margin_m > 0):
        raise ValueError(f"margin_m must be above 0, got {margin_m}")
    places = [(w.lat_deg, w.lon_deg) for w in sortie.waypoints]
    if plan.home is not None:
        places = [plan.home, *places, plan.home]
    if not places:
        raise ValueError("the sortie has no waypoints to put a fence around")
    frame = LocalFrame.about(*places[0])
    path = _path(frame, places)
    area = [_polygon(frame, polygon) for polygon in plan.area]
    inclusion = _outline(shapely.union_all([path, *area]), margin_m)
    exclusions = [_exclusion(_polygon(frame, zone), path) for zone in plan.avoid]
    return _fence(frame, inclusion, True), tuple(_fence(frame, z, False) for z in exclusions if z is not None)


def _outline(flown: BaseGeometry, margin_m: float) -> Polygon:
    """One polygon of few vertices that holds everything with a margin."""
    whole = flown.buffer(margin_m, join_style="mitre", mitre_limit=1.5)
    if isinstance(whole, MultiPolygon):
        whole = whole.convex_hull
    return _with_fewer_vertices(Polygon(whole.exterior), whole.buffer(-1e-6 * margin_m))


def _with_fewer_vertices(polygon: Polygon, must_hold: BaseGeometry) -> Polygon:
    """Widen and simplify until the vertices are few; the convex hull in the end."""
    tolerance = 0.01 * math.sqrt(polygon.area)
    for _ in range(5):
        if len(polygon.exterior.coords) - 1 <= MOST_VERTICES:
            return polygon
        wider = polygon.buffer(tolerance, join_style="mitre", mitre_limit=1.5).simplify(tolerance)
        if isinstance(wider, Polygon):
            simple = Polygon(wider.exterior)
            if len(simple.exterior.coords) - 1 <= MOST_VERTICES and simple.covers(must_hold):
                return simple
        tolerance *= 1.5
    hull = polygon.convex_hull
    if len(hull.exterior.coords) - 1 <= MOST_VERTICES:
        return hull
    return hull.minimum_rotated_rectangle


def _exclusion(zone: Polygon, path: BaseGeometry) -> Polygon | None:
    """The zone's outline; None where the flight is in a hole of it, which a fence cannot say."""
    outline = Polygon(zone.exterior)
    if outline.buffer(-1.0).intersects(path):
        return None
    simple = _with_fewer_vertices(outline, outline.buffer(-1e-3))
    return outline if simple.intersects(path) else simple


def _path(frame: LocalFrame, places: list[tuple[float, float]]) -> BaseGeometry:
    xy = frame.to_xy(places)
    return LineString(xy) if len(xy) > 1 else Point(xy[0])


def _polygon(frame: LocalFrame, polygon: GeoPolygon) -> Polygon:
    rings = [frame.to_xy([(lat, lon) for lon, lat in ring]) for ring in polygon.rings]
    made = Polygon(rings[0], rings[1:])
    return made if made.is_valid else _largest(shapely.make_valid(made))


def _largest(geometry: BaseGeometry) -> Polygon:
    parts = [part for part in shapely.get_parts(geometry) if isinstance(part, Polygon)]
    return max(parts, key=lambda part: part.area, default=Polygon())


def _fence(frame: LocalFrame, polygon: Polygon, inclusion: bool) -> FencePolygon:
    places = frame.to_lat_lon(polygon.exterior.coords[:-1])
    return FencePolygon(tuple((float(lat), float(lon)) for lat, lon in places), inclusion)
