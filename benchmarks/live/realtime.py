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
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from photomap_gis.cli.serve_view import open_view
from photomap_gis.core.live import LiveFrame
from photomap_gis.ingest.stream import open_stream
from photomap_gis.live.flight import Flight, FlightRequest, open_flight
from photomap_gis.live.hand import Command, Take
from photomap_gis.live.look import Look
from photomap_gis.live.loop import FlightLoop
from photomap_gis.live.options import LiveOptions
from photomap_gis.live.session import Session
from photomap_gis.live.steps import Step
from photomap_gis.server import Access, BoundServer, Host, create_app
from photomap_gis.server.live_view import LiveEvent, LivePicture, LiveSolution, LiveTiles

from ..registration.report import Bar, Figure, Section
from ..registration.score import Interval
from .browser import Seen, Watching
from .flights import RATE_HZ, video_of
from .memory import resident_mib
from .patrol import patrol_video

WARM_S = 3.0
LONGEST_S = 40
"""Longer flights are made of one so long, lap after lap."""
LAST_LOOK_S = 3.0
UNSEEN_S = 5.0


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
            zoom = _zoom_of(self._flight.session)
            window = event.windows[len(event.windows) // 2]
            x = lattice.first_tile.col + window.col_off // window.width
            y = lattice.first_tile.row + window.row_off // window.height
            with contextlib.suppress(OSError):
                urllib.request.urlopen(f"{self._root}missions/1/layers/map/{zoom}/{x}/{y}.webp", timeout=5).read()
                self.served_ms.append(1000.0 * (time.monotonic() - came_s))


@dataclass(slots=True)
class EngineLog:
    """When, by the machine's clock, each frame came, and by which frame each version of the map was made."""

    came_s: list[float] = field(default_factory=list)
    tiles: dict[int, tuple[float, frozenset[tuple[int, int]]]] = field(default_factory=dict)

    def follow(self, session: Session) -> None:
        """Listen to a session that is about to begin."""
        publish, work = session._publish, session._do

        def published(frame: LiveFrame, step: Step) -> None:
            self.came_s.append(frame.arrival_s + _wall_s())
            publish(frame, step)

        def done(command: Command) -> None:
            came_s = session._waiting_keys[0] if isinstance(command, Take | Look) and session._waiting_keys else None
            work(command)
            painter = session.hand.painter
            if came_s is not None and painter is not None and painter.canvas.lattice.georeferenced:
                first, version = painter.canvas.lattice.first_tile, painter.canvas.version
                changed = frozenset(
                    (t.col + first.col, t.row + first.row)
                    for t in painter.canvas.tiles() if painter.canvas.version_of(t) == version
                )  # fmt: skip
                self.tiles[version] = (came_s + _wall_s(), changed)

        session._publish, session._do = published, done  # type: ignore[method-assign]

    def in_page(self, seen: Seen, zoom: int) -> tuple[list[float], list[float]]:
        """Return, in milliseconds, from a frame to its pose in the page, and from new ground to the tile that shows it.

        A tile counts once for each frame that changed it, up to when it was painted with that change in it; what the
        page did not paint within ``UNSEEN_S`` it had not in sight.
        """
        pose = [1000.0 * (at_s - self.came_s[n]) for n, at_s in seen.poses if n < len(self.came_s)]
        painted: dict[tuple[int, int, int], list[tuple[int, float]]] = {}
        for z, x, y, etag, at_s in seen.tiles:
            version = etag.strip('"').rpartition("-")[2]
            if version.isdigit():
                painted.setdefault((z, x, y), []).append((int(version), at_s))
        ground = []
        zooms = {z for z, _, _ in painted}
        for version, (came_s, changed) in self.tiles.items():
            for z in zooms:
                up = max(0, zoom - z)
                for x, y in {(x >> up, y >> up) for x, y in changed}:
                    at_s = next((at for v, at in painted.get((z, x, y), ()) if v >= version and at > came_s), None)
                    if at_s is not None and at_s - came_s < UNSEEN_S:
                        ground.append(1000.0 * (at_s - came_s))
        return pose, ground


def measure(
    folder: Path, *, seconds: int, width_px: int = 1280, height_px: int = 720, in_browser: bool = False
) -> Section:
    """Play, serve, look on, and say what came of it."""
    video = video_of(folder, min(seconds, LONGEST_S), width_px=width_px, height_px=height_px)
    if seconds > LONGEST_S:
        video = patrol_video(video, folder / f"patrol-{seconds}s-{width_px}x{height_px}", seconds)
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
        log = EngineLog()
        log.follow(flight.session)
        eyes = None if in_browser else Eyes(flight, server.url)
        watching = Watching(server.url, folder / "page", seconds) if in_browser else None
        say = flight.session._on_step
        flight.session._on_step = lambda one: (step(one), say(one))[-1]
        resident: list[float] = []
        with watching or contextlib.nullcontext():
            before, began = _cpu_s(), time.monotonic()
            with _sampled(lambda: resident.append(resident_mib() + resident_mib(flight.graph.pid))):
                flight.fly()
            took_s, cpu_s = time.monotonic() - began, _cpu_s() - before
            time.sleep(LAST_LOOK_S if in_browser else 0.0)
        if eyes is not None:
            eyes.close()
        server.stop()
        serving.join(timeout=5.0)
        session = flight.session
        tally, times = session.loop.tally, session.latencies
        keys = len(session.loop.chart)
    played_s = tally.frames / RATE_HZ + tally.dropped / RATE_HZ
    warm, warm_cpu = (list(t)[round(WARM_S * RATE_HZ) :] for t in (times.step, times.step_cpu))
    pose = list(times.pose)[round(WARM_S * RATE_HZ) :]
    if eyes is not None:
        ground, views, in_page = eyes.served_ms, eyes.pictures, ()
        where = "served"
        note = (
            "the page's work is done in the engine's process (a thread that fetches each changed tile and watches the "
            "view): no browser"
        )
    else:
        assert watching is not None
        zoom = _zoom_of(session)
        shown, ground = log.in_page(watching.seen, zoom)
        views = len(watching.seen.views)
        where = "painted in Chromium"
        in_page = (
            _spread("frame in to pose in the page", shown, "ms"),
            _one("frame in to pose in the page, p99", _percentile(shown, 99), len(shown), "ms"),
            _one("processors used by Chromium, mean", watching.chromium_cpu_s / took_s, 1, "x"),
        )
        errors = [e for e in watching.seen.errors if not e.startswith("asked")]
        note = (
            f"the page was open in a Chromium of its own; errors in it: {len(errors)}; screenshots in {folder / 'page'}"
        )
    early = max(resident[: max(1, len(resident) // 6)], default=float("nan"))
    pasted = session.hand.pasted + session.hand.looks
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
            *in_page,
            _one(f"new ground to tile {where}, p50", _percentile(ground, 50), len(ground), "ms", Bar(high=300.0)),
            _one(f"new ground to tile {where}, p99", _percentile(ground, 99), len(ground), "ms", Bar(high=800.0)),
            _one("frames pasted a second (key frames and looks)", pasted / played_s, pasted, "/s", Bar(low=4.0)),
            _one("key frames a second", keys / played_s, keys, "/s"),
            _one("stabilised views a second", views / played_s, views, "/s", Bar(low=10.0)),
            _one("longest pause of the loop", 1000.0 * max(stalls[round(WARM_S * RATE_HZ) :], default=0.0),
                 len(stalls), "ms", Bar(high=100.0)),
            _one("solution adopted to map drawn anew, longest", max(times.settled_s, default=0.0),
                 len(times.settled_s), "s", Bar(high=3.0)),
            _one("resident at most, MiB (engine and graph)", max(resident, default=float("nan")), len(resident), ""),
            _one("resident, growth since a sixth of the flight", max(resident, default=float("nan")) / early,
                 len(resident), "x"),
            _one("pieces at the end", session.loop.tracker.pieces, 1, "", Bar(high=1.0)),
        ),
        notes=(f"{seconds} s of {width_px}x{height_px} at {RATE_HZ:g} fps{_flown(seconds)}; {note}",),
        data={"resident_mib": resident, "intervals": [asdict(i) for i in tally.intervals]},
    )  # fmt: skip


def _flown(seconds: int) -> str:
    if seconds <= LONGEST_S:
        return ""
    return (
        f", made of a flight of {LONGEST_S} s: four grounds (as it was, mirrored, negative, both) side by side, flown "
        "in turn, round after round; between two of them the picture jumps"
    )


def _zoom_of(session: Session) -> int:
    """Return the zoom of the map's own pixels among web tiles."""
    painter = session.hand.painter
    if painter is None or not painter.canvas.lattice.georeferenced:
        return 0
    return round(math.log2(2.0 * math.pi * 6378137.0 / 256 / painter.canvas.lattice.grid.pixel_size))


@contextlib.contextmanager
def _sampled(look: Callable[[], None]) -> Iterator[None]:
    """Look once a second, in a thread."""
    ended = threading.Event()

    def run() -> None:
        while not ended.wait(1.0):
            look()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _wall_s() -> float:
    """Return what to add to a time of the monotonic clock."""
    return time.time() - time.monotonic()


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
