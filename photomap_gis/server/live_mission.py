"""A live session under a name: its layers, its documents, and its events on their way to listeners."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import Any, Literal

import numpy as np

from photomap_gis.core.accuracy import CE90_PER_RMSE_R
from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.similarity import FloatArray
from photomap_gis.export.warp import ground_pixel_m
from photomap_gis.server.live_documents import (
    EllipseDocument,
    EndDocument,
    HealthDocument,
    LiveDocument,
    LiveEventDocument,
    Place,
    PoseDocument,
    SegmentDocument,
    SnappedDocument,
    SolutionDocument,
    TilesDocument,
)
from photomap_gis.server.live_hub import LiveHub, Views
from photomap_gis.server.live_layers import LiveLayer
from photomap_gis.server.live_view import (
    LiveEnd,
    LiveEvent,
    LiveHealth,
    LivePhase,
    LivePose,
    LiveSegment,
    LiveSession,
    LiveSnapped,
    LiveSolution,
    LiveState,
    LiveTiles,
    RasterKind,
)
from photomap_gis.server.missions import NOT_GEOREFERENCED
from photomap_gis.server.placer import Placer
from photomap_gis.server.protocol import LayerDocument, LegendDocument, MissionDocument, SchemeDocument
from photomap_gis.server.ramp import STOPS

_ANSWERS_PX = 256
"""A layer's range is looked at in a picture of about this side."""


class LiveMission:
    """What is served of a live session; safe among threads, but for ``hub`` and ``views``, which live in the loop."""

    def __init__(self, id: str, session: LiveSession, on_moved: Callable[[LiveMission], None]) -> None:
        """Serve a session; ``on_moved`` is called in a thread of its own when the solution has moved the map."""
        self.id, self.session = id, session
        self._on_moved = on_moved
        self.hub, self.views = LiveHub(), Views(session.watch)
        self._lock = threading.Lock()
        self._epoch = ""
        self._layers: tuple[LiveLayer, ...] = ()
        self._placer: Placer | None = None
        self._version = 0
        self._told_epoch = session.state.epoch
        self._unsubscribe = session.subscribe(self._happened)

    @property
    def ended(self) -> bool:
        """Whether the folder is a mission like any other by now."""
        return self.session.state.phase is LivePhase.ENDED

    @property
    def layers(self) -> tuple[LiveLayer, ...]:
        """The layers of the present epoch, the map first."""
        epoch = self.session.state.epoch
        with self._lock:
            if epoch != self._epoch or not self._layers:
                self._layers = tuple(LiveLayer(raster) for raster in self.session.rasters)
                self._epoch = epoch
            return self._layers

    def layer(self, id: str) -> LiveLayer:
        """Return a layer; ``KeyError`` where there is none of that name."""
        return next((layer for layer in self.layers if layer.id == id), None) or _no_layer(id)

    @property
    def placer(self) -> Placer:
        """How the present map frame becomes the documents' coordinates."""
        return self._placer_of(self.session.state.map_frame)

    def close(self) -> None:
        """Listen to the session no more."""
        self._unsubscribe()

    def mission_document(self) -> MissionDocument:
        """Return what a page needs to begin."""
        state, layers = self._together()
        root = f"missions/{self.id}"
        georeferenced = state.map_frame.crs_wkt is not None
        self.look_at_ranges()
        links = {name: f"{root}/{name}.geojson" for name in ("track", "finds")}
        links |= {
            "frames": f"{root}/frames.geojson",
            "live": f"{root}/live",
            "events": f"{root}/live/events",
            "view": f"{root}/live/view.jpg",
            "coverage": f"{root}/live/coverage.geojson",
            "accuracy": f"{root}/live/accuracy",
        }
        if georeferenced:
            links |= {"tilejson": f"{root}/layers/map/tiles.json", "wmts": f"{root}/wmts.xml"}
        note = "" if georeferenced else NOT_GEOREFERENCED
        frames = 0 if state.pose is None else state.pose.frame + 1
        return MissionDocument(
            id=self.id,
            name=state.name,
            epoch=state.epoch,
            revision=state.revision,
            georeferenced=georeferenced,
            note=note,
            crs=None,
            bounds=layers[0].scheme.bounds,
            layers=[_layer_document(layer, root, state.epoch) for layer in layers],
            frames={"total": frames},
            start_utc=_utc(state.started_utc_s),
            end_utc=None,
            pieces=[],
            accuracy={},
            accuracy_words=[note] if note else [],
            warnings=list(state.warnings),
            links=links,
            live=self.live_document(state),
        )

    def _together(self) -> tuple[LiveState, tuple[LiveLayer, ...]]:
        """Return a state and the layers of its epoch: the map may snap between two looks."""
        while True:
            state, layers = self.session.state, self.layers
            if state.epoch == self.session.state.epoch:
                return state, layers

    def live_document(self, state: LiveState | None = None) -> LiveDocument:
        """Return the session at this moment, or as ``state`` has it."""
        state = state or self.session.state
        area = None
        if state.area_lon_lat is not None and state.map_frame.crs_wkt is not None:
            area = [(float(x), float(y)) for x, y in state.area_lon_lat]
        return LiveDocument(
            epoch=state.epoch,
            phase=state.phase,
            georeferenced=state.map_frame.crs_wkt is not None,
            revision=state.revision,
            version=self._version,
            elapsed_s=round(state.elapsed_s, 3),
            started_utc=_utc(state.started_utc_s),
            pose=None if state.pose is None or not _same_kind(state.pose, state) else self.pose_document(state.pose),
            health=None if state.health is None else _health_document(state.health),
            end=None if state.end is None else _end_document(state.end),
            area=area,
        )

    def track_document(self) -> dict[str, Any]:
        """Return the path of the camera over ground as GeoJSON, a line a segment."""
        state, track = self.session.state, self.session.track()
        place = self._placer_of(state.map_frame)
        features = []
        for segment in sorted(set(track.segment.tolist())):
            rows = np.flatnonzero(track.segment == segment)
            line = place(track.xy_map_m[rows])
            if len(line) >= 2:
                properties = {
                    "flight": 0, "piece": segment, "frames": [],
                    "start_s": round(float(track.time_s[rows[0]]), 3), "end_s": round(float(track.time_s[rows[-1]]), 3),
                }  # fmt: skip
                geometry = {"type": "LineString", "coordinates": line}
                features.append({"type": "Feature", "geometry": geometry, "properties": properties})
        kind = "local" if state.map_frame.crs_wkt is None else "lonlat"
        return {"type": "FeatureCollection", "coordinates": kind, "features": features}

    def pose_document(self, pose: LivePose) -> PoseDocument:
        """Return a pose as clients read it."""
        found: dict[str, Any] = {"frame": pose.frame, "time_s": round(pose.time_s, 3), "time_utc": _utc(pose.utc_s)}
        v, p = pose.vehicle, pose.placement
        if v is not None:
            found |= {"altitude_m": v.altitude_m, "speed_m_s": v.speed_m_s, "battery_percent": v.battery_percent}
            found |= {"mode": v.mode, "heading_deg": v.heading_deg}
            if pose.map_frame.crs_wkt is not None:
                found["drone"] = (v.lon_deg, v.lat_deg)
        if p is not None:
            place = self._placer_of(pose.map_frame)
            if centre := _first(place(p.centre_xy_map_m[None])):
                found |= self._on_map(p, place, centre)
        return PoseDocument(**found)

    def _on_map(self, p: FramePlacement, place: Placer, centre: Place) -> dict[str, Any]:
        plumb = p.plumb_xy_map_m
        heading, gsd = math.degrees(p.heading_rad) % 360.0, p.gsd_m_per_px
        ring = [(x, y) for x, y in place(p.outline_xy_map_m(1))]
        return {
            "centre": centre,
            "footprint": ring if len(ring) >= 3 else None,
            "heading_deg": round(heading, 1) if math.isfinite(heading) else None,
            "gsd": round(gsd, 5) if math.isfinite(gsd) else None,
            "ellipse": ellipse(p.position_covariance_m2()[0]),
            "segment": p.segment,
            "drone": centre if plumb is None else _first(place(plumb[None])) or centre,
        }

    def look_at_ranges(self) -> None:
        """Stretch the colours of layers of numbers over what they hold by now."""
        for layer in self.layers:
            extent = layer.raster.extent()
            if layer.ramp is None or extent is None:
                continue
            if layer.raster.kind is RasterKind.AGE:
                layer.tell_range(max(1.0, self.session.state.elapsed_s / 60.0))
            else:
                layer.tell_range(_largest(layer, _ANSWERS_PX))

    def _placer_of(self, frame: Any) -> Placer:
        placer = self._placer
        if placer is None or placer.frame != frame:
            placer = self._placer = Placer(frame)
        return placer

    def _happened(self, event: LiveEvent) -> None:
        if isinstance(event, LiveTiles):
            self._version = max(self._version, event.version)
        if isinstance(event, LiveSolution | LiveSnapped):
            threading.Thread(target=self._on_moved, args=(self,), daemon=True).start()
        epoch = event.epoch if isinstance(event, LiveSnapped) else self.session.state.epoch
        if epoch != self._told_epoch:
            self._told_epoch = epoch
            if not isinstance(event, LiveSnapped):  # as when the first picture gives the map its lattice
                self.hub.post(lambda: self._document(LiveSnapped(epoch)))
        self.hub.post(lambda: self._document(event))

    def _document(self, event: LiveEvent) -> LiveEventDocument | None:
        state = self.session.state
        georeferenced = state.map_frame.crs_wkt is not None
        if isinstance(event, LivePose):
            return self.pose_document(event) if _same_kind(event, state) and self.hub.listeners else None
        if isinstance(event, LiveTiles):
            return TilesDocument(version=event.version, areas=self.layers[0].window_bounds(event.windows))
        if isinstance(event, LiveSolution):
            moved_m = None
            if event.shift_px is not None and (lattice := self.layers[0].raster.lattice).crs_wkt is not None:
                moved_m = round(event.shift_px * ground_pixel_m(lattice), 3)
            return SolutionDocument(
                revision=event.revision, frame=event.frame, shift_px=event.shift_px, shift_m=moved_m,
                georeferenced=georeferenced,
            )  # fmt: skip
        if isinstance(event, LiveHealth):
            return _health_document(event)
        if isinstance(event, LiveSegment):
            return SegmentDocument(segment=event.segment, frame=event.frame, joined=event.joined, words=event.words)
        if isinstance(event, LiveSnapped):
            return SnappedDocument(epoch=event.epoch, georeferenced=georeferenced, words=event.words)
        return _end_document(event)


def _same_kind(pose: LivePose, state: LiveState) -> bool:
    # In the moment of snapping poses may be of the new frame while the map is still drawn in the old one.
    return (pose.map_frame.crs_wkt is None) == (state.map_frame.crs_wkt is None)


def ellipse(covariance: FloatArray | None) -> EllipseDocument | None:
    """Return the ellipse of a ``(2, 2)`` covariance (x east, y south); ``None`` where that is none."""
    if covariance is None or not np.isfinite(covariance).all():
        return None
    values, vectors = np.linalg.eigh(covariance)
    if values[0] < 0:
        return None
    x, y = vectors[:, 1]
    return EllipseDocument(
        major=round(float(math.sqrt(values[1])), 3),
        minor=round(float(math.sqrt(values[0])), 3),
        bearing_deg=round(math.degrees(math.atan2(float(x), -float(y))) % 180.0, 1),
        ce90=round(CE90_PER_RMSE_R * math.sqrt(float(values.sum())), 3),
    )


def _layer_document(layer: LiveLayer, root: str, epoch: str) -> LayerDocument:
    scheme = layer.scheme
    legend = None
    if layer.ramp is not None:
        colours = [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in STOPS]
        legend = LegendDocument(low=layer.ramp.low, high=layer.ramp.high, units=layer.units, colours=colours)
    return LayerDocument(
        id=layer.id,
        title=layer.title,
        role="map" if layer.raster.kind is RasterKind.MAP else "layer",
        scheme=SchemeDocument(
            kind="local" if scheme.kind == "local" else "webmercator",
            min_zoom=scheme.min_zoom,
            max_zoom=scheme.max_zoom,
            bounds=scheme.bounds,
            origin_xy=scheme.origin_xy,
            unit_per_px=scheme.unit_per_px,
        ),
        tiles=f"{root}/layers/{layer.id}/{{z}}/{{x}}/{{y}}.webp?epoch={epoch}-{layer.generation}",
        legend=legend,
    )


def _health_document(h: LiveHealth) -> HealthDocument:
    return HealthDocument(
        frames=h.frames, fps=round(h.fps, 1), latency_ms=round(h.latency_ms, 1), dropped=h.dropped,
        error_frames=h.error_frames, keyframes=h.keyframes, segments=h.segments, link=h.link, gps=h.gps,
        words=list(h.words),
    )  # fmt: skip


def _end_document(end: LiveEnd) -> EndDocument:
    phase: Literal["finalising", "ended"] = "ended" if end.phase is LivePhase.ENDED else "finalising"
    return EndDocument(event=phase, progress=round(end.progress, 4), words=end.words)


def _largest(layer: LiveLayer, side_px: int) -> float:
    """Return the 99th percentile of some of a layer's numbers."""
    extent = layer.raster.extent()
    if extent is None:
        return math.nan
    rows = np.linspace(extent.row_off, extent.row_off + extent.height - 1, 24).astype(int).tolist()
    seen = [layer.raster.read(extent._replace(row_off=r, height=1)).ravel() for r in rows]
    values = np.concatenate(seen)
    values = values[np.isfinite(values)]
    return float(np.percentile(values, 99)) if len(values) else math.nan


def _first(places: Sequence[Sequence[float]]) -> Place | None:
    return (places[0][0], places[0][1]) if places else None


def _utc(seconds: float | None) -> str | None:
    if seconds is None or not math.isfinite(seconds):
        return None
    try:
        return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    except (OverflowError, ValueError, OSError):
        return None


def _no_layer(id: str) -> LiveLayer:
    raise KeyError(id)
