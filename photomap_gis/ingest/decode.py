"""Video files: what they are, when each frame is, and the pixels of those that are wanted.

A frame's number is its rank by presentation time among the packets of the file, so it means the same whoever opens the
file, whatever the container claims of rates and counts.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import av
import numpy as np
import numpy.typing as npt
from av.error import FFmpegError
from av.stream import Disposition

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import ImageArray
from photomap_gis.ingest.telemetry.demux import packets
from photomap_gis.ingest.trouble import Trouble
from photomap_gis.ingest.video_pixels import bgr_of
from photomap_gis.ingest.video_tags import make_and_model, rotation_deg, start_utc_s

logger = logging.getLogger(__name__)

_MAX_PACKETS = 5_000_000
MAX_PIXELS = 200_000_000
_MIN_SEEK_FRAMES = 24
"""Fewer frames than this to the key frame before the wanted one are decoded rather than leapt over."""

_LEADING_PACKETS = 60

_MAX_ERRORS_IN_A_ROW = 200


@dataclass(frozen=True, slots=True)
class VideoInfo:
    """What a video's header tells. ``start_utc_s`` is as the camera wrote it: often local time called UTC.

    ``frame_count`` is the header's, 0 where it tells none; ``rotation_deg`` is for players: the raster is stored
    without it.
    """

    path: Path
    width_px: int
    height_px: int
    rate_hz: float
    frame_count: int
    duration_s: float
    start_utc_s: float | None = None
    make: str = ""
    model: str = ""
    codec: str = ""
    rotation_deg: int = 0
    has_klv: bool = False
    has_subtitles: bool = False
    has_gopro_metadata: bool = False
    size_bytes: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class FrameIndex:
    """Every frame of a video in order of time.

    ``pts`` ``(N,)`` in units of ``time_base_s`` and strictly increasing; ``keys`` the numbers of key frames.
    ``is_counted`` where the file has no usable time stamps: then frames are told apart by counting.
    """

    pts: npt.NDArray[np.int64]
    time_base_s: float
    keys: npt.NDArray[np.int64]
    is_counted: bool = False

    @property
    def times_s(self) -> npt.NDArray[np.float64]:
        """``(N,)`` seconds since the first frame."""
        return (self.pts - self.pts[0]) * self.time_base_s if len(self.pts) else np.empty(0)

    def number_of(self, pts: int) -> int | None:
        """Return the number of the frame at a time stamp, ``None`` where none is near."""
        if not len(self.pts):
            return None
        i = int(np.searchsorted(self.pts, pts))
        near = min((k for k in (i - 1, i) if 0 <= k < len(self.pts)), key=lambda k: abs(int(self.pts[k]) - pts))
        spacing = int(self.pts[-1] - self.pts[0]) / max(len(self.pts) - 1, 1)
        return near if abs(int(self.pts[near]) - pts) <= spacing / 2.0 else None


def probe(path: Path) -> VideoInfo:
    """Return what a video's header tells; ``DataError`` where it is no video that can be read."""
    path = Path(path)
    with open_video(path) as container:
        stream = video_stream(container, path)
        context = stream.codec_context
        kinds = {s.type for s in container.streams}
        rate = stream.average_rate or stream.guessed_rate or 0
        make, model = make_and_model(container.metadata, stream.metadata)
        return VideoInfo(
            path=path,
            width_px=context.width,
            height_px=context.height,
            rate_hz=_sane_rate(float(rate)),
            frame_count=max(0, stream.frames),
            duration_s=_duration_s(container, stream),
            start_utc_s=start_utc_s(container.metadata, stream.metadata),
            make=make,
            model=model,
            codec=context.name,
            rotation_deg=rotation_deg(stream.metadata),
            has_klv="data" in kinds and container.format.name == "mpegts",
            has_subtitles="subtitle" in kinds,
            has_gopro_metadata=any("GoPro MET" in s.metadata.get("handler_name", "") for s in container.streams),
            size_bytes=path.stat().st_size,
        )


def frame_index(path: Path) -> FrameIndex:
    """Return when each frame of a video is, from its packets alone: nothing is decoded."""
    path = Path(path)
    try:
        state = path.stat()
    except OSError as error:
        raise DataError(f"{path}: {error.strerror or error}; check the path and its rights") from error
    return _frame_index(str(path.resolve()), state.st_size, state.st_mtime_ns)


@dataclass(frozen=True, slots=True, eq=False)
class VideoFrame:
    """A frame read from a video: ``image`` ``(H, W, 3)`` BGR, ``None`` where it is damaged or not there.

    ``is_suspect`` tells that the decoder lost data since the last key frame.
    """

    number: int
    image: ImageArray | None
    is_suspect: bool


def read_video_frames(path: Path, frame_numbers: Sequence[int]) -> Iterator[tuple[int, ImageArray | None]]:
    """Yield (number, ``(H, W, 3)`` BGR image) of the wanted frames as ``video_frames`` does."""
    for frame in video_frames(path, frame_numbers):
        yield frame.number, frame.image


def video_frames(path: Path, frame_numbers: Sequence[int]) -> Iterator[VideoFrame]:
    """Yield the wanted frames, ascending, each number once.

    One pass over the file, leaping over long stretches in which nothing is wanted. A frame that is damaged or not there
    has no image; the others are still read.
    """
    path = Path(path)
    numbers = sorted(set(frame_numbers))
    if numbers and numbers[0] < 0:
        raise ValueError(f"frame numbers must not be negative, got {numbers[0]}")
    if not numbers:
        return
    index = frame_index(path)
    with open_video(path) as container:
        reader = _Reader(container, video_stream(container, path), index, frozenset(numbers))
        for number in numbers:
            image = reader.read(number)
            yield VideoFrame(number, image, reader.is_suspect)


def read_video_frame(path: Path, number: int) -> ImageArray | None:
    """Return one frame as ``(H, W, 3)`` BGR, ``None`` where it is damaged or not there."""
    return next(iter(read_video_frames(path, [number])))[1]


class _Reader:
    """A decoder that goes forward to the frames that are asked of it in ascending order."""

    def __init__(self, container: Any, stream: Any, index: FrameIndex, wanted: frozenset[int]) -> None:
        self._container, self._stream = container, stream
        self._index, self._wanted = index, wanted
        self._size = (stream.codec_context.width, stream.codec_context.height)
        self._frames = self._decode()
        self._held: tuple[int, Any, bool] | None = None
        self.is_suspect = False
        """Whether data was missing for the frame read last."""
        self._at = -1
        self._is_after_seek = False
        self._may_seek = not index.is_counted
        stream.thread_type = "AUTO"

    def read(self, number: int) -> ImageArray | None:
        """Return the frame's pixels, ``None`` where it cannot be decoded."""
        if number >= len(self._index.pts):
            return None
        self._leap(number)
        while True:
            if self._held is None:
                self._held = next(self._frames, None)
            if self._held is None:
                return None
            found, frame, is_suspect = self._held
            if found > number:
                if self._is_after_seek:
                    self._rewind()  # the container leapt too far: walk there
                    continue
                return None
            self._is_after_seek = False
            self._held = None
            if found == number:
                self.is_suspect = is_suspect
                return self._image(frame)

    def _leap(self, number: int) -> None:
        """Seek to the key frame before a frame where that saves decoding."""
        if not self._may_seek or (self._held is not None and self._held[0] >= number):
            return
        keys = self._index.keys
        i = int(np.searchsorted(keys, number, side="right")) - 1
        if i < 0 or keys[i] - self._at < _MIN_SEEK_FRAMES:
            return
        try:
            self._container.seek(int(self._index.pts[keys[i]]), stream=self._stream, backward=True)
        except FFmpegError:
            self._may_seek = False
            return
        self._is_after_seek = True
        self._held = None
        self._frames = self._decode()

    def _rewind(self) -> None:
        self._may_seek = self._is_after_seek = False
        self._at = -1
        self._held = None
        try:
            self._container.seek(int(self._index.pts[0]), stream=self._stream, backward=True)
        except FFmpegError:
            logger.warning("cannot rewind %s", self._container.name)
        self._frames = self._decode()

    def _decode(self) -> Iterator[tuple[int, Any, bool]]:
        """Yield (number, decoded frame, whether it is suspect); damaged packets are passed over."""
        context = self._stream.codec_context
        trouble = Trouble()
        counted = -1
        errors = 0
        for packet in packets(self._container, self._stream):
            # A frame that no other refers to need not be decoded where it is not wanted.
            context.skip_frame = "DEFAULT" if self._needs(packet) else "NONREF"
            if packet.is_corrupt:
                trouble.failed()
            try:
                frames = packet.decode()
            except FFmpegError:
                trouble.failed()
                errors += 1
                if errors > _MAX_ERRORS_IN_A_ROW:
                    return
                continue
            for frame in frames:
                errors = 0
                counted += 1
                is_suspect = trouble.of(frame)
                number = counted if self._index.is_counted else self._number_of(frame)
                if number is not None:
                    self._at = number
                    yield number, frame, is_suspect

    def _needs(self, packet: Any) -> bool:
        if self._index.is_counted or packet.pts is None:
            return True
        number = self._index.number_of(packet.pts)
        return number is None or number in self._wanted

    def _number_of(self, frame: Any) -> int | None:
        return self._at + 1 if frame.pts is None else self._index.number_of(frame.pts)

    def _image(self, frame: Any) -> ImageArray | None:
        if frame.is_corrupt or (frame.width, frame.height) != self._size:
            return None
        return bgr_of(frame)


@lru_cache(maxsize=16)
def _frame_index(path: str, size: int, mtime_ns: int) -> FrameIndex:
    """Demux a whole file once; size and time of change are part of the cache's key."""
    stamps: list[int | None] = []
    keys: list[bool] = []
    with open_video(Path(path)) as container:
        stream = video_stream(container, Path(path))
        rate = _sane_rate(float(stream.average_rate or stream.guessed_rate or 0)) or 25.0
        time_base_s = float(stream.time_base) if stream.time_base else 1.0 / rate
        table = _index_of_table(container, stream, time_base_s, size)
    if table is not None:
        return table
    with open_video(Path(path)) as container:
        stream = video_stream(container, Path(path))
        for packet in packets(container, stream):
            if packet.size == 0 or packet.is_discard:
                continue
            stamps.append(packet.pts)
            keys.append(bool(packet.is_keyframe))
            if len(stamps) >= _MAX_PACKETS:
                break
    if not stamps:
        raise DataError(f"{path}: the video holds no frames; it was cut short, copy it again from the card")
    known = [s for s in stamps if s is not None]
    pts, first = np.unique(np.array(known, dtype=np.int64), return_index=True)
    if len(known) < 0.9 * len(stamps) or len(pts) < 0.9 * len(stamps):
        counted = np.arange(len(stamps), dtype=np.int64)
        return FrameIndex(counted, 1.0 / rate, np.flatnonzero(keys), is_counted=True)
    is_key = np.array([k for k, s in zip(keys, stamps, strict=True) if s is not None], dtype=bool)[first]
    return FrameIndex(pts, time_base_s, np.flatnonzero(is_key))


def _index_of_table(container: Any, stream: Any, time_base_s: float, size_bytes: int) -> FrameIndex | None:
    """Return the index from an MP4's own table, without reading gigabytes of pictures; ``None`` where it can't be.

    The table counts in order of decoding. Without frames out of order that is the order of presentation up to a
    constant, which the first packets tell.
    """
    entries = stream.index_entries
    if len(entries) and entries[len(entries) - 1].pos + entries[len(entries) - 1].size > size_bytes:
        return None  # the file was cut short: its packets tell how far it goes
    if "mp4" not in container.format.name or len(entries) < _LEADING_PACKETS or stream.codec_context.has_b_frames:
        return None
    shifts = set()
    for count, packet in enumerate(packets(container, stream)):
        if count >= _LEADING_PACKETS or packet.size == 0:
            break
        if packet.pts is None or packet.dts is None:
            return None
        shifts.add(packet.pts - packet.dts)
    shown = [e for e in entries if not e.is_discard]
    pts = np.array([e.timestamp for e in shown], dtype=np.int64)
    if len(shifts) != 1 or len(pts) < 2 or not (np.diff(pts) > 0).all():
        return None
    is_key = np.array([e.is_keyframe for e in shown], dtype=bool)
    return FrameIndex(pts + shifts.pop(), time_base_s, np.flatnonzero(is_key))


def open_video(path: Path) -> Any:
    """Open a container; ``DataError`` with what to do where it cannot be."""
    try:
        return av.open(str(path), metadata_errors="ignore")
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such file; check the path") from error
    except PermissionError as error:
        raise DataError(f"{path}: may not be read; check its rights") from error
    except (FFmpegError, OSError, ValueError) as error:
        why = "the recording was not closed or copied whole" if _is_unfinished(path) else "it is damaged or no video"
        raise DataError(f"{path}: cannot be opened as a video; {why}: copy it again or repair it") from error


def _is_unfinished(path: Path) -> bool:
    """Whether this is an MP4 whose table of contents, written at the end, is missing."""
    try:
        with path.open("rb") as file:
            return file.read(12)[4:8] == b"ftyp"
    except OSError:
        return False


def video_stream(container: Any, path: Path) -> Any:
    """Return the stream of the recording, not that of a thumbnail."""
    streams = [s for s in container.streams.video if s.codec_context is not None and s.codec_context.width > 0]
    moving = [s for s in streams if Disposition.attached_pic not in s.disposition] or streams
    if not moving:
        raise DataError(f"{path}: holds no video that can be decoded; give the drone's original file")
    stream = max(moving, key=lambda s: (s.frames > 1 or s.frames == 0, s.codec_context.width * s.codec_context.height))
    if stream.codec_context.width * stream.codec_context.height > MAX_PIXELS:
        raise DataError(f"{path}: claims frames of {stream.width} x {stream.height} pixels; the file is damaged")
    return stream


def _sane_rate(rate_hz: float) -> float:
    return rate_hz if math.isfinite(rate_hz) and 0.01 <= rate_hz <= 2000.0 else 0.0


def _duration_s(container: Any, stream: Any) -> float:
    if stream.duration is not None and stream.time_base is not None:
        return max(0.0, float(stream.duration * stream.time_base))
    return max(0.0, container.duration / 1e6) if container.duration is not None else 0.0
