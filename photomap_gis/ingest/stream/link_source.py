"""A stream over a link as a live source: it comes and goes, and comes again by itself."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

from av.error import FFmpegError

from photomap_gis.core.errors import DataError, PhotomapError
from photomap_gis.core.live import EndReason, GapKind, LiveClock, LiveFrame, StreamEnd, StreamEvent, StreamGap
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.stream.addresses import Address
from photomap_gis.ingest.stream.black_box import BlackBox
from photomap_gis.ingest.stream.connect import Connection, Connector, Limits, NobodySendsError, Plain
from photomap_gis.ingest.stream.delivery import Delivery, held_back, pts_s
from photomap_gis.ingest.stream.file_source import set_low_latency
from photomap_gis.ingest.stream.own_address import as_typed_elsewhere, own_address
from photomap_gis.ingest.stream.timeline import Timeline
from photomap_gis.ingest.telemetry.beside import BesidePictures, Timed
from photomap_gis.ingest.trouble import Trouble

_MAX_ERRORS_IN_A_ROW = 50
_LONGEST_NAP_S = 0.2


class LinkSource:
    """A ``FrameSource`` of an address. What nobody answers is told at once; a listener waits for its sender.

    Every connection has a decoder of its own, which begins at its first key frame.
    ``connector`` is FFmpeg's; tests give another. ``realtime``: what has an end is played at its rate.
    """

    is_live = True

    def __init__(
        self, address: Address, options: IngestOptions, clock: LiveClock, *,
        limits: Limits | None = None, connector: Connector | None = None, realtime: bool = True,
    ) -> None:  # fmt: skip
        self._address, self._clock, self._realtime = address, clock, realtime
        self._box: BlackBox | None = None
        self._limits, self._connector = limits or Limits(), connector or Plain()
        self._timeline = Timeline(by_arrival=True)
        self._delivery = Delivery(address.name, self._timeline, options, stem="live")
        self._trouble = Trouble()
        self._closed = threading.Event()
        self._started_utc_s: float | None = None
        self._told_box = False
        self._lost_why = ""
        self._paced_from_s: float | None = None
        self._first: Connection | None = None
        if not address.is_listener:
            self._first = self._connector.connect(address, self._limits)

    def record_into(self, box: BlackBox) -> None:
        """Have all packets kept; before the iteration begins."""
        self._box = box

    @property
    def name(self) -> str:
        """The address without a password."""
        return self._address.name

    @property
    def started_utc_s(self) -> float | None:
        """Unix seconds at which the first frame came."""
        return self._started_utc_s

    def close(self) -> None:
        """End the source when the wait in progress is over (``Limits``)."""
        self._closed.set()
        self._connector.close()

    def __iter__(self) -> Iterator[StreamEvent]:
        """Yield what comes, through lost links, until it is closed, ends or stays away too long."""
        reason, message = EndReason.CLOSED, ""
        retry_s = self._limits.first_retry_s
        silent_since_s: float | None = None  # None until there was a frame, and while they come
        said_waiting = False
        told = ""
        while not self._closed.is_set():
            connection, self._first = self._first, None
            lost = ""
            try:
                if connection is None:
                    if self._address.is_listener and not said_waiting and silent_since_s is None:
                        said_waiting = True
                        where = as_typed_elsewhere(self.name, own_address())
                        yield self._gap(GapKind.WAITING, f"nobody sends yet: have the drone's app send to {where}")
                    connection = self._connector.connect(self._address, self._limits)
            except PhotomapError as error:
                lost = str(error)
                if isinstance(error, NobodySendsError):
                    retry_s = 0.0
                elif isinstance(error, DataError) and lost != told:
                    told = lost  # somebody sends, but nothing that can be shown: the sender can be set right
                    yield self._gap(GapKind.UNUSABLE, lost)
            if connection is not None:
                frames = 0
                with_end = connection.has_end
                for event in self._play(connection, silent_since_s):
                    if isinstance(event, LiveFrame):
                        frames += 1
                        silent_since_s = None
                    yield event
                if with_end and not self._closed.is_set():
                    reason, message = EndReason.END_OF_FILE, f"{self.name} came to its end"
                    break
                if frames:
                    retry_s = self._limits.first_retry_s
                    silent_since_s = self._clock.now_s()
                    if not self._closed.is_set():
                        yield self._gap(GapKind.LINK_LOST, f"{self.name}: {self._lost_why}; trying again")
                lost = self._lost_why
            if self._closed.is_set():
                break
            now_s = self._clock.now_s()
            patience_s = self._limits.give_up_s
            if silent_since_s is None and not self._address.is_listener and self._delivery.index == 0:
                silent_since_s = now_s  # it answered once, in the constructor
            if patience_s is not None and silent_since_s is not None and now_s - silent_since_s >= patience_s:
                reason, message = EndReason.GAVE_UP, f"{self.name}: no frame for {patience_s:g} s ({lost})"
                break
            self._nap(retry_s)
            retry_s = min(max(2.0 * retry_s, self._limits.first_retry_s), self._limits.last_retry_s)
        self._connector.close()
        yield StreamEnd(reason, self._timeline.stream_time_s, self._clock.now_s(), message)

    def _play(self, connection: Connection, silent_since_s: float | None) -> Iterator[StreamEvent]:
        """Yield what one connection brings, until it is lost."""
        video = connection.video
        set_low_latency(video)
        if self._box is not None:
            self._box.connect(video, connection.data)
        self._timeline.restart()
        began_s = self._clock.now_s()
        self._paced_from_s = began_s - self._timeline.stream_time_s if connection.has_end and self._realtime else None
        is_awake = _stands_alone(video)
        said_no_key = False
        damaged, self._trouble = 0, Trouble()
        beside: BesidePictures[bytes] = BesidePictures()
        self._lost_why = "the stream ended"
        try:
            for packet in self._packets(connection):
                arrival_s = self._clock.now_s()
                if packet.stream is not video:
                    if self._box is not None:
                        self._box.packet(packet)
                    data, stamp_s = bytes(packet), pts_s(packet)
                    told = [Timed(data, stamp_s)] if stamp_s is not None else beside.untimed(packet.pos, data)
                    yield from self._metadata(told, arrival_s)
                    continue
                yield from self._metadata(beside.picture(packet.pos, pts_s(packet)), arrival_s)
                if not is_awake and not packet.is_keyframe:
                    late = arrival_s - began_s > self._limits.no_key_frame_s
                    if late and not said_no_key:
                        said_no_key = True
                        yield self._gap(
                            GapKind.NO_KEY_FRAME,
                            f"{self.name}: packets come but no key frame: have the sender make one every second or two",
                        )
                    if not late:
                        continue
                # Some encoders refresh their pictures piece by piece and never send a key frame.
                is_awake = True
                if self._box is not None:
                    self._box.packet(packet)
                if packet.is_corrupt:
                    self._trouble.failed()
                try:
                    decoded_frames = packet.decode()
                except FFmpegError:
                    self._trouble.failed()
                    damaged += 1
                    continue
                if damaged and decoded_frames:
                    yield self._gap(GapKind.DAMAGED, f"{damaged} frames were damaged on their way", lost=damaged)
                    damaged = 0
                for decoded in decoded_frames:
                    yield from self._back(silent_since_s, arrival_s)
                    silent_since_s = None
                    yield from self._frame(decoded, arrival_s)
            if not self._closed.is_set():
                for decoded in held_back(video.codec_context, video.time_base):
                    yield from self._frame(decoded, self._clock.now_s())
        finally:
            connection.close()

    def _metadata(self, told: list[Timed[bytes]], arrival_s: float) -> Iterator[StreamEvent]:
        for data, stamp_s in told:
            yield from self._delivery.metadata(data, arrival_s, self._timeline.at(stamp_s))

    def _back(self, silent_since_s: float | None, arrival_s: float) -> Iterator[StreamEvent]:
        if silent_since_s is not None:
            away_s = arrival_s - silent_since_s
            yield self._gap(GapKind.RECONNECTED, f"{self.name}: frames again after {away_s:.1f} s", duration_s=away_s)

    def _frame(self, decoded: Any, arrival_s: float) -> Iterator[StreamEvent]:
        if self._started_utc_s is None:
            self._started_utc_s = self._clock.utc_s()
        is_suspect = self._trouble.of(decoded)
        moment = self._timeline.place(pts_s(decoded), arrival_s)
        if self._paced_from_s is not None:
            self._nap(self._paced_from_s + moment.stream_time_s - self._clock.now_s())
            arrival_s = self._clock.now_s()
        place = None
        if self._box is not None:
            self._box.frame(decoded, moment.stream_time_s, arrival_s)
            place = self._box.place_of(decoded)
            if self._box.problem is not None and not self._told_box:
                self._told_box = True
                yield self._gap(GapKind.RECORDING_STOPPED, self._box.problem)
        yield from self._delivery.frames(
            decoded, arrival_s, moment=moment,
            time_utc_s=self._started_utc_s + moment.stream_time_s,
            frame_number=None if place is None else place.frame_number,
            source=None if place is None else str(place.path),
            is_suspect=is_suspect,
        )  # fmt: skip

    def _packets(self, connection: Connection) -> Iterator[Any]:
        """Yield packets until none comes for the stall time, the stream ends, or it is damaged without end."""
        wanted = [connection.video, *connection.data]
        errors = 0
        while errors < _MAX_ERRORS_IN_A_ROW and not self._closed.is_set():
            try:
                for packet in connection.container.demux(wanted):
                    errors = 0
                    if packet.size:
                        yield packet
                    if self._closed.is_set():
                        return
                return
            except (FFmpegError, IndexError) as error:
                kind = type(error).__name__
                if kind in ("ExitError", "TimeoutError"):
                    self._lost_why = f"nothing came for {self._limits.stall_s:g} s"
                    return
                if isinstance(error, OSError):
                    self._lost_why = f"the connection broke ({error.strerror or error})"
                    return
                errors += 1
        self._lost_why = "what comes is damaged without end"

    def _gap(self, kind: GapKind, message: str, *, duration_s: float | None = None, lost: int = 0) -> StreamGap:
        gap = StreamGap(kind, self._timeline.stream_time_s, self._clock.now_s(), message, duration_s, lost)
        if self._box is not None:
            self._box.line(
                kind="gap", what=kind.value, frame=self._delivery.index, stream_time_s=gap.stream_time_s,
                arrival_s=gap.arrival_s, duration_s=duration_s, lost=lost, message=message,
            )  # fmt: skip
        return gap

    def _nap(self, seconds: float) -> None:
        until_s = self._clock.now_s() + seconds
        while not self._closed.is_set() and (left_s := until_s - self._clock.now_s()) > 0.0:
            self._clock.sleep(min(left_s, _LONGEST_NAP_S))


def _stands_alone(video: Any) -> bool:
    """Whether every picture of a stream can be decoded by itself (a grabber's raw frames, MJPEG)."""
    codec = video.codec_context.codec
    return codec.name == "wrapped_avframe" or bool(codec.intra_only)
