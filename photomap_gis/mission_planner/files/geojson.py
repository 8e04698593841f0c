"""A plan as GeoJSON for any GIS: waypoints, paths, lanes, area, zones to avoid, what stays uncovered [RFC 7946].

Positions are two-dimensional, since a third number would mean a height above the ellipsoid; heights are properties.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

from photomap_gis.core.plan import GeoPolygon, SurveyPlan, Waypoint
from photomap_gis.mission_planner.files.lanes import cut_at_antimeridian, lanes_of
from photomap_gis.mission_planner.heights import amsl_m

Json = dict[str, Any]


def plan_geojson(plan: SurveyPlan) -> str:
    """Return a FeatureCollection; each feature's ``kind`` says what it is."""
    collection = {
        "type": "FeatureCollection",
        "pattern": plan.pattern,
        "altitude_frame": str(plan.frame),
        "covered_share": plan.covered_share,
        "gsd_m_per_px": plan.gsd_m_per_px,
        "warnings": list(plan.warnings),
        "features": list(plan_features(plan)),
    }
    return json.dumps(collection, indent=1, allow_nan=False) + "\n"


def plan_features(plan: SurveyPlan) -> Iterator[Json]:
    """Yield area, zones, gaps, home, and each sortie's path, lanes and waypoints."""
    for kind, polygons in (("area", plan.area), ("avoid", plan.avoid), ("uncovered", plan.uncovered)):
        for polygon in polygons:
            yield feature({"type": "Polygon", "coordinates": rings_of(polygon)}, kind=kind)
    if plan.home is not None:
        yield feature({"type": "Point", "coordinates": [plan.home[1], plan.home[0]]}, kind="home")
    for number, sortie in enumerate(plan.sorties, 1):
        facts = {"photos": sortie.photos, "length_m": sortie.length_m, "duration_s": sortie.duration_s}
        path = _line(sortie.waypoints)
        if path is not None:
            yield feature(path, kind="path", sortie=number, **facts)
        for i, lane in enumerate(lanes_of(sortie), 1):
            line = _line(lane)
            if line is not None:
                yield feature(line, kind="lane", sortie=number, lane=i)
        for i, waypoint in enumerate(sortie.waypoints, 1):
            point = {"type": "Point", "coordinates": [waypoint.lon_deg, waypoint.lat_deg]}
            yield feature(point, kind="waypoint", sortie=number, seq=i, **waypoint_facts(plan, waypoint))


def waypoint_facts(plan: SurveyPlan, waypoint: Waypoint) -> Json:
    """Return what a table of waypoints says of one, None where it is not known or not set."""
    trigger = waypoint.trigger
    kind = None
    if trigger is not None:
        kind = "hover" if trigger.hover else "distance" if trigger.distance_m is not None else "time"
    return {
        "role": str(waypoint.role),
        "alt_m": waypoint.alt_m,
        "alt_frame": str(plan.frame),
        "alt_amsl_m": amsl_m(plan, waypoint),
        "speed_m_s": waypoint.speed_m_s,
        "heading_deg": waypoint.heading_deg,
        "hold_s": waypoint.hold_s,
        "gimbal_pitch_deg": waypoint.gimbal_pitch_deg,
        "trigger": kind,
        "trigger_distance_m": trigger.distance_m if trigger else None,
        "trigger_interval_s": trigger.interval_s if trigger else None,
    }


def feature(geometry: Json, **properties: object) -> Json:
    """Return a GeoJSON feature."""
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def rings_of(polygon: GeoPolygon) -> list[list[list[float]]]:
    """Return a polygon's rings as GeoJSON has them."""
    return [[[lon, lat] for lon, lat in ring] for ring in polygon.rings]


def _line(waypoints: Sequence[Waypoint]) -> Json | None:
    parts = cut_at_antimeridian([(w.lon_deg, w.lat_deg) for w in waypoints])
    if not parts:
        return None
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": parts[0]}
    return {"type": "MultiLineString", "coordinates": parts}
