"""Live telemetry of an autopilot: a passive listener on a link, and the log of what it heard."""

from __future__ import annotations

import struct
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.core.errors import OutputError
from photomap_gis.core.frame import TrackFix
from photomap_gis.core.live import FrameMoment, LiveClock, VehicleState
from photomap_gis.ingest.stream.lagged import Lagged, fixes_of
from photomap_gis.ingest.stream.mavlink_track import MavlinkTrack
from photomap_gis.ingest.stream.stream_clock import StreamClock
from photomap_gis.vehicle_link import Transport, Url, open_transport

_GROUND_STATION = 254, 190
"""Not 255, which ArduPilot's failsafe listens for: a vehicle must not miss us when the map is done."""
_READ_S = 0.2
_BEAT_S = 1.0
_FLUSH_S = 1.0
_STREAM_HZ = 10.0
_ASK_AGAIN_S = 10.0
_STREAMED = (33, 30, 24, 2, 285, 245, 158, 265)


class MavlinkTelemetry(Lagged):
    """An autopilot listened to. Nothing is sent but, where we must call first (udpout, tcp), heartbeats.

    ``request_streams`` asks for messages ten times a second. ``tlog`` keeps every packet with its time.
    """

    def __init__(
        self, url: Url, name: str, clock: LiveClock, *, tlog: Path | None = None, request_streams: bool = False,
        transport: Transport | None = None,
    ) -> None:  # fmt: skip
        super().__init__(name)
        self._clock, self._requests = clock, request_streams
        self._calls = request_streams or url.scheme in ("udpout", "tcp")
        self._track = MavlinkTrack()
        self._stream = StreamClock()
        self._damaged = 0
        self._transport = transport or open_transport(url)
        self._log: BinaryIO | None = None
        if tlog is not None:
            try:
                tlog.parent.mkdir(parents=True, exist_ok=True)
                self._log = tlog.open("ab")
            except OSError as error:
                self._transport.close()
                raise OutputError(f"{tlog} cannot be written: {error.strerror or error}") from error
        self._mav = mavlink.MAVLink(None, *_GROUND_STATION)
        self._mav.robust_parsing = True
        self._ended = threading.Event()
        self._beat_s = self._asked_s = self._flushed_s = -1e9
        self._thread = threading.Thread(target=self._listen, name="photomap mavlink", daemon=True)
        self._thread.start()

    def place(self, moments: Sequence[FrameMoment]) -> tuple[TrackFix | None, ...]:
        """Return where the camera was at each frame."""
        with self.lock:
            self._stream.hear(moments)
            here_s = [self._stream.arrival_s(m.stream_time_s) - self.lag_s for m in moments]
            return fixes_of(moments, self._track.place(here_s))

    def state(self) -> VehicleState:
        """Return what is known of the vehicle now."""
        with self.lock:
            return self.with_lag(replace(self._track.state(self._clock.now_s()), damaged=self._damaged))

    def close(self) -> None:
        """Stop listening."""
        self._ended.set()
        self._thread.join(5.0)

    def _listen(self) -> None:
        """Read the link, in the thread of its own."""
        try:
            while not self._ended.is_set():
                self._call()
                data = self._transport.read(_READ_S)
                if data:
                    self.take(data)
        finally:
            self._transport.close()
            if self._log is not None:
                self._log.close()

    def take(self, data: bytes) -> None:
        """Take bytes of the link in, whatever they are."""
        try:
            messages = self._mav.parse_buffer(data) or ()
        except (mavlink.MAVError, struct.error, ValueError):
            self._mav.buf, self._mav.buf_index = bytearray(), 0
            self._damaged += 1
            return
        here_s = self._clock.now_s()
        for message in messages:
            kind = message.get_type()
            if kind == "BAD_DATA":
                self._damaged += 1
                continue
            if kind.startswith("UNKNOWN"):
                continue  # no checksum of it can be known
            self._keep(message.get_msgbuf(), here_s)
            with self.lock:
                self._track.add(here_s, message.get_srcSystem(), message.get_srcComponent(), kind, _fields(message))
                for system, count in self._track.others.items():
                    if count > 10 and system != _GROUND_STATION[0] and system < 250:
                        self.warn(f"{self._name}: vehicle {self._track.system} is used, also heard: {system}")

    def _keep(self, packet: bytes, here_s: float) -> None:
        if self._log is None:
            return
        try:
            self._log.write(struct.pack(">Q", round(self._clock.utc_s() * 1e6)) + bytes(packet))
            if here_s - self._flushed_s > _FLUSH_S:
                self._flushed_s = here_s
                self._log.flush()
        except OSError as error:
            self._log = None
            with self.lock:
                self.warn(f"the telemetry log stopped: {error.strerror or error}")

    def _call(self) -> None:
        """Say that we are there, and ask for streams, where that is wanted."""
        now_s = self._clock.now_s()
        if self._calls and now_s - self._beat_s >= _BEAT_S:
            self._beat_s = now_s
            self._send(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
                )
            )
        system = self._track.system
        if self._requests and system is not None and now_s - self._asked_s >= _ASK_AGAIN_S:
            self._asked_s = now_s
            for number in _STREAMED:
                self._send(
                    mavlink.MAVLink_command_long_message(
                        system, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, number, 1e6 / _STREAM_HZ, 0, 0, 0, 0, 0
                    )
                )

    def _send(self, message: mavlink.MAVLink_message) -> None:
        self._transport.write(bytes(message.pack(self._mav)), self._track.system or 0)


def _fields(message: mavlink.MAVLink_message) -> dict[str, object]:
    return {name: getattr(message, name) for name in message.get_fieldnames()}
