"""A live session: who does what in which thread, from the first frame to the landing.

::

    source -> reader -> queue(2) -> LOOP -> commands -> hand: keep, tell the graph, paste, redraw, write tiles
                 drops counted        ^                        |
                                      +--- solutions --- graph process

Where time does not matter (a file as fast as possible, a test) the same steps are done one after the other in one
thread, and nothing is ever dropped.
"""

from __future__ import annotations

import contextlib
import logging
import math
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from photomap_gis.core.errors import DataError, PhotomapError
from photomap_gis.core.live import FrameSource, GapKind, LiveFrame, StreamEnd, StreamEvent, StreamGap, StreamRenamed
from photomap_gis.live.canvas import LiveCanvas
from photomap_gis.live.chart import LiveSolution
from photomap_gis.live.graph_desk import GraphDesk
from photomap_gis.live.hand import Command, Hand, KeptPixels, Take, canvas_digest
from photomap_gis.live.health import HealthWatch
from photomap_gis.live.journal import FOLDER, JOURNAL, RENDER, LineLog
from photomap_gis.live.locate import Locator
from photomap_gis.live.look import Look
from photomap_gis.live.loop import FlightLoop
from photomap_gis.live.options import LiveOptions
from photomap_gis.live.steps import Step
from photomap_gis.live.tracker import frame_placement, is_video
from photomap_gis.live.view import LiveView
from photomap_gis.server.live_view import (
    LivePhase,
    LivePose,
    LiveSegment,
    LiveSnapped,
    LiveTiles,
)
from photomap_gis.server.live_view import LiveSolution as SolutionEvent
from photomap_gis.store import Mission

logger = logging.getLogger(__name__)

QUEUE = 2
"""Frames that wait for the loop; the oldest is dropped where more come."""
MOST_WAITING = 3
"""Commands that wait for the hand; where more do, no looks are taken: key frames go first."""
MOST_BEHIND = 24
"""So many commands wait at most, some of them with a picture; where more would, the loop waits with them."""
FLUSH_EVERY_S = 2.0
FLUSH_EVERY_KEYS = 24
LAST_REDRAW_S = 5.0
REDRAW_SHARE = 0.35
"""Share of the hand's time that redrawing may take while frames come."""


@dataclass(slots=True)
class Latencies:
    """How long things took in a session that ran in real time, in milliseconds; bounded."""

    step: deque[float] = field(default_factory=lambda: deque(maxlen=40_000))
    step_cpu: deque[float] = field(default_factory=lambda: deque(maxlen=40_000))
    pose: deque[float] = field(default_factory=lambda: deque(maxlen=40_000))
    paste: deque[float] = field(default_factory=lambda: deque(maxlen=10_000))
    settled_s: deque[float] = field(default_factory=lambda: deque(maxlen=1000))


class Session:
    """One flight; use ``run`` once. ``graph`` is closed by it."""

    def __init__(
        self,
        mission: Mission,
        source: FrameSource,
        locator: Locator,
        graph: GraphDesk,
        view: LiveView,
        options: LiveOptions,
        *,
        realtime: bool,
        on_step: Callable[[Step], None] = lambda step: None,
        on_words: Callable[[str], None] = lambda words: None,
        skip_until: int = -1,
        skip_sources: frozenset[str] = frozenset(),
    ) -> None:
        self._mission, self._source, self._locator, self._graph = mission, source, locator, graph
        self.view, self._options, self._realtime = view, options, realtime
        self.on_words = on_words
        self._on_step, self._skip_until, self._skip_sources = on_step, skip_until, skip_sources
        (mission.folder / FOLDER).mkdir(exist_ok=True)
        self._log = LineLog(mission.folder / FOLDER / JOURNAL, self._disk_failed)
        self._render_log = LineLog(mission.folder / FOLDER / RENDER, self._disk_failed)
        self.pixels = KeptPixels(mission.paths, lambda k: self.loop.chart.refs[k])
        self.loop = FlightLoop(options, self.pixels.grey, self._log)
        self.hand = Hand(
            mission, graph, self.pixels, self._render_log, self._tiles_changed, self._moved, self._canvas_begun
        )
        self.health = HealthWatch(self.loop.tally, locator)
        self.latencies = Latencies()
        self.failure: PhotomapError | None = None
        self._frames: deque[LiveFrame] = deque()
        self._arrived = threading.Condition()
        self._ended: StreamEnd | None = None
        self._stop = threading.Event()
        self._commands: queue.Queue[Command | None] = queue.Queue(MOST_BEHIND)
        self._hand_thread: threading.Thread | None = None
        self._waiting_keys: deque[float] = deque()
        self._flushed_at = 0.0
        self._flushed_keys = 0
        self._solution_at: float | None = None
        self._graph_lost = False
        view.on_finalise = self.stop

    def stop(self) -> None:
        """End the flight: the source is closed, what has come is worked off. May be called from any thread."""
        self._stop.set()
        self._source.close()

    def begin(self, commands: list[Command]) -> None:
        """Carry out what a resumed session begins with."""
        for command in commands:
            self.hand.do(command)
        self._put_chart()

    def run(self) -> None:
        """Fly until the source ends or ``stop`` is called; then everything is on disk."""
        self.view.put(phase=LivePhase.FLYING, started_utc_s=self._source.started_utc_s)
        try:
            if self._realtime:
                self._run_threads()
            else:
                self._run_here()
        finally:
            self._graph.close()
            # In real time somebody waits for the final map, which is drawn anew in any case.
            until = time.monotonic() + (LAST_REDRAW_S if self._realtime else math.inf)
            while self.hand.idle() and time.monotonic() < until:
                pass
            self._flush_now()
            if self.hand.painter is not None:
                self._log.write("landed", canvas=canvas_digest(self.hand.painter.canvas), frames=self.loop.tally.frames)
            self._log.close()
            self._render_log.close()

    # in one thread

    def _run_here(self) -> None:
        for event in self._source:
            if isinstance(event, LiveFrame):
                if not self._is_known(event):
                    self._take(event)
            else:
                self._hear(event)
            if self._stop.is_set():
                break

    def _is_known(self, frame: LiveFrame) -> bool:
        return frame.index <= self._skip_until or frame.ref.source in self._skip_sources

    # in several

    def _run_threads(self) -> None:
        reader = threading.Thread(target=self._read, name="reader", daemon=True)
        hand = self._hand_thread = threading.Thread(target=self._work, name="hand", daemon=True)
        reader.start()
        hand.start()
        try:
            while (frame := self._next()) is not None:
                self._take(frame)
        finally:
            self._source.close()
            self._give(None)
            hand.join()
            reader.join(timeout=5.0)

    def _read(self) -> None:
        try:
            for event in self._source:
                if not isinstance(event, LiveFrame):
                    self._hear(event)
                    continue
                if self._is_known(event):
                    continue
                with self._arrived:
                    # Photos wait in their folder: each is worth a whole second of video, so none is dropped.
                    while not is_video(event.ref) and len(self._frames) >= QUEUE and not self._stop.is_set():
                        self._arrived.wait(0.2)
                    self._frames.append(event)
                    while len(self._frames) > QUEUE:
                        old = self._frames.popleft()
                        self.loop.drop(old.index, old.stream_time_s)
                    self._arrived.notify()
        except PhotomapError as error:
            self.failure = error
        except Exception as error:
            logger.exception("reading the source failed")
            self.failure = DataError(f"internal fault in reading the source ({type(error).__name__}: {error})")
        finally:
            with self._arrived:
                if self._ended is None:
                    self._stop.set()
                self._arrived.notify()

    def _next(self) -> LiveFrame | None:
        with self._arrived:
            while not self._frames:
                if self._ended is not None or self._stop.is_set():
                    return None
                self._arrived.wait(0.2)
            self._arrived.notify()
            return self._frames.popleft()

    def _give(self, command: Command | None) -> None:
        """Give the hand a command; where too many wait, wait with it: the reader drops frames then, and counts them."""
        while self._hand_thread is not None and self._hand_thread.is_alive():
            with contextlib.suppress(queue.Full):
                self._commands.put(command, timeout=0.5)
                return

    def _work(self) -> None:
        """The hand's thread: commands first, redrawing in what time is left, tiles to disk once a second."""
        busy_until = 0.0
        open_end = True
        while open_end or not self._commands.empty():
            now = time.monotonic()
            idle = self.hand.is_idle
            wait = 0.25 if idle else max(0.0, busy_until - now)
            try:
                command = self._commands.get(timeout=wait) if wait > 0.0 else self._commands.get_nowait()
            except queue.Empty:
                if not idle:
                    began = time.monotonic()
                    more = self.hand.idle()
                    took = time.monotonic() - began
                    busy_until = began + took / REDRAW_SHARE
                    if not more and self._solution_at is not None:
                        self.latencies.settled_s.append(time.monotonic() - self._solution_at)
                        self._solution_at = None
                self._flush()
                continue
            if command is None:
                open_end = False
                continue
            self._do(command)
            self._flush()

    def _do(self, command: Command) -> None:
        try:
            self.hand.do(command)
        except PhotomapError as error:  # a full disk: what cannot be kept is told, the flight goes on
            self._disk_failed(error)
        except Exception as error:  # a fault of ours must not end the drawing unseen, nor the flight
            logger.exception("a command of the live map failed")
            self._disk_failed(DataError(f"internal fault in drawing the map ({type(error).__name__}: {error})"))
        if isinstance(command, Take | Look) and self._waiting_keys:
            self.latencies.paste.append(1000.0 * (time.monotonic() - self._waiting_keys.popleft()))

    def _flush(self) -> None:
        now = time.monotonic()
        if now - self._flushed_at >= FLUSH_EVERY_S:
            self._flushed_at = now
            self._flush_now()

    def _flush_now(self) -> None:
        try:
            self.hand.flush()
        except PhotomapError as error:
            self._disk_failed(error)

    def _disk_failed(self, error: PhotomapError) -> None:
        """Tell of what cannot be kept any more; the flight goes on, on the screen."""
        first, self.failure = self.failure is None, error
        self.health.say(f"not kept any more, only shown: {error}")
        if first:
            logger.warning("%s", error)
            self.on_words(f"{error}. The flight goes on, but only what was kept until now is there after it")

    # the loop's step, whatever the threads

    def _take(self, frame: LiveFrame) -> None:
        self._adopt(frame.stream_time_s)
        ref = self._locator.place(frame)
        began, began_cpu = time.monotonic(), time.thread_time()
        step, commands = self.loop.take(frame, ref, may_look=self._commands.qsize() < MOST_WAITING)
        self.latencies.step.append(1000.0 * (time.monotonic() - began))
        self.latencies.step_cpu.append(1000.0 * (time.thread_time() - began_cpu))
        self._publish(frame, step)
        if self._realtime:
            self.latencies.pose.append(1000.0 * (time.monotonic() - frame.arrival_s))
        for command in commands:
            if self._realtime:
                if isinstance(command, Take | Look):
                    self._waiting_keys.append(frame.arrival_s)
                self._give(command)
            else:
                self.hand.do(command)
        if not self._realtime and self.hand.pasted - self._flushed_keys >= FLUSH_EVERY_KEYS:
            self._flushed_keys = self.hand.pasted
            self.hand.flush()
        self._on_step(step)

    def _adopt(self, stream_time_s: float) -> None:
        while (solution := self._polled()) is not None:
            commands, snapped = self.loop.adopt(solution, stream_time_s)
            self._put_chart()
            self._solution_at = time.monotonic()
            for command in commands:
                if self._realtime:
                    self._give(command)
                else:
                    self.hand.do(command)
            if snapped:
                self.health.snapped = True

    def _polled(self) -> LiveSolution | None:
        if self._graph_lost:
            return None
        try:
            return self._graph.poll()
        except PhotomapError as error:
            self._graph_lost = True
            self.health.say(str(error))
            logger.warning("%s", error)
            return None

    def _hear(self, event: StreamEvent) -> None:
        self._locator.hear(event)
        if isinstance(event, StreamGap):
            self.loop.hear(event)
            self.health.hear(event)
            if event.kind is not GapKind.DAMAGED:  # over a bad radio several a second; they are counted
                self.on_words(event.message)
            self._tell_health()
        elif isinstance(event, StreamRenamed):
            self.pixels.renamed[event.path] = event.to
        elif isinstance(event, StreamEnd):
            self._ended = event

    # what the world sees

    def _publish(self, frame: LiveFrame, step: Step) -> None:
        chart = self.loop.chart
        placement = frame_placement(step)
        time_s = frame.stream_time_s
        if step.key is not None or step.promoted is not None or step.joined is not None:
            self._put_chart()
        pose = LivePose(self.loop.tally.frames - 1, time_s, placement, chart.map_frame, step.ref.time_s)
        self.view.put(pose=pose, elapsed_s=time_s, revision=chart.revision)
        self.view.tell(pose)
        if step.began is not None:
            self.view.tell(
                LiveSegment(step.began, pose.frame, None, "the ground was not recognised: a new piece begins")
            )
        if step.joined is not None:
            self.view.tell(
                LiveSegment(step.joined.segment, pose.frame, step.joined.into, "recognised: the pieces are one again")
            )
        # Where the map has found its place on Earth but is not laid anew yet, the two do not speak of the same numbers.
        if placement is not None and self.view.state.map_frame == chart.map_frame:
            self.view.still.put(pose.frame, time_s, frame.picture, placement)
        if self.health.step(step, time_s, self.latencies.step[-1], self.loop.tracker.pieces, len(chart)):
            self._tell_health()

    def _tell_health(self) -> None:
        health = self.health.now()
        self.view.put(health=health)
        self.view.tell(health)

    def _put_chart(self) -> None:
        self.view.put_chart(self.loop.chart.snapshot(), self.loop.times_s, self.pixels)

    def _tiles_changed(self) -> None:
        painter = self.hand.painter
        if painter is None:
            return
        windows = tuple(painter.canvas.window_of(t) for t in painter.canvas.take_changed())
        if windows:
            self.view.tell(LiveTiles(painter.canvas.version, windows))

    def _moved(self, revision: int, shift_px: float) -> None:
        pose = self.view.state.pose
        self.view.tell(SolutionEvent(revision, 0 if pose is None else pose.frame, shift_px))

    def _canvas_begun(self, canvas: LiveCanvas, epoch: str) -> None:
        self.view.put_canvas(canvas, epoch)
        words = "the map has found its place on Earth" if canvas.lattice.georeferenced else "the map begins"
        self.view.tell(LiveSnapped(epoch, words))
