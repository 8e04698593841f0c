"""A recorded session flown again: the same frames, the same solutions at the same frames, the same drawing.

The loop's own code runs; what hung on time (dropped frames, when a solution was ready, what was drawn anew) is
taken from the journal. What comes out must be what came out then: poses to 1e-9, pixels equal.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
from threadpoolctl import threadpool_limits

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import Footage
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.live import FrameSource, LiveFrame
from photomap_gis.ingest.box_files import is_recording
from photomap_gis.ingest.stream import open_stream
from photomap_gis.live.chart import LiveSolution
from photomap_gis.live.frame_line import pose_numbers
from photomap_gis.live.graph import GraphWork, KeyNews
from photomap_gis.live.hand import Command, Hand, KeptPixels, canvas_digest
from photomap_gis.live.journal import FOLDER, JOURNAL, RENDER, LineLog, load_session, read_lines
from photomap_gis.live.locate import FromJournal, FromTelemetry
from photomap_gis.live.loop import FlightLoop
from photomap_gis.live.opening import RECORDING, is_video_file, locator_of, session_options
from photomap_gis.live.steps import Tie
from photomap_gis.store import Mission

TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """What came of a replay; ``first_difference`` is the source's number of the first frame whose pose differs."""

    frames: int
    poses: int
    largest_difference: float
    first_difference: int | None
    solutions: int
    pixels_equal: bool | None
    keyframes: int

    @property
    def same(self) -> bool:
        """Whether poses agree to 1e-9 and pixels are equal (as far as the journal knows of them)."""
        return self.first_difference is None and self.pixels_equal is not False

    def as_document(self) -> dict[str, Any]:
        """Return all of it as JSON takes it."""
        return asdict(self) | {"same": self.same}


class _Graph:
    """The graph as the journal says that it was worked on: news wait until a solution that knew of them is due."""

    def __init__(self, work: GraphWork) -> None:
        self._work = work
        self._news: deque[KeyNews | Tie] = deque()
        self._ties = 0

    def tell(self, news: KeyNews | Tie) -> None:
        self._news.append(news)

    def solution(self, line: Mapping[str, Any]) -> LiveSolution:
        """Work off what the solution of a journal's line knew of, and solve."""
        keys, ties = int(line["keys"]), int(line["ties"])
        while self._work.count < keys or self._ties < ties:
            if not self._news:
                raise DataError("the journal speaks of key frames that this replay has not: is it the same recording?")
            one = self._news.popleft()
            if isinstance(one, Tie):
                self._work.tie(one)
                self._ties += 1
            else:
                self._work.add(one)
        self._work.measure([(int(a), int(b)) for a, b in line["pairs"]])
        solution = self._work.solve()
        if solution is None:
            raise DataError("the journal speaks of a solution where this replay finds none")
        return solution

    def poll(self) -> LiveSolution | None:
        return None

    def close(self) -> None:
        pass


def replay(
    folder: Path,
    out: Path,
    *,
    on_progress: Callable[[str, int, int], None] = lambda stage, done, total: None,
) -> ReplayResult:
    """Fly the session of a mission again into the folder ``out`` and compare; ``PhotomapError`` where it cannot be."""
    document = load_session(folder)
    if document.get("part"):
        raise DataError(
            f"{folder}: this session was cut off and resumed; what was decided before the cut cannot be replayed, "
            "map its recording instead"
        )
    lines = list(read_lines(folder / FOLDER / JOURNAL))
    taken = {int(line["n"]): line for line in lines if line["t"] == "frame"}
    if not taken:
        raise DataError(f"{folder}: the journal of this session holds no frames")
    with Mission.open(folder) as mission:
        options = session_options(folder, mission)
        header = mission.header
    box = folder / RECORDING
    played = str(document["source"])
    # what came in which order into a folder of photos, too, only the recording knows
    source = played if is_video_file(played) else str(box) if is_recording(box) else header.sources[0]
    stream = open_stream(source, realtime=False, options=options.settings.ingest)
    base = locator_of(source, options, None) if is_video_file(source) else FromTelemetry()
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with Mission.create(
            out, replace(header, map_frame=MapFrame(None)), Footage((), tuple(mission.flights))
        ) as scratch, threadpool_limits(1):  # fmt: skip
            return _flown(
                scratch, stream, lines, FromJournal(taken, base),
                list(read_lines(folder / FOLDER / RENDER)), FlightParts(options, len(taken), on_progress),
            )  # fmt: skip
    finally:
        cv2.setNumThreads(threads)
        stream.close()


@dataclass(frozen=True, slots=True)
class FlightParts:
    """What a replay is flown with."""

    options: Any
    frames: int
    on_progress: Callable[[str, int, int], None]


def _flown(
    scratch: Mission,
    stream: FrameSource,
    lines: list[Mapping[str, Any]],
    locator: FromJournal,
    drawn: list[Mapping[str, Any]],
    parts: FlightParts,
) -> ReplayResult:
    (scratch.folder / FOLDER).mkdir(exist_ok=True)
    graph = _Graph(GraphWork(scratch, parts.options.settings))
    log, render_log = LineLog(scratch.folder / FOLDER / JOURNAL), LineLog(scratch.folder / FOLDER / RENDER)
    pixels = KeptPixels(scratch.paths, lambda k: loop.chart.refs[k])
    loop = FlightLoop(parts.options, pixels.grey, log)
    hand = Hand(scratch, graph, pixels, render_log)
    redraws = deque(line for line in drawn if line["t"] == "redraw")

    def do(commands: list[Command]) -> None:
        for command in commands:
            hand.do(command)
            while redraws and int(redraws[0]["after"]) == hand.done:
                line = redraws.popleft()
                hand.redraw(tuple((int(r), int(c)) for r, c in line["tiles"]), tuple(int(k) for k in line["keys"]))

    frames = iter(event for event in stream if isinstance(event, LiveFrame))
    largest, first, poses, solutions, done = 0.0, None, 0, 0, 0
    equal: bool | None = None
    for line in lines:
        if line["t"] == "adopt":
            commands, _ = loop.adopt(graph.solution(line), 0.0)
            solutions += 1
            do(commands)
        elif line["t"] == "frame":
            number = int(line["n"])
            frame = next((f for f in frames if f.index >= number), None)
            if frame is None or frame.index != number:
                raise DataError(f"the recording has no frame {number}: is it whole, and the same?")
            frame = as_taken(frame, line)
            step, commands = loop.take(frame, locator.place(frame), may_look=bool(line.get("look")))
            do(commands)
            difference = _difference(line.get("pose"), pose_numbers(step))
            poses += line.get("pose") is not None
            largest = max(largest, difference)
            if difference > TOLERANCE and first is None:
                first = number
            done += 1
            parts.on_progress("replay", done, parts.frames)
        elif line["t"] == "landed" and hand.painter is not None:
            equal = canvas_digest(hand.painter.canvas) == line["canvas"]
    hand.flush()
    log.close()
    render_log.close()
    return ReplayResult(done, poses, largest, first, solutions, equal, len(loop.chart))


def as_taken(frame: LiveFrame, line: Mapping[str, Any]) -> LiveFrame:
    """Return a frame as its journal line tells of it.

    Its stream time: photos of a folder go on, after a gap, as they came. Whether data was missing: what was recorded
    may be decoded from another packet on.
    """
    ref = replace(frame.ref, pts_s=float(line["s"]))
    return replace(frame, ref=ref, is_suspect=bool(line.get("suspect", False)))


def _difference(then: list[float] | None, now: list[float] | None) -> float:
    """Return how far two poses are apart: map units, radians, logarithms; infinite where one is missing."""
    if then is None or now is None:
        return 0.0 if then is now else math.inf
    return max(abs(a - b) for a, b in zip(then, now, strict=True))
