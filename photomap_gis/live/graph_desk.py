"""How the loop hands work to the graph: at once in the same thread, or to a process of its own.

A process and not a thread: registering two frames is hundreds of short calls, and two threads that do so hand Python's
lock to and fro (measured: half as slow again as one).
"""

from __future__ import annotations

import math
import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Sequence
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Protocol

import cv2

from photomap_gis.core.errors import PhotomapError
from photomap_gis.core.frame import FrameRef
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.live.chart import LiveSolution
from photomap_gis.live.graph import GraphWork, KeyNews
from photomap_gis.live.heap import give_back
from photomap_gis.live.steps import Tie
from photomap_gis.pipeline.settings import MapSettings
from photomap_gis.store import Mission

News = KeyNews | Tie
SAVE_EVERY_KEYS = 12
"""The solution on disk, from which others export, is renewed after so many key frames."""


class GraphDesk(Protocol):
    """What the loop knows of the graph worker."""

    def tell(self, news: News) -> None:
        """Hand over a key frame or a tie; never waits."""
        ...

    def poll(self) -> LiveSolution | None:
        """Return the next solution that is ready; ``PhotomapError`` where the worker failed."""
        ...

    def close(self) -> None:
        """Have everything told worked off and kept."""
        ...


class GraphShift:
    """Works news off in their order and decides when to solve (a builder with one owner)."""

    def __init__(self, work: GraphWork, solve_every: int) -> None:
        self._work, self._every = work, solve_every
        self._solved_at = 0
        self._saved_at = 0
        self._gained = 0

    def take(self, news: Sequence[News], *, hurry: bool = False) -> LiveSolution | None:
        """Measure what is told and what it suggests; return a solution where one is due.

        In a ``hurry`` (the flight has landed, and nobody waits for a solution any more) only what was told is measured.
        """
        work = self._work
        for one in news:
            if isinstance(one, Tie):
                self._gained += work.tie(one)
                continue
            work.add(one)
            if not hurry:
                self._gained += work.measure(work.loops_of(one.ref.index))
        if hurry:
            return None
        if news:
            self._gained += work.measure(work.joins())
        fresh = work.count - self._solved_at
        due = max(self._every, math.ceil(0.03 * self._solved_at))
        closes = self._gained > 0 and fresh >= max(self._every / 2, 0.02 * self._solved_at)
        if work.count < 2 or not (fresh >= due or closes):
            return None
        self._solved_at, self._gained = work.count, 0
        solution = work.solve()
        give_back()
        if work.count - self._saved_at >= max(SAVE_EVERY_KEYS, 0.05 * work.count) or self._saved_at == 0:
            self._saved_at = work.count
            work.save()
        return solution

    def finish(self) -> None:
        """Solve and keep what is there."""
        if self._work.count >= 2:
            self._work.solve()
            self._work.save()


class GraphHere:
    """The graph worked on in the loop's own thread: a replay, a test, a file as fast as possible."""

    def __init__(
        self, mission: Mission, settings: MapSettings, solve_every: int, work: GraphWork | None = None
    ) -> None:
        self._shift = GraphShift(work or GraphWork(mission, settings), solve_every)
        self._ready: list[LiveSolution] = []

    def tell(self, news: News) -> None:
        """Work it off now."""
        solution = self._shift.take([news])
        if solution is not None:
            self._ready.append(solution)

    def poll(self) -> LiveSolution | None:
        """Return the next solution."""
        return self._ready.pop(0) if self._ready else None

    def close(self) -> None:
        """Keep the last solution."""
        self._shift.finish()


class GraphProcess:
    """The graph worked on in a process of its own; use ``close`` at the end."""

    def __init__(self, folder: Path, settings: MapSettings, solve_every: int, *, recall: bool = False) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, there = context.Pipe()
        self._hurry = context.Event()
        self._process = context.Process(
            target=_attend, args=(there, self._hurry, str(folder), settings, solve_every, recall), daemon=True
        )
        before = {k: os.environ.get(k) for k in _ONE_THREAD}
        os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # BLAS threads that spin would take the loop's processor
        try:
            self._process.start()
        finally:
            for name, value in before.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value
        there.close()
        self._outbox: queue.SimpleQueue[News | None] = queue.SimpleQueue()
        self._sender = threading.Thread(target=self._send, name="graph-sender", daemon=True)
        self._sender.start()
        self._failed = False

    @property
    def pid(self) -> int | None:
        """The worker's process, for those who measure."""
        return self._process.pid

    def tell(self, news: News) -> None:
        """Hand over; a thread of its own pickles and sends."""
        self._outbox.put(news)

    def poll(self) -> LiveSolution | None:
        """Return the next solution that has come."""
        if self._failed:
            return None
        try:
            if not self._pipe.poll():
                return None
            answer = self._pipe.recv()
        except (EOFError, OSError):
            self._failed = True
            raise PhotomapError(
                "the graph worker ended: the map goes on without loop closures; it is solved after landing"
            ) from None
        if isinstance(answer, str):
            self._failed = True
            raise PhotomapError(f"the graph worker failed: {answer}; the map is solved after landing")
        return answer

    def close(self) -> None:
        """Wait until everything told is worked off."""
        self._hurry.set()
        self._outbox.put(None)
        while self._process.is_alive():  # answers are taken meanwhile: a full pipe would hold both sides
            try:
                if self._pipe.poll(0.2):
                    self._pipe.recv()
            except (EOFError, OSError):
                break
        self._process.join()
        self._sender.join(timeout=5.0)
        self._pipe.close()

    def _send(self) -> None:
        while True:
            news = self._outbox.get()
            try:
                self._pipe.send(news)
            except (OSError, ValueError):
                return
            if news is None:
                return


_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def _attend(pipe: Connection, hurry: Event, folder: str, settings: MapSettings, solve_every: int, recall: bool) -> None:
    """The worker process: take all that waits, work it off, answer with a solution where one is due."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # ^C is for the loop: it says when to end
    cv2.setNumThreads(1)
    if hasattr(os, "nice"):
        os.nice(3)  # the loop goes first
    try:
        with Mission.open(Path(folder)) as mission:
            work = recalled(mission, settings, tuple(mission.frames)) if recall else GraphWork(mission, settings)
            shift = GraphShift(work, solve_every)
            while True:
                news = [pipe.recv()]
                while len(news) < 8 and news[-1] is not None and pipe.poll():
                    news.append(pipe.recv())
                ends = news[-1] is None
                solution = shift.take([n for n in news if n is not None], hurry=hurry.is_set())
                if solution is not None:
                    pipe.send(solution)
                if ends:
                    shift.finish()
                    return
    except EOFError:
        return
    except Exception as error:
        pipe.send(f"{type(error).__name__}: {error}")


def recalled(mission: Mission, settings: MapSettings, refs: Sequence[FrameRef]) -> GraphWork:
    """Return the graph of a session that was cut off, from the mission's journals."""
    work = GraphWork(mission, settings)
    prepared = {p.frame: p for p in mission.prepared}
    for ref in refs:
        work.recall(ref, prepared[ref.index], Similarity2D())
    for record in mission.registrations:
        work.recall_pair(record)
    return work
