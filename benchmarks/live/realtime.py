"""A video played at its rate into a session with its page served: what is dropped, how late, at what cost."""

from __future__ import annotations

import contextlib
import math
import queue
import resource
import shutil
import threading
import time
import urllib.request
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from photomap_gis.cli.serve_view import open_view
from photomap_gis.core.live import LiveFrame
from photomap_gis.ingest.stream import open_stream
from photomap_gis.live.flight import Flight, FlightRequest, open_flight
from photomap_gis.live.loop import FlightLoop
from photomap_gis.live.options import LiveOptions
from photomap_gis.live.steps import Step
from photomap_gis.server import Access, BoundServer, Host, create_app
from photomap_gis.server.live_view import LiveEvent, LivePicture, LiveSolution, LiveTiles

from ..registration.report import Bar, Figure, Section
from ..registration.score import Interval
from .flights import RATE_HZ, video_of

WARM_S = 3.0


class Eyes:
    """What a page does: it fetches the tiles that it is told of, and watches the stabilised view."""

    def __init__(self, flight: Flight, root: str) -> None:
        self._flight, self._root = flight, root
        self._waiting: queue.SimpleQueue[tuple[float, LiveTiles] | None] = queue.SimpleQueue()
        self.served_ms: list[float] = []
        self.pictures = 0
        self.shifts: list[float] = []
        self._ends = [flight.view.subscribe(self._hear), flight.view.watch(self._look)]
        self._thread = threading.Thread(target=self._fetch, daemon=True)
        self._thread.start()

    def close(self) -> None:
        for end in self._ends:
            end()
        self._waiting.put(None)
        self._thread.join(timeout=10.0)

    def _hear(self, event: LiveEvent) -> None:
        if isinstance(event, LiveTiles) and len(self._flight.session.latencies.paste):
            # the ground that is shown now came with a frame so long ago
            self._waiting.put((time.monotonic() - self._flight.session.latencies.paste[-1] / 1000.0, event))
        elif isinstance(event, LiveSolution) and event.shift_px is not None:
            self.shifts.append(event.shift_px)

    def _look(self, picture: LivePicture) -> None:
        self.pictures += 1

    def _fetch(self) -> None:
        while (waiting := self._waiting.get()) is not None:
            came_s, event = waiting
            painter = self._flight.session.hand.painter
            if painter is None or not painter.canvas.lattice.georeferenced:
                continue
            lattice = painter.canvas.lattice
            zoom = round(math.log2(2.0 * math.pi * 6378137.0 / 256 / lattice.grid.pixel_size))
            window = event.windows[len(event.windows) // 2]
            x = lattice.first_tile.col + window.col_off // window.width
            y = lattice.first_tile.row + window.row_off // window.height
            with contextlib.suppress(OSError):
                urllib.request.urlopen(f"{self._root}missions/1/layers/map/{zoom}/{x}/{y}.webp", timeout=5).read()
                self.served_ms.append(1000.0 * (time.monotonic() - came_s))


def measure(folder: Path, *, seconds: int, width_px: int = 1280, height_px: int = 720) -> Section:
    """Play, serve, look on, and say what came of it."""
    video = video_of(folder, seconds, width_px=width_px, height_px=height_px)
    mission = folder / "mission-realtime"
    shutil.rmtree(mission, ignore_errors=True)
    stalls: list[float] = []
    last = [0.0]

    def step(one: Step) -> None:
        now = time.monotonic()
        if last[0]:
            stalls.append(now - last[0])
        last[0] = now

    with open_flight(FlightRequest(str(video), mission)) as flight:
        host = Host(open_view)
        host.open_live(flight.view)
        server = BoundServer("127.0.0.1", 0)
        up = threading.Event()
        serving = threading.Thread(
            target=server.serve, args=(create_app(host, Access(None, loopback_only=True)), up.set), daemon=True
        )
        serving.start()
        up.wait(20.0)
        eyes = Eyes(flight, server.url)
        say = flight.session._on_step
        flight.session._on_step = lambda one: (step(one), say(one))[-1]
        before, began = _cpu_s(), time.monotonic()
        flight.fly()
        took_s, cpu_s = time.monotonic() - began, _cpu_s() - before
        eyes.close()
        server.stop()
        serving.join(timeout=5.0)
        session = flight.session
        tally, times = session.loop.tally, session.latencies
        keys = len(session.loop.chart)
    played_s = tally.frames / RATE_HZ + tally.dropped / RATE_HZ
    warm, warm_cpu = (list(t)[round(WARM_S * RATE_HZ) :] for t in (times.step, times.step_cpu))
    pose = list(times.pose)[round(WARM_S * RATE_HZ) :]
    return Section(
        "realtime",
        (
            _one("frames registered a second", tally.tracked / played_s, tally.frames, "/s", Bar(low=29.9)),
            _one("frames dropped", tally.dropped, tally.frames, "", Bar(high=0.0)),
            _one("processors used, mean (engine and graph)", cpu_s / took_s, tally.frames, "x", Bar(high=1.3)),
            _spread("registration and chaining on one core, the loop alone", alone_ms(video), "ms", Bar(high=8.0)),
            _spread("the same in the session, processor time", warm_cpu, "ms"),
            _spread("the same in the session, with waiting for the other threads", warm, "ms"),
            _one("frame in to pose, p99", _percentile(pose, 99), len(pose), "ms", Bar(high=100.0)),
            _one("new ground to tile served, p50", _percentile(eyes.served_ms, 50), len(eyes.served_ms), "ms",
                 Bar(high=300.0)),
            _one("new ground to tile served, p99", _percentile(eyes.served_ms, 99), len(eyes.served_ms), "ms",
                 Bar(high=800.0)),
            _one("key frames a second", keys / played_s, keys, "/s"),
            _one("stabilised views a second", eyes.pictures / played_s, eyes.pictures, "/s", Bar(low=10.0)),
            _one("longest pause of the loop", 1000.0 * max(stalls[round(WARM_S * RATE_HZ) :], default=0.0),
                 len(stalls), "ms"),
            _one("solution adopted to map drawn anew, longest", max(times.settled_s, default=0.0),
                 len(times.settled_s), "s", Bar(high=3.0)),
            _one("pieces at the end", session.loop.tracker.pieces, 1, "", Bar(high=1.0)),
        ),
        notes=(f"{seconds} s of {width_px}x{height_px} at {RATE_HZ:g} fps; the page's work is done in the engine's "
               "process (a thread that fetches each changed tile and watches the view): no browser",),
    )  # fmt: skip


def alone_ms(video: Path, frames: int = 300) -> list[float]:
    """Return what each of a video's first frames takes the loop where nothing else is done, in milliseconds."""
    loop, took = FlightLoop(LiveOptions(), lambda key: np.zeros((1, 1), np.uint8)), []
    with contextlib.closing(open_stream(str(video), realtime=False)) as source:
        for event in source:
            if isinstance(event, LiveFrame):
                event.grey  # noqa: B018 (decoding and converting are the reader's)
                began = time.thread_time()
                loop.take(event, event.ref)
                took.append(1000.0 * (time.thread_time() - began))
                if len(took) == frames:
                    break
    return took


def _cpu_s() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def _percentile(values: Sequence[float], q: float) -> float:
    return float(np.percentile(values, q)) if values else float("nan")


def _one(name: str, value: float, count: int, unit: str, bar: Bar | None = None) -> Figure:
    return Figure(name, Interval(value, value, value), count, unit, bar)  # type: ignore[arg-type]


def _spread(name: str, values: Sequence[float], unit: str, bar: Bar | None = None) -> Figure:
    low, middle, high = (_percentile(values, q) for q in (5, 50, 95))
    return Figure(f"{name} (p50; p5, p95)", Interval(middle, low, high), len(values), unit, bar)  # type: ignore[arg-type]
