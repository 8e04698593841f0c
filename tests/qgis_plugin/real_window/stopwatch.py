"""How long the window is held up: by the plugin's own code, and by anything at all."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field

from qgis.PyQt.QtCore import QObject, QTimer

BEAT_MS = 10


@dataclass
class Entry:
    """One stay in the plugin's code, from the event loop or from QGIS until it gave control back."""

    name: str
    cpu_ms: float
    wall_ms: float


@dataclass
class Stopwatch:
    """Times every entry into code below ``folder`` in this thread, and the gaps between beats of a timer.

    A beat that is late tells that somebody held the window up: QGIS itself, drawing, or a machine that was busy. What
    the plugin answers for is its entries, in time of this thread on a processor, whatever else the machine does.
    Entries that hold a nested event loop (a modal dialog) are left out: the window answers meanwhile.
    """

    folder: str
    entries: list[Entry] = field(default_factory=list)
    gaps_ms: list[float] = field(default_factory=list)
    _inside: object = None
    _begun: tuple[float, float] = (0.0, 0.0)
    _nested: bool = False

    def start(self, parent: QObject) -> None:
        """Begin."""
        self._last = time.perf_counter()
        timer = QTimer(parent)
        timer.timeout.connect(self._beat)
        timer.start(BEAT_MS)
        sys.setprofile(self._profile)

    def worst(self, count: int = 8) -> list[dict]:
        """Return the longest entries, as documents."""
        longest = sorted(self.entries, key=lambda e: -e.cpu_ms)[:count]
        return [{"name": e.name, "cpu_ms": round(e.cpu_ms, 1), "wall_ms": round(e.wall_ms, 1)} for e in longest]

    def _beat(self) -> None:
        now = time.perf_counter()
        self.gaps_ms.append(1000.0 * (now - self._last))
        self._last = now
        self._nested = self._nested or self._inside is not None

    def _profile(self, frame, event: str, argument: object) -> None:
        if event == "call" and self._inside is None and frame.f_code.co_filename.startswith(self.folder):
            self._inside, self._nested = frame, False
            self._begun = (time.thread_time(), time.perf_counter())
        elif event == "return" and frame is self._inside:
            cpu_s, wall_s = time.thread_time() - self._begun[0], time.perf_counter() - self._begun[1]
            self._inside = None
            if not self._nested:
                code = frame.f_code
                name = f"{code.co_filename[len(self.folder) + 1 :]}:{code.co_name}"
                self.entries.append(Entry(name, 1000.0 * cpu_s, 1000.0 * wall_s))
