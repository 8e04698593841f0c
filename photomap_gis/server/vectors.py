"""A mission's frames as GeoJSON: what each saw of the ground, the path of the camera, the map's outline, the finds.

Longitude and latitude (RFC 7946) where the map has a place on Earth, else the map's own units, x right and y up, as its
GeoTIFF has them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any

import numpy as np

from photomap_gis.core.frame import FrameRef
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.similarity import FloatArray
from photomap_gis.export.crs import WGS84, point_map
from photomap_gis.server.view import MissionView

_DEGREE_DIGITS, _LOCAL_DIGITS = 8, 2
_MAX_FINDS_BYTES = 32 << 20


def frames_document(view: MissionView) -> dict[str, Any]:
    """Return one feature a frame, in the order of time: its outline on the ground, ``null`` where it has no place."""
    placed = {p.frame: p for p in view.placements}
    place = _Placer(view.map_frame, view.placements)
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
    place = _Placer(view.map_frame, view.placements)
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


def finds_document(view: MissionView) -> dict[str, Any]:
    """Return the mission's finds (``finds.geojson`` in its folder), empty where there are none or they are damaged."""
    path = view.folder / "finds.geojson"
    features: list[Any] = []
    try:
        if path.is_file() and path.stat().st_size <= _MAX_FINDS_BYTES:
            document = json.loads(path.read_text(encoding="utf-8"))
            found = document.get("features", []) if isinstance(document, dict) else []
            features = [f for f in found if isinstance(f, dict) and f.get("type") == "Feature"]
    except (OSError, ValueError, RecursionError):
        features = []
    return _collection(features, view)


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


class _Placer:
    """Plan to bring points of the internal map frame into the document's coordinates."""

    def __init__(self, frame: MapFrame, placements: Iterable[FramePlacement]) -> None:
        self._frame = frame
        self.digits = _LOCAL_DIGITS if frame.crs_wkt is None else _DEGREE_DIGITS
        self._to = None
        if frame.crs_wkt is not None:
            centres = np.array([p.centre_xy_map_m for p in placements]).reshape(-1, 2)
            centres = centres[np.isfinite(centres).all(axis=1)]
            around = frame.to_crs(centres if len(centres) else [[0.0, 0.0]])
            self._to = point_map(frame.crs_wkt, WGS84, around_xy=around)

    def __call__(self, xy_map: FloatArray) -> list[list[float]]:
        xy = self._frame.to_crs(xy_map)
        if self._to is not None:
            xy = self._to(xy)
            if len(xy) and np.isfinite(xy).all():  # an outline across the antimeridian runs on, it does not jump
                xy[:, 0] = xy[0, 0] + (xy[:, 0] - xy[0, 0] + 180.0) % 360.0 - 180.0
        return [
            [round(float(x), self.digits), round(float(y), self.digits)] for x, y in xy if np.isfinite([x, y]).all()
        ]


def _pose(p: FramePlacement, place: _Placer) -> dict[str, Any]:
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
