"""What must not be uploaded: rules on a mission, with what is known of the vehicle; pure, nothing is asked here.

A rule that is broken is a sentence that says what to do. What cannot be checked is a warning, never silence.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import shapely
from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.mission import Autopilot, FenceCircle, FencePolygon, Home, Mission, MissionItem
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.mavlink import dialect as cmd
from photomap_gis.mission_planner.mavlink.state import distance_m

_TOUCH_M = 0.05  # a leg may run along a fence's edge, as far as its rounding to 1e-7 degrees goes
_FENCE_ALTITUDE, _FENCE_CIRCLE, _FENCE_POLYGON = 1, 2, 4  # bits of ArduPilot's FENCE_TYPE
_MOST_ITEMS_NAMED = 5


@dataclass(frozen=True, slots=True)
class Limits:
    """What the user allows: metres above home, metres from home, and whether the pilot takes off by hand."""

    height_m: float = 120.0
    distance_m: float = 5000.0
    takes_off_by_hand: bool = False


@dataclass(frozen=True, slots=True)
class Situation:
    """What is known of the vehicle when a mission is judged."""

    autopilot: Autopilot
    home: Home | None
    needs_takeoff: bool
    place: tuple[float, float] | None = None
    is_in_air: bool = False
    fence_polygons: tuple[FencePolygon, ...] = ()
    fence_circles: tuple[FenceCircle, ...] = ()
    fence_is_plans: bool = True
    params: dict[str, float] = field(default_factory=dict)

    @property
    def fence_is_idle(self) -> bool:
        """Whether the fence is one that the vehicle kept from another day and is known not to enforce."""
        known = "FENCE_ENABLE" in self.params
        return not self.fence_is_plans and known and not _enforces(self, _FENCE_POLYGON)


@dataclass(frozen=True, slots=True)
class Verdict:
    """Why a mission is refused (nothing: it is not), and what could not be checked."""

    refusals: tuple[str, ...]
    warnings: tuple[str, ...] = ()


def judge(mission: Mission, situation: Situation, limits: Limits) -> Verdict:
    """Judge a mission; ``situation``'s fence is the one that will hold when it is flown."""
    warnings: list[str] = []
    refusals = [*_bad_items(mission.items, situation.autopilot), *_bad_fence(mission, situation)]
    if not refusals:
        refusals += _takeoff(mission.items, situation, limits)
        refusals += _heights(mission.items, situation, limits, warnings)
        refusals += _distances(mission, situation, limits, warnings)
        outside = _outside(mission, situation)
        if situation.fence_is_idle:
            warnings += [f"{words}; it is an old one of the vehicle's, which does not enforce it" for words in outside]
        else:
            refusals += outside
        warnings += _parameters(mission, situation)
    return Verdict(tuple(refusals), tuple(warnings))


def _bad_items(items: Sequence[MissionItem], autopilot: Autopilot) -> list[str]:
    """What an autopilot would refuse in mid upload, when the old mission is half gone already."""
    found: list[str] = []
    for n, item in enumerate(items, start=1):
        placed = cmd.has_place(item.command)
        why = None
        here = item.command in cmd.TAKEOFFS | cmd.LANDINGS and math.isnan(item.x) and math.isnan(item.y)
        if placed and not here and not (abs(item.x) <= 90 and abs(item.y) <= 180):
            why = f"the place {item.x:g}, {item.y:g} is not on Earth"
        elif placed and not math.isfinite(item.z):
            why = "the altitude is not a number"
        elif placed and item.frame not in cmd.PLACE_FRAMES and item.command in cmd.LEG_ENDS:
            why = f"frame {item.frame} is none that a mission can have; use 0 (sea level), 3 (home) or 10 (terrain)"
        elif item.command == cmd.TRIGGER_DISTANCE and item.params[0] < 0:
            why = "the camera trigger distance is negative"
        elif item.command == cmd.DO_JUMP and not 1 <= item.params[0] <= len(items):
            why = f"it jumps to item {item.params[0]:g}, which does not exist"
        elif any(math.isinf(p) for p in (*item.params, item.z)):
            why = "a parameter is infinite"
        elif autopilot is Autopilot.ARDUPILOT:
            if item.command in cmd.REFUSED_BY_ARDUPILOT:
                why = f"ArduPilot does not take {cmd.REFUSED_BY_ARDUPILOT[item.command]}"
            elif item.command == cmd.WAYPOINT and math.isnan(item.params[0]):
                why = "ArduPilot does not take a hold time that is not a number; use 0"
        elif placed and item.frame in cmd.TERRAIN_FRAMES:
            why = "PX4 knows no terrain frame; plan in heights above sea level or home"
        if why:
            found.append(f"item {n}: {why}")
    return _few(found)


def _bad_fence(mission: Mission, situation: Situation) -> list[str]:
    found = [
        f"fence polygon {n}: {len(polygon.vertices)} vertices are too few, three are needed"
        for n, polygon in enumerate(mission.fence_polygons, start=1)
        if len(polygon.vertices) < 3
    ]
    found += [
        f"fence circle {n}: a radius of {circle.radius_m:g} m is none"
        for n, circle in enumerate(mission.fence_circles, start=1)
        if not (math.isfinite(circle.radius_m) and circle.radius_m > 0)
    ]
    return _few(found)


def _takeoff(items: Sequence[MissionItem], situation: Situation, limits: Limits) -> list[str]:
    if not situation.needs_takeoff or limits.takes_off_by_hand:
        return []
    for item in items:
        if item.command in cmd.TAKEOFFS:
            return []
        if item.command in cmd.LEG_ENDS:
            return [
                "the vehicle stands on the ground and the mission does not begin with a take-off: add one, or give "
                "--hand-launch if the pilot takes off by hand"
            ]
    return []


def _heights(items: Sequence[MissionItem], situation: Situation, limits: Limits, warnings: list[str]) -> list[str]:
    most_m, whose = limits.height_m, "--max-height"
    fence_m = situation.params.get("FENCE_ALT_MAX")
    if fence_m is not None and _enforces(situation, _FENCE_ALTITUDE) and fence_m < most_m:
        most_m, whose = fence_m, "the vehicle's FENCE_ALT_MAX"
    home_alt_m = situation.home.alt_amsl_m if situation.home else None
    found: list[str] = []
    unchecked = False
    for n, item in enumerate(items, start=1):
        if item.command not in cmd.LEG_ENDS or item.command in cmd.LANDINGS:
            continue
        height_m = item.z
        if item.frame in cmd.ABSOLUTE_FRAMES:
            if home_alt_m is None:
                unchecked = True
                continue
            height_m = item.z - home_alt_m
        if height_m > most_m + 0.01:
            found.append(f"item {n}: {height_m:.0f} m is above the limit of {most_m:g} m ({whose})")
    if unchecked:
        warnings.append("heights above sea level were not checked: the altitude of home is not known")
    return _few(found)


def _distances(mission: Mission, situation: Situation, limits: Limits, warnings: list[str]) -> list[str]:
    home = situation.home
    if home is None:
        if mission.items:
            warnings.append("the distance from home was not checked: home is not known (has the vehicle a GPS fix?)")
        return []
    most_m, whose = limits.distance_m, "--max-distance"
    fence_m = situation.params.get("FENCE_RADIUS")
    if fence_m is not None and _enforces(situation, _FENCE_CIRCLE) and fence_m < most_m:
        most_m, whose = fence_m, "the vehicle's FENCE_RADIUS"
    found: list[str] = []
    for n, item in enumerate(mission.items, start=1):
        if not _is_placed_leg(item):
            continue
        away_m = distance_m(home.lat_deg, home.lon_deg, item.x, item.y)
        if away_m > most_m:
            found.append(f"item {n}: {away_m:.0f} m from home is beyond the limit of {most_m:g} m ({whose})")
    return _few(found)


def _outside(mission: Mission, situation: Situation) -> list[str]:
    """Legs that leave the fence; ArduPilot wants the inside of every inclusion, PX4 of any."""
    if not (situation.fence_polygons or situation.fence_circles):
        return []
    path = _path(mission.items, situation.home)
    if situation.is_in_air and situation.place is not None:
        path = [(0, situation.place), *path]
    if not path:
        return []
    frame = LocalFrame.about(*path[0][1])
    inside, outside = _zones(frame, situation)
    allowed = _allowed(inside, situation.autopilot)
    found: list[str] = []
    xy = frame.to_xy([place for _, place in path])
    for at, (n, _) in enumerate(path):
        leg = LineString(xy[at - 1 : at + 1]) if at else Point(xy[0])
        name = f"the way to item {n}" if n > 0 else ("the vehicle" if n == 0 else "the way home")
        if n == -1 and at == 0:
            name = "home"
        if allowed is not None and not allowed.covers(leg):
            found.append(f"{name} is not all inside the fence")
        elif any(zone.intersects(leg) for zone in outside):
            found.append(f"{name} enters a zone that the fence excludes")
    return _few(found)


def _path(items: Sequence[MissionItem], home: Home | None) -> list[tuple[int, tuple[float, float]]]:
    """Places in flying order with their item's number, -1 for home at the start and where the mission returns."""
    at_home = [(-1, (home.lat_deg, home.lon_deg))] if home is not None else []
    path = list(at_home) if any(i.command in cmd.TAKEOFFS for i in items) else []
    for n, item in enumerate(items, start=1):
        if _is_placed_leg(item):
            path.append((n, (item.x, item.y)))
        elif item.command == cmd.RETURN_TO_LAUNCH:
            path += at_home
    return path


def _zones(frame: LocalFrame, situation: Situation) -> tuple[list[BaseGeometry], list[BaseGeometry]]:
    inside: list[BaseGeometry] = []
    outside: list[BaseGeometry] = []
    for polygon in situation.fence_polygons:
        if len(polygon.vertices) < 3:
            continue
        zone = shapely.make_valid(Polygon(frame.to_xy(polygon.vertices)))
        (inside if polygon.inclusion else outside).append(zone)
    for circle in situation.fence_circles:
        zone = Point(frame.to_xy([(circle.lat_deg, circle.lon_deg)])[0]).buffer(circle.radius_m, quad_segs=64)
        (inside if circle.inclusion else outside).append(zone)
    return [zone.buffer(_TOUCH_M) for zone in inside], [zone.buffer(-_TOUCH_M) for zone in outside]


def _allowed(inside: list[BaseGeometry], autopilot: Autopilot) -> BaseGeometry | None:
    if not inside:
        return None
    if autopilot is Autopilot.PX4:
        return shapely.union_all(inside)
    allowed = inside[0]
    for zone in inside[1:]:
        allowed = allowed.intersection(zone)
    return allowed


def _parameters(mission: Mission, situation: Situation) -> list[str]:
    enabled = situation.params.get("FENCE_ENABLE")
    if (mission.fence_polygons or mission.fence_circles) and enabled == 0:
        return ["the vehicle keeps the fence but does not enforce it: FENCE_ENABLE is 0"]
    return []


def _enforces(situation: Situation, bit: int) -> bool:
    return bool(situation.params.get("FENCE_ENABLE")) and bool(int(situation.params.get("FENCE_TYPE", 0)) & bit)


def _is_placed_leg(item: MissionItem) -> bool:
    return item.command in cmd.LEG_ENDS and math.isfinite(item.x + item.y) and (item.x != 0 or item.y != 0)


def _few(found: list[str]) -> list[str]:
    if len(found) <= _MOST_ITEMS_NAMED:
        return found
    return [*found[:_MOST_ITEMS_NAMED], f"and {len(found) - _MOST_ITEMS_NAMED} more like these"]


def first_survey_item(items: Sequence[MissionItem]) -> int | None:
    """Return the number (from 1) of the item where the survey begins: the waypoint at which the camera starts.

    Going there first and starting the camera then is what the plan meant; the camera command alone would take pictures
    on the way. Without a camera it is the first waypoint after take-off.
    """
    starts = line_starts(items)
    if starts:
        return starts[0]
    return next((n for n, i in enumerate(items, start=1) if i.command == cmd.WAYPOINT and _is_placed_leg(i)), None)


def line_starts(items: Sequence[MissionItem]) -> tuple[int, ...]:
    """Return the numbers of the waypoints at which the camera starts; before the first one, of the camera's command."""
    starts: list[int] = []
    waypoint: int | None = None
    for n, item in enumerate(items, start=1):
        if item.command in cmd.LEG_ENDS:
            waypoint = n if item.command not in cmd.TAKEOFFS else None
        elif cmd.starts_camera(item.command, item.params):
            start = waypoint or n
            if not starts or starts[-1] != start:
                starts.append(start)
    return tuple(starts)


def nearest_start(items: Sequence[MissionItem], lat_deg: float, lon_deg: float) -> int | None:
    """Return the number of the line start nearest to a place, of the nearest waypoint where no line starts."""
    numbers = [n for n in line_starts(items) if _is_placed_leg(items[n - 1])] or [
        n for n, i in enumerate(items, start=1) if i.command == cmd.WAYPOINT and _is_placed_leg(i)
    ]
    return min(numbers, key=lambda n: distance_m(lat_deg, lon_deg, items[n - 1].x, items[n - 1].y), default=None)
