"""What a play in QGIS's real window needs: waiting without blocking, real clicks on widgets and places, pictures."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

from qgis.core import QgsPointXY
from qgis.PyQt.QtCore import QObject, QPoint, QTimer
from qgis.PyQt.QtWidgets import QApplication, QScrollArea, QWidget
from x_mouse import LEFT, Mouse

POLL_MS = 15
SETTLE_MS = 60
"""How long a click is given to travel through the X server before the play goes on."""


class Until:
    """A step of a play: wait until ``condition`` holds; ``words`` say what did not come, after ``seconds``."""

    def __init__(self, condition: Callable[[], object], words: str, seconds: float = 45.0) -> None:
        self.condition, self.words, self.seconds = condition, words, seconds


class Stage(QObject):
    """Runs a play (an iterator of ``Until``) by a timer of the window's own event loop, modal dialogs included."""

    def __init__(self, iface, folder: Path) -> None:
        super().__init__(iface.mainWindow())
        self.iface, self.folder, self.mouse = iface, folder, Mouse()
        self.result: dict = {"steps": []}
        self._play: Iterator[Until] | None = None
        self._waiting: Until | None = None
        self._since = 0.0
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._turn)
        self._on_end: Callable[[], None] = lambda: None

    def run(self, play: Iterator[Until], on_end: Callable[[], None]) -> None:
        """Begin the play; ``on_end`` is called after its last step, or its first fault."""
        self._play, self._on_end = play, on_end
        self._timer.start(POLL_MS)

    def note(self, **facts: object) -> None:
        """Keep facts for the test outside."""
        self.result.update(facts)

    def picture(self, name: str) -> Until:
        """Let the window settle, keep a picture of the screen, and go on."""

        def take() -> bool:
            QApplication.primaryScreen().grabWindow(0).save(str(self.folder / f"{name}.png"))
            return True

        canvas, calm = self.iface.mapCanvas(), time.monotonic() + 0.4
        return Until(lambda: time.monotonic() > calm and not canvas.isDrawing() and take(), f"the picture {name}")

    def click(self, widget: QWidget, at: QPoint | None = None, button: int = LEFT) -> Until:
        """Click a widget (its middle) with the real mouse, once it is to be seen."""
        if widget is None:
            raise AssertionError("there is no such widget to click")
        parent = widget.parent()
        while parent is not None:
            if isinstance(parent, QScrollArea):
                parent.ensureWidgetVisible(widget)
            parent = parent.parent()
        at = at or widget.rect().center()

        def press() -> bool:
            if not widget.isVisible() or not widget.isEnabled():
                return False
            place = widget.mapToGlobal(at)
            self.mouse.click(place.x(), place.y(), button)
            return True

        return Until(press, f"a click on {widget.objectName() or type(widget).__name__}", 20.0)

    def place(self, point: QgsPointXY) -> tuple[int, int]:
        """Return where on the screen the canvas shows a point of its own coordinates."""
        canvas = self.iface.mapCanvas()
        at = canvas.getCoordinateTransform().transform(point)
        spot = canvas.viewport().mapToGlobal(QPoint(round(at.x()), round(at.y())))
        return spot.x(), spot.y()

    def pause(self, ms: int = SETTLE_MS) -> Until:
        """Give events time to arrive."""
        end = time.monotonic() + ms / 1000.0
        return Until(lambda: time.monotonic() > end, "a pause")

    def _turn(self) -> None:
        try:
            if self._waiting is not None:
                if not self._waiting.condition():
                    if time.monotonic() - self._since > self._waiting.seconds:
                        raise AssertionError(f"{self._waiting.words} did not come in {self._waiting.seconds:g} s")
                    return
                self._waiting = None
            self._waiting = next(self._play)
            self._since = time.monotonic()
            self.result["steps"].append(self._waiting.words)
        except StopIteration:
            self._end()
        except Exception:
            self.result["fault"] = traceback.format_exc()
            QApplication.primaryScreen().grabWindow(0).save(str(self.folder / "fault.png"))
            self._end()

    def _end(self) -> None:
        self._timer.stop()
        self._on_end()

    def save(self) -> None:
        """Write what was noted for the test outside."""
        (self.folder / "result.json").write_text(json.dumps(self.result, indent=1, default=str))
