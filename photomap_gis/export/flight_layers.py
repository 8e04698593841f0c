"""The vector layers of a flight: where the cameras were, what they saw, and which frames were registered to which."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import shapely
from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.frame import FrameRef
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.placement import FramePlacement, PlanePlacement, PosedPlacement
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.core.similarity import FloatArray
from photomap_gis.export.poses import PoseRow, utc_text
from photomap_gis.export.vectors import VectorLayer


@dataclass(frozen=True, slots=True)
class Link:
    """A registration between two frames, accepted or not."""

    a: int
    b: int
    kind: str
    accepted: bool
    method: str
    probability: float
    overlap: float


def flight_layers(
    frames: Sequence[FrameRef],
    trajectory: Trajectory,
    map_frame: MapFrame,
    rows: Sequence[PoseRow],
    links: Iterable[Link],
) -> list[VectorLayer]:
    """Return track, cameras, footprints and registrations in the map's CRS; ``rows`` are one a frame."""
    placed = {p.frame: p for p in trajectory.placements}
    camera_at = {f.index: _camera(placed[f.index], map_frame) for f in frames if f.index in placed}
    camera_at = {index: xy for index, xy in camera_at.items() if np.isfinite(xy).all()}
    by_index = {f.index: row for f, row in zip(frames, rows, strict=True)}
    with_camera = [f for f in frames if f.index in camera_at]
    cameras = VectorLayer(
        "cameras",
        tuple(Point(camera_at[f.index]) for f in with_camera),
        tuple(_row(by_index[f.index]) for f in with_camera),
    )
    footprints = _footprints([f for f in frames if f.index in placed], placed, map_frame, by_index)
    return [_track(with_camera, camera_at), cameras, footprints, _links(links, camera_at, by_index)]


def _camera(placement: FramePlacement, map_frame: MapFrame) -> FloatArray:
    """``(2,)`` the point of the map under the camera, in the map's CRS."""
    model = placement.camera_to_map
    if isinstance(model, PosedPlacement):
        xy = np.asarray(model.centre_map[:2], dtype=np.float64)
    elif isinstance(model, PlanePlacement):
        xy = np.asarray(model.T_map_plane.translation, dtype=np.float64)  # a plane's origin is the plumb point
    else:
        xy = placement.centre_xy_map_m
    return map_frame.to_crs(xy)


def _track(frames: Sequence[FrameRef], camera_at: Mapping[int, FloatArray]) -> VectorLayer:
    flights: dict[int, list[FrameRef]] = defaultdict(list)
    for f in frames:
        flights[f.flight].append(f)
    lines, rows = [], []
    for flight, members in sorted(flights.items()):
        if len(members) < 2:
            continue
        lines.append(LineString([camera_at[f.index] for f in members]))
        times = [f.time_s for f in members if f.time_s is not None]
        rows.append(
            {
                "name": f"flight {flight}",
                "frames": len(members),
                "start_utc": utc_text(min(times, default=None)),
                "end_utc": utc_text(max(times, default=None)),
            }
        )
    return VectorLayer("track", tuple(lines), tuple(rows))


def _footprints(
    frames: Sequence[FrameRef],
    placed: Mapping[int, FramePlacement],
    map_frame: MapFrame,
    rows: Mapping[int, PoseRow],
) -> VectorLayer:
    found: list[tuple[BaseGeometry, dict[str, Any]]] = []
    for f in frames:
        ring = map_frame.to_crs(placed[f.index].outline_xy_map_m())
        if len(ring) < 4:  # looks at the horizon
            continue
        polygon: BaseGeometry = Polygon(ring)
        if not polygon.is_valid:
            polygon = shapely.make_valid(polygon)
            parts = [g for g in getattr(polygon, "geoms", [polygon]) if isinstance(g, Polygon)]
            if not parts:
                continue
            polygon = max(parts, key=lambda g: g.area)
        found.append((polygon, _row(rows[f.index])))
    return VectorLayer("footprints", tuple(g for g, _ in found), tuple(r for _, r in found))


def _links(links: Iterable[Link], at: Mapping[int, FloatArray], rows: Mapping[int, PoseRow]) -> VectorLayer:
    kept = [k for k in links if k.a in at and k.b in at]
    return VectorLayer(
        "registrations",
        tuple(LineString([at[k.a], at[k.b]]) for k in kept),
        tuple(
            {
                "name": f"{rows[k.a].frame} - {rows[k.b].frame}",
                **asdict(k),
                "probability": round(k.probability, 4),
                "overlap": round(k.overlap, 3),
            }
            for k in kept
        ),
    )


def _row(row: PoseRow) -> dict[str, Any]:
    return {k: round(v, 6) if isinstance(v, float) else v for k, v in asdict(row).items()}
