"""What all live telemetry shares: the lag that was found from the motion, and warnings, each said once."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import replace

from photomap_gis.core.frame import GpsFix, TrackFix
from photomap_gis.core.live import FrameMoment, StreamEvent, VehicleState
from photomap_gis.ingest.telemetry import TrackPoint

_MAX_LAG_S = 30.0


class Lagged:
    """What all telemetry shares: the lag that was found, and warnings, each said once."""

    def __init__(self, name: str) -> None:
        self._name = name
        self.lock = threading.RLock()
        self.lag_s = 0.0
        self.lag_sigma_s: float | None = None
        self._warnings: dict[str, None] = {}

    @property
    def name(self) -> str:
        """Where it comes from."""
        return self._name

    def set_lag(self, lag_s: float, sigma_s: float) -> None:
        """Tell by how much pictures come later than positions, beyond what was told before."""
        with self.lock:
            if abs(self.lag_s + lag_s) > _MAX_LAG_S:
                return  # no link is that slow: the motion was misread
            self.lag_s += lag_s
            self.lag_sigma_s = sigma_s

    def warnings(self) -> tuple[str, ...]:
        """Return what the user should know."""
        with self.lock:
            return tuple(self._warnings)

    def hear(self, event: StreamEvent) -> None:
        """Take note of what the stream tells itself: of no use here."""

    def close(self) -> None:
        """End it."""

    def warn(self, words: str) -> None:
        """Keep a warning."""
        if words not in self._warnings and len(self._warnings) < 100:
            self._warnings[words] = None

    def with_lag(self, state: VehicleState) -> VehicleState:
        """Return a state with what is known of the lag."""
        return replace(state, lag_s=self.lag_s if self.lag_sigma_s is not None else None,
                       lag_sigma_s=self.lag_sigma_s)  # fmt: skip


def fixes_of(moments: Sequence[FrameMoment], points: Sequence[TrackPoint | None]) -> tuple[TrackFix | None, ...]:
    """Return points of a track as places of frames."""
    return tuple(
        None if p is None
        else TrackFix(m.stream_time_s, GpsFix(p.lat_deg, p.lon_deg, p.alt_m, p.sigma_m), p.height_m, p.attitude)
        for m, p in zip(moments, points, strict=True)
    )  # fmt: skip
