"""A video file as a live source: played at its own rate, or as fast as it is read."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from av.error import FFmpegError

from photomap_gis.core.live import EndReason, GapKind, LiveClock, StreamEnd, StreamEvent, StreamGap
from photomap_gis.ingest.decode import frame_index, open_video, probe, video_stream
from photomap_gis.ingest.lenses import LensFacts
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.stream.delivery import Delivery, pts_s
from photomap_gis.ingest.stream.timeline import Timeline
from photomap_gis.ingest.telemetry.demux import packets
from photomap_gis.ingest.trouble import Trouble

_LONGEST_NAP_S = 0.2
_DECODING_THREADS = 2


class FileSource:
    """A ``FrameSource`` of one video file. Frame numbers are those that ``photomap map`` gives the same file."""

    is_live: bool

    def __init__(self, path: Path, options: IngestOptions, clock: LiveClock, *, realtime: bool) -> None:
        self._path, self._options, self._clock = path, options, clock
        self.is_live = realtime
        self._info = probe(path)
        self._index = frame_index(path)
        self._closed = threading.Event()

    @property
    def name(self) -> str:
        """The file's name."""
        return self._path.name

    @property
    def started_utc_s(self) -> float | None:
        """Unix seconds of the first frame by the camera's clock."""
        return self._info.start_utc_s

    @property
    def span_s(self) -> float:
        """From the first frame to the last, in seconds."""
        return float(self._index.times_s[-1])

    def close(self) -> None:
        """End the source before the next frame."""
        self._closed.set()

    def __iter__(self) -> Iterator[StreamEvent]:
        """Yield the file's frames and metadata."""
        info = self._info
        timeline = Timeline(by_arrival=False, interval_s=1.0 / info.rate_hz if info.rate_hz else 0.0)
        delivery = Delivery(
            str(self._path), timeline, self._options, stem=self._path.stem,
            lens=LensFacts(make=info.make, model=info.model),
        )  # fmt: skip
        began_s: float | None = None
        counted = -1
        damaged, trouble = 0, Trouble()
        with open_video(self._path) as container:
            stream = video_stream(container, self._path)
            set_low_latency(stream)
            wanted = [stream, *(s for s in container.streams if s.type == "data")]
            for packet in packets(container, wanted):
                if self._closed.is_set():
                    break
                if packet.stream is not stream:
                    yield from delivery.metadata(bytes(packet), self._clock.now_s(), self._second(packet))
                    continue
                if packet.is_corrupt:
                    trouble.failed()
                try:
                    frames = packet.decode()
                except FFmpegError:
                    trouble.failed()
                    damaged += 1
                    continue
                if damaged and frames:
                    yield self._damage(damaged, timeline)
                    damaged = 0
                for decoded in frames:
                    counted += 1
                    is_suspect = trouble.of(decoded)
                    if began_s is None:
                        began_s = self._clock.now_s()
                    if self.is_live:
                        self._wait_for(decoded, began_s)
                        if self._closed.is_set():
                            break
                    number = counted if self._index.is_counted else self._number(decoded)
                    started = info.start_utc_s
                    told_s = self._second(decoded)
                    yield from delivery.frames(
                        decoded, self._clock.now_s(), frame_number=number,
                        time_utc_s=None if started is None or told_s is None else started + told_s,
                        is_suspect=is_suspect,
                    )  # fmt: skip
        if damaged:
            yield self._damage(damaged, timeline)
        closed = self._closed.is_set()
        yield StreamEnd(
            EndReason.CLOSED if closed else EndReason.END_OF_FILE,
            timeline.stream_time_s,
            self._clock.now_s(),
            "" if closed else f"{self._path.name} was played to its end",
        )

    def _damage(self, count: int, timeline: Timeline) -> StreamGap:
        return StreamGap(
            GapKind.DAMAGED, timeline.stream_time_s, self._clock.now_s(),
            f"{count} frames of {self._path.name} are damaged", frames_lost=count,
        )  # fmt: skip

    def _number(self, decoded: Any) -> int | None:
        return None if decoded.pts is None else self._index.number_of(decoded.pts)

    def _second(self, decoded: Any) -> float | None:
        """Seconds since the first frame by the file's time stamps."""
        told = pts_s(decoded)
        return None if told is None else told - float(self._index.pts[0]) * self._index.time_base_s

    def _wait_for(self, decoded: Any, began_s: float) -> None:
        due_s = began_s + (self._second(decoded) or 0.0)
        while not self._closed.is_set():
            left_s = due_s - self._clock.now_s()
            if left_s <= 0.0:
                return
            self._clock.sleep(min(left_s, _LONGEST_NAP_S))


def set_low_latency(stream: Any) -> None:
    """Have a decoder return each frame at once: threads that work on frames hold back one frame each."""
    stream.thread_type = "SLICE"
    stream.codec_context.thread_count = _DECODING_THREADS
