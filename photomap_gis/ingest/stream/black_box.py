"""The black box: packets of a stream go to disk as they came, unencoded, in pieces that survive a cut.

The thread that reads the stream decides what goes where (so that each frame knows its place in the recording at
once); another one writes, so that a slow disk never holds up the flight. A full disk or queue ends the recording with a
warning; the frames go on.
"""

from __future__ import annotations

import contextlib
import logging
import os
import queue
import shutil
import threading
from bisect import bisect_left, insort
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import av
from av.error import FFmpegError

from photomap_gis.core.live import LiveClock
from photomap_gis.ingest.box_files import TICKS_HZ, VERSION, BoxIndex, FrameRecord, is_recording, read_contents

logger = logging.getLogger(__name__)

_IN_TRANSPORT_STREAM = frozenset({"h264", "hevc", "mpeg1video", "mpeg2video", "mpeg4"})
_OPTIONS = {
    "mpegts": {"flush_packets": "1", "mpegts_copyts": "1", "avoid_negative_ts": "disabled"},
    "matroska": {"flush_packets": "1", "cluster_time_limit": "900"},
}
_RAW = frozenset({"rawvideo", "wrapped_avframe"})
_SUFFIX = {"mpegts": ".ts", "matroska": ".mkv"}
_PIECE_S = 300.0
_JUMP_S = 5.0
_FLUSH_EVERY_S = 1.0
_MAX_WAITING = 900
_MOST_UNTIMED = 60
_USUAL_INTERVAL_S = 1.0 / 30.0
_LEAST_FREE_BYTES = 64 << 20
"""What must stay free: the map's own journal is worth more than the last minutes of video."""


@dataclass(slots=True)
class _Piece:
    """A piece being written: time stamps (in the stream's units) of its video packets, sorted."""

    number: int
    path: Path
    container: Any
    streams: dict[int, Any]
    began_s: float
    last_dts_s: float
    shape: tuple[int, int]
    stamps: list[int] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Place:
    """Where a decoded frame lies in the recording: the piece's file and the frame's rank in it by time stamp."""

    path: Path
    frame_number: int


class BlackBox:
    """A recording being made in a folder; one thread calls it (a context manager). ``problem`` says why it stopped."""

    def __init__(
        self, folder: Path, clock: LiveClock, *, source: str,
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
    ) -> None:  # fmt: skip
        self.folder = folder
        self.problem: str | None = None
        self._clock, self._free_bytes = clock, free_bytes
        # What a session that was cut off has left stays, and what comes now is added to it.
        self._number = _last_piece(folder)
        self._connection = _last_connection(folder)
        self._index = BoxIndex(folder)
        self._open: list[_Piece] = []
        self._untimed: list[Any] = []
        self._template: tuple[Any, tuple[Any, ...]] | None = None
        self._flushed_s = clock.now_s()
        self._jobs: queue.Queue[Callable[[], None] | None] = queue.Queue(_MAX_WAITING)
        self._index.line(
            kind="recording", version=VERSION, source=source, began_utc_s=clock.utc_s(), began_arrival_s=clock.now_s(),
            pid=os.getpid(),
        )  # fmt: skip
        self._index.flush()
        self._thread = threading.Thread(target=self._write, name="photomap black box", daemon=True)
        self._thread.start()

    def __enter__(self) -> BlackBox:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def connect(self, video: Any, data: tuple[Any, ...]) -> None:
        """Begin a connection: its packets have streams, time stamps and a decoder of their own."""
        self._connection += 1
        self._untimed = []
        self._close_piece()
        self._template = (video, data)
        if video.codec_context.name in _RAW and self.problem is None:
            width, height = _shape(video)
            self._stop(
                f"raw pictures of {width} x {height} would fill the disk within minutes (set the device to MJPEG or "
                "H.264 to have them recorded); key frames are kept"
            )

    def packet(self, packet: Any) -> None:
        """Keep one packet of the connection (before it is decoded: the decoder may change it)."""
        if self.problem is not None or self._template is None:
            return
        video = self._template[0]
        copy = av.Packet(bytes(packet))
        copy.pts, copy.dts, copy.time_base = packet.pts, packet.dts, packet.time_base
        copy.is_keyframe, copy.duration = packet.is_keyframe, packet.duration
        if copy.dts is None:
            copy.dts = copy.pts
        if packet.stream is not video:
            self._keep(copy, packet.stream)
            return
        if copy.dts is None:
            # The first packets of an RTP session may tell no time: they go before the first that does.
            if len(self._untimed) < _MOST_UNTIMED:
                self._untimed.append(copy)
            return
        if copy.pts is None:
            copy.pts = copy.dts
        untimed, self._untimed = self._untimed, []
        step = max(1, round(_USUAL_INTERVAL_S / float(copy.time_base)))
        for before, early in zip(range(len(untimed), 0, -1), untimed, strict=True):
            early.pts = early.dts = copy.dts - before * step
            self._keep(early, video)
        self._keep(copy, video)

    def _keep(self, packet: Any, stream: Any) -> None:
        """Give a packet its piece and have it written."""
        assert self._template is not None  # told apart by the caller
        video, data = self._template
        is_video = stream is video
        if is_video and self._needs_piece(packet, video):
            self._close_piece()
            if not self._begin_piece(packet, video, data):
                return
        if not self._open:
            return  # metadata before the first key frame
        piece = self._open[-1]
        target = piece.streams.get(stream.index)
        if target is None:
            return
        if is_video:
            insort(piece.stamps, packet.pts)
            piece.last_dts_s = _dts_s(packet, piece.last_dts_s)
        container, path = piece.container, piece.path
        self._do(lambda: _mux(container, path, target, packet))
        self._flush_now_and_then()

    def frame(self, decoded: Any, stream_time_s: float, arrival_s: float) -> None:
        """Keep when a decoded frame was."""
        ticks = None if decoded.pts is None else round(decoded.pts * decoded.time_base * TICKS_HZ)
        self._stamp(FrameRecord(self._connection, self._number, ticks, stream_time_s, arrival_s))

    def stamp(self, stream_time_s: float, arrival_s: float) -> None:
        """Keep when a frame of a played file or a photo was."""
        self._stamp(FrameRecord(0, 0, None, stream_time_s, arrival_s))
        self._flush_now_and_then()

    def _stamp(self, record: FrameRecord) -> None:
        if self.problem is None:
            self._do(lambda: self._index.frame(record))

    def place_of(self, decoded: Any) -> Place | None:
        """Return where a decoded frame can be read again, ``None`` where it is not in the recording."""
        if self.problem is not None or decoded.pts is None:
            return None
        for piece in reversed(self._open):
            rank = bisect_left(piece.stamps, decoded.pts)
            if rank < len(piece.stamps) and piece.stamps[rank] == decoded.pts:
                return Place(piece.path, rank)
        return None

    def line(self, **what: object) -> None:
        """Keep something else that happened: a file played, a photo read, a gap."""
        if self.problem is None:
            self._do(lambda: self._index.line(**what))
            self._flush_now_and_then()

    def close(self) -> None:
        """Write what waits and close the files; idempotent."""
        if not self._thread.is_alive() and self._jobs.empty():
            return
        if self.problem is None:
            self._close_piece()
            self._do(lambda: self._index.line(kind="end", utc_s=self._clock.utc_s()))
            self._do(self._index.flush)
        self._jobs.put(None)
        self._thread.join()

    def _needs_piece(self, packet: Any, video: Any) -> bool:
        if not self._open or self._open[-1].shape != _shape(video):
            return True
        piece = self._open[-1]
        now_s = _dts_s(packet, piece.last_dts_s)
        if not 0.0 <= now_s - piece.last_dts_s <= _JUMP_S:
            return True  # time stamps that jump make a file that no player gets through
        return bool(packet.is_keyframe) and now_s - piece.began_s > _PIECE_S

    def _begin_piece(self, packet: Any, video: Any, data: tuple[Any, ...]) -> bool:
        self._number += 1
        name = video.codec_context.name
        kind = "mpegts" if name in _IN_TRANSPORT_STREAM else "matroska"
        path = self.folder / f"piece-{self._number:05d}{_SUFFIX[kind]}"
        try:
            container = av.open(str(path), "w", format=kind, options=dict(_OPTIONS[kind]))
            streams = {video.index: container.add_stream_from_template(video)}
            for stream in data if kind == "mpegts" else ():
                with contextlib.suppress(FFmpegError, ValueError):
                    streams[stream.index] = container.add_stream_from_template(stream)
        except (FFmpegError, OSError, ValueError) as error:
            self._stop(f"{path} cannot be written: {error}")
            return False
        now_s = _dts_s(packet, 0.0)
        self._open.append(_Piece(self._number, path, container, streams, now_s, now_s, _shape(video)))
        del self._open[:-2]  # frames of the piece before may still be in the decoder
        width, height = _shape(video)
        self.line(
            kind="piece", number=self._number, file=path.name, connection=self._connection, codec=name,
            width_px=width, height_px=height, utc_s=self._clock.utc_s(), arrival_s=self._clock.now_s(),
            first_pts_s=None if packet.pts is None else float(packet.pts * packet.time_base),
        )  # fmt: skip
        return True

    def _close_piece(self) -> None:
        if self._open and self._open[-1].container is not None:
            container, self._open[-1].container = self._open[-1].container, None
            self._do(container.close)

    def _flush_now_and_then(self) -> None:
        now_s = self._clock.now_s()
        if now_s - self._flushed_s >= _FLUSH_EVERY_S:
            self._flushed_s = now_s
            path = self._open[-1].path if self._open else None
            self._do(lambda: self._flush(path))

    def _flush(self, path: Path | None) -> None:
        self._index.flush()
        if path is not None:
            with contextlib.suppress(FileNotFoundError), path.open("rb") as file:  # begun, nothing written yet
                os.fsync(file.fileno())
        if self._free_bytes(self.folder) < _LEAST_FREE_BYTES:
            raise OSError(28, "No space left on device")

    def _do(self, job: Callable[[], None]) -> None:
        try:
            self._jobs.put_nowait(job)
        except queue.Full:
            self._stop("the disk is too slow for the stream")

    def _stop(self, why: str) -> None:
        if self.problem is None:
            self.problem = f"the recording stopped: {why}; the map goes on without it"
            logger.warning("%s", self.problem)

    def _write(self) -> None:
        """Do the jobs, in the thread of its own, until told to end."""
        while (job := self._jobs.get()) is not None:
            if self.problem is not None:
                continue
            try:
                job()
            except (FFmpegError, OSError, ValueError) as error:
                full = isinstance(error, OSError) and error.errno == 28
                self._stop(f"the disk with {self.folder} is full" if full else f"{self.folder}: {error}")
        for piece in self._open:
            if piece.container is not None:
                with contextlib.suppress(FFmpegError, OSError, ValueError):
                    piece.container.close()
        with contextlib.suppress(OSError):
            self._index.close()


def _mux(container: Any, path: Path, target: Any, packet: Any) -> None:
    packet.stream = target
    if packet.dts is None:
        return
    try:
        container.mux(packet)
    except ValueError as error:  # a time stamp that falls back: that packet is lost, the recording is not
        logger.info("%s: a packet was left out (%s)", path.name, error)


def _shape(video: Any) -> tuple[int, int]:
    return video.codec_context.width, video.codec_context.height


def _dts_s(packet: Any, otherwise: float) -> float:
    stamp = packet.dts if packet.dts is not None else packet.pts
    return otherwise if stamp is None or packet.time_base is None else float(stamp * packet.time_base)


def _last_piece(folder: Path) -> int:
    """The highest number of the pieces that are there: a session that is resumed adds to them."""
    numbers = [p.stem.removeprefix("piece-") for p in folder.glob("piece-*")]
    return max((int(n) for n in numbers if n.isdigit()), default=0)


def _last_connection(folder: Path) -> int:
    if not is_recording(folder):
        return 0
    contents = read_contents(folder)
    named = [int(line.get("connection", 0)) for line in contents.of_kind("piece")]
    return max([0, *named, *(f.connection for f in contents.frames)])
