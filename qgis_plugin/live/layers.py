"""What is drawn over the live map: the server's documents as features of our layers."""

from __future__ import annotations

import math

from ..overlay import LayerSpec, Overlay
from ..translation import tr
from . import styles

CE90_OF_SIGMA = 2.146
"""Half axes of the ellipse that holds nine of ten, over those of one sigma: sqrt(-2 ln 0.1)."""
_METRES_A_DEGREE = 111_320.0
_RING = 36


def live_overlay() -> Overlay:
    """Return the layers of a flight under way; the rasters come below them."""
    return Overlay(
        tr("photomap live"),
        (
            LayerSpec(
                "finds",
                tr("Finds"),
                "Point",
                ("id:string(40)", "kind:string(20)", "name:string(80)", "note:string(2000)", "time_utc:string(40)",
                 "ce90_m:double"),
                styles.style_finds,
            ),
            LayerSpec(
                "drone",
                tr("Drone"),
                "Point",
                ("heading_deg:double", "altitude_m:double", "speed_m_s:double", "battery_percent:double",
                 "mode:string(40)", "time_utc:string(40)"),
                styles.style_drone,
            ),
            LayerSpec("ellipse", tr("Accuracy here (CE90)"), "Polygon", ("ce90:double",), styles.style_ellipse),
            LayerSpec("footprint", tr("What the camera sees"), "Polygon", ("frame:integer",), styles.style_footprint),
            LayerSpec("track", tr("Track"), "MultiLineString", ("piece:integer",), styles.style_track),
            LayerSpec("area", tr("Area to cover"), "Polygon", (), styles.style_area),
            LayerSpec("gaps", tr("Not seen yet"), "MultiPolygon", (), styles.style_gaps),
        ),
    )  # fmt: skip


def pose_features(pose: dict) -> dict[str, list[dict]]:
    """Return a ``pose`` event by layers; one without a place on the map empties what hangs on it."""
    found: dict[str, list[dict]] = {"drone": [], "footprint": [], "ellipse": []}
    at = pose.get("drone") or pose.get("centre")
    if at:
        keys = ("heading_deg", "altitude_m", "speed_m_s", "battery_percent", "mode", "time_utc")
        found["drone"] = [_feature("Point", at, **{k: pose.get(k) for k in keys})]
    if pose.get("footprint"):
        ring = pose["footprint"]
        found["footprint"] = [_feature("Polygon", [[*ring, ring[0]]], frame=pose.get("frame"))]
    ellipse, centre = pose.get("ellipse"), pose.get("centre")
    if ellipse and centre:
        found["ellipse"] = [_feature("Polygon", [ellipse_ring(centre, ellipse)], ce90=ellipse.get("ce90"))]
    return found


def ellipse_ring(centre: list[float], ellipse: dict) -> list[list[float]]:
    """Return the closed ring (degrees) about ``centre`` that holds the truth nine times of ten."""
    lon, lat = centre
    bearing = math.radians(float(ellipse.get("bearing_deg") or 0.0))
    major, minor = (CE90_OF_SIGMA * float(ellipse[k]) for k in ("major", "minor"))
    ring = []
    for k in range(_RING + 1):
        turn = 2.0 * math.pi * k / _RING
        along, across = major * math.cos(turn), minor * math.sin(turn)
        east = along * math.sin(bearing) + across * math.cos(bearing)
        north = along * math.cos(bearing) - across * math.sin(bearing)
        ring.append(
            [lon + east / (_METRES_A_DEGREE * max(math.cos(math.radians(lat)), 1e-6)), lat + north / _METRES_A_DEGREE]
        )
    return ring


def area_features(live: dict) -> list[dict]:
    """Return the outline that is to be covered, of a ``live`` event."""
    ring = live.get("area")
    return [_feature("Polygon", [[*ring, ring[0]]])] if ring else []


def gap_features(coverage: dict) -> list[dict]:
    """Return what of the area nobody has seen, of ``coverage.geojson``."""
    return [f for f in coverage.get("features", []) if f["properties"].get("kind") == "gaps" and f.get("geometry")]


def find_features(finds: dict) -> list[dict]:
    """Return the finds that have a place."""
    found = []
    for feature in finds.get("features", []):
        if not feature.get("geometry"):
            continue
        properties = {**feature["properties"], "id": feature["properties"].get("id", feature.get("id"))}
        found.append({"type": "Feature", "geometry": feature["geometry"], "properties": properties})
    return found


def _feature(kind: str, coordinates: list, **properties: object) -> dict:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}
