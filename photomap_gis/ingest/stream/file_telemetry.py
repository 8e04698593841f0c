"""Live telemetry of a log on the disk, whole or still being written."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median

import numpy as np

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import GpsFix, TrackFix
from photomap_gis.core.live import FrameMoment, VehicleState
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.resample import interpolate
from photomap_gis.ingest.stream.lagged import Lagged, fixes_of
from photomap_gis.ingest.sync import place_frames
from photomap_gis.ingest.telemetry import Track, read_track
from photomap_gis.ingest.telemetry.track import Clock

logger = logging.getLogger(__name__)

_POLL_S = 1.0
_FRESH_S = 5.0


class FileTelemetry(Lagged):
    """A log on the disk; ``follow`` reads it again as it grows.

    ``started_utc_s`` tells when stream time 0 was, as far as that is known by then; ``span_s`` is how long the played
    recording lasts, ``None`` for a stream.
    """

    def __init__(
        self, path: Path, options: IngestOptions, *, started_utc_s: Callable[[], float | None], span_s: float | None,
        follow: bool,
    ) -> None:  # fmt: skip
        super().__init__(path.name)
        self._path, self._options = path, options
        self._started, self._span_s = started_utc_s, span_s
        self._to_track_s: float | None = None
        self._ended = threading.Event()
        self._stat: tuple[int, int] | None = None
        self._track: Track | None = None
        self._grew_s = -1e9
        try:
            self._read()
        except DataError:
            if not follow:
                raise
            # a log that begins with the flight may be empty yet
        if follow:
            threading.Thread(target=self._follow, name="photomap log", daemon=True).start()

    def place(self, moments: Sequence[FrameMoment]) -> tuple[TrackFix | None, ...]:
        """Return where the camera was at each frame."""
        with self.lock:
            if self._track is None or not self._track.points:
                return (None,) * len(moments)
            shift_s = self._shift_s(self._track)
            if shift_s is None:
                return (None,) * len(moments)
            at_s = [m.stream_time_s + shift_s - self.lag_s for m in moments]
            return fixes_of(moments, interpolate(self._track, at_s))

    def state(self) -> VehicleState:
        """Return what the log's last record says."""
        with self.lock:
            point = self._track.points[-1] if self._track is not None and self._track.points else None
            if point is None:
                return self.with_lag(VehicleState())
            assert self._track is not None
            mode = self._track.modes[-1].name if self._track.modes else None
            age_s = time.monotonic() - self._grew_s
            return self.with_lag(
                VehicleState(
                    is_heard=age_s < _FRESH_S, mode=mode, sigma_m=point.sigma_m, fix_age_s=age_s,
                    fix=GpsFix(point.lat_deg, point.lon_deg, point.alt_m, point.sigma_m),
                    messages=len(self._track.points),
                )
            )  # fmt: skip

    def close(self) -> None:
        """Stop following."""
        self._ended.set()

    def look(self) -> bool:
        """Read the log again where it has changed, and say whether it has."""
        try:
            state = self._path.stat()
        except OSError:
            return False
        if (state.st_size, state.st_mtime_ns) == self._stat:
            return False
        try:
            self._read()
        except DataError as error:
            logger.info("%s: %s", self._path, error)
            return False
        return True

    def _follow(self) -> None:
        pause_s = _POLL_S
        while not self._ended.wait(pause_s):
            began_s = time.monotonic()
            self.look()
            # a log of hours takes its time to read: never more than a tenth of a processor
            pause_s = max(_POLL_S, 10.0 * (time.monotonic() - began_s))

    def _read(self) -> None:
        try:
            state = self._path.stat()
            self._stat = state.st_size, state.st_mtime_ns
        except OSError:
            pass  # told by the reader
        track = read_track(self._path, srt_order=self._options.srt_order)
        with self.lock:
            for warning in track.warnings:
                self.warn(warning)
            if self._track is None or len(track.points) > len(self._track.points):
                self._grew_s = time.monotonic()
            self._track = track

    def _shift_s(self, track: Track) -> float | None:
        """Return what to add to a stream time to reach the track's clock; ``None`` while it cannot be known."""
        if self._to_track_s is not None:
            return self._to_track_s
        started_s = self._started()
        if self._span_s is not None:
            times_s = np.linspace(0.0, self._span_s, 50).tolist()
            try:
                placed = place_frames(times_s, track, start_utc_s=started_s, options=self._options,
                                      length_s=self._span_s)  # fmt: skip
            except DataError as error:
                self.warn(str(error))
                return None
            for warning in placed.warnings:
                self.warn(warning)
            apart = [p.time_s - t for t, p in zip(times_s, placed.points, strict=True) if p is not None]
            self._to_track_s = median(apart)
            return self._to_track_s
        forced_s = self._options.track_offset_s
        if track.clock is Clock.VIDEO:
            self._to_track_s = -(forced_s or 0.0)
        elif track.clock is Clock.BOOT or started_s is None:
            if forced_s is None:
                self.warn(
                    f"{self._path.name}: its clock counts from nothing that is known; --track-offset SECONDS sets it"
                )
                return None
            self._to_track_s = track.points[0].time_s - forced_s
        else:
            # A log that grows ends about now: whole quarter hours between are time zones.
            ahead_s = 0.0 if forced_s is not None else 900.0 * round((time.time() - track.points[-1].time_s) / 900.0)
            inside = track.points[0].time_s - 60.0 <= started_s <= track.points[-1].time_s + 600.0
            self._to_track_s = started_s - (forced_s or 0.0) - (0.0 if inside else ahead_s)
        return self._to_track_s
