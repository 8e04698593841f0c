"""The place on Earth: the map's CRS, what GPS, height and attitude say of each frame, and how sure the map is.

pyproj enters here: longitude first always, the network off, ballpark transforms refused. The maps made here are
plane: scale and convergence of the projection are taken as constant over a flight (a UTM zone's scale is within
0.04 % of 1 near its middle; GPS and registrations are both expressed in it).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pyproj
from pyproj.exceptions import CRSError, ProjError
from pyproj.network import set_network_enabled  # type: ignore[attr-defined]

from photomap_gis.core.accuracy import CE90_PER_RMSE_R
from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.frame import FrameRef, GpsFix, level_rotation
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.posegraph import (
    HeadingObservation,
    PoseGraph,
    PositionObservation,
    ScaleObservation,
    Solution,
    Trajectory,
)
from photomap_gis.core.similarity import FloatArray, wrap_angle

WGS84 = "EPSG:4326"
ORIGIN_STEP_M = 100.0
AREA_MARGIN_DEG = 3.0
"""How far beyond its stated area a CRS may be used: countries do use one UTM zone beyond its edges."""
MAX_DISTORTION = 0.01

WHITE_SIGMA_M = 0.5
DRIFT_SIGMA_M = 2.0
DRIFT_TIME_S = 60.0
BIAS_SIGMA_M = 1.0
"""The error of a plain GPS per axis: white, slowly drifting (first-order Gauss-Markov), and constant for a flight."""
NOMINAL_INTERVAL_S = 2.0
"""Between frames without a clock: only the correlation of their fixes' errors hangs on it."""

UNKNOWN_TILT_RAD = math.radians(2.5)
UNKNOWN_HEIGHT_M = 80.0
"""Where no attitude is reported: how far off plumb a camera hangs, and from how high, where that is unknown too."""
HEIGHT_SIGMA_REL = 0.1
HEIGHT_SIGMA_M = 3.0
MIN_HEIGHT_M = 2.0
MAX_LEVELLED_RAD = math.radians(60.0)
"""Cameras that look further off nadir are not levelled: the horizon is in the picture or near it."""


@dataclass(frozen=True, slots=True)
class Observations:
    """What fixes, heights and attitudes say of the frames, in the internal map frame."""

    positions: tuple[PositionObservation, ...]
    scales: tuple[ScaleObservation, ...]
    headings: tuple[HeadingObservation, ...]


@dataclass(frozen=True, slots=True)
class Accuracy:
    """How sure the map is of its place on Earth: root mean square over the frames' positions, predicted, not tested.

    The constant bias of the GPS is part of every number. ``n_frames`` is how many frames they rest on.
    """

    sigma_e_m: float
    sigma_n_m: float
    predicted_ce90_m: float
    n_frames: int


def resolve_crs(text: str) -> str:
    """Return the WKT of a CRS given as an authority code, WKT or PROJ string; ``UsageError`` for anything else."""
    try:
        return _crs(text.strip()).to_wkt()
    except CRSError:
        raise UsageError(
            f"'{_short(text)}' is no coordinate reference system; write a code such as EPSG:32633 (UTM zone 33 north)"
        ) from None


def choose_map_frame(fixes: Sequence[GpsFix], crs: str | None = None) -> MapFrame:
    """Return the map frame for these fixes: the user's CRS where it is fit to work in, else UTM (UPS at the poles).

    Fit is a projected CRS in metres, true to scale within 1 % where the data lie; for others (degrees, feet, Web
    Mercator) the work is done in UTM and export warps. The median fix decides, so single blunders do not.
    ``UsageError`` for a ``crs`` that is unknown or made for another part of the world.
    """
    if not fixes:
        raise DataError("no frame has a GPS fix: the map has no place on Earth; give a track with --track FILE")
    lat, lon = _middle(fixes)
    wanted = _crs(utm_code(lat, lon))
    if crs is not None:
        asked = _crs(resolve_crs(crs))
        _check_area(asked, crs, lat, lon)
        if _is_fit(asked, lat, lon):
            wanted = asked
    wkt = wanted.to_wkt()
    e, n = _forward(wkt, np.array([lat]), np.array([lon]))[0]
    if not (math.isfinite(e) and math.isfinite(n)):
        raise UsageError(
            f"the CRS {crs} cannot hold the data at {lat:.4f}, {lon:.4f}; write another or leave --crs out"
        )
    return MapFrame(wkt, round(e / ORIGIN_STEP_M) * ORIGIN_STEP_M, round(n / ORIGIN_STEP_M) * ORIGIN_STEP_M)


def utm_code(lat_deg: float, lon_deg: float) -> str:
    """Return the EPSG code of the UTM zone at a place, with Norway's and Svalbard's exceptions; UPS near the poles."""
    if lat_deg >= 84.0:
        return "EPSG:5041"
    if lat_deg < -80.0:
        return "EPSG:5042"
    lon = (lon_deg + 180.0) % 360.0 - 180.0
    zone = int((lon + 180.0) // 6.0) + 1
    if 56.0 <= lat_deg < 64.0 and 3.0 <= lon < 12.0:
        zone = 32
    elif lat_deg >= 72.0 and 0.0 <= lon < 42.0:
        zone = 31 + 2 * int((lon + 3.0) // 12.0)
    return f"EPSG:{32600 + zone if lat_deg >= 0.0 else 32700 + zone}"


def fix_to_map(map_frame: MapFrame, lats: npt.ArrayLike, lons: npt.ArrayLike) -> FloatArray:
    """Return ``(N, 2)`` internal map points of ``(N,)`` WGS84 latitudes and longitudes in degrees."""
    lat, lon = np.atleast_1d(np.asarray(lats, np.float64)), np.atleast_1d(np.asarray(lons, np.float64))
    return map_frame.from_crs(_forward(_wkt(map_frame), lat, lon))


def crs_to_lonlat(crs: str, xy: npt.ArrayLike) -> FloatArray:
    """Return ``(N, 2)`` WGS84 longitudes, latitudes in degrees of ``(N, 2)`` points, x east and y north, of a CRS.

    ``UsageError`` for a CRS that is unknown, or that cannot hold the points.
    """
    p = np.atleast_2d(np.asarray(xy, np.float64))
    wkt = resolve_crs(crs)
    x, y = _transformer(wkt).transform(p[:, 0], p[:, 1], direction="INVERSE")
    lonlat = np.stack([np.asarray(x), np.asarray(y)], axis=1)
    if not np.isfinite(lonlat).all():
        wrong = p[~np.isfinite(lonlat).all(axis=1)][0]
        raise UsageError(f"{_short(crs)} cannot hold the point {wrong[0]:g}, {wrong[1]:g} (x east, y north)")
    lon, lat = np.median(lonlat, axis=0).tolist()
    _check_area(_crs(wkt), crs, lat, lon)
    return lonlat


def map_to_lonlat(map_frame: MapFrame, xy_map_m: npt.ArrayLike) -> FloatArray:
    """Return ``(N, 2)`` WGS84 **longitudes, latitudes** in degrees of ``(N, 2)`` internal map points."""
    en = map_frame.to_crs(np.atleast_2d(np.asarray(xy_map_m, np.float64)))
    lon, lat = _transformer(_wkt(map_frame)).transform(en[:, 0], en[:, 1], direction="INVERSE")
    return np.stack([np.asarray(lon), np.asarray(lat)], axis=1)


def grid_convergence_rad(map_frame: MapFrame, lat_deg: float, lon_deg: float) -> float:
    """Return the grid azimuth of true north: add it to a true heading to have the heading from grid north."""
    # A metre or so of meridian, measured in the CRS itself: right for every projection, whatever its parameters.
    step = 1e-5 if lat_deg < 89.0 else -1e-5
    here, there = fix_to_map(map_frame, [lat_deg, lat_deg + step], [lon_deg, lon_deg])
    dx, dy = (there - here) * math.copysign(1.0, step)
    return math.atan2(float(dx), -float(dy))


def plane_view(ref: FrameRef) -> PlaneView:
    """Return the road between a frame's pixels and its plane: levelled where lens and attitude are known, else flat."""
    camera = ref.camera if ref.camera is not None else Camera(ref.width_px, ref.height_px)
    if (camera.width_px, camera.height_px) != (ref.width_px, ref.height_px) and ref.width_px > 0:
        camera = _resized(camera, ref.width_px, ref.height_px)
    if ref.attitude is None or not _is_levelled(ref, camera):
        return PlaneView.flat(camera)
    return PlaneView(camera, level_rotation(ref.attitude.R_ned_camera))


def observe(frames: Sequence[FrameRef], map_frame: MapFrame, *, of_cameras: bool = False) -> Observations:
    """Return what fixes, heights and attitudes say of the frames' planes, or of their cameras' places in space.

    EXIF altitude is never a height and is not looked at. A fix tells where the camera is, that is the plumb point
    where the attitude is known; where it is not, the plane's origin is the image centre, and the ground there is off
    by tilt times height. The camera itself is where the fix says, however it leans.
    """
    positions, scales, headings = [], [], []
    with_fix = [r for r in frames if r.fix is not None and (r.fix.lat_deg, r.fix.lon_deg) != (0.0, 0.0)]
    xy = fix_to_map(map_frame, [_fix(r).lat_deg for r in with_fix], [_fix(r).lon_deg for r in with_fix])
    place = {r.index: p for r, p in zip(with_fix, xy, strict=True) if np.isfinite(p).all()}
    heights = _heights_by_flight(frames)
    bias = _bias_by_flight(with_fix)
    for k, ref in enumerate(frames):
        view = plane_view(ref)
        if ref.index in place:
            height = ref.height_m if _is_height(ref.height_m) else heights.get(ref.flight, UNKNOWN_HEIGHT_M)
            leaning_m = 0.0 if of_cameras else math.tan(_tilt_sigma(ref, view)) * (height or UNKNOWN_HEIGHT_M)
            positions.append(_position(ref, place[ref.index], leaning_m, k, bias[ref.flight]))
        focal = view.camera.focal_px
        if focal is not None and ref.height_m is not None and _is_height(ref.height_m):
            sigma = math.hypot(HEIGHT_SIGMA_REL, HEIGHT_SIGMA_M / ref.height_m, view.camera.focal_sigma_rel)
            scales.append(ScaleObservation(ref.index, ref.height_m / focal, sigma))
        if ref.attitude is not None and ref.attitude.off_nadir_rad < MAX_LEVELLED_RAD:
            turn = _convergence_at(map_frame, ref, with_fix)
            heading = wrap_angle(ref.attitude.heading_rad + turn)
            headings.append(HeadingObservation(ref.index, heading, ref.attitude.sigma_yaw_rad))
    return Observations(tuple(positions), tuple(scales), tuple(headings))


def accuracy(solution: Solution, graph: PoseGraph) -> Accuracy | None:
    """Return the predicted accuracy of the solved positions; ``None`` for a map without a place on Earth.

    Predicted from the covariances of the solution, which hold the GPS's drift and constant bias; check points would
    test it, the fixes that were used in the fit cannot.
    """
    if not graph.georeferenced or not solution.poses:
        return None
    linear = np.array([p.T_map_plane.linear for p in solution.poses])
    covariance = np.array([p.covariance[:2, :2] for p in solution.poses])
    on_map = linear @ covariance @ linear.transpose(0, 2, 1)
    east, north = float(np.mean(on_map[:, 0, 0])), float(np.mean(on_map[:, 1, 1]))
    return Accuracy(math.sqrt(east), math.sqrt(north), CE90_PER_RMSE_R * math.sqrt(east + north), len(solution.poses))


def predicted_ce90_m(trajectory: Trajectory) -> float | None:
    """Return the CE90 that the placements' covariances predict of the frames' centres; ``None`` where there are none.

    It holds the GPS's drift and bias, and what is not known of the ground.
    """
    if not trajectory.placements:
        return None
    variance = np.array([p.position_covariance_m2()[0] for p in trajectory.placements])
    variance = variance[np.isfinite(variance).all(axis=(1, 2))]
    return CE90_PER_RMSE_R * math.sqrt(float(np.mean(np.trace(variance, axis1=1, axis2=2)))) if len(variance) else None


def _tilt_sigma(ref: FrameRef, view: PlaneView) -> float:
    """How far off the plumb line the plane's origin may hang."""
    if ref.attitude is not None and _is_levelled(ref, view.camera):
        return ref.attitude.sigma_tilt_rad
    return UNKNOWN_TILT_RAD


def _position(
    ref: FrameRef, xy: FloatArray, leaning_m: float, place_in_order: int, bias_m: float
) -> PositionObservation:
    """Return a fix as an observation of the plane's origin: white, leaning and drift parts of its error told apart."""
    sigma = _fix(ref).sigma_m
    white, drift = WHITE_SIGMA_M, DRIFT_SIGMA_M
    if sigma is not None and sigma > 0.0:
        whole = math.hypot(white, drift)
        # A better receiver is better in all its parts; what is worse than a plain GPS (rounded digits) is noise.
        share = min(1.0, sigma / whole)
        white, drift = white * share, drift * share
        white = math.hypot(white, math.sqrt(max(sigma**2 - whole**2, 0.0)))
    variance = white**2 + drift**2 + leaning_m**2
    time = ref.time_s if ref.time_s is not None else ref.pts_s
    if time is None:
        time = place_in_order * NOMINAL_INTERVAL_S
    return PositionObservation(ref.index, xy, np.eye(2) * variance, ref.flight, time, drift, DRIFT_TIME_S, bias_m)


def _bias_by_flight(with_fix: Sequence[FrameRef]) -> Mapping[int, float]:
    """Prior sigma of each flight's constant bias: smaller where the receiver reports itself better than plain GPS."""
    whole = math.hypot(WHITE_SIGMA_M, DRIFT_SIGMA_M)
    sigmas: dict[int, list[float]] = {}
    for r in with_fix:
        sigma = _fix(r).sigma_m
        sigmas.setdefault(r.flight, []).append(whole if sigma is None or sigma <= 0.0 else sigma)
    return {flight: BIAS_SIGMA_M * min(1.0, float(np.median(s)) / whole) for flight, s in sigmas.items()}


def _heights_by_flight(frames: Sequence[FrameRef]) -> Mapping[int, float]:
    """Median reported height of each flight that has any."""
    known: dict[int, list[float]] = {}
    for r in frames:
        if r.height_m is not None and _is_height(r.height_m):
            known.setdefault(r.flight, []).append(r.height_m)
    return {flight: float(np.median(h)) for flight, h in known.items()}


def _is_height(height_m: float | None) -> bool:
    return height_m is not None and math.isfinite(height_m) and height_m >= MIN_HEIGHT_M


def _is_levelled(ref: FrameRef, camera: Camera) -> bool:
    """Whether the frame's attitude can be taken out of its picture."""
    return camera.focal_px is not None and ref.attitude is not None and ref.attitude.off_nadir_rad < MAX_LEVELLED_RAD


def _fix(ref: FrameRef) -> GpsFix:
    if ref.fix is None:
        raise ValueError(f"frame {ref.index} has no fix")
    return ref.fix


def _convergence_at(map_frame: MapFrame, ref: FrameRef, with_fix: Sequence[FrameRef]) -> float:
    """Convergence at a frame, or at the middle of the fixes where it has none; 0 for a map without a place."""
    if map_frame.crs_wkt is None or not with_fix:
        return 0.0
    lat, lon = (ref.fix.lat_deg, ref.fix.lon_deg) if ref.fix is not None else _middle([_fix(r) for r in with_fix])
    # Convergence changes by less than an arc minute over the 0.001 degrees that share one value.
    return _rounded_convergence(map_frame, round(lat, 3), round(lon, 3))


@lru_cache(maxsize=4096)
def _rounded_convergence(map_frame: MapFrame, lat_deg: float, lon_deg: float) -> float:
    turn = grid_convergence_rad(map_frame, lat_deg, lon_deg)
    return turn if math.isfinite(turn) else 0.0


def _resized(camera: Camera, width_px: int, height_px: int) -> Camera:
    """Return the camera for a raster of another size (a downscaled copy with its lens data kept)."""
    zoom = width_px / camera.width_px if camera.width_px > 0 else 1.0
    x, y = camera.principal_xy_px
    return replace(
        camera,
        width_px=width_px,
        height_px=height_px,
        focal_px=None if camera.focal_px is None else camera.focal_px * zoom,
        cx_px=None if camera.cx_px is None else (float(x) + 0.5) * zoom - 0.5,
        cy_px=None if camera.cy_px is None else (float(y) + 0.5) * zoom - 0.5,
    )


def _middle(fixes: Sequence[GpsFix]) -> tuple[float, float]:
    """Median latitude and longitude, across the antimeridian too; a fix of 0, 0 is none."""
    real = [f for f in fixes if (f.lat_deg, f.lon_deg) != (0.0, 0.0)] or list(fixes)
    lat = np.array([f.lat_deg for f in real])
    lon = np.array([f.lon_deg for f in real])
    mean = math.degrees(np.angle(np.exp(1j * np.radians(lon)).sum()))
    around = np.remainder(lon - mean + 180.0, 360.0) - 180.0
    middle = mean + float(np.median(around))
    return float(np.median(lat)), (middle + 180.0) % 360.0 - 180.0


@lru_cache(maxsize=64)
def _crs(text: str) -> pyproj.CRS:
    """Return the horizontal part of a CRS; ``CRSError`` for what is none (vertical, engineering, nonsense)."""
    crs = pyproj.CRS.from_user_input(text)
    if crs.is_compound:
        crs = next((part for part in crs.sub_crs_list if part.is_projected or part.is_geographic), crs)
    if not (crs.is_projected or crs.is_geographic):
        raise CRSError("neither projected nor geographic")
    return crs.to_2d()


@lru_cache(maxsize=64)
def _transformer(wkt: str) -> pyproj.Transformer:
    """Return the road from WGS84 longitude, latitude to a CRS."""
    set_network_enabled(False)
    try:
        return pyproj.Transformer.from_crs(WGS84, _crs(wkt), always_xy=True, allow_ballpark=False)
    except ProjError:
        raise UsageError(
            f"no exact way leads from WGS84 to {_crs(wkt).name} without extra grid files; "
            "write a CRS on WGS84 or ETRS89"
        ) from None


def _forward(wkt: str, lat: FloatArray, lon: FloatArray) -> FloatArray:
    """``(N, 2)`` easting, northing; not finite where the CRS cannot hold the place."""
    if not len(lat):
        return np.zeros((0, 2))
    x, y = _transformer(wkt).transform(lon, lat)
    return np.stack([np.asarray(x), np.asarray(y)], axis=1)


def _wkt(map_frame: MapFrame) -> str:
    if map_frame.crs_wkt is None:
        raise ValueError("a relative map frame has no place on Earth")
    return map_frame.crs_wkt


def _check_area(crs: pyproj.CRS, text: str, lat: float, lon: float) -> None:
    """Raise ``UsageError`` where the data lie well outside the CRS's area of use."""
    area = crs.area_of_use
    if area is None:
        return
    m = AREA_MARGIN_DEG
    width = (area.east - area.west) % 360.0 or 360.0
    inside = width + 2 * m >= 360.0 or (lon - area.west + m) % 360.0 <= width + 2 * m
    if not (inside and area.south - m <= lat <= area.north + m):
        raise UsageError(
            f"the CRS {_short(text)} is made for {_short(area.name or 'another part of the world')}, the data lie at "
            f"{lat:.4f}, {lon:.4f}; write {utm_code(lat, lon)} or leave --crs out"
        )


def _is_fit(crs: pyproj.CRS, lat: float, lon: float) -> bool:
    """Whether a CRS can be worked in: projected, and there a metre is a metre both ways, east right of north."""
    if not crs.is_projected or "pseudo-mercator" in crs.name.lower():
        return False
    if any(axis.direction == "west" for axis in crs.axis_info):  # counts westings and southings: upside down
        return False
    # Measured in the CRS itself: this finds feet, swapped or mirrored axes and distorting projections alike.
    geod = pyproj.Geod(ellps="WGS84")
    step = 100.0
    points = [(lon, lat), *(geod.fwd(lon, lat, azimuth, step)[:2] for azimuth in (90.0, 0.0))]
    en = _forward(crs.to_wkt(), np.array([p[1] for p in points]), np.array([p[0] for p in points]))
    jacobian = (en[1:] - en[0]).T / step
    if not np.isfinite(jacobian).all():
        return False
    return bool(np.linalg.det(jacobian) > 0 and np.abs(jacobian.T @ jacobian - np.eye(2)).max() < 2 * MAX_DISTORTION)


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= 60 else line[:57] + "..."
