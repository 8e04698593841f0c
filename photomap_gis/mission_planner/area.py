"""Areas as they were asked for become sound polygons in local metres, with words on what was repaired."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.errors import DataError
from photomap_gis.core.plan import GeoPolygon
from photomap_gis.mission_planner.local_frame import LocalFrame

FloatArray = npt.NDArray[np.float64]

MOST_AREA_M2 = 3e9
MOST_REACH_M = 100_000.0
LEAST_AREA_M2 = 0.25
_SAG_M = 0.05
_SNAP_M = 0.01


@dataclass(frozen=True, slots=True)
class SurveyArea:
    """What to survey in ``frame`` (metres x east, y north): ``target`` is the area less ``avoid``."""

    frame: LocalFrame
    area: BaseGeometry
    avoid: BaseGeometry
    target: BaseGeometry
    corridor: tuple[LineString, ...] = ()
    corridor_width_m: float = 0.0
    warnings: tuple[str, ...] = ()


def survey_area(
    polygons: Sequence[GeoPolygon],
    avoid: Sequence[GeoPolygon] = (),
    *,
    line: Sequence[tuple[float, float]] = (),
    corridor_width_m: float | None = None,
) -> SurveyArea:
    """Return the area in a metric frame about it, repaired where that is safe.

    Rings are (longitude, latitude). Raises ``DataError`` where nothing is left to survey, or too much to plan at once.
    """
    warnings: list[str] = []
    points = [p for polygon in polygons for ring in polygon.rings for p in ring] + list(line)
    if not points:
        raise DataError(
            "the area holds no polygon: where it is a line, say how wide the strip about it is by --corridor-width M"
        )
    frame = _frame_about(points)
    corridor: tuple[LineString, ...] = ()
    if corridor_width_m is not None:
        if len(line) < 2:
            raise DataError("--corridor-width needs a line: give AREA as a LineString, or as two places")
        path = LineString(_ring_xy(frame, list(line))).simplify(0.02)
        if path.length < 0.5:
            raise DataError("the line is shorter than half a metre: nothing to plan")
        corridor = (path,)
        area: BaseGeometry = path.buffer(corridor_width_m / 2.0, cap_style="flat", join_style="round")
    else:
        area = _sound(frame, polygons, "area", warnings)
    _check(area)
    zones = _sound(frame, avoid, "no-fly zone", warnings) if avoid else Polygon()
    target = area if zones.is_empty else _polygons(area.difference(zones))
    if target.area < LEAST_AREA_M2:
        raise DataError("the no-fly zones cover the whole area: nothing is left to survey")
    near = zones if zones.is_empty else zones.intersection(shapely.box(*area.buffer(20_000.0).bounds))
    return SurveyArea(frame, area, _polygons(near), target, corridor, corridor_width_m or 0.0, tuple(warnings))


def geo_polygons(frame: LocalFrame, geometry: BaseGeometry) -> tuple[GeoPolygon, ...]:
    """Return polygons in local metres as rings of (longitude, latitude); longitudes run on across the antimeridian."""
    found = []
    for part in shapely.get_parts(geometry):
        if isinstance(part, Polygon) and not part.is_empty:
            rings = []
            for ring in (part.exterior, *part.interiors):
                lat_lon = frame.to_lat_lon(ring.coords)
                lon = frame.lon_deg + (lat_lon[:, 1] - frame.lon_deg + 180.0) % 360.0 - 180.0
                rings.append(
                    tuple((round(float(x), 9), round(float(y), 9)) for x, y in zip(lon, lat_lon[:, 0], strict=True))
                )
            found.append(GeoPolygon(tuple(rings)))
    return tuple(found)


def _frame_about(points: Sequence[tuple[float, float]]) -> LocalFrame:
    """About the middle on the sphere, which is right across the antimeridian and at the poles."""
    lon, lat = np.radians(np.array(points, np.float64)).T
    xyz = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
    x, y, z = (xyz.min(axis=0) + xyz.max(axis=0)) / 2.0
    middle = LocalFrame.about(math.degrees(math.atan2(z, math.hypot(x, y))), math.degrees(math.atan2(y, x)))
    reach = np.hypot(*middle.to_xy(np.degrees(np.stack([lat, lon], axis=1))).T).max()
    if not reach < MOST_REACH_M:
        raise DataError(
            f"the area reaches {reach / 1000:.0f} km from its middle: plan parts of at most "
            f"{MOST_REACH_M / 1000:.0f} km, and check that latitude and longitude are in their order"
        )
    return middle


def _ring_xy(frame: LocalFrame, ring: Sequence[tuple[float, float]]) -> FloatArray:
    """``(N, 2)`` metres of a ring; edges straight in longitude and latitude, as GeoJSON has them, within 5 cm."""
    lon = np.unwrap(np.array([p[0] for p in ring], np.float64), period=360.0)
    lat = np.array([p[1] for p in ring], np.float64)
    places = np.stack([lat, lon], axis=1)
    xy = frame.to_xy(places)
    sag = np.hypot(*(frame.to_xy((places[1:] + places[:-1]) / 2.0) - (xy[1:] + xy[:-1]) / 2.0).T)
    parts = np.clip(np.ceil(np.sqrt(sag / _SAG_M)), 1, 200).astype(int)
    if not (parts > 1).any():
        return xy
    dense = [a + (b - a) * (np.arange(n) / n)[:, None] for a, b, n in zip(places[:-1], places[1:], parts, strict=True)]
    return frame.to_xy(np.concatenate([*dense, places[-1:]]))


def _sound(frame: LocalFrame, polygons: Sequence[GeoPolygon], what: str, warnings: list[str]) -> BaseGeometry:
    whole: list[BaseGeometry] = []
    for polygon in polygons:
        rings = [_closed(_ring_xy(frame, ring)) for ring in polygon.rings]
        rings = [r for r in rings if len(np.unique(np.round(r / _SNAP_M), axis=0)) >= 3]
        if not rings or len(np.unique(np.round(_ring_xy(frame, polygon.rings[0]) / _SNAP_M), axis=0)) < 3:
            warnings.append(f"a polygon of the {what} has fewer than three different corners and was left out")
            continue
        made = Polygon(rings[0], rings[1:])
        if not made.is_valid:
            reason = shapely.is_valid_reason(made).split("[")[0].lower()
            warnings.append(f"a polygon of the {what} was repaired ({reason}): check the picture")
            made = shapely.make_valid(made)
        whole.append(_polygons(made))
    if not whole:
        return Polygon()
    return _polygons(shapely.set_precision(shapely.union_all(whole), 1e-4))


def _closed(xy: FloatArray) -> FloatArray:
    return xy if np.array_equal(xy[0], xy[-1]) else np.concatenate([xy, xy[:1]])


def _polygons(geometry: BaseGeometry) -> BaseGeometry:
    return MultiPolygon(
        [p for g in shapely.get_parts(geometry) for p in shapely.get_parts(g) if isinstance(p, Polygon)]
    )


def _check(area: BaseGeometry) -> None:
    if area.area < LEAST_AREA_M2:
        raise DataError(
            f"the area is {area.area:.2g} m²: nothing to survey; is it a line (--corridor-width M), or are its corners "
            "all in one place?"
        )
    if area.area > MOST_AREA_M2:
        raise DataError(
            f"the area is {area.area / 1e6:.0f} km²: plan at most {MOST_AREA_M2 / 1e6:.0f} km² at once, and check that "
            "latitude and longitude are in their order"
        )
