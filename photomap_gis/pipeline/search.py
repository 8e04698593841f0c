"""The corridor of a search: where, with which camera and pattern, becomes flights with what they cover and find."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.errors import UsageError
from photomap_gis.core.plan import AltitudeFrame, CameraTrigger, GeoPolygon, SurveyPlan
from photomap_gis.mission_planner.flight_time import FlightModel
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.optics import Optics
from photomap_gis.mission_planner.patterns import (
    Detection,
    Pattern,
    Track,
    detection,
    from_area,
    from_datum,
    from_line,
    sweep_width_m,
)
from photomap_gis.mission_planner.patterns.detection import spacing_m
from photomap_gis.mission_planner.patterns.flight import SearchFlight, search_plan
from photomap_gis.mission_planner.patterns.shapes import FROM_AREA, FROM_DATUM
from photomap_gis.mission_planner.terrain import (
    FollowSettings,
    TerrainReport,
    VerticalDatum,
    by_the_vehicles_terrain,
    follow_terrain,
    on_flat_ground,
    open_dem,
)

LonLat = tuple[float, float]

SEARCH_OVERLAP = 0.3
"""Of successive pictures in a search: every spot is looked at twice over most of the swath."""


@dataclass(frozen=True, slots=True)
class SearchPlace:
    """Where to search: a datum as (latitude, longitude), an area, or a line of (longitude, latitude)."""

    datum: tuple[float, float] | None = None
    area: tuple[GeoPolygon, ...] = ()
    line: tuple[LonLat, ...] = ()


@dataclass(frozen=True, slots=True)
class SearchRequest:
    """What is asked of a search; None where the planner decides.

    ``height_m`` is above ground; a target of ``target_m`` must span 8 pixels from there. The sweep width is the
    camera's swath unless stated, the track spacing the sweep width over ``coverage_factor`` unless stated.
    """

    pattern: Pattern
    optics: Optics
    height_m: float
    target_m: float | None = None
    radius_m: float | None = None
    track_spacing_m: float | None = None
    sweep_width_m: float | None = None
    coverage_factor: float = 1.0
    heading_deg: float | None = None
    passes: int = 1
    trigger: str = "distance"
    front_overlap: float = SEARCH_OVERLAP
    least_interval_s: float = 0.7


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The plan, and what the search is worth; ``area_searched_m2`` is what coverage factor and POD are over."""

    plan: SurveyPlan
    detection: Detection
    area_searched_m2: float


@dataclass(frozen=True, slots=True)
class TerrainRequest:
    """Where the ground is, and how to follow it; without a model only the vehicle's own terrain can be followed."""

    dem: Path | None
    settings: FollowSettings
    vertical: VerticalDatum | None = None
    frame: AltitudeFrame = AltitudeFrame.RELATIVE


def plan_search(
    place: SearchPlace,
    request: SearchRequest,
    model: FlightModel,
    *,
    avoid: Sequence[GeoPolygon] = (),
    home: tuple[float, float] | None = None,
    transit_height_m: float | None = None,
    endurance_s: float | None = None,
    lands: bool = False,
    zone_margin_m: float = 5.0,
) -> SearchResult:
    """Return the flights of a search over flat ground. Raises ``UsageError`` where the request makes no sense."""
    place, request = _with_datum(place, request)
    height = request.height_m
    width = _sweep_width(request, height) if request.sweep_width_m is None else request.sweep_width_m
    spacing = request.track_spacing_m
    if spacing is None:
        spacing = spacing_m(width, request.coverage_factor)
    frame = _frame(place)
    track, target = _track(place, request, frame, spacing)
    gsd = request.optics.gsd_m_per_px(height)
    orbits = request.pattern is Pattern.ORBIT
    trigger, speed = _camera(request, height, model)
    flight = SearchFlight(
        height_m=height,
        gsd_m_per_px=gsd,
        sweep_width_m=width,
        trigger=trigger,
        model=replace(model, most_ground_speed_m_s=min(speed, model.most_ground_speed_m_s)),
        survey_speed_m_s=speed,
        transit_height_m=transit_height_m,
        endurance_s=endurance_s,
        lands=lands,
        zone_margin_m=zone_margin_m,
        look_at_datum=orbits,
    )
    plan = search_plan(
        track, frame, flight, pattern=request.pattern.value, target=target, avoid=_local(frame, avoid), home=home
    )
    area = target.difference(_local(frame, avoid)).area
    # Even tracks over the whole: by their spacing. A sector's are dense in the middle: by length and area.
    even = request.pattern not in (Pattern.SECTOR, Pattern.PERIMETER, Pattern.ORBIT)
    found = detection(width, spacing) if even else detection(width, spacing, length_m=track.length_m, area_m2=area)
    return SearchResult(on_flat_ground(plan), found, area)


def over_terrain(plan: SurveyPlan, request: TerrainRequest) -> tuple[SurveyPlan, TerrainReport | None]:
    """Return a plan over flat ground bent to an elevation model. Raises ``DataError`` where elevations are missing."""
    if request.dem is None:
        return by_the_vehicles_terrain(plan), None
    return follow_terrain(plan, open_dem(request.dem, request.vertical), request.settings, request.frame)


def _sweep_width(request: SearchRequest, height_m: float) -> float:
    target = request.target_m if request.target_m is not None else math.inf
    return sweep_width_m(height_m, request.optics.focal_px, request.optics.width_px, target)


def _camera(request: SearchRequest, height_m: float, model: FlightModel) -> tuple[CameraTrigger | None, float]:
    """How pictures are taken, and the speed at which it can be done."""
    speed = min(model.speed_m_s, model.most_ground_speed_m_s)
    step = request.optics.footprint_m(height_m)[1] * (1.0 - request.front_overlap)
    if request.trigger == "hover":
        return CameraTrigger(hover=True), speed
    if request.least_interval_s > 0:
        speed = min(speed, step / request.least_interval_s)
    if request.trigger == "time":
        return CameraTrigger(interval_s=round(step / speed, 2)), speed
    return CameraTrigger(distance_m=round(step, 2)), speed


def _frame(place: SearchPlace) -> LocalFrame:
    if place.datum is not None:
        return LocalFrame.about(*place.datum)
    points = [p for polygon in place.area for p in polygon.rings[0]] or list(place.line)
    if not points:
        raise UsageError("a search needs a place: --datum LAT,LON, an AREA, or a line")
    # The mean on the sphere is right across the antimeridian and at the poles.
    lon, lat = np.radians(np.array(points)).T
    xyz = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]).mean(axis=1)
    middle = math.atan2(xyz[2], math.hypot(xyz[0], xyz[1])), math.atan2(xyz[1], xyz[0])
    return LocalFrame.about(math.degrees(middle[0]), math.degrees(middle[1]))


def _track(place: SearchPlace, request: SearchRequest, frame: LocalFrame, spacing: float) -> tuple[Track, BaseGeometry]:
    """The track in ``frame``, and the ground that it is to search."""
    pattern, heading = request.pattern, request.heading_deg
    if pattern is Pattern.TRACKLINE:
        if len(place.line) < 2:
            raise UsageError("--pattern trackline needs a line: give a LineString as AREA")
        line = LineString(frame.to_xy([(lat, lon) for lon, lat in place.line]))
        swath = line.buffer(request.passes * spacing, cap_style="flat", join_style="mitre", mitre_limit=2.0)
        return from_line(line, spacing_m=spacing, passes=request.passes), swath
    if pattern in FROM_AREA:
        area = _local(frame, place.area)
        if area.is_empty:
            raise UsageError(f"--pattern {pattern} needs an AREA with a polygon")
        track = from_area(pattern, area, spacing_m=spacing, heading_deg=heading, passes=request.passes)
        rim = area.difference(area.buffer(-spacing * request.passes)) if pattern is Pattern.PERIMETER else area
        return track, rim
    return _about_datum(request, spacing)


def _about_datum(request: SearchRequest, spacing: float) -> tuple[Track, BaseGeometry]:
    pattern, radius, heading = request.pattern, request.radius_m, request.heading_deg or 0.0
    if radius is None:
        raise UsageError(f"--pattern {pattern} needs --radius M: how far from the datum to search")
    track = from_datum(pattern, spacing_m=spacing, radius_m=radius, heading_deg=heading, passes=request.passes)
    if pattern is Pattern.EXPANDING_SQUARE:
        square = shapely.box(-radius, -radius, radius, radius)
        return track, shapely.affinity.rotate(square, -heading, origin=(0.0, 0.0))
    return track, Point(0.0, 0.0).buffer(radius, quad_segs=32)


def _with_datum(place: SearchPlace, request: SearchRequest) -> tuple[SearchPlace, SearchRequest]:
    """Where a pattern wants a datum and an area is given: the area's middle, and as far as the area reaches."""
    if request.pattern not in FROM_DATUM or place.datum is not None:
        return place, request
    if not place.area:
        raise UsageError(f"--pattern {request.pattern} needs a datum: --datum LAT,LON and --radius M")
    frame = _frame(place)
    area = _local(frame, place.area)
    middle = np.asarray(area.centroid.coords[0])
    lat, lon = frame.to_lat_lon(middle)[0]
    radius = request.radius_m or float(np.hypot(*(shapely.get_coordinates(area) - middle).T).max())
    return SearchPlace(datum=(float(lat), float(lon))), replace(request, radius_m=radius)


def _local(frame: LocalFrame, polygons: Sequence[GeoPolygon]) -> BaseGeometry:
    made = []
    for polygon in polygons:
        rings = [frame.to_xy([(lat, lon) for lon, lat in ring]) for ring in polygon.rings]
        made.append(shapely.make_valid(Polygon(rings[0], rings[1:])))
    return shapely.union_all(made) if made else Polygon()
