"""Lanes in their order become flights: each on one battery, from take-off to return.

Where to part is found by dynamic programming over the lanes in order: the flights together are the shortest that the
endurance allows. Lanes that are long for one battery may be parted within.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
import shapely.ops
from shapely.geometry import LineString

from photomap_gis.core.errors import UsageError
from photomap_gis.core.plan import CameraTrigger, Sortie, Waypoint, WaypointRole
from photomap_gis.mission_planner.flight_time import FlightModel
from photomap_gis.mission_planner.free_space import FreeSpace
from photomap_gis.mission_planner.lanes import Lane
from photomap_gis.mission_planner.local_frame import LocalFrame

FloatArray = npt.NDArray[np.float64]

_PARTS_A_SORTIE = 12
"""A lane may be parted at this share of a battery's range."""


@dataclass(frozen=True, slots=True)
class FlightStyle:
    """How sorties are flown: heights in metres above home, the camera's trigger, what is flown about a lane."""

    height_m: float
    transit_height_m: float
    trigger: CameraTrigger
    step_m: float
    overshoot_m: float = 0.0
    lead_in_m: float = 0.0
    trigger_in_turns: bool = False
    nose_deg: float | None = None
    lands: bool = False
    endurance_s: float | None = None


@dataclass(frozen=True, slots=True)
class _Point:
    xy: FloatArray
    role: WaypointRole
    high: bool = False
    trigger: CameraTrigger | None = None
    nose_deg: float | None = None


def split(
    lanes: Sequence[Lane], home: FloatArray, free: FreeSpace, model: FlightModel, style: FlightStyle
) -> list[list[Lane]]:
    """Return the lanes of each sortie in order. Raises ``UsageError`` where one battery does not reach a lane."""
    if style.endurance_s is None:
        return [list(lanes)] if lanes else []
    longest = max(style.endurance_s * model.speed_m_s / _PARTS_A_SORTIE, 2.0 * style.step_m)
    parts = [(i, part) for i, lane in enumerate(lanes) for part in _parts(lane, longest)]
    resumed = 2.0 * style.step_m  # flown again where a lane goes on in another sortie
    count = len(parts)
    out = [transit_s(home, p.xy[0], free, model) for _, p in parts]
    back = [transit_s(home, p.xy[-1], free, model) for _, p in parts]
    fixed = model.vertical_s(style.transit_height_m, style.transit_height_m)
    again = (
        2.0
        * resumed
        / float(min(model.ground_speed(np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]), survey=True)))
    )
    fixed += again if len(parts) > len(lanes) else 0.0
    own = [lane_s(p, model, style) for _, p in parts]
    hop = [0.0] + [
        0.0 if parts[k][0] == parts[k - 1][0] else transit_s(parts[k - 1][1].xy[-1], parts[k][1].xy[0], free, model)
        for k in range(1, count)
    ]
    best, since = [0.0] + [math.inf] * count, [0] * (count + 1)
    for end in range(1, count + 1):
        flown = 0.0
        for start in range(end - 1, -1, -1):
            flown += own[start] + (hop[start + 1] if start + 1 < end else 0.0)
            total = fixed + out[start] + flown + back[end - 1]
            if total > style.endurance_s:
                if flown > style.endurance_s:
                    break
                continue
            if best[start] + total < best[end]:
                best[end], since[end] = best[start] + total, start
    if math.isinf(best[-1]):
        need = max(fixed + o + w + b for o, w, b in zip(out, own, back, strict=True))
        raise UsageError(
            f"one battery of {style.endurance_s / 60:.0f} min does not reach all of the area and back: the farthest "
            f"part takes {need / 60:.0f} min; move --home nearer, or raise --endurance-min or --speed"
        )
    cuts, end = [], count
    while end > 0:
        cuts.append((since[end], end))
        end = since[end]
    return [_joined(parts[a:b], lanes, resumed) for a, b in reversed(cuts)]


def transit_s(a: FloatArray, b: FloatArray, free: FreeSpace, model: FlightModel) -> float:
    """Return the seconds from rest to rest by the free way; infinite where there is none."""
    way = free.path(a, b)
    return math.inf if way is None else model.path_s(way)


def lane_s(lane: Lane, model: FlightModel, style: FlightStyle) -> float:
    """Return the seconds with the camera on."""
    if lane.spot:
        return model.hover_s
    if style.trigger.hover:
        xy = lane.shots(style.step_m)[0]
        return sum(model.path_s(xy[k : k + 2]) for k in range(len(xy) - 1)) + model.hover_s * len(xy)
    return model.path_s(lane.xy, np.ones(len(lane.xy) - 1, bool))


def fly(
    lanes: Sequence[Lane], home: FloatArray, frame: LocalFrame, free: FreeSpace, model: FlightModel, style: FlightStyle
) -> Sortie:
    """Return the sortie over lanes in their order, from take-off at home and back round every no-fly zone."""
    points = [_Point(home, WaypointRole.TAKEOFF, high=True)]
    climbs = style.transit_height_m > style.height_m
    for k, lane in enumerate(lanes):
        _fly_to(points, _lane_points(lane, free, style), free, high=k == 0, climbs=climbs)
    last = points[-1].xy
    way = _way(free, last, home)
    if climbs:
        points.append(_Point(last, WaypointRole.TRANSIT, high=True))
    points += [_Point(p, WaypointRole.TRANSIT, high=True) for p in way[1:-1]]
    points.append(_Point(home, WaypointRole.RETURN, high=True))
    xy = np.array([p.xy for p in points])
    places = frame.to_lat_lon(xy)
    speed = _speeds(points, xy, model)
    noses = [p.nose_deg if style.nose_deg is None else style.nose_deg for p in points]
    high, low = round(style.transit_height_m, 2), round(style.height_m, 2)
    waypoints = [
        Waypoint(
            round(float(lat), 9), round(float(lon), 9), high if p.high else low, p.role,
            p.trigger, speed_m_s=speed[i], heading_deg=noses[i], gimbal_pitch_deg=-90.0 if i == 0 else None,
        )
        for i, (p, (lat, lon)) in enumerate(zip(points, places, strict=True))
    ]  # fmt: skip
    if style.lands:
        waypoints.append(Waypoint(waypoints[0].lat_deg, waypoints[0].lon_deg, 0.0, WaypointRole.LAND))
    on = np.array([p.trigger is not None and not p.trigger.hover for p in points[:-1]])
    stops = sum(p.trigger is not None and p.trigger.hover for p in points)
    photos = sum(len(lane.shots(style.step_m)[0]) for lane in lanes)
    return Sortie(
        tuple(waypoints), photos, float(np.hypot(*np.diff(xy, axis=0).T).sum()),
        _flight_s(points, xy, on, model) + stops * model.hover_s
        + model.vertical_s(style.transit_height_m, style.transit_height_m),
    )  # fmt: skip


def _flight_s(points: Sequence[_Point], xy: FloatArray, on: npt.NDArray[np.bool_], model: FlightModel) -> float:
    """A vehicle stands still where it hovers for a picture; else it flies through."""
    stops = [0, *(i for i, p in enumerate(points) if p.trigger is not None and p.trigger.hover), len(points) - 1]
    return sum(model.path_s(xy[a : b + 1], on[a:b]) for a, b in itertools.pairwise(stops) if b > a)


def _speeds(points: Sequence[_Point], xy: FloatArray, model: FlightModel) -> list[float | None]:
    """What each leg is commanded to over the ground, where it changes."""
    found: list[float | None] = []
    for i, p in enumerate(points):
        leg = xy[i + 1] - xy[i] if i + 1 < len(points) else np.zeros(2)
        length = float(np.hypot(*leg))
        if length < 1e-6:
            found.append(found[-1] if found else None)
            continue
        on = p.trigger is not None and not p.trigger.hover
        found.append(round(float(model.ground_speed(leg / length, survey=on)), 2))
    return found


def _lane_points(lane: Lane, free: FreeSpace, style: FlightStyle) -> list[_Point]:
    nose = style.nose_deg
    if nose is None and lane.nose_rad is not None:
        nose = math.degrees(lane.nose_rad) % 360.0
    if lane.spot:
        return [_Point(lane.xy[0], WaypointRole.SURVEY, trigger=CameraTrigger(hover=True), nose_deg=nose)]
    if style.trigger.hover:
        return [
            _Point(p, WaypointRole.SURVEY, trigger=style.trigger, nose_deg=nose) for p in lane.shots(style.step_m)[0]
        ]
    points = [_Point(p, WaypointRole.SURVEY, trigger=style.trigger, nose_deg=nose) for p in lane.xy]
    after = style.trigger if style.trigger_in_turns else None
    points[-1] = _Point(lane.xy[-1], WaypointRole.SURVEY, trigger=after, nose_deg=nose)
    for extra, role, inner, tip in (
        (style.lead_in_m, WaypointRole.LEAD_IN, lane.xy[1], lane.xy[0]),
        (style.overshoot_m, WaypointRole.TURN, lane.xy[-2], lane.xy[-1]),
    ):
        along = tip - inner
        place = tip + along / max(float(np.hypot(*along)), 1e-9) * extra
        if extra <= 0.0 or not free.sees(tip, place)[0]:  # where a zone is near there is no room for it
            continue
        point = _Point(place, role, trigger=after if role is WaypointRole.TURN else None, nose_deg=nose)
        points = [point, *points] if role is WaypointRole.LEAD_IN else [*points, point]
    return points


def _fly_to(points: list[_Point], lane: list[_Point], free: FreeSpace, *, high: bool, climbs: bool) -> None:
    """Append the way to a lane and the lane; the first one is reached at the transit height where that is higher."""
    role = WaypointRole.TRANSIT if high else WaypointRole.TURN
    trigger = None if high else points[-1].trigger
    kept = trigger if trigger is not None and not trigger.hover else None
    way = _way(free, points[-1].xy, lane[0].xy)
    points += [_Point(p, role, high=high, trigger=kept) for p in way[1:-1]]
    if high and climbs:
        points.append(_Point(lane[0].xy, WaypointRole.TRANSIT, high=True))
    points += lane


def _way(free: FreeSpace, a: FloatArray, b: FloatArray) -> FloatArray:
    way = free.path(a, b)
    if way is None:
        raise UsageError("no way leads round the no-fly zones to a part of the area: this is a fault, please report it")
    return way


def _parts(lane: Lane, longest_m: float) -> list[Lane]:
    if lane.spot or lane.length_m <= longest_m:
        return [lane]
    line, count = LineString(lane.xy), math.ceil(lane.length_m / longest_m)
    cuts = np.linspace(0.0, line.length, count + 1)
    return [
        Lane(shapely.get_coordinates(shapely.ops.substring(line, a, b)), nose_rad=lane.nose_rad)
        for a, b in itertools.pairwise(cuts)
    ]


def _joined(parts: Sequence[tuple[int, Lane]], lanes: Sequence[Lane], resumed_m: float) -> list[Lane]:
    """Put the parts of one lane that are flown in one go together, a little longer where the lane was parted."""
    groups: dict[int, list[Lane]] = {}
    for i, part in parts:
        groups.setdefault(i, []).append(part)
    joined = []
    for i, group in groups.items():
        lane, line = lanes[i], LineString(lanes[i].xy)
        flown = sum(part.length_m for part in group)
        if lane.spot or flown > line.length - 1e-6:
            joined.append(lane)
            continue
        start = line.project(shapely.Point(group[0].xy[0]))
        cut = shapely.ops.substring(line, max(0.0, start - resumed_m), min(line.length, start + flown + resumed_m))
        joined.append(Lane(shapely.get_coordinates(cut), nose_rad=lane.nose_rad))
    return joined
