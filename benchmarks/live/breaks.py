"""One flight with everything that goes wrong in it: bursts of error frames, a lost link, a long loss of GPS.

The flight's truth is known. It is flown whole and broken; both live maps are exported and laid over the true ground:
one piece, as right as the unbroken one, nothing torn, every break told when it began and when it ended.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photomap_gis.cli import main as photomap
from photomap_gis.core.live import EndReason, GapKind, LiveFrame, StreamEnd, StreamEvent, StreamGap
from photomap_gis.ingest import IngestOptions, open_sources
from photomap_gis.ingest.stream import open_stream
from photomap_gis.ingest.stream.picture import ArrayPicture
from photomap_gis.live.flight import Flight
from photomap_gis.live.loop import Interval as Told
from photomap_gis.live.opening import begin_session
from photomap_gis.live.options import LiveOptions
from photomap_gis.simulate.breakage import Breakage, break_frame
from photomap_gis.simulate.evaluate import MapErrors, evaluate_map

from ..registration.report import Bar, Figure, Section, Table
from ..registration.score import Interval
from ..telling import LineProgress
from .flights import video_of

RATE_HZ = 10.0
WIDTH_PX, HEIGHT_PX = 640, 360
ERROR_SHARE, BURST = 0.02, (2, 5)
LINK_AT, LINK_S = 0.3, 5.0
GPS_AT, GPS_SHARE = 0.5, 1.0 / 3.0
"""When, as shares of the flight, the link and the positions go; of three minutes, a third is the minute of the bar."""
TOLD_WITHIN_S = 1.0
APART = 15
"""Frames between two bursts: what is closer is told as one."""
KINDS = (Breakage.GREY, Breakage.MACROBLOCKS, Breakage.BLACK, Breakage.TEARING, Breakage.GREEN)
"""A frozen picture is left out: for half a second it is taken for video that stutters, and lies where the last lay."""


@dataclass(frozen=True, slots=True)
class Break:
    """What went wrong, from the first frame that it hit to the first that it did not; the kinds that may tell of it."""

    what: str
    since_s: float
    until_s: float
    told_as: tuple[str, ...]

    def is_told(self, intervals: Sequence[Told]) -> bool:
        """Whether the session has told of it, when it began and when it ended."""
        mine = [
            (i.since_s, i.until_s) for i in intervals
            if i.kind in self.told_as and i.until_s is not None
            and i.since_s < self.until_s + TOLD_WITHIN_S and i.until_s > self.since_s - TOLD_WITHIN_S
        ]  # fmt: skip
        return bool(mine) and (
            abs(min(since for since, _ in mine) - self.since_s) <= TOLD_WITHIN_S
            and abs(max(until for _, until in mine) - self.until_s) <= TOLD_WITHIN_S
        )


class BrokenFlight:
    """The frames of a simulated video with breaks in them (a ``FrameSource``); none where ``broken`` is not set."""

    name, is_live, started_utc_s = "breaks", False, None

    def __init__(self, video: Path, *, broken: bool, seed: int = 8) -> None:
        self._video = video
        self._refs = {
            int(r.frame_number or 0): r for r in open_sources([video], IngestOptions(frame_rate_hz=1000.0)).frames
        }
        self._closed = False
        self.breaks: list[Break] = []
        self._errors: dict[int, Breakage] = {}
        n = len(self._refs)
        link_at, gps_at = round(LINK_AT * n), round(GPS_AT * n)
        self._link = range(link_at, link_at + round(LINK_S * RATE_HZ)) if broken else range(0)
        self._gps = range(gps_at, gps_at + round(GPS_SHARE * n)) if broken else range(0)
        self._rng = np.random.default_rng(seed)
        if broken:
            self._plan(n)

    def _plan(self, n: int) -> None:
        while len(self._errors) < ERROR_SHARE * n:
            start, length = int(self._rng.integers(10, n - 10)), int(self._rng.integers(*BURST, endpoint=True))
            burst = range(start, start + length)
            near = range(start - APART, burst.stop + APART)
            if any(k in self._errors or k in self._link for k in near):
                continue
            kind = KINDS[len(self.breaks) % len(KINDS)]
            self._errors |= dict.fromkeys(burst, kind)
            told_as = ("error_frames", "not_recognised")
            self.breaks.append(Break(f"{kind.value} x {length}", start / RATE_HZ, burst.stop / RATE_HZ, told_as))
        link, gps = self._link, self._gps
        self.breaks.append(Break("link", (link.start - 1) / RATE_HZ, link.stop / RATE_HZ, ("link_lost",)))
        self.breaks.append(Break("positions", gps.start / RATE_HZ, gps.stop / RATE_HZ, ("no_position",)))

    def __iter__(self) -> Iterator[StreamEvent]:
        last, at_s = None, 0.0
        for event in open_stream(str(self._video), realtime=False):
            if not isinstance(event, LiveFrame) or self._closed:
                continue
            k = event.index
            at_s = k / RATE_HZ
            if k in self._link:
                if k == self._link.start:
                    yield StreamGap(GapKind.LINK_LOST, at_s - 1.0 / RATE_HZ, at_s, "link lost")
                continue
            if len(self._link) and k == self._link.stop:
                before_s = (self._link.start - 1) / RATE_HZ
                yield StreamGap(GapKind.RECONNECTED, before_s, at_s, "link back", at_s - before_s)
            ref = replace(self._refs[k], index=k, pts_s=at_s)
            if k in self._gps:
                ref = replace(ref, fix=None, attitude=None, height_m=None)
            picture = event.picture
            if k in self._errors:
                picture = ArrayPicture(break_frame(event.image, last, self._errors[k], self._rng))
            else:
                last = event.image
            yield LiveFrame(ref, picture, at_s)
        yield StreamEnd(EndReason.END_OF_FILE, at_s, at_s)

    def close(self) -> None:
        """End it."""
        self._closed = True


@dataclass(frozen=True, slots=True)
class Flown:
    """What came of a flight."""

    pieces: int
    used_broken: int
    intervals: tuple[Told, ...]
    errors: MapErrors


def measure(folder: Path, *, seconds: int = 180) -> Section:
    """Fly whole and broken; compare both with the truth."""
    video = video_of(folder, seconds, width_px=WIDTH_PX, height_px=HEIGHT_PX, rate_hz=RATE_HZ)
    whole = _flown(folder, "whole", BrokenFlight(video, broken=False), video)
    source = BrokenFlight(video, broken=True)
    broken = _flown(folder, "broken", source, video)
    told = [b.is_told(broken.intervals) for b in source.breaks]
    w, b = whole.errors, broken.errors
    rows = tuple(
        (one.what, f"{one.since_s:.1f}-{one.until_s:.1f}", "yes" if ok else "NO")
        for one, ok in sorted(zip(source.breaks, told, strict=True), key=lambda pair: pair[0].since_s)
    )
    return Section(
        "breaks",
        (
            _one("pieces at the end", broken.pieces, Bar(high=1.0)),
            _one("error frames that are in the map", broken.used_broken, Bar(high=0.0)),
            _one("breaks told within a second, of all", sum(told) / len(told), Bar(low=1.0)),
            _one("relative error, broken, in GSD", b.relative_rmse_gsd),
            _one("relative error, whole, in GSD", w.relative_rmse_gsd),
            _one("absolute error over its floor, broken", b.ratio_to_floor or math.nan),
            _one("absolute error over its floor, whole", w.ratio_to_floor or math.nan),
            _one("patches torn, broken", b.unmatched_share, Bar(high=max(0.005, 2.0 * w.unmatched_share))),
            _one("patches torn, whole", w.unmatched_share),
            _one("true ground that is covered, broken", b.coverage),
            _one("true ground that is covered, whole", w.coverage),
        ),
        tables=(Table("What went wrong", ("what", "s", "told"), rows),),
        notes=(
            f"{seconds} s of {WIDTH_PX}x{HEIGHT_PX} at {RATE_HZ:g} fps, {ERROR_SHARE:.0%} error frames in bursts, "
            f"{LINK_S:g} s without link, {GPS_SHARE * seconds:.0f} s without positions; live maps as exported at the "
            "end of the flight, before they are finished",
        ),
    )


def _flown(folder: Path, name: str, source: BrokenFlight, video: Path) -> Flown:
    mission, out = folder / f"mission-{name}", folder / f"{name}.tif"
    shutil.rmtree(mission, ignore_errors=True)
    progress = LineProgress(f"breaks, {name}")
    with Flight(begin_session("breaks", mission, source, LiveOptions(), None), source, realtime=False) as flight:
        flight.session._on_step = lambda step: progress(flight.session.loop.tally.frames, len(source._refs))
        flight.fly()
        loop = flight.session.loop
        used = {int(r.frame_number or 0) for r in loop.chart.refs}
        pieces, intervals = loop.tracker.pieces, tuple(loop.tally.intervals)
    out.unlink(missing_ok=True)
    if photomap(["export", str(mission), "--geotiff", "-o", str(out), "-q"]) != 0:
        raise RuntimeError(f"{mission} could not be exported")
    return Flown(pieces, len(used & set(source._errors)), intervals, evaluate_map(out, video.parents[1] / "truth"))


def _one(name: str, value: float, bar: Bar | None = None) -> Figure:
    return Figure(name, Interval(value, value, value), 1, "", bar)
