"""A search pattern's track as flights: round the zones, within the battery, with take-off, camera and return."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.errors import UsageError
from photomap_gis.core.plan import (
    AltitudeFrame,
    CameraTrigger,
    GeoPolygon,
    Sortie,
    SurveyPlan,
    Waypoint,
    WaypointRole,
)
from photomap_gis.mission_planner.flight_time import FlightModel
from photomap_gis.mission_planner.free_space import FreeSpace
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.patterns.shapes import Track

FloatArray = NDArray[np.float64]

_SAME_PLACE_M = 0.05
_MOST_SORTIES = 200


@dataclass(frozen=True, slots=True)
class SearchFlight:
    """How a pattern is flown. Heights are metres above the take-off place, ``zone_margin_m`` is kept from zones."""

    height_m: float
    gsd_m_per_px: float
    sweep_width_m: float
    trigger: CameraTrigger | None
    model: FlightModel
    survey_speed_m_s: float
    transit_height_m: float | None = None
    endurance_s: float | None = None
    zone_margin_m: float = 5.0
    lands: bool = False
    look_at_datum: bool = False
    """Nose and gimbal stay on the datum, as an orbit wants."""

    @property
    def safe_height_m(self) -> float:
        """The height between home and the search."""
        return max(self.height_m, self.transit_height_m or 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """A stretch with the camera on, ``(N, 2)`` metres."""

    xy: FloatArray


def search_plan(
    track: Track,
    frame: LocalFrame,
    flight: SearchFlight,
    *,
    pattern: str,
    target: BaseGeometry,
    avoid: BaseGeometry | None = None,
    home: tuple[float, float] | None = None,
) -> SurveyPlan:
    """Return the flights of a track in ``frame``, and what of ``target`` (local metres) its sweep covers.

    No leg enters a zone: legs are cut there, and ways between them go round. ``home`` is (latitude, longitude), the
    track's beginning by default. Raises ``UsageError`` where home lies in a zone, nothing is left to fly, a zone shuts
    a part off, or the battery reaches nothing.
    """
    zones = Polygon() if avoid is None else avoid
    free = FreeSpace(zones, margin_m=flight.zone_margin_m)
    pieces = [piece for leg in track.legs for piece in _clipped(leg, free)]
    if not pieces:
        raise UsageError("every leg of the pattern lies in the zones to avoid: nothing is left to fly")
    home_xy = frame.to_xy([home])[0] if home is not None else np.asarray(free.nearest(pieces[0].xy[0]))
    if not free.holds(home_xy)[0]:
        raise UsageError("the take-off place lies in a zone to avoid: choose another --home")
    flights = _split(pieces, home_xy, free, flight)
    sorties = tuple(_sortie(part, home_xy, frame, free, flight) for part in flights)
    home_lat, home_lon = frame.to_lat_lon(home_xy)[0]
    wanted = target.difference(zones)
    seen = _swept(pieces, flight.sweep_width_m)
    left = wanted.difference(seen).buffer(-0.25).buffer(0.25) if not flight.look_at_datum else Polygon()
    share = 1.0 - left.area / wanted.area if wanted.area > 0 else 1.0
    return SurveyPlan(
        area=_polygons(frame, target),
        avoid=_polygons(frame, zones),
        frame=AltitudeFrame.RELATIVE,
        sorties=sorties,
        covered_share=float(min(max(share, 0.0), 1.0)),
        uncovered=_polygons(frame, left),
        gsd_m_per_px=flight.gsd_m_per_px,
        pattern=pattern,
        home=home if home is not None else (float(home_lat), float(home_lon)),
    )


def _clipped(leg: FloatArray, free: FreeSpace) -> list[_Piece]:
    """The free stretches of a leg, step by step: a track that crosses itself must keep its order."""
    found: list[list[FloatArray]] = []
    for a, b in itertools.pairwise(leg):
        if np.hypot(*(b - a)) < 1e-9:
            continue
        for part in free.clip(LineString([a, b])):
            ends = np.asarray(part.coords)[[0, -1]]
            if (ends[1] - ends[0]) @ (b - a) < 0:
                ends = ends[::-1]
            if found and np.hypot(*(found[-1][-1] - ends[0])) < 1e-6:
                found[-1].append(ends[1])
            else:
                found.append([ends[0], ends[1]])
    return [_Piece(np.array(points)) for points in found]


def _swept(pieces: Sequence[_Piece], width_m: float) -> BaseGeometry:
    """A square swath as wide as the sweep about every place of the track."""
    swaths = [LineString(p.xy).buffer(width_m / 2 + 1e-3, cap_style="square", join_style="mitre") for p in pieces]
    return shapely.union_all(swaths)


def _split(pieces: Sequence[_Piece], home: FloatArray, free: FreeSpace, flight: SearchFlight) -> list[list[_Piece]]:
    """Fill each battery to the furthest point from which it still comes home."""
    if flight.endurance_s is None:
        return [list(pieces)]
    longest = max(flight.survey_speed_m_s * flight.endurance_s / 40.0, 5.0)
    left = [_Piece(_dense(p.xy, longest)) for p in pieces]
    found: list[list[_Piece]] = []
    while left:
        if len(found) >= _MOST_SORTIES:
            raise UsageError(f"more than {_MOST_SORTIES} sorties: use a longer --endurance-min or a smaller search")
        total = sum(len(p.xy) - 1 for p in left)
        low, high = 0, total
        while low < high:  # the most steps that one battery flies
            middle = (low + high + 1) // 2
            if _seconds(_first(left, middle)[0], home, free, flight) <= flight.endurance_s:
                low = middle
            else:
                high = middle - 1
        if low == 0:
            need = _seconds(_first(left, 1)[0], home, free, flight)
            raise UsageError(
                f"the battery does not reach the search and back: {need / 60:.1f} minutes are needed, "
                f"{flight.endurance_s / 60:.1f} are there; take off nearer (--home) or fly faster (--speed)"
            )
        now, left = _first(left, low)
        found.append(now)
    return [[_Piece(_simple(p.xy)) for p in part] for part in found]


def _first(pieces: Sequence[_Piece], steps: int) -> tuple[list[_Piece], list[_Piece]]:
    """The first so many steps, and what is left."""
    now: list[_Piece] = []
    for i, piece in enumerate(pieces):
        here = len(piece.xy) - 1
        if steps >= here:
            now.append(piece)
            steps -= here
            if steps == 0:
                return now, list(pieces[i + 1 :])
        else:
            now.append(_Piece(piece.xy[: steps + 1]))
            return now, [_Piece(piece.xy[steps:]), *pieces[i + 1 :]]
    return now, []


def _route(
    pieces: Sequence[_Piece], home: FloatArray, free: FreeSpace
) -> tuple[FloatArray, list[WaypointRole], list[bool]]:
    """The whole way from home and back: points, what each is for, and whether the camera is on from it on."""
    points, roles, camera = [home], [WaypointRole.TAKEOFF], [False]
    for i, piece in enumerate(pieces):
        way = _way(points[-1], piece.xy[0], free)
        between = WaypointRole.TRANSIT if i == 0 else WaypointRole.TURN
        for place in way[1:-1]:
            points.append(place)
            roles.append(between)
            camera.append(False)
        joined = i > 0 and np.hypot(*(points[-1] - piece.xy[0])) < _SAME_PLACE_M
        if joined:
            camera[-1] = True
        for place in piece.xy[1:] if joined else piece.xy:
            points.append(place)
            roles.append(WaypointRole.SURVEY)
            camera.append(True)
        camera[-1] = False
    for place in _way(points[-1], home, free)[1:]:
        points.append(place)
        roles.append(WaypointRole.RETURN)
        camera.append(False)
    return np.array(points), roles, camera


def _way(a: FloatArray, b: FloatArray, free: FreeSpace) -> FloatArray:
    way = free.path(a, b)
    if way is None:
        raise UsageError("the zones to avoid shut a part of the pattern off: change --avoid, --home or the pattern")
    return way


def _seconds(pieces: Sequence[_Piece], home: FloatArray, free: FreeSpace, flight: SearchFlight) -> float:
    points, _, camera = _route(pieces, home, free)
    vertical = flight.model.vertical_s(flight.safe_height_m, flight.safe_height_m)
    return flight.model.path_s(points, camera[:-1]) + vertical


def _sortie(
    pieces: Sequence[_Piece], home: FloatArray, frame: LocalFrame, free: FreeSpace, flight: SearchFlight
) -> Sortie:
    points, roles, camera = _route(pieces, home, free)
    places = frame.to_lat_lon(points)
    waypoints: list[Waypoint] = []
    for i, (place, role) in enumerate(zip(places, roles, strict=True)):
        waypoints.append(_waypoint(i, place, points[i], role, camera[i], flight))
    # Down to the search's height only above its beginning.
    if flight.safe_height_m > flight.height_m:
        start = roles.index(WaypointRole.SURVEY)
        entry = Waypoint(*_lat_lon(places[start]), flight.safe_height_m, WaypointRole.TRANSIT)
        waypoints.insert(start, entry)
        end = len(roles) - 1 - roles[::-1].index(WaypointRole.SURVEY) + 2
        waypoints.insert(end, Waypoint(*_lat_lon(places[end - 2]), flight.safe_height_m, WaypointRole.RETURN))
    if flight.lands:
        waypoints.append(Waypoint(*_lat_lon(places[0]), 0.0, WaypointRole.LAND))
    legs = np.hypot(*np.diff(points, axis=0).T)
    return Sortie(
        tuple(waypoints),
        photos=sum(_photos(p, flight) for p in pieces),
        length_m=float(legs.sum()),
        duration_s=_seconds(pieces, home, free, flight),
    )


def _waypoint(
    index: int, place: FloatArray, xy: FloatArray, role: WaypointRole, camera: bool, flight: SearchFlight
) -> Waypoint:
    survey = role is WaypointRole.SURVEY
    low = survey or role is WaypointRole.TURN
    heading = pitch = None
    if flight.look_at_datum and survey:
        heading = math.degrees(math.atan2(-xy[0], -xy[1])) % 360.0
        pitch = -math.degrees(math.atan2(flight.height_m, float(np.hypot(*xy))))
    elif index == 0:
        pitch = -90.0
    speed = flight.survey_speed_m_s if camera else flight.model.speed_m_s
    return Waypoint(
        *_lat_lon(place),
        alt_m=round(flight.height_m if low else flight.safe_height_m, 2),
        role=role,
        trigger=flight.trigger if camera else None,
        speed_m_s=speed,
        heading_deg=heading,
        gimbal_pitch_deg=None if pitch is None else round(pitch, 2),
    )


def _lat_lon(place: FloatArray) -> tuple[float, float]:
    return round(float(place[0]), 9), round(float(place[1]), 9)


def _photos(piece: _Piece, flight: SearchFlight) -> int:
    length = float(np.hypot(*np.diff(piece.xy, axis=0).T).sum())
    trigger = flight.trigger
    if trigger is None:
        return 0
    if trigger.hover:
        return len(piece.xy)
    step = trigger.distance_m or (trigger.interval_s or math.inf) * flight.survey_speed_m_s
    return int(length / step) + 1


def _dense(xy: FloatArray, longest_m: float) -> FloatArray:
    return shapely.get_coordinates(shapely.segmentize(LineString(xy), longest_m))


def _simple(xy: FloatArray) -> FloatArray:
    return shapely.get_coordinates(shapely.simplify(LineString(xy), 1e-3))


def _polygons(frame: LocalFrame, geometry: BaseGeometry) -> tuple[GeoPolygon, ...]:
    found = []
    for part in shapely.get_parts(geometry):
        if isinstance(part, Polygon) and part.area > 0:
            rings = []
            for ring in (part.exterior, *part.interiors):
                lat_lon = frame.to_lat_lon(ring.coords)
                rings.append(tuple((float(lon), float(lat)) for lat, lon in lat_lon))
            found.append(GeoPolygon(tuple(rings)))
    return tuple(found)
