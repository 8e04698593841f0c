"""Memory over a long flight: a patrol over ground that goes on, as fast as it goes, the graph in the same process."""

from __future__ import annotations

import shutil
from pathlib import Path

from photomap_gis.live.flight import Flight
from photomap_gis.live.opening import begin_session
from photomap_gis.live.options import LiveOptions

from ..registration.report import Bar, Figure, Section
from ..registration.score import Interval
from ..telling import LineProgress
from .flights import video_of
from .patrol import Patrol

LOOKS = 60
"""So often memory is looked at."""


def measure(folder: Path, *, frames: int, seconds: int = 40, width_px: int = 1280, height_px: int = 720) -> Section:
    """Fly so many frames and watch the process grow."""
    video = video_of(folder, seconds, width_px=width_px, height_px=height_px)
    mission = folder / "mission-memory"
    shutil.rmtree(mission, ignore_errors=True)
    seen: list[tuple[int, float]] = []
    progress = LineProgress("memory")

    def look(number: int) -> None:
        progress(number, frames)
        if number % max(1, frames // LOOKS) == 0:
            seen.append((number, resident_mib()))

    patrol = Patrol(video, frames, on_frame=look)
    with Flight(begin_session("patrol", mission, patrol, LiveOptions(), None), patrol, realtime=False) as flight:
        flight.fly()
        keys, looks = len(flight.session.loop.chart), flight.session.hand.looks
        pieces, solutions = flight.session.loop.tracker.pieces, flight.session.loop.tally.solutions
    shutil.rmtree(mission, ignore_errors=True)
    early = max(mib for n, mib in seen if n <= frames / 6)
    late = max(mib for _, mib in seen)
    return Section(
        "memory",
        (
            Figure("resident after a sixth of the flight", Interval(early, early, early), keys, ""),
            Figure("resident at most, MiB", Interval(late, late, late), keys, "", Bar(high=2048.0)),
            Figure("growth since a sixth of the flight", Interval(late / early, 0.0, 0.0), keys, "x", Bar(high=1.1)),
        ),
        notes=(
            f"{frames} frames of {width_px}x{height_px}, {keys} key frames, {looks} looks, {solutions} solutions, "
            f"{pieces} piece(s); laps of a {seconds} s video side by side, mirrored and negative in turn: the ground "
            "goes on; loop, graph and painting in one process",
        ),
        data={"rss_mib": seen},
    )


def resident_mib(pid: int | None = None) -> float:
    """Return the resident memory of a process, else of this one; 0 where there is no such process."""
    status = Path(f"/proc/{pid or 'self'}/status")
    if not status.is_file():
        return 0.0
    for line in status.read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return float(line.split()[1]) / 1024.0
    return 0.0
