"""What a live source yields, in the order in which it came: frames, what the stream itself tells, gaps, an end.

Two clocks: ``stream_time_s`` is the pictures' own (seconds since the first frame, strictly increasing, whatever
the stream's time stamps do), ``arrival_s`` is when this machine had the frame (monotonic seconds of the clock that was
given to the source). Values only; nothing here opens anything.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, Protocol, runtime_checkable

from photomap_gis.core.frame import Attitude, Frame, FrameRef, GpsFix, ImageArray, TrackFix


class Picture(Protocol):
    """The pixels of a frame, converted when they are asked for: most frames of a flight are never wanted in colour."""

    @property
    def bgr(self) -> ImageArray:
        """``(H, W, 3)`` uint8, read-only: the very pixels that a recording of the stream gives."""
        ...

    @property
    def grey(self) -> ImageArray:
        """``(H, W)`` uint8, read-only: brightness over the full range, at a tenth of the cost of ``bgr``."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class LiveFrame:
    """A frame as it came.

    ``ref.index`` counts the frames of the source from 0, also those that nobody takes; ``ref.pts_s`` is the stream
    time; ``ref.frame_number`` its rank within ``ref.source`` (a file, or the recording) where that can be read again.
    ``ref.fix``, ``ref.attitude`` and ``ref.time_s`` are set where the picture itself tells them (photos).
    ``is_suspect`` tells that the decoder lost data since the last key frame: parts of the picture may be its guess.
    """

    ref: FrameRef
    picture: Picture
    arrival_s: float
    is_suspect: bool = False

    @property
    def index(self) -> int:
        """The frame's number within the source."""
        return self.ref.index

    @property
    def stream_time_s(self) -> float:
        """Seconds since the source's first frame."""
        return self.ref.pts_s or 0.0

    @property
    def image(self) -> ImageArray:
        """``(H, W, 3)`` BGR uint8, read-only."""
        return self.picture.bgr

    @property
    def grey(self) -> ImageArray:
        """``(H, W)`` uint8, read-only."""
        return self.picture.grey

    @property
    def frame(self) -> Frame:
        """The frame as the rooms that work on pictures take it."""
        return Frame(self.ref, self.image)


class GapKind(StrEnum):
    """Why the frames do not simply go on."""

    WAITING = "waiting"
    """Nobody sends yet; ``message`` says to which address they should."""
    LINK_LOST = "link_lost"
    """Nothing came for too long, or the connection ended; the source tries again by itself."""
    RECONNECTED = "reconnected"
    """Frames come again after ``duration_s``."""
    DAMAGED = "damaged"
    """``frames_lost`` frames could not be decoded."""
    TIME_JUMP = "time_jump"
    """The stream's time stamps jumped or began anew; the stream time goes on by the clock of arrival."""
    SIZE_CHANGED = "size_changed"
    """Frames have another size from here on."""
    NO_KEY_FRAME = "no_key_frame"
    """Packets come, but no key frame from which decoding could begin."""
    UNUSABLE = "unusable"
    """Something comes, but no video that is understood; the source goes on trying."""
    FILE_LEFT_OUT = "file_left_out"
    """A file of a watched folder could not be read."""
    RECORDING_STOPPED = "recording_stopped"
    """The black box cannot be written any more (a full disk); the frames go on."""


@dataclass(frozen=True, slots=True)
class StreamGap:
    """Something happened between two frames; ``stream_time_s`` is that of the last frame before (0 before the first).

    ``duration_s`` is how long it lasted by the clock of arrival, ``None`` where it is not over or has no length.
    """

    kind: GapKind
    stream_time_s: float
    arrival_s: float
    message: str
    duration_s: float | None = None
    frames_lost: int = 0


class EndReason(StrEnum):
    """Why nothing more comes."""

    END_OF_FILE = "end_of_file"
    CLOSED = "closed"
    GAVE_UP = "gave_up"


@dataclass(frozen=True, slots=True)
class StreamEnd:
    """The last thing that a source yields."""

    reason: EndReason
    stream_time_s: float
    arrival_s: float
    message: str = ""


@dataclass(frozen=True, slots=True)
class StreamFix:
    """Where the camera was as the stream itself tells (MISB metadata), on the stream's own clock.

    ``utc_s`` is the packet's precision time stamp (Unix seconds), ``None`` where it has none.
    """

    stream_time_s: float
    arrival_s: float
    fix: GpsFix
    utc_s: float | None = None
    height_m: float | None = None
    attitude: Attitude | None = None
    hfov_rad: float | None = None


@dataclass(frozen=True, slots=True)
class StreamRenamed:
    """A photo that was read before has another name now: its pixels are to be found there."""

    path: str
    to: str


StreamEvent = LiveFrame | StreamFix | StreamGap | StreamRenamed | StreamEnd


@runtime_checkable
class FrameSource(Protocol):
    """A source of frames: iterate over it once, in one thread. ``close`` may be called from any other.

    Iteration blocks until something comes, never for longer than the source's own time limits, and ends after a
    ``StreamEnd``. Nothing is dropped by the source: who cannot follow must drop frames himself.
    """

    @property
    def name(self) -> str:
        """The source as a person knows it, without passwords."""
        ...

    @property
    def is_live(self) -> bool:
        """Whether frames come by themselves: a file that is played as fast as possible waits for its reader."""
        ...

    @property
    def started_utc_s(self) -> float | None:
        """Unix seconds of stream time 0: the file's own clock, this machine's for a stream; ``None`` if unknown."""
        ...

    def __iter__(self) -> Iterator[StreamEvent]:
        """Yield what comes."""
        ...

    def close(self) -> None:
        """End the source soon; idempotent."""
        ...


class LiveClock(Protocol):
    """The clock of a source: tests give one that never waits."""

    def now_s(self) -> float:
        """Return monotonic seconds."""
        ...

    def utc_s(self) -> float:
        """Return Unix seconds."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait so long."""
        ...


class FrameMoment(NamedTuple):
    """When a frame was, on both clocks: what telemetry needs to find its place."""

    stream_time_s: float
    arrival_s: float


@dataclass(frozen=True, slots=True)
class VehicleState:
    """What is known of the vehicle now; ``None`` where it does not say.

    ``fix_age_s`` is how long ago the last position came, by the clock of arrival; ``sigma_m`` the receiver's own
    horizontal one-sigma. ``lag_s`` is by how much pictures come later than positions (found from the motion, with
    ``lag_sigma_s``; ``None`` until it is known). ``is_heard`` tells whether anything came lately.
    """

    is_heard: bool = False
    mode: str | None = None
    armed: bool | None = None
    landed: bool | None = None
    gps_fix: str | None = None
    satellites: int | None = None
    sigma_m: float | None = None
    fix_age_s: float | None = None
    fix: GpsFix | None = None
    heading_rad: float | None = None
    lag_s: float | None = None
    lag_sigma_s: float | None = None
    messages: int = 0
    damaged: int = 0


@runtime_checkable
class LiveTelemetry(Protocol):
    """Positions that come while the flight lasts, from a log that grows, an autopilot, or the stream itself.

    All methods may be called from any thread.
    """

    @property
    def name(self) -> str:
        """Where it comes from, as a person knows it."""
        ...

    def place(self, moments: Sequence[FrameMoment]) -> tuple[TrackFix | None, ...]:
        """Return where the camera was at each frame as well as is known by now; ``None`` where nothing is.

        ``TrackFix.time_s`` is the frame's stream time. Asked again later the answer may be better: positions on both
        sides of the frame have come, and the lag is known.
        """
        ...

    def state(self) -> VehicleState:
        """Return what is known of the vehicle now."""
        ...

    def set_lag(self, lag_s: float, sigma_s: float) -> None:
        """Tell by how much pictures come later than positions (added to what was told before)."""
        ...

    def hear(self, event: StreamEvent) -> None:
        """Take note of what the source yields: streams and photos may tell their places themselves."""
        ...

    def warnings(self) -> tuple[str, ...]:
        """Return what the user should know, each once."""
        ...

    def close(self) -> None:
        """End it; idempotent."""
        ...
