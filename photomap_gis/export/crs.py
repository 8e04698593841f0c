"""Coordinate reference systems of outputs: what a user names, and the exact way from one to another."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from pyproj import CRS, Transformer
from pyproj.aoi import AreaOfInterest
from pyproj.exceptions import CRSError, ProjError

from photomap_gis.core.errors import NotGeoreferencedError, UsageError
from photomap_gis.core.similarity import FloatArray

WGS84 = "EPSG:4326"
WEB_MERCATOR = "EPSG:3857"

PointMap = Callable[[npt.ArrayLike], FloatArray]


def parse_crs(text: str) -> CRS:
    """Return the two-dimensional CRS that the user means (``EPSG:25833``, WKT or PROJ); ``UsageError`` for others."""
    try:
        crs = CRS.from_user_input(text)
    except CRSError as error:
        raise UsageError(f"{text!r} is no coordinate reference system; try one like EPSG:25833 or EPSG:3857") from error
    if crs.is_compound:  # a map has no heights: its horizontal part is meant
        crs = next((part for part in crs.sub_crs_list if part.is_projected or part.is_geographic), crs)
    if not (crs.is_projected or crs.is_geographic):
        raise UsageError(
            f"{text!r} is not a map's coordinate reference system; choose a projected one, like EPSG:25833"
        )
    return crs.to_2d() if len(crs.axis_info) > 2 else crs


def same_crs(a_wkt: str | None, b_wkt: str | None) -> bool:
    """Whether two CRS name the same coordinates (in east-north order); local frames equal only local frames."""
    if a_wkt is None or b_wkt is None:
        return a_wkt is b_wkt
    return a_wkt == b_wkt or _parsed(a_wkt).equals(_parsed(b_wkt), ignore_axis_order=True)


def needs_place(crs_wkt: str | None, what: str) -> str:
    """Return the CRS; ``NotGeoreferencedError`` with the way out where there is none."""
    if crs_wkt is None:
        raise NotGeoreferencedError(
            f"{what} needs a place on Earth and this map has none: map the flight again with --track FILE, "
            "or export --geotiff, which keeps local units"
        )
    return crs_wkt


def crs_label(crs_wkt: str | None) -> str:
    """Return ``EPSG:32633``-like text where an authority knows the CRS, else its name; ``local`` for none."""
    if crs_wkt is None:
        return "local"
    crs = _parsed(crs_wkt)
    authority = crs.to_authority(min_confidence=70)
    return ":".join(authority) if authority else crs.name


def point_map(from_crs: str, to_crs: str, *, around_xy: npt.ArrayLike | None = None) -> PointMap:
    """Return the map of ``(N, 2)`` points (east, north or longitude, latitude) from one CRS to another.

    Never by a ballpark guess: where PROJ knows no true operation (a grid file is missing), ``UsageError``.
    ``around_xy``, ``(N, 2)`` points in ``from_crs``, lets PROJ choose the operation made for the region. Points that
    cannot be mapped come back as inf.
    """
    if same_crs(from_crs, to_crs):
        return lambda points: np.asarray(points, dtype=np.float64)
    source, target = _parsed(from_crs), _parsed(to_crs)
    try:
        transformer = Transformer.from_crs(
            source,
            target,
            always_xy=True,
            allow_ballpark=False,
            area_of_interest=_area(source, around_xy),  # type: ignore[arg-type]  # the stub names the wrong class
        )
    except ProjError as error:
        raise UsageError(
            f"no exact way is known here from {source.name} to {target.name}: choose a --crs made for the map's region"
        ) from error

    def apply(points: npt.ArrayLike) -> FloatArray:
        p = np.asarray(points, dtype=np.float64)
        x, y = transformer.transform(p[..., 0], p[..., 1])
        return np.stack([x, y], axis=-1)

    return apply


def world_period(crs_wkt: str) -> float | None:
    """Return the width of the world where x wraps at the antimeridian (geographic, Web Mercator), else ``None``."""
    crs = _parsed(crs_wkt)
    if crs.is_geographic:
        return 360.0 if crs.axis_info[0].unit_name == "degree" else None
    return 2.0 * math.pi * 6378137.0 if same_crs(crs_wkt, WEB_MERCATOR) else None


def bounds_in(bounds: tuple[float, float, float, float], from_crs: str, to_crs: str) -> tuple[float, ...]:
    """Return west, south, east, north in ``to_crs`` of a box in ``from_crs``; across the antimeridian, east > 180."""
    west, south, east, north = bounds
    t = np.linspace(0.0, 1.0, 33)
    x, y = np.meshgrid(west + t * (east - west), south + t * (north - south))
    box = np.stack([x.ravel(), y.ravel()], axis=-1)
    p = point_map(from_crs, to_crs, around_xy=box)(box)
    if not np.isfinite(p).all():
        raise UsageError(f"the map does not fit into {_parsed(to_crs).name}: choose a --crs made for its region")
    period = world_period(to_crs)
    if period is not None:
        middle = p[len(p) // 2, 0]
        p[:, 0] = middle + (p[:, 0] - middle + period / 2) % period - period / 2
    return (float(p[:, 0].min()), float(p[:, 1].min()), float(p[:, 0].max()), float(p[:, 1].max()))


@lru_cache(maxsize=64)
def _parsed(text: str) -> CRS:
    return parse_crs(text)


def _area(source: CRS, around_xy: npt.ArrayLike | None) -> AreaOfInterest | None:
    if around_xy is None or source.geodetic_crs is None:
        return None
    to_lon_lat = Transformer.from_crs(source, source.geodetic_crs, always_xy=True)
    p = np.asarray(around_xy, dtype=np.float64)
    lon, lat = to_lon_lat.transform(p[..., 0], p[..., 1])
    if not (np.isfinite(lon).all() and np.isfinite(lat).all()):
        return None
    if lon.max() - lon.min() > 180.0:  # across the antimeridian
        lon = lon % 360.0 - np.where(lon % 360.0 > 180.0, 360.0, 0.0)
        return AreaOfInterest(lon[lon > 0].min(), lat.min(), lon[lon <= 0].max(), lat.max())
    return AreaOfInterest(float(lon.min()), float(lat.min()), float(lon.max()), float(lat.max()))
