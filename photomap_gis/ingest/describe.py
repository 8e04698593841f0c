"""What is there, before anyone waits for a map: footage in, a summary out (``photomap info``)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from statistics import median

from photomap_gis.core.camera import Camera
from photomap_gis.core.frame import Flight, Footage, FrameRef
from photomap_gis.ingest.photo_fixes import distance_m, offset_m
from photomap_gis.ingest.source_info import Bounds, CameraInfo, FlightInfo, Range, SourceInfo

__all__ = ["SourceInfo", "describe"]

OBLIQUE_RAD = math.radians(35.0)  # more than this off nadir is not pasted into a map by default
_GOOD_OVERLAP = 0.6


def describe(footage: Footage) -> SourceInfo:
    """Return the summary of the footage."""
    frames = footage.frames
    usable = [f for f in frames if f.problem is None]
    fixes = [f for f in frames if f.fix is not None]
    tilts = [math.degrees(f.attitude.off_nadir_rad) for f in frames if f.attitude is not None]
    oblique = sum(t > math.degrees(OBLIQUE_RAD) for t in tilts)
    gsds = [g for g in (_gsd(f) for f in usable) if g is not None]
    by_flight: dict[int, list[FrameRef]] = {}
    for frame in frames:
        by_flight.setdefault(frame.flight, []).append(frame)
    flights = tuple(_flight(flight, by_flight.get(flight.id, [])) for flight in footage.flights)
    sizes = Counter((f.width_px, f.height_px) for f in usable)
    return SourceInfo(
        frames=len(frames),
        photos=sum(f.frame_number is None for f in frames),
        video_frames=sum(f.frame_number is not None for f in frames),
        usable=len(usable),
        sizes_px=tuple(size for size, _ in sizes.most_common()),
        cameras=_cameras(usable),
        flights=flights,
        fixes=len(fixes),
        attitudes=len(tilts),
        bounds=_bounds(fixes),
        height_m=_range([f.height_m for f in frames if f.height_m is not None]),
        off_nadir_deg=_range(tilts),
        oblique=oblique,
        gsd_m_per_px=median(gsds) if gsds else None,
        problems=_problems(footage, flights, usable, len(fixes), oblique),
    )


def _range(values: Sequence[float]) -> Range | None:
    return Range(min(values), median(values), max(values)) if values else None


def _cameras(frames: Sequence[FrameRef]) -> tuple[CameraInfo, ...]:
    """List the cameras; a lens that zooms through a video counts once a degree of its field of view."""
    cameras = [f.camera if f.camera is not None else Camera(f.width_px, f.height_px) for f in frames]
    alike: dict[tuple[object, ...], Camera] = {}
    for c in cameras:
        alike.setdefault(_likeness(c), c)
    counts = Counter(alike[_likeness(c)] for c in cameras)
    return tuple(
        CameraInfo(
            name=camera.name or "unknown camera",
            frames=count,
            width_px=camera.width_px,
            height_px=camera.height_px,
            focal_px=camera.focal_px,
            hfov_deg=math.degrees(camera.hfov_rad) if camera.hfov_rad is not None else None,
            focal_sigma_percent=100.0 * camera.focal_sigma_rel if camera.focal_px is not None else None,
            origin=camera.origin,
        )
        for camera, count in counts.most_common()
    )


def _likeness(camera: Camera) -> tuple[object, ...]:
    degrees = None if camera.hfov_rad is None else round(math.degrees(camera.hfov_rad))
    return (camera.name, camera.width_px, camera.height_px, camera.origin, degrees)


def _gsd(frame: FrameRef) -> float | None:
    """Ground metres a pixel straight below the camera."""
    focal = frame.camera.focal_px if frame.camera else None
    return frame.height_m / focal if frame.height_m and frame.height_m > 0 and focal else None


def _flight(flight: Flight, frames: Sequence[FrameRef]) -> FlightInfo:
    times = [f.time_s for f in frames if f.time_s is not None]
    if not times:
        times = [f.pts_s for f in frames if f.pts_s is not None]
    gaps = [b - a for a, b in pairwise(times) if b > a]
    located = [f for f in frames if f.fix is not None]
    steps = _steps_m(located)
    length = sum(steps) if steps else None
    duration = max(times) - min(times) if len(times) > 1 else None
    overlaps = [o for o in (_overlap(a, b) for a, b in pairwise(frames)) if o is not None]
    return FlightInfo(
        id=flight.id,
        name=flight.name,
        kind=flight.kind,
        camera=flight.camera_name,
        frames=len(frames),
        track_source=flight.track_source,
        start_utc_s=min((f.time_s for f in frames if f.time_s is not None), default=None),
        duration_s=duration,
        interval_s=median(gaps) if gaps else None,
        fixes=len(located),
        length_m=length,
        speed_m_s=_speed(located, steps),
        spacing_m=median(steps) if steps else None,
        height_m=_range([f.height_m for f in frames if f.height_m is not None]),
        overlap=median(overlaps) if overlaps else None,
    )


def _steps_m(located: Sequence[FrameRef]) -> list[float]:
    return [distance_m(a.fix, b.fix) for a, b in pairwise(located) if a.fix is not None and b.fix is not None]


def _speed(located: Sequence[FrameRef], steps_m: Sequence[float]) -> float | None:
    """The median speed between consecutive fixes."""
    speeds = []
    for a, b, step in zip(located, located[1:], steps_m, strict=False):
        start, end = (f.time_s if f.time_s is not None else f.pts_s for f in (a, b))
        if start is not None and end is not None and end > start:
            speeds.append(step / (end - start))
    return median(speeds) if speeds else None


def _overlap(a: FrameRef, b: FrameRef) -> float | None:
    """Return the part of a's ground that b sees again, of two nadir frames in the same direction.

    Where the heading is not known it is taken along the way flown, and the frame's shorter side along it (as
    surveys are flown): the least overlap of the two ways to hang a camera.
    """
    gsd = _gsd(a)
    if gsd is None or a.fix is None or b.fix is None:
        return None
    east, north = offset_m(a.fix, b.fix)
    if a.attitude is not None:
        c, s = math.cos(a.attitude.heading_rad), math.sin(a.attitude.heading_rad)
        right, up = abs(east * c - north * s), abs(east * s + north * c)
        along_x, along_y = right / (gsd * a.width_px), up / (gsd * a.height_px)
    else:
        along_x, along_y = 0.0, math.hypot(east, north) / (gsd * min(a.width_px, a.height_px))
    return max(0.0, 1.0 - along_x) * max(0.0, 1.0 - along_y)


def _bounds(located: Sequence[FrameRef]) -> Bounds | None:
    """The box of all fixes; across the date line west is greater than east."""
    fixes = [f.fix for f in located if f.fix is not None]
    if not fixes:
        return None
    first = fixes[0].lon_deg
    east_of_first = [math.remainder(f.lon_deg - first, 360.0) for f in fixes]
    west, east = (math.remainder(first + d, 360.0) for d in (min(east_of_first), max(east_of_first)))
    return Bounds(west, min(f.lat_deg for f in fixes), east, max(f.lat_deg for f in fixes))


def _problems(
    footage: Footage, flights: Sequence[FlightInfo], usable: Sequence[FrameRef], fixes: int, oblique: int
) -> tuple[str, ...]:
    total = len(footage.frames)
    said = list(footage.warnings)
    if total - len(usable):
        said.append(f"{total - len(usable)} of {total} frames cannot be read")
    if fixes == 0:
        said.append("no positions: the map will be relative; --track FILE gives them")
    elif fixes < total:
        said.append(f"{total - fixes} of {total} frames have no position")
    if any(f.camera is None or f.camera.focal_px is None for f in usable):
        said.append("the lens is not known: scale comes from GPS alone; --fov-deg or --focal-35mm tells it")
    elif any(f.camera is not None and f.camera.focal_sigma_rel >= 0.1 for f in usable):
        said.append("the lens is only guessed: --fov-deg or --focal-35mm tells it")
    if oblique:
        said.append(f"{oblique} of {total} frames look more than {math.degrees(OBLIQUE_RAD):.0f}° off nadir")
    said += [
        f"flight {f.name}: consecutive frames overlap by {100 * f.overlap:.0f} % only; 60 % or more make a good map"
        for f in flights
        if f.overlap is not None and f.overlap < _GOOD_OVERLAP
    ]
    return tuple(dict.fromkeys(said))
