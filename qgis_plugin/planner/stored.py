"""What a vehicle holds, as ``photomap download`` writes it (QGroundControl's .plan), as features. No Qt here."""

from __future__ import annotations

import json
import math
from pathlib import Path

PLACE_COMMANDS = frozenset({16, 17, 18, 19, 21, 22, 31, 82, 84, 85})
"""MAV_CMD_NAV_WAYPOINT, LOITER_*, LAND, TAKEOFF, LOITER_TO_ALT, SPLINE_WAYPOINT, VTOL_*: those that go to a place."""
MOST_BYTES = 20_000_000


class UnreadableMissionError(Exception):
    """A mission file that is none."""


def stored_features(path: Path) -> dict[str, list[dict]]:
    """Return ``items`` (points), ``route`` (one line) and ``fence`` (polygons) as GeoJSON features in WGS 84.

    Raises ``UnreadableMissionError`` where the file is no plan.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise UnreadableMissionError(f"{path} is too large for a mission")
        return _features(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise UnreadableMissionError(f"{path} cannot be read as a mission: {error}") from error


def _features(plan: dict) -> dict[str, list[dict]]:
    mission, fence = plan["mission"], plan.get("geoFence", {})
    items = [i for i in mission["items"] if i.get("type") == "SimpleItem"]
    places: list[tuple[int, int, float, float, float | None]] = []
    for number, item in enumerate(items, 1):
        lat, lon, alt = (_number(p) for p in [*item.get("params", []), *[None] * 7][4:7])
        if item.get("command") not in PLACE_COMMANDS or lat is None or lon is None:
            continue
        if (lat, lon) == (0.0, 0.0) or abs(lat) > 90 or abs(lon) > 360:
            continue  # "where it is": take-off and landing without a place
        places.append((number, int(item["command"]), lat, lon, alt))
    points = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [lon, lat]},
            "properties": {"seq": number, "command": command, "alt_m": alt},
        }
        for number, command, lat, lon, alt in places
    ]
    route = (
        [
            {
                "type": "Feature",
                "geometry": {"type": "LineString", "coordinates": [[lon, lat] for _, _, lat, lon, _ in places]},
                "properties": {},
            }
        ]
        if len(places) > 1
        else []
    )
    return {"items": points, "route": route, "fence": list(_fence(fence))}


def _fence(fence: dict):
    for polygon in fence.get("polygons", []) if isinstance(fence, dict) else []:
        ring = [[_number(p[1]), _number(p[0])] for p in polygon.get("polygon", []) if len(p) >= 2]
        if len(ring) >= 3 and all(v is not None for p in ring for v in p):
            yield {
                "type": "Feature",
                "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]},
                "properties": {"inclusion": int(bool(polygon.get("inclusion", True)))},
            }


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else None
