"""QGroundControl's ``.plan``: JSON with mission, fence and rally points [QGC developer guide: plan files]."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from photomap_gis.core.errors import DataError
from photomap_gis.core.mission import (
    PLACED_COMMANDS,
    Autopilot,
    FenceCircle,
    FencePolygon,
    Home,
    Mission,
    MissionItem,
    RallyPoint,
)
from photomap_gis.mission_planner.commands import Cmd
from photomap_gis.mission_planner.files.checks import MOST_ITEMS, MOST_VERTICES, checked_item, number, place, whole

_FIRMWARE = {Autopilot.ARDUPILOT: 3, Autopilot.PX4: 12}  # MAV_AUTOPILOT
_GENERIC = 0  # MAV_AUTOPILOT_GENERIC: not known
_MULTICOPTER = 2  # MAV_TYPE_QUADROTOR
_ALTITUDE_MODES = {0: 2, 5: 2, 3: 1, 6: 1, 10: 4, 11: 4}  # MAV_FRAME -> QGC's absolute 2, relative 1, terrain 4
_DEFAULT_SPEED_M_S = 5.0


def plan_document(mission: Mission) -> str:
    """Return the text of a ``.plan``; what is not known (NaN) is null."""
    speed = mission.cruise_speed_m_s or _DEFAULT_SPEED_M_S
    modes = {_ALTITUDE_MODES.get(item.frame) for item in mission.items if item.command in PLACED_COMMANDS} - {None}
    document = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2,
            "firmwareType": _FIRMWARE[mission.autopilot] if mission.autopilot else _GENERIC,
            "vehicleType": _MULTICOPTER,
            "cruiseSpeed": speed,
            "hoverSpeed": speed,
            "globalPlanAltitudeMode": modes.pop() if len(modes) == 1 else 0,
            "plannedHomePosition": _home(mission),
            "items": [_item(item, i) for i, item in enumerate(mission.items, 1)],
        },
        "geoFence": {
            "version": 2,
            "polygons": [
                {"version": 1, "inclusion": p.inclusion, "polygon": [list(v) for v in p.vertices]}
                for p in mission.fence_polygons
            ],
            "circles": [
                {
                    "version": 1,
                    "inclusion": c.inclusion,
                    "circle": {"center": [c.lat_deg, c.lon_deg], "radius": c.radius_m},
                }
                for c in mission.fence_circles
            ],
        },
        "rallyPoints": {"version": 2, "points": [[r.lat_deg, r.lon_deg, r.alt_m] for r in mission.rally]},
    }
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def _home(mission: Mission) -> list[float | None]:
    home = mission.home
    if home is not None:
        return [home.lat_deg, home.lon_deg, home.alt_amsl_m]
    # A plan needs one: QGC opens the map there.
    for item in mission.items:
        if item.command in PLACED_COMMANDS and not math.isnan(item.x + item.y):
            return [item.x, item.y, None]
    return [0.0, 0.0, None]


def _item(item: MissionItem, jump_id: int) -> dict[str, object]:
    known: dict[str, object] = {}
    if item.command in PLACED_COMMANDS and item.frame in _ALTITUDE_MODES:
        known = {"AMSLAltAboveTerrain": None, "Altitude": item.z, "AltitudeMode": _ALTITUDE_MODES[item.frame]}
    return {
        "type": "SimpleItem",
        "command": int(item.command),
        "frame": int(item.frame),
        "doJumpId": jump_id,
        "autoContinue": item.autocontinue,
        "params": [None if math.isnan(p) else p for p in (*item.params, item.x, item.y, item.z)],
        **known,
    }


def read_plan_document(text: str, name: str) -> Mission:
    """Read a ``.plan``; ``name`` is for messages. Surveys and other complex items are read as the items they hold.

    Raises ``DataError`` where the document is not a plan or holds what cannot be flown.
    """
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DataError(f"{name} is not valid JSON: {str(error)[:120]}") from error
    if not isinstance(document, dict) or document.get("fileType") != "Plan":
        raise DataError(f"{name} is not a QGroundControl plan (fileType is not 'Plan')")
    mission = _object(document.get("mission"), f"{name}: mission")
    firmware = mission.get("firmwareType")
    autopilot = next((a for a, code in _FIRMWARE.items() if code == firmware), None)
    speed = mission.get("hoverSpeed")
    polygons, circles = _read_fence(document.get("geoFence"), f"{name}: geoFence")
    return Mission(
        items=tuple(_read_items(_list(mission.get("items"), f"{name}: mission.items"), name)),
        fence_polygons=polygons,
        fence_circles=circles,
        rally=_read_rally(document.get("rallyPoints"), f"{name}: rallyPoints"),
        home=_read_home(mission.get("plannedHomePosition"), f"{name}: plannedHomePosition"),
        autopilot=autopilot,
        cruise_speed_m_s=None if speed is None else number(speed, f"{name}: hoverSpeed"),
    )


def _read_items(raw: list[Any], name: str) -> list[MissionItem]:
    """Items in order, jumps pointing at places in this order instead of at ``doJumpId``."""
    found: list[MissionItem] = []
    order: dict[int, int] = {}
    for entry in _flat(raw, name, 0):
        where = f"{name}: item {len(found) + 1}"
        if len(found) >= MOST_ITEMS:
            raise DataError(f"{name} holds more than {MOST_ITEMS} items: no vehicle takes these")
        jump_id = entry.get("doJumpId")
        found.append(checked_item(_read_item(entry, where), where))
        if isinstance(jump_id, int):
            order.setdefault(jump_id, len(found))
    return [_retarget(item, order, f"{name}: item {i}") for i, item in enumerate(found, 1)]


def _retarget(item: MissionItem, order: dict[int, int], where: str) -> MissionItem:
    if item.command != Cmd.DO_JUMP:
        return item
    target = order.get(int(item.params[0])) if math.isfinite(item.params[0]) else None
    if target is None:
        raise DataError(f"{where} jumps to item {item.params[0]:g}, which the plan does not hold")
    return replace(item, params=(float(target), *item.params[1:]))


def _flat(raw: list[Any], name: str, depth: int) -> Iterator[dict[str, Any]]:
    if depth > 4:
        raise DataError(f"{name}: complex items lie in each other too deeply")
    for entry in raw:
        item = _object(entry, f"{name}: an item")
        if item.get("type", "SimpleItem") == "SimpleItem":
            yield item
            continue
        inside = item.get("TransectStyleComplexItem", item)
        held = inside.get("Items") if isinstance(inside, dict) else None
        if not isinstance(held, list) or not held:
            raise DataError(
                f"{name} holds a complex item ({str(item.get('complexItemType'))[:40]}) without its waypoints: "
                "save it again in QGroundControl, or upload it from there"
            )
        yield from _flat(held, name, depth + 1)


def _read_item(entry: dict[str, Any], where: str) -> MissionItem:
    if "params" in entry:
        params = [number(p, f"{where}: params", nan=True) for p in _list(entry["params"], f"{where}: params")]
    else:  # the first version of the format
        place_of = _list(entry.get("coordinate"), f"{where}: coordinate")
        params = [number(entry.get(f"param{i}"), f"{where}: param{i}", nan=True) for i in range(1, 5)]
        params += [number(p, f"{where}: coordinate", nan=True) for p in place_of]
    if len(params) != 7:
        raise DataError(f"{where}: seven params are needed, not {len(params)}")
    proceeds = entry.get("autoContinue", True)
    if not isinstance(proceeds, bool):
        raise DataError(f"{where}: autoContinue must be true or false")
    return MissionItem(
        command=whole(entry.get("command"), f"{where}: command", 65535),
        frame=whole(entry.get("frame"), f"{where}: frame", 255),
        params=(params[0], params[1], params[2], params[3]),
        x=params[4],
        y=params[5],
        z=params[6],
        autocontinue=proceeds,
    )


def _read_home(raw: object, where: str) -> Home | None:
    if raw is None:
        return None
    values = [number(v, where, nan=True) for v in _list(raw, where)]
    if len(values) not in (2, 3) or math.isnan(values[0] + values[1]):
        return None
    lat, lon = place(values[0], values[1], where)
    alt = values[2] if len(values) == 3 else math.nan
    return Home(lat, lon, None if math.isnan(alt) else alt)


def _read_fence(raw: object, where: str) -> tuple[tuple[FencePolygon, ...], tuple[FenceCircle, ...]]:
    if raw is None:
        return (), ()
    fence = _object(raw, where)
    polygons, vertices_left = [], MOST_VERTICES
    for entry in _list(fence.get("polygons", []), f"{where}: polygons"):
        polygon = _object(entry, f"{where}: a polygon")
        ring = _list(polygon.get("polygon"), f"{where}: a polygon")
        vertices_left -= len(ring)
        if vertices_left < 0:
            raise DataError(f"{where} has more than {MOST_VERTICES} vertices: no vehicle takes these")
        vertices = tuple(_vertex(v, where) for v in ring)
        if len(vertices) > 1 and vertices[0] == vertices[-1]:
            vertices = vertices[:-1]
        if len(vertices) < 3:
            raise DataError(f"{where}: a polygon needs at least 3 vertices")
        polygons.append(FencePolygon(vertices, _inclusion(polygon, where)))
    circles = []
    for entry in _list(fence.get("circles", []), f"{where}: circles"):
        raw_circle = _object(entry, f"{where}: a circle")
        circle = _object(raw_circle.get("circle"), f"{where}: a circle")
        lat, lon = _vertex(circle.get("center"), where)
        radius = number(circle.get("radius"), f"{where}: radius")
        if radius <= 0:
            raise DataError(f"{where}: a circle's radius must be above 0")
        circles.append(FenceCircle(lat, lon, radius, _inclusion(raw_circle, where)))
    return tuple(polygons), tuple(circles)


def _inclusion(entry: dict[str, Any], where: str) -> bool:
    inclusion = entry.get("inclusion", True)
    if not isinstance(inclusion, bool):
        raise DataError(f"{where}: inclusion must be true or false")
    return inclusion


def _vertex(raw: object, where: str) -> tuple[float, float]:
    values = _list(raw, f"{where}: a vertex")
    if len(values) not in (2, 3):
        raise DataError(f"{where}: a vertex is a latitude and a longitude")
    return place(number(values[0], where), number(values[1], where), where)


def _read_rally(raw: object, where: str) -> tuple[RallyPoint, ...]:
    if raw is None:
        return ()
    points = []
    for entry in _list(_object(raw, where).get("points", []), where):
        values = [number(v, where) for v in _list(entry, where)]
        if len(values) != 3:
            raise DataError(f"{where}: a point is a latitude, a longitude and an altitude above home")
        points.append(RallyPoint(*place(values[0], values[1], where), values[2]))
    if len(points) > MOST_ITEMS:
        raise DataError(f"{where}: more than {MOST_ITEMS} points: no vehicle takes these")
    return tuple(points)


def _object(raw: object, where: str) -> dict[str, Any]:
    if not isinstance(raw, dict):
        raise DataError(f"{where} is missing or not an object")
    return raw


def _list(raw: object, where: str) -> list[Any]:
    if not isinstance(raw, list):
        raise DataError(f"{where} is missing or not a list")
    return raw
