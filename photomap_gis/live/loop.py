"""The loop: frames and solutions in, in one order; commands for the hand and lines of the journal out.

It never draws, solves or waits, and knows no clock but the stream's: a replay runs this very code.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from photomap_gis.core.frame import FrameRef, ImageArray
from photomap_gis.core.live import GapKind, LiveFrame, Picture, StreamGap
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.live.chart import Belief, Chart, LiveSolution
from photomap_gis.live.frame_line import place_of, pose_numbers
from photomap_gis.live.hand import Again, Command, Lay, Move, Take, Told
from photomap_gis.live.journal import LineLog
from photomap_gis.live.lattice import choose_lattice
from photomap_gis.live.look import Look, LookClock
from photomap_gis.live.options import LiveOptions
from photomap_gis.live.steps import FrameState, NewKey, Step
from photomap_gis.live.tracker import Tracker, frame_placement, is_video, wide_covariance

MERGED_S = 1.0
MOST_INTERVALS = 5000
"""So many are listed; a link that is worse than that is told by the counts."""


@dataclass(slots=True)
class Interval:
    """A time during which the map did not simply grow; ``until_s`` is ``None`` while it lasts."""

    kind: str
    since_s: float
    until_s: float | None = None
    frames: int = 0
    words: str = ""


@dataclass(slots=True)
class Tally:
    """What is counted of a session."""

    frames: int = 0
    tracked: int = 0
    error_frames: int = 0
    waiting: int = 0
    dropped: int = 0
    with_fix: int = 0
    segments_begun: int = 0
    joined: int = 0
    solutions: int = 0
    snapped_at_s: float | None = None
    intervals: list[Interval] = field(default_factory=list)


class FlightLoop:
    """The tracker with its book-keeping; one owner."""

    def __init__(self, options: LiveOptions, load: Callable[[int], ImageArray], log: LineLog | None = None) -> None:
        self.tracker = Tracker(options, load)
        self.tally = Tally()
        self.times_s: list[float] = []
        self.arrivals_s: list[float] = []
        self._log = log
        self._epoch = 0
        self._max_off_nadir_rad = options.settings.max_off_nadir_rad
        self._held: tuple[FrameRef, Picture] | None = None
        self._looks = LookClock()

    @property
    def chart(self) -> Chart:
        """Where key frames lie."""
        return self.tracker.chart

    @property
    def epoch(self) -> str:
        """Names the canvas of now."""
        return str(self._epoch)

    def take(self, frame: LiveFrame, ref: FrameRef, *, may_look: bool = True) -> tuple[Step, list[Command]]:
        """Take the next frame; ``ref`` is what is known of it. ``may_look`` allows for a look where one is due."""
        if is_video(ref) and ref.frame_number is None:
            ref = replace(ref, frame_number=frame.index)  # its pixels are kept by the mission
        step = self.tracker.take(ref, frame.grey, frame.stream_time_s, is_suspect=frame.is_suspect)
        commands: list[Command] = []
        if step.promoted is not None:
            held = self._held
            commands += self._keyed(step.promoted, frame.picture if held is None else held[1], frame.arrival_s)
        if step.key is not None:
            commands += self._keyed(step.key, frame.picture, frame.arrival_s)
        if step.joined is not None:
            commands.append(Told(step.joined.tie))
            commands.append(Move(self.chart.snapshot(), self.chart.revision, step.joined.moved))
        look = self._look_at(step, frame) if may_look else None
        if look is not None:
            commands.append(look)
        if step.state is FrameState.TRACKED:
            self._held = (ref, frame.picture)
        self._count(step, frame)
        if self._log is not None:
            self._log.write(
                "frame", n=frame.index, s=frame.stream_time_s, state=step.state.value, p=place_of(ref),
                pose=pose_numbers(step), seg=step.segment, key=None if step.key is None else step.key.ref.index,
                rev=self.chart.revision, why=step.reason, suspect=frame.is_suspect,
                **({} if look is None else {"look": True}),
            )  # fmt: skip
        return step, commands

    def adopt(self, solution: LiveSolution, stream_time_s: float) -> tuple[list[Command], bool]:
        """Take a solution over; the commands, and whether the map has found its place on Earth by it."""
        before = self.chart.map_frame
        self.tracker.adopt(solution)
        self.tally.solutions += 1
        if self._log is not None:
            self._log.write(
                "adopt", rev=solution.revision, keys=len(solution), ties=solution.ties,
                pairs=[list(p) for p in solution.pairs], crs=solution.map_frame.crs_wkt is not None,
            )  # fmt: skip
        snapshot = self.chart.snapshot()
        if solution.map_frame == before:
            return [Move(snapshot, solution.revision)], False
        if self.tally.snapped_at_s is None:
            self.tally.snapped_at_s = stream_time_s
        # The newest first: they are what the drone is over.
        again = [
            Again(k, self.times_s[k], snapshot.placement(k))
            for k in range(len(snapshot) - 1, -1, -1)
            if self._is_steep(snapshot.refs[k])
        ]  # fmt: skip
        return [self._lay(snapshot, len(snapshot) - 1), Move(snapshot, solution.revision, ()), *again], True

    def resume(self, keys: list[tuple[FrameRef, int]], solution: LiveSolution) -> list[Command]:
        """Take up the key frames of a session that was cut off, where a solution lays them."""
        for ref, segment in keys:
            self.chart.add(ref, Belief(Similarity2D(), wide_covariance(ref)), segment)
            self.times_s.append(ref.pts_s or 0.0)
            self.arrivals_s.append(-math.inf)  # before this session: no telemetry knows it
        self.tracker.adopt(solution)
        if not keys:
            return []
        snapshot = self.chart.snapshot()
        again = [
            Again(k, self.times_s[k], snapshot.placement(k))
            for k in range(len(snapshot))
            if self._is_steep(snapshot.refs[k])
        ]
        return [self._lay(snapshot, len(snapshot) - 1), *again]

    def drop(self, index: int, stream_time_s: float) -> None:
        """Count a frame that was dropped because the loop was late."""
        self.tally.dropped += 1
        if self._log is not None:
            self._log.write("drop", n=index, s=stream_time_s)

    def hear(self, gap: StreamGap) -> None:
        """Report what the source tells of itself; a link that is lost is so until frames come again."""
        since_s = gap.stream_time_s
        if gap.kind is GapKind.RECONNECTED:
            lost = next((i for i in reversed(self.tally.intervals) if i.kind == "link_lost"), None)
            if lost is None or lost.until_s is not None:
                lost = Interval("link_lost", since_s, None)
                self._begun(lost)
            lost.until_s, lost.words = lost.since_s + (gap.duration_s or 0.0), gap.message
        elif gap.kind is GapKind.LINK_LOST:
            self._begun(Interval("link_lost", since_s, None, 0, gap.message))
        else:
            self._begun(Interval(f"source_{gap.kind.value}", since_s, None, gap.frames_lost, gap.message))
        if self._log is not None:
            self._log.write("gap", kind=gap.kind.value, s=since_s, duration_s=gap.duration_s, words=gap.message)

    def _keyed(self, key: NewKey, picture: Picture, arrival_s: float) -> list[Command]:
        self.times_s.append(key.stream_time_s)
        self.arrivals_s.append(arrival_s)
        placement = self.chart.placement(key.ref.index)
        commands: list[Command] = []
        if self._epoch == 0:
            commands.append(self._lay(self.chart, key.ref.index))
        return [*commands, Take(key, picture, placement, self._is_steep(key.ref))]

    def _look_at(self, step: Step, frame: LiveFrame) -> Look | None:
        """Return the command to paste a frame that is no key frame, where one is due."""
        is_due = self._looks.is_due(frame.stream_time_s)
        if step.key is not None or step.promoted is not None:
            self._looks.pasted(frame.stream_time_s)
            return None
        if not is_due or step.witness is None or self._key_now is None or not self._is_steep(step.ref):
            return None
        placement = frame_placement(step)
        if placement is None:
            return None
        self._looks.pasted(frame.stream_time_s)
        return Look(self._key_now, frame.picture, placement, frame.stream_time_s, step.witness)

    @property
    def _key_now(self) -> int | None:
        return len(self.chart) - 1 if len(self.chart) else None

    def _is_steep(self, ref: FrameRef) -> bool:
        """Whether a frame looks down steeply enough to be pasted, as far as is known."""
        return ref.attitude is None or ref.attitude.off_nadir_rad <= self._max_off_nadir_rad

    def _lay(self, chart: Chart, key: int) -> Lay:
        self._epoch += 1
        return Lay(choose_lattice(chart.map_frame, chart.placement(key)), self.epoch)

    def _count(self, step: Step, frame: LiveFrame) -> None:
        t = self.tally
        t.frames += 1
        t.tracked += step.belief is not None
        t.error_frames += step.state is FrameState.ERROR
        t.waiting += step.state is FrameState.WAITING
        t.with_fix += step.ref.fix is not None
        t.segments_begun += step.began is not None
        t.joined += step.joined is not None
        now_s = frame.stream_time_s
        self._interval("error_frames", step.state is FrameState.ERROR, now_s, step.reason or "")
        self._interval("not_recognised", step.state is FrameState.WAITING, now_s, "the map waits: not recognised yet")
        if t.with_fix:
            self._interval("no_position", step.ref.fix is None, now_s, "no position came with these frames")
        if step.began is not None:
            self._begun(Interval("segment", now_s, None, 0, f"segment {step.began} began"))
        if step.joined is not None:
            for one in t.intervals:
                if one.kind == "segment" and one.until_s is None:
                    one.until_s, one.words = now_s, f"{one.words}, recognised as part of segment {step.joined.into}"

    def _begun(self, interval: Interval) -> None:
        if len(self.tally.intervals) < MOST_INTERVALS:
            self.tally.intervals.append(interval)

    def _interval(self, kind: str, lasts: bool, now_s: float, words: str) -> None:
        if lasts:
            last = next((i for i in reversed(self.tally.intervals[-20:]) if i.kind == kind), None)
            if last is not None and last.until_s is not None and now_s - last.until_s < MERGED_S:
                last.until_s = None  # a link that stutters is one interval, not fifty
        open_one = next((i for i in reversed(self.tally.intervals) if i.kind == kind and i.until_s is None), None)
        if lasts and open_one is None:
            self._begun(Interval(kind, now_s, None, 1, words))
        elif lasts and open_one is not None:
            open_one.frames += 1
        elif open_one is not None:
            open_one.until_s = now_s
