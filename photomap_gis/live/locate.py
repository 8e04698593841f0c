"""What is known of a frame's place when the loop takes it: from a log that is there, or from telemetry that comes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

from photomap_gis.core.frame import Flight, FlightTrack, FrameRef
from photomap_gis.core.live import FrameMoment, LiveFrame, LiveTelemetry, StreamEvent
from photomap_gis.live.frame_line import placed_as


class Locator(Protocol):
    """Gives a frame what is known of its place, lens and time."""

    def place(self, frame: LiveFrame) -> FrameRef:
        """Return the frame's ref with all of it."""
        ...

    def hear(self, event: StreamEvent) -> None:
        """Take in what the stream itself tells."""
        ...

    @property
    def has_positions(self) -> bool:
        """Whether positions are to be expected."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know."""
        ...


class FromLog:
    """A file's frames by what ``photomap map`` would know of them: its track, lens and clock."""

    def __init__(
        self,
        refs: Sequence[FrameRef],
        *,
        flights: Sequence[Flight] = (),
        tracks: Sequence[FlightTrack] = (),
        warnings: Sequence[str] = (),
    ) -> None:
        self._by_number = {r.frame_number: r for r in refs}
        self.flights, self.tracks, self.warnings = tuple(flights), tuple(tracks), tuple(warnings)
        self.has_positions = any(r.fix is not None for r in refs)

    def place(self, frame: LiveFrame) -> FrameRef:
        """Return what the footage says of the frame."""
        known = self._by_number.get(frame.ref.frame_number)
        return frame.ref if known is None else known

    def hear(self, event: StreamEvent) -> None:
        """Know it from the log already."""


class FromTelemetry:
    """Frames by positions that come while the flight lasts, or by what the frames tell themselves (photos)."""

    def __init__(self, telemetry: LiveTelemetry | None = None) -> None:
        self._telemetry = telemetry
        self._has_told = False

    @property
    def has_positions(self) -> bool:
        """Whether positions have come, or an autopilot was heard."""
        return self._has_told or (self._telemetry is not None and self._telemetry.state().is_heard)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the telemetry has to say."""
        return () if self._telemetry is None else self._telemetry.warnings()

    def hear(self, event: StreamEvent) -> None:
        """Hand on what the stream tells."""
        if self._telemetry is not None:
            self._telemetry.hear(event)

    def place(self, frame: LiveFrame) -> FrameRef:
        """Return the frame's ref with the newest position that is known of it."""
        ref = frame.ref
        if self._telemetry is not None:
            self._telemetry.hear(frame)
            (point,) = self._telemetry.place([FrameMoment(frame.stream_time_s, frame.arrival_s)])
            if point is not None:
                self._has_told = True
                ref = replace(
                    ref, fix=point.fix, height_m=point.height_m if point.height_m is not None else ref.height_m,
                    attitude=point.attitude if point.attitude is not None else ref.attitude,
                )  # fmt: skip
        self._has_told = self._has_told or ref.fix is not None
        return ref


class FromJournal:
    """Frames as a session knew them: what its journal holds of each, by the source's number."""

    has_positions = True
    warnings: tuple[str, ...] = ()

    def __init__(self, lines: Mapping[int, Mapping[str, object]], base: Locator) -> None:
        self._lines, self._base = lines, base

    def place(self, frame: LiveFrame) -> FrameRef:
        """Return the ref with the place that was known then."""
        line = self._lines.get(frame.index)
        return self._base.place(frame) if line is None else placed_as(self._base.place(frame), line.get("p"))

    def hear(self, event: StreamEvent) -> None:
        """Know what was known then."""
