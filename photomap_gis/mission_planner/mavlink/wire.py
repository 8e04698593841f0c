"""A mission as the items that go over the wire, and back.

A ``WireItem`` is one MISSION_ITEM_INT without its number: latitude and longitude as degrees x 1e7, *rounded*. An
autopilot keeps three lists of them (``Kind``). ArduPilot's mission begins with home as item 0, PX4's does not.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

from photomap_gis.core.errors import DataError
from photomap_gis.core.mission import (
    Autopilot,
    FenceCircle,
    FencePolygon,
    Home,
    Mission,
    MissionItem,
    RallyPoint,
)
from photomap_gis.mission_planner.mavlink import dialect as cmd

_DEG_TO_WIRE = 1e7


class Kind(IntEnum):
    """The three lists of an autopilot, as ``MAV_MISSION_TYPE`` numbers them."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


@dataclass(frozen=True, slots=True)
class WireItem:
    """One item of a list. ``x`` and ``y`` are degrees x 1e7 where the command has a place, else plain numbers.

    ``from_float`` says that it was read as MISSION_ITEM, whose 32-bit degrees are off by up to a metre.
    """

    command: int
    frame: int
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    x: int = 0
    y: int = 0
    z: float = 0.0
    autocontinue: bool = True
    from_float: bool = False


Lists = Mapping[Kind, tuple[WireItem, ...]]
"""What an autopilot holds; ArduPilot's mission with its home item."""


def to_wire(degrees: float) -> int:
    """Return degrees x 1e7, rounded.

    >>> to_wire(51.50000005), to_wire(-0.00000009)
    (515000000, -1)
    """
    return round(degrees * _DEG_TO_WIRE)


def to_degrees(x: int) -> float:
    """Return the degrees of a latitude or longitude on the wire."""
    return x / _DEG_TO_WIRE


def as_float32(value: float) -> float:
    """Return a number as it arrives after a MAVLink float."""
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        return math.copysign(math.inf, value)


def lists_of(mission: Mission, autopilot: Autopilot, home: Home | None = None) -> dict[Kind, tuple[WireItem, ...]]:
    """Return the lists to upload; a kind of which the mission has nothing is left out: the vehicle keeps its own.

    ``home`` fills ArduPilot's item 0, a placeholder that the vehicle replaces by its own.
    """
    lists: dict[Kind, tuple[WireItem, ...]] = {}
    if mission.items:
        known = home or mission.home
        items = tuple(_wire_item(item, autopilot, known) for item in mission.items)
        lists[Kind.MISSION] = (_home_item(known), *items) if _has_home(autopilot) else items
    fence = [*_polygon_items(mission.fence_polygons), *_circle_items(mission.fence_circles)]
    if fence:
        lists[Kind.FENCE] = tuple(fence)
    if mission.rally:
        lists[Kind.RALLY] = tuple(
            WireItem(cmd.RALLY_POINT, cmd.FRAME_RELATIVE, x=to_wire(p.lat_deg), y=to_wire(p.lon_deg), z=p.alt_m)
            for p in mission.rally
        )
    return lists


def kinds_of(mission: Mission) -> frozenset[Kind]:
    """Return the lists of which a mission has anything."""
    has_fence = bool(mission.fence_polygons or mission.fence_circles)
    has = {Kind.MISSION: bool(mission.items), Kind.FENCE: has_fence, Kind.RALLY: bool(mission.rally)}
    return frozenset(kind for kind, is_there in has.items() if is_there)


def mission_of(lists: Lists, autopilot: Autopilot) -> tuple[Mission, tuple[str, ...]]:
    """Return what an autopilot holds as a mission, and warnings about what a mission cannot say."""
    warnings: list[str] = []
    items, home = without_home(lists.get(Kind.MISSION, ()), autopilot)
    polygons, circles = _fence_of(lists.get(Kind.FENCE, ()), warnings)
    rally = tuple(RallyPoint(to_degrees(i.x), to_degrees(i.y), i.z) for i in lists.get(Kind.RALLY, ()))
    mission = Mission(
        items=tuple(_mission_item(i, autopilot) for i in items),
        fence_polygons=polygons,
        fence_circles=circles,
        rally=rally,
        home=home,
        autopilot=autopilot,
    )
    return mission, tuple(warnings)


def without_home(items: Sequence[WireItem], autopilot: Autopilot) -> tuple[tuple[WireItem, ...], Home | None]:
    """Return a mission list's own items, and the home that ArduPilot keeps before them (None: not set)."""
    if not _has_home(autopilot) or not items:
        return tuple(items), None
    first = items[0]
    known = first.x != 0 or first.y != 0
    home = Home(to_degrees(first.x), to_degrees(first.y), first.z) if known else None
    return tuple(items[1:]), home


def first_seq(autopilot: Autopilot) -> int:
    """Return the number on the wire of a mission's first own item."""
    return 1 if _has_home(autopilot) else 0


def _has_home(autopilot: Autopilot) -> bool:
    return autopilot is Autopilot.ARDUPILOT


def _home_item(home: Home | None) -> WireItem:
    if home is None:
        return WireItem(cmd.WAYPOINT, cmd.FRAME_GLOBAL)
    return WireItem(
        cmd.WAYPOINT,
        cmd.FRAME_GLOBAL,
        x=to_wire(home.lat_deg),
        y=to_wire(home.lon_deg),
        z=home.alt_amsl_m or 0.0,
    )


def _wire_item(item: MissionItem, autopilot: Autopilot, home: Home | None) -> WireItem:
    placed = cmd.has_place(item.command)
    if placed and (math.isnan(item.x) or math.isnan(item.y)):
        item = _placed_here(item, autopilot, home)
    if item.command == cmd.DO_JUMP:
        item = replace(item, params=_jump(item.params, first_seq(autopilot) - 1))
    if autopilot is Autopilot.PX4 and item.command in cmd.PX4_WITHOUT_PLACE:
        return WireItem(item.command, cmd.FRAME_MISSION, item.params, autocontinue=item.autocontinue)
    x, y, z = (0.0 if math.isnan(v) and not placed else v for v in (item.x, item.y, item.z))
    wire = WireItem(
        command=item.command,
        frame=item.frame if placed else cmd.FRAME_MISSION,
        params=item.params,
        x=to_wire(x) if placed else round(x),
        y=to_wire(y) if placed else round(y),
        z=z,
        autocontinue=item.autocontinue,
    )
    return _without_nan(wire) if autopilot is Autopilot.ARDUPILOT else wire


def _placed_here(item: MissionItem, autopilot: Autopilot, home: Home | None) -> MissionItem:
    """Give a take-off or landing "where the vehicle is" its place: 0, 0 for ArduPilot, home for PX4."""
    if item.command in cmd.TAKEOFFS | cmd.LANDINGS:
        if autopilot is Autopilot.ARDUPILOT:
            return replace(item, x=0.0, y=0.0)
        if home is not None:
            return replace(item, x=home.lat_deg, y=home.lon_deg)
    raise DataError(f"command {item.command}: its place is not known; give it a latitude and longitude")


def _without_nan(item: WireItem) -> WireItem:
    # ArduPilot refuses a NaN where it has no meaning to it, and a refused item ends the whole upload half done.
    # Param1 of a waypoint and the altitude stay: rules.py refuses them, since zero would be another flight.
    keep = {3} if item.command in cmd.NAN_YAW_IN_ARDUPILOT else set()
    if item.command == cmd.WAYPOINT:
        keep.add(0)
    params = [0.0 if math.isnan(p) and n not in keep else p for n, p in enumerate(item.params)]
    return replace(item, params=(params[0], params[1], params[2], params[3]))


def _jump(params: tuple[float, float, float, float], change: int) -> tuple[float, float, float, float]:
    """A jump's target counts from 1 for the first item, on the wire from that item's number there."""
    return (params[0] + change, *params[1:])


def _mission_item(item: WireItem, autopilot: Autopilot) -> MissionItem:
    placed = cmd.has_place(item.command)
    params = _jump(item.params, 1 - first_seq(autopilot)) if item.command == cmd.DO_JUMP else item.params
    # PX4 answers with the _INT frames; files and people use the plain ones.
    plain = {cmd.FRAME_GLOBAL_INT: cmd.FRAME_GLOBAL, cmd.FRAME_RELATIVE_INT: cmd.FRAME_RELATIVE,
             cmd.FRAME_TERRAIN_INT: cmd.FRAME_TERRAIN}  # fmt: skip
    return MissionItem(
        command=item.command,
        frame=plain.get(item.frame, item.frame) if placed else cmd.FRAME_MISSION,
        params=params,
        x=to_degrees(item.x) if placed else float(item.x),
        y=to_degrees(item.y) if placed else float(item.y),
        z=item.z,
        autocontinue=item.autocontinue,
    )


def _polygon_items(polygons: Sequence[FencePolygon]) -> list[WireItem]:
    return [
        WireItem(
            cmd.POLYGON_INCLUSION if polygon.inclusion else cmd.POLYGON_EXCLUSION,
            cmd.FRAME_GLOBAL,
            (float(len(polygon.vertices)), 0.0, 0.0, 0.0),
            x=to_wire(lat_deg),
            y=to_wire(lon_deg),
        )
        for polygon in polygons
        for lat_deg, lon_deg in polygon.vertices
    ]


def _circle_items(circles: Sequence[FenceCircle]) -> list[WireItem]:
    return [
        WireItem(
            cmd.CIRCLE_INCLUSION if circle.inclusion else cmd.CIRCLE_EXCLUSION,
            cmd.FRAME_GLOBAL,
            (circle.radius_m, 0.0, 0.0, 0.0),
            x=to_wire(circle.lat_deg),
            y=to_wire(circle.lon_deg),
        )
        for circle in circles
    ]


def _fence_of(
    items: Sequence[WireItem], warnings: list[str]
) -> tuple[tuple[FencePolygon, ...], tuple[FenceCircle, ...]]:
    polygons: list[FencePolygon] = []
    circles: list[FenceCircle] = []
    at = 0
    while at < len(items):
        item = items[at]
        if item.command in (cmd.POLYGON_INCLUSION, cmd.POLYGON_EXCLUSION):
            count = round(item.params[0])
            run = items[at : at + max(count, 1)]
            if count < 3 or len(run) < count or any(i.command != item.command for i in run):
                warnings.append(f"fence item {at}: a polygon of {count} vertices is not whole; it is left out")
            else:
                vertices = tuple((to_degrees(i.x), to_degrees(i.y)) for i in run)
                polygons.append(FencePolygon(vertices, item.command == cmd.POLYGON_INCLUSION))
            at += len(run)
            continue
        if item.command in (cmd.CIRCLE_INCLUSION, cmd.CIRCLE_EXCLUSION):
            inclusion = item.command == cmd.CIRCLE_INCLUSION
            circles.append(FenceCircle(to_degrees(item.x), to_degrees(item.y), item.params[0], inclusion))
        else:
            warnings.append(f"fence item {at}: command {item.command} (a return point?) is left out")
        at += 1
    return tuple(polygons), tuple(circles)
