"""A black box read back: the same frames, stream times and gaps as when the drone flew."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
from av.error import FFmpegError

from photomap_gis.core.errors import DataError
from photomap_gis.core.live import EndReason, GapKind, LiveClock, LiveFrame, StreamEnd, StreamEvent, StreamGap
from photomap_gis.ingest.box_files import TICKS_HZ, BoxContents, FrameRecord, piece_path, read_contents, started_utc_s
from photomap_gis.ingest.decode import frame_index
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.photos import photo_footage
from photomap_gis.ingest.stills import read_photo
from photomap_gis.ingest.stream.delivery import Delivery, held_back, pts_s
from photomap_gis.ingest.stream.file_source import FileSource, set_low_latency
from photomap_gis.ingest.stream.picture import ArrayPicture
from photomap_gis.ingest.stream.timeline import Moment, Timeline
from photomap_gis.ingest.telemetry.demux import packets

logger = logging.getLogger(__name__)

_LONGEST_NAP_S = 0.2


class RecordedSource:
    """A ``FrameSource`` of a recording's folder, played at the pace of its arrivals or as fast as it is read.

    Arrival times are those of the flight (the clock of that machine). Where a cut lost the last second of the index,
    frames that are there get stream times by their time stamps.
    """

    def __init__(self, folder: Path, options: IngestOptions, clock: LiveClock, *, realtime: bool) -> None:
        self._folder, self._options, self._clock = folder, options, clock
        self.is_live = realtime
        self._contents = read_contents(folder)
        if not any(self._contents.of_kind(kind) for kind in ("piece", "file", "photo")):
            raise DataError(f"{folder}: nothing was recorded: no frame had come")
        self._closed = threading.Event()

    @property
    def name(self) -> str:
        """What was recorded."""
        return str(self._contents.begun.get("source") or self._folder.name)

    @property
    def started_utc_s(self) -> float | None:
        """Unix seconds of stream time 0."""
        return started_utc_s(self._contents)

    def close(self) -> None:
        """End the source before the next frame."""
        self._closed.set()

    def __iter__(self) -> Iterator[StreamEvent]:
        """Yield what was recorded."""
        began_s: float | None = None
        last_s = arrival_s = 0.0
        for event in _events(self._contents, self._options, self._clock):
            if self._closed.is_set():
                break
            if isinstance(event, LiveFrame):
                last_s, arrival_s = event.stream_time_s, event.arrival_s
                if self.is_live:
                    began_s = self._clock.now_s() - last_s if began_s is None else began_s
                    self._wait_until(began_s + last_s)
            yield event
        closed = self._closed.is_set()
        yield StreamEnd(
            EndReason.CLOSED if closed else EndReason.END_OF_FILE, last_s, arrival_s,
            "" if closed else f"the recording of {self.name} ends here",
        )  # fmt: skip

    def _wait_until(self, due_s: float) -> None:
        while not self._closed.is_set() and (left_s := due_s - self._clock.now_s()) > 0.0:
            self._clock.sleep(min(left_s, _LONGEST_NAP_S))


class _Records:
    """The frames' records in order, and what follows from the last one where they end too soon."""

    def __init__(self, contents: BoxContents) -> None:
        self._left = list(reversed(contents.frames))
        self._is_whole = contents.lines[-1]["kind"] == "end"
        self._last: tuple[FrameRecord, float | None] | None = None

    def next(self, connection: int, pts: float | None) -> FrameRecord | None:
        """Return the record of a decoded frame, ``None`` for one that nobody saw."""
        while self._left and self._left[-1].connection == connection:
            record = self._left.pop()
            ticks = None if pts is None else round(pts * TICKS_HZ)
            self._last = record, pts
            if record.pts_ticks is None or ticks is None or _alike(record.pts_ticks, ticks):
                return record
        if self._left or self._is_whole or self._last is None:
            return None
        record, then = self._last
        step_s = 1.0 / 30.0 if pts is None or then is None or not 0.0 < pts - then < 5.0 else pts - then
        guessed = replace(record, stream_time_s=record.stream_time_s + step_s, arrival_s=record.arrival_s + step_s)
        self._last = guessed, pts
        return guessed


def _alike(a: int, b: int) -> bool:
    """Whether two time stamps agree to a millisecond, the 33 bits of a transport stream apart."""
    return abs((a - b + (1 << 32)) % (1 << 33) - (1 << 32)) <= TICKS_HZ // 1000


def _events(contents: BoxContents, options: IngestOptions, clock: LiveClock) -> Iterator[StreamEvent]:
    """Yield frames, metadata and gaps in their order."""
    records = _Records(contents)
    delivery = Delivery(str(contents.folder), Timeline(by_arrival=False), options, stem="live")
    gaps = [g for line in contents.of_kind("gap") if (g := _gap(line)) is not None]
    used = [line for line in contents.lines if line["kind"] in ("piece", "file", "photo")]
    at = 0
    while at < len(used):
        line = used[at]
        run = [line]
        if line["kind"] == "piece":  # pieces of one connection share a decoder
            while at + len(run) < len(used) and used[at + len(run)].get("connection") == line.get("connection"):
                run.append(used[at + len(run)])
            events = _of_connection(contents.folder, run, delivery, records)
        elif line["kind"] == "file":
            events = _of_file(line, options, clock, records)
        else:
            events = _of_photo(line, options)
        for event in events:
            if isinstance(event, LiveFrame):
                while gaps and gaps[0][0] <= event.index:
                    yield gaps.pop(0)[1]
            if not isinstance(event, StreamEnd):
                yield event
        at += len(run)
    for _, gap in gaps:
        yield gap


def _of_connection(
    folder: Path, lines: Sequence[Mapping[str, Any]], delivery: Delivery, records: _Records
) -> Iterator[StreamEvent]:
    """Yield the frames of one connection: its pieces go through one decoder, as they did."""
    decoder: Any = None
    time_base: Any = None
    last: Path | None = None
    held: list[Any] = []  # the decoder lives in the first piece's container
    connection = int(lines[0].get("connection", 0))
    try:
        for line in lines:
            path = piece_path(folder, line)
            if path is None:
                logger.warning("%s: a piece of the recording is missing: %s", folder, line.get("file"))
                continue
            try:
                container = av.open(str(path), metadata_errors="ignore")
            except (FFmpegError, OSError) as error:
                logger.warning("%s: cannot be read (%s)", path, error)
                continue
            held.append(container)
            video = next(iter(container.streams.video), None)
            if video is None:
                continue
            if decoder is None:
                set_low_latency(video)
                decoder = video.codec_context
            time_base, last = video.time_base, path
            yield from _of_piece(container, video, decoder, path, connection, delivery, records)
            if len(held) > 1:
                held.pop().close()
        if decoder is not None:
            yield from _frames(held_back(decoder, time_base), last, connection, delivery, records)
    finally:
        for container in held:
            container.close()


def _of_piece(
    container: Any, video: Any, decoder: Any, path: Path, connection: int, delivery: Delivery, records: _Records
) -> Iterator[StreamEvent]:
    wanted = [video, *(s for s in container.streams if s.type == "data")]
    for packet in packets(container, wanted):
        if not packet.size:
            continue
        if packet.stream is not video:
            yield from delivery.metadata(bytes(packet), clock_of(delivery))
            continue
        yield from _frames(_decoded(decoder, packet), path, connection, delivery, records)


def clock_of(delivery: Delivery) -> float:
    """The arrival that metadata is given: the stream time stands in for it."""
    return delivery.timeline.stream_time_s


def _decoded(decoder: Any, packet: Any) -> list[Any]:
    try:
        return list(decoder.decode(packet))
    except (FFmpegError, EOFError):
        return []


def _frames(
    decoded_frames: Sequence[Any], path: Path | None, connection: int, delivery: Delivery, records: _Records
) -> Iterator[LiveFrame | StreamGap]:
    for decoded in decoded_frames:
        record = records.next(connection, pts_s(decoded))
        if record is None:
            continue
        delivery.timeline.place(None, record.arrival_s)
        number = None
        if path is not None and decoded.pts is not None:
            number = frame_index(path).number_of(decoded.pts)
        yield from delivery.frames(
            decoded, record.arrival_s, moment=Moment(record.stream_time_s), frame_number=number,
            source=None if path is None else str(path),
        )  # fmt: skip


def _of_file(
    line: Mapping[str, Any], options: IngestOptions, clock: LiveClock, records: _Records
) -> Iterator[StreamEvent]:
    """Yield a played file's frames as far as they were played."""
    path = Path(str(line.get("path")))
    for event in FileSource(path, options, clock, realtime=False):
        if isinstance(event, LiveFrame):
            record = records.next(0, None)
            if record is None:
                return
            yield replace(event, arrival_s=record.arrival_s)
        else:
            yield event


def _of_photo(line: Mapping[str, Any], options: IngestOptions) -> Iterator[StreamEvent]:
    path = Path(str(line.get("path")))
    arrival_s, stream_s = float(line.get("arrival_s", 0.0)), float(line.get("stream_time_s", 0.0))
    try:
        ref = photo_footage([path], options).frames[0]
        ref = replace(ref, index=int(line.get("index", 0)), pts_s=stream_s)
        yield LiveFrame(ref, ArrayPicture(read_photo(ref).image), arrival_s)
    except DataError as error:
        yield StreamGap(GapKind.FILE_LEFT_OUT, stream_s, arrival_s, str(error), frames_lost=1)


def _gap(line: Mapping[str, Any]) -> tuple[int, StreamGap] | None:
    try:
        duration = line.get("duration_s")
        return int(line["frame"]), StreamGap(
            GapKind(line["what"]), float(line["stream_time_s"]), float(line["arrival_s"]), str(line["message"]),
            None if duration is None else float(duration), int(line.get("lost", 0)),
        )  # fmt: skip
    except (KeyError, ValueError, TypeError):
        return None
