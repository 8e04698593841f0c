"""The plan on the map: which features of the planner's drawing go to which layer."""

from __future__ import annotations

from ..overlay import Features, LayerSpec, Overlay
from ..translation import tr
from . import styles

_SORTIE = ("sortie:integer",)
_KINDS = {
    "waypoint": "waypoints",
    "path": "path",
    "lane": "lanes",
    "uncovered": "uncovered",
    "avoid": "avoid",
    "area": "area",
    "footprint": "footprints",
    "covered": "covered",
}
"""The drawing's kinds and our layers."""


def plan_overlay() -> Overlay:
    """Return the layers of the flight that is being planned."""
    return Overlay(
        tr("photomap flight plan"),
        (
            LayerSpec("places", tr("Take-off"), "Point", ("kind:string(20)", "words:string(80)"), styles.style_places),
            LayerSpec(
                "waypoints",
                tr("Waypoints"),
                "Point",
                ("sortie:integer", "seq:integer", "role:string(20)", "alt_m:double", "speed_m_s:double"),
                styles.style_waypoints,
            ),
            LayerSpec(
                "path",
                tr("Flight path"),
                "MultiLineString",
                (*_SORTIE, "photos:integer", "length_m:double", "duration_s:double"),
                styles.style_path,
            ),
            LayerSpec("lanes", tr("Camera on"), "MultiLineString", (*_SORTIE, "lane:integer"), styles.style_lanes),
            LayerSpec("uncovered", tr("Not sure to be seen"), "Polygon", (), styles.style_uncovered),
            LayerSpec("avoid", tr("No-fly areas"), "Polygon", (), styles.style_avoid),
            LayerSpec("area", tr("Area"), "Polygon", (), styles.style_area),
            LayerSpec(
                "footprints", tr("Photo footprints"), "Polygon", (*_SORTIE, "photo:integer"), styles.style_footprints
            ),
            LayerSpec("covered", tr("Sure to be seen"), "Polygon", (), styles.style_covered),
        ),
    )


def stored_overlay() -> Overlay:
    """Return the layers of the mission that a vehicle holds, and of the vehicle itself."""
    return Overlay(
        tr("photomap vehicle"),
        (
            LayerSpec("vehicle", tr("Vehicle"), "Point", ("kind:string(20)", "words:string(80)"), styles.style_places),
            LayerSpec(
                "items",
                tr("Stored items"),
                "Point",
                ("seq:integer", "command:integer", "alt_m:double"),
                styles.style_stored_items,
            ),
            LayerSpec("route", tr("Stored route"), "MultiLineString", (), styles.style_stored),
            LayerSpec("fence", tr("Stored fence"), "Polygon", ("inclusion:integer",), styles.style_fence),
        ),
    )


def by_layer(drawing: dict) -> dict[str, Features]:
    """Return the features of a planner's drawing by the keys of ``plan_overlay``, every key present."""
    found: dict[str, list] = {key: [] for key in _KINDS.values()}
    for feature in drawing.get("features", []):
        key = _KINDS.get(feature["properties"].get("kind"))
        if key is not None:
            found[key].append(feature)
    return found


def place_feature(kind: str, lat_lon: tuple[float, float], words: str = "") -> dict:
    """Return a place of ``style_places``."""
    return {
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": [lat_lon[1], lat_lon[0]]},
        "properties": {"kind": kind, "words": words},
    }
