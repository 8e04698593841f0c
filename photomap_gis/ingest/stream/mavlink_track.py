"""An autopilot's messages as they come: where the camera was at any moment of the flight so far. No socket, no clock.

Times are the vehicle's (seconds since its boot); ``boot_to_here_s`` takes them to this machine's clock by the quickest
of its messages, so that what is left over is the least delay of the link. Old messages become points of a track;
only the last seconds are kept as they came.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.core.frame import GpsFix
from photomap_gis.core.live import VehicleState
from photomap_gis.ingest.resample import interpolate
from photomap_gis.ingest.telemetry.tlog import WANTED, Messages, mode_name, points_of_messages
from photomap_gis.ingest.telemetry.track import Clock, Track, TrackPoint

_OPEN_S = 5.0
"""Messages younger than this are kept as they came: a gimbal's may still follow a position."""
_CLOSE_EVERY_S = 2.0
_JOIN_EVERY_S = 0.1
"""How often the newest messages are made points of: at each of thirty frames a second that is a fifth of a core."""
_REACH_S, _FAR_S = 6.0, 20.0
_MIN_STEP_S = 0.1
_MAX_POINTS = 150_000
_REBOOT_S = 5.0
_MAX_OPEN = 20_000
_FIX_WORDS = {0: "none", 1: "none", 2: "2D", 3: "3D", 4: "DGPS", 5: "RTK float", 6: "RTK fixed", 7: "static", 8: "PPP"}
_STATE_KINDS = frozenset({"HEARTBEAT", "EXTENDED_SYS_STATE", "GPS_RAW_INT", "GLOBAL_POSITION_INT", "ATTITUDE"})
KINDS = frozenset(WANTED) | _STATE_KINDS
_FINITE = {
    "ATTITUDE": ("roll", "pitch", "yaw"),
    "GIMBAL_DEVICE_ATTITUDE_STATUS": ("q",),
    "MOUNT_ORIENTATION": ("roll", "pitch", "yaw"),
}
_FIRST_UNIX_US = 946_684_800_000_000
_MAX_SIGMA_M = 1000.0
_UNKNOWN_HEADING = 65_535


def _numbers(value: Any) -> Sequence[float]:
    return value if isinstance(value, list | tuple) else (math.nan,) if value is None else (float(value),)


class MavlinkTrack:
    """A builder with one owner; what comes is told to ``add``, what is known is asked of ``place`` and ``state``."""

    def __init__(self) -> None:
        self.messages = 0
        self.system: int | None = None
        self.others: Counter[int] = Counter()
        self.boot_to_here_s: float | None = None
        self._open = Messages()
        self._open_count = 0
        self._points: list[TrackPoint] = []
        self._times_s: list[float] = []
        self._last_boot_s = 0.0
        self._closed_s = 0.0
        self._last: dict[str, tuple[float, Mapping[str, Any]]] = {}
        self._joined: tuple[TrackPoint, ...] | None = None
        self._joined_s = 0.0

    def add(self, here_s: float, system: int, component: int, kind: str, fields: Mapping[str, Any]) -> None:
        """Take a message in; ``here_s`` is when it came."""
        if kind not in KINDS:
            return
        if self.system is None and (
            (kind == "HEARTBEAT" and fields.get("autopilot") != mavlink.MAV_AUTOPILOT_INVALID)
            or kind in ("GLOBAL_POSITION_INT", "GPS_RAW_INT")
        ):
            self.system = system
        if system != self.system:
            self.others[system] += 1
            return
        if kind == "HEARTBEAT" and fields.get("autopilot") == mavlink.MAV_AUTOPILOT_INVALID:
            return  # a gimbal or camera of the same vehicle
        if not all(math.isfinite(v) for name in _FINITE.get(kind, ()) for v in _numbers(fields.get(name))):
            return
        self.messages += 1
        boot_ms = fields.get("time_boot_ms")
        if boot_ms is not None and kind != "SYSTEM_TIME":
            self._set_clock(here_s, float(boot_ms) / 1e3)
        self._last[kind] = here_s, fields
        if kind not in WANTED or kind in ("HEARTBEAT", "SYSTEM_TIME"):
            return
        if kind in ("GPS_RAW_INT", "CAMERA_TRIGGER", "CAMERA_FEEDBACK"):
            if self.boot_to_here_s is None:
                if kind != "GPS_RAW_INT":
                    return
                self._set_clock(here_s, here_s)  # a receiver alone: its messages' arrival is all there is
            stamp_us = int(fields["time_usec"])
            assert self.boot_to_here_s is not None
            if stamp_us > _FIRST_UNIX_US or stamp_us == 0:
                # UTC, or nothing: when it came, on the vehicle's clock
                fields = {**fields, "time_usec": round((here_s - self.boot_to_here_s) * 1e6)}
        self._open.of[kind].append((here_s, dict(fields)))
        self._open_count += 1
        now_s = self._last_boot_s
        if now_s - self._closed_s > _OPEN_S + _CLOSE_EVERY_S or self._open_count > _MAX_OPEN:
            self._close(now_s - _OPEN_S)

    def place(self, here_s: Sequence[float]) -> list[TrackPoint | None]:
        """Return the camera's place at moments of this machine's clock, as well as is known by now."""
        if self.boot_to_here_s is None:
            return [None] * len(here_s)
        at_s = [t - self.boot_to_here_s for t in here_s]
        if not at_s:
            return []
        reach_s = _REACH_S if self._times_s else _FAR_S
        low, high = min(at_s) - reach_s, max(at_s) + reach_s
        points = self._points[bisect_left(self._times_s, low) : bisect_right(self._times_s, high)]
        if len(points) < 2:  # a slow stream, or none for a while
            points = self._points[bisect_left(self._times_s, low - _FAR_S) : bisect_right(self._times_s, high + _FAR_S)]
        if high > self._closed_s:
            last_s = points[-1].time_s if points else -1e18
            points = points + [p for p in self._newest() if p.time_s > last_s and p.time_s >= low - _FAR_S]
        return interpolate(Track(tuple(points), Clock.BOOT, "mavlink"), at_s)

    def state(self, here_s: float) -> VehicleState:
        """Return what is known of the vehicle."""
        heartbeat, position = self._last.get("HEARTBEAT"), self._last.get("GLOBAL_POSITION_INT")
        receiver, extended = self._last.get("GPS_RAW_INT"), self._last.get("EXTENDED_SYS_STATE")
        newest = max((s for s, _ in self._last.values()), default=None)
        state = VehicleState(is_heard=newest is not None and here_s - newest < 5.0, messages=self.messages)
        if heartbeat is not None:
            fields = heartbeat[1]
            state = replace(
                state,
                mode=mode_name(int(fields["autopilot"]), int(fields["type"]), int(fields["custom_mode"])),
                armed=bool(int(fields["base_mode"]) & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
            )
        if receiver is not None:
            fields = receiver[1]
            accuracy_m = int(fields.get("h_acc", 0)) / 1e3
            satellites = int(fields["satellites_visible"])
            state = replace(
                state,
                gps_fix=_FIX_WORDS.get(int(fields["fix_type"]), "unknown"),
                satellites=None if satellites == 255 else satellites,
                sigma_m=accuracy_m if 0.0 < accuracy_m < _MAX_SIGMA_M else None,
            )
        if extended is not None and int(extended[1]["landed_state"]) in (1, 2):
            state = replace(state, landed=int(extended[1]["landed_state"]) == 1)
        if position is not None:
            fields = position[1]
            lat, lon = int(fields["lat"]) / 1e7, int(fields["lon"]) / 1e7
            known = (abs(lat) > 1e-6 or abs(lon) > 1e-6) and abs(lat) <= 90.0 and abs(lon) <= 180.0
            heading = int(fields.get("hdg", _UNKNOWN_HEADING))
            state = replace(
                state,
                fix_age_s=here_s - position[0],
                fix=GpsFix(lat, lon, int(fields["alt"]) / 1e3) if known else None,
                heading_rad=None if heading == _UNKNOWN_HEADING else heading / 100.0 * 0.017453292519943295,
            )
        return state

    def _set_clock(self, here_s: float, boot_s: float) -> None:
        """Follow the vehicle's clock; a reboot begins it anew, and points so far stay where they are here."""
        ahead_s = here_s - boot_s
        if self.boot_to_here_s is not None and boot_s < self._last_boot_s - _REBOOT_S:
            self._close(self._last_boot_s + 1.0)
            shift_s = self.boot_to_here_s - ahead_s
            self._points = [replace(p, time_s=p.time_s + shift_s) for p in self._points]
            self._times_s = [p.time_s for p in self._points]
            self._open, self._open_count, self._joined = Messages(), 0, None
            self.boot_to_here_s, self._last_boot_s, self._closed_s = ahead_s, boot_s, boot_s
            return
        if self.boot_to_here_s is None:
            self.boot_to_here_s, self._closed_s = ahead_s, boot_s
        self.boot_to_here_s = min(self.boot_to_here_s, ahead_s)
        self._last_boot_s = max(self._last_boot_s, boot_s)

    def _newest(self) -> tuple[TrackPoint, ...]:
        """Return the points of messages that are still open, as they were a moment ago at most."""
        if self._joined is None or self._last_boot_s - self._joined_s >= _JOIN_EVERY_S:
            self._joined, self._joined_s = self._points_open(), self._last_boot_s
        return self._joined

    def _points_open(self) -> tuple[TrackPoint, ...]:
        return points_of_messages(self._open)

    def _close(self, until_s: float) -> None:
        """Make points of what is older than a moment, and forget how it came."""
        last_s = self._times_s[-1] if self._times_s else -1e18
        for point in self._points_open():
            if last_s + _MIN_STEP_S <= point.time_s + 1e-6 and point.time_s <= until_s:
                self._points.append(point)
                self._times_s.append(point.time_s)
                last_s = point.time_s
        if len(self._points) > _MAX_POINTS:
            del self._points[: _MAX_POINTS // 10], self._times_s[: _MAX_POINTS // 10]
        here_s = until_s + (self.boot_to_here_s or 0.0) - _CLOSE_EVERY_S
        kept = Messages()
        for kind, rows in self._open.of.items():
            # the last ones stay in any case: they are what the next are interpolated from
            kept.of[kind] = [r for r in rows if r[0] > here_s][-_MAX_OPEN // 4 :] or rows[-1:]
        self._open = kept
        self._open_count = sum(len(rows) for rows in kept.of.values())
        self._closed_s = until_s
        self._joined = None
