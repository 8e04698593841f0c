"""Memory over a long flight: a video flown again and again as fast as possible, each time on from where it was."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from photomap_gis.core.live import EndReason, LiveFrame, StreamEnd, StreamEvent
from photomap_gis.ingest.stream import open_stream
from photomap_gis.live.flight import Flight
from photomap_gis.live.locate import FromTelemetry
from photomap_gis.live.opening import begin_session
from photomap_gis.live.options import LiveOptions

from ..registration.report import Bar, Figure, Section
from ..registration.score import Interval
from .flights import RATE_HZ, video_of


class Laps:
    """A file's frames lap after lap: forth and back, as a drone on patrol sees the ground."""

    name, is_live, started_utc_s = "laps", False, None

    def __init__(self, video: Path, frames: int) -> None:
        self._video, self._frames = video, frames
        self._closed = False
        self.rss_mib: list[tuple[int, float]] = []

    def __iter__(self) -> Iterator[StreamEvent]:
        count, at_s = 0, 0.0
        while count < self._frames and not self._closed:
            for event in open_stream(self._video, realtime=False):
                if not isinstance(event, LiveFrame):
                    continue
                if count >= self._frames or self._closed:
                    break
                if count % max(1, self._frames // 40) == 0:
                    self.rss_mib.append((count, resident_mib()))
                ref = replace(event.ref, index=count, frame_number=count, pts_s=at_s)
                yield LiveFrame(ref, event.picture, at_s)
                count, at_s = count + 1, at_s + 1.0 / RATE_HZ
        yield StreamEnd(EndReason.END_OF_FILE, at_s, at_s)

    def close(self) -> None:
        self._closed = True


def measure(folder: Path, *, frames: int, seconds: int = 40) -> Section:
    """Fly so many frames and watch the process grow."""
    video = video_of(folder, seconds)
    mission = folder / "mission-memory"
    shutil.rmtree(mission, ignore_errors=True)
    laps = Laps(video, frames)
    ready = begin_session("laps", mission, laps, LiveOptions(), None)
    with Flight(replace(ready, locator=FromTelemetry()), laps, realtime=False) as flight:
        flight.fly()
        keys = len(flight.session.loop.chart)
    early = max(mib for n, mib in laps.rss_mib if n <= frames / 6)
    late = max(mib for _, mib in laps.rss_mib)
    return Section(
        "memory",
        (
            Figure("resident after a sixth of the flight", Interval(early, early, early), keys, ""),
            Figure("resident at most, MiB", Interval(late, late, late), keys, "", Bar(high=2048.0)),
            Figure("growth since a sixth of the flight", Interval(late / early, 0.0, 0.0), keys, "x", Bar(high=1.1)),
        ),
        notes=(f"{frames} frames, {keys} key frames, no positions: the ground is the same lap after lap",),
        data={"rss_mib": laps.rss_mib},
    )


def resident_mib() -> float:
    """Return this process's resident memory."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return float(line.split()[1]) / 1024.0
    return float("nan")
