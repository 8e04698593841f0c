"""Live telemetry that the stream itself carries: MISB metadata between the frames, EXIF in photos."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from statistics import median

from photomap_gis.core.frame import GpsFix, TrackFix
from photomap_gis.core.live import FrameMoment, LiveFrame, StreamEvent, StreamFix, VehicleState
from photomap_gis.ingest.resample import interpolate
from photomap_gis.ingest.stream.lagged import Lagged, fixes_of
from photomap_gis.ingest.telemetry import Clock, Track, TrackPoint

_MAX_STREAM_FIXES = 150_000


class StreamTelemetry(Lagged):
    """What the stream tells itself: MISB metadata between the frames, EXIF in photos."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._points: list[TrackPoint] = []
        self._apart: deque[float] = deque(maxlen=200)

    def hear(self, event: StreamEvent) -> None:
        """Take note of a position; anything else is passed over."""
        if isinstance(event, LiveFrame):
            ref = event.ref
            if ref.fix is None:
                return
            f = ref.fix
            point = TrackPoint(
                event.stream_time_s, f.lat_deg, f.lon_deg, f.alt_m, ref.height_m, ref.attitude, f.sigma_m
            )
        elif isinstance(event, StreamFix):
            f, at_s = event.fix, event.stream_time_s
            if event.utc_s is not None:  # the packet's own time is finer than its place between two frames
                self._apart.append(at_s - event.utc_s)
                at_s = event.utc_s + median(self._apart)
            point = TrackPoint(at_s, f.lat_deg, f.lon_deg, f.alt_m, event.height_m, event.attitude, f.sigma_m,
                               hfov_rad=event.hfov_rad)  # fmt: skip
        else:
            return
        with self.lock:
            if not self._points or point.time_s > self._points[-1].time_s:
                self._points.append(point)
            if len(self._points) > _MAX_STREAM_FIXES:
                del self._points[: _MAX_STREAM_FIXES // 10]

    def place(self, moments: Sequence[FrameMoment]) -> tuple[TrackFix | None, ...]:
        """Return where the camera was at each frame."""
        if not moments:
            return ()
        with self.lock:
            low = min(m.stream_time_s for m in moments) - self.lag_s - 20.0
            high = max(m.stream_time_s for m in moments) - self.lag_s + 20.0
            points = tuple(p for p in self._points if low <= p.time_s <= high)
            at_s = [m.stream_time_s - self.lag_s for m in moments]
            return fixes_of(moments, interpolate(Track(points, Clock.VIDEO, self._name), at_s))

    def state(self) -> VehicleState:
        """Return the last position."""
        with self.lock:
            if not self._points:
                return self.with_lag(VehicleState())
            p = self._points[-1]
            fix = GpsFix(p.lat_deg, p.lon_deg, p.alt_m, p.sigma_m)
            return self.with_lag(VehicleState(is_heard=True, fix=fix, sigma_m=p.sigma_m, messages=len(self._points)))
