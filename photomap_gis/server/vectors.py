"""A mission's frames as GeoJSON: what each saw of the ground, the path of the camera, the map's outline, the finds.

Longitude and latitude (RFC 7946) where the map has a place on Earth, else the map's own units, x right and y up, as its
GeoTIFF has them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any

import numpy as np

from photomap_gis.core.frame import FrameRef
from photomap_gis.core.placement import FramePlacement
from photomap_gis.server.placer import Placer
from photomap_gis.server.view import MissionView


def frames_document(view: MissionView) -> dict[str, Any]:
    """Return one feature a frame, in the order of time: its outline on the ground, ``null`` where it has no place."""
    placed = {p.frame: p for p in view.placements}
    place = _placer(view)
    features = []
    for order, ref in enumerate(in_time(view.frames)):
        p = placed.get(ref.index)
        ring = None if p is None else place(p.outline_xy_map_m())
        geometry = (
            {"type": "Polygon", "coordinates": [[*ring, ring[0]]]} if ring is not None and len(ring) >= 3 else None
        )
        status = view.statuses.get(ref.index)
        properties: dict[str, Any] = {
            "frame": ref.index,
            "name": ref.name,
            "order": order,
            "flight": ref.flight,
            "time_utc": utc_of(ref),
            "status": None if status is None else str(status.value),
            "reason": view.reasons.get(ref.index) or ref.problem,
            "piece": None if p is None else p.segment,
        }
        if p is not None:
            properties |= _pose(p, place)
        features.append({"type": "Feature", "geometry": geometry, "properties": properties})
    return _collection(features, view)


def track_document(view: MissionView) -> dict[str, Any]:
    """Return the path over ground of each flight and piece: lines through frame centres, in the order of time."""
    placed = {p.frame: p for p in view.placements}
    place = _placer(view)
    lines: dict[tuple[int, int], list[tuple[FrameRef, list[float]]]] = {}
    for ref in in_time(view.frames):
        p = placed.get(ref.index)
        if p is None:
            continue
        piece = 0 if view.georeferenced else p.segment
        if point := place(p.centre_xy_map_m[None]):
            lines.setdefault((ref.flight, piece), []).append((ref, point[0]))
    features = []
    for (flight, piece), points in lines.items():
        if len(points) < 2:
            continue
        properties = {
            "flight": flight,
            "piece": piece,
            "frames": [ref.index for ref, _ in points],
            "start_utc": utc_of(points[0][0]),
            "end_utc": utc_of(points[-1][0]),
        }
        geometry = {"type": "LineString", "coordinates": [xy for _, xy in points]}
        features.append({"type": "Feature", "geometry": geometry, "properties": properties})
    return _collection(features, view)


def _placer(view: MissionView) -> Placer:
    return Placer(view.map_frame, [p.centre_xy_map_m for p in view.placements])


def in_time(frames: Iterable[FrameRef]) -> list[FrameRef]:
    """Return frames in the order in which they were taken; those without a time keep their place in the flight."""
    refs = list(frames)
    if all(r.time_s is not None for r in refs):
        return sorted(refs, key=lambda r: (r.time_s or 0.0, r.index))
    return sorted(refs, key=lambda r: (r.flight, r.index))


def utc_of(ref: FrameRef) -> str | None:
    """Return when a frame was taken, ISO 8601, ``None`` where unknown."""
    if ref.time_s is None or not math.isfinite(ref.time_s):
        return None
    try:
        return datetime.fromtimestamp(ref.time_s, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    except (OverflowError, ValueError, OSError):
        return None


def _pose(p: FramePlacement, place: Placer) -> dict[str, Any]:
    centre = place(p.centre_xy_map_m[None])
    if not centre:
        return {}
    variance = np.diag(p.position_covariance_m2()[0])
    sigma = math.sqrt(float(variance.sum()) / 2.0) if np.isfinite(variance).all() and variance.min() >= 0 else None
    heading, gsd = math.degrees(p.heading_rad) % 360.0, p.gsd_m_per_px
    return {
        "centre": centre[0],
        "heading_deg": round(heading, 1) if math.isfinite(heading) else None,
        "gsd": round(gsd, 5) if math.isfinite(gsd) else None,
        "sigma": None if sigma is None else round(sigma, 3),
    }


def _collection(features: list[Any], view: MissionView) -> dict[str, Any]:
    return {
        "type": "FeatureCollection",
        "coordinates": "lonlat" if view.georeferenced else "local",
        "features": features,
    }
