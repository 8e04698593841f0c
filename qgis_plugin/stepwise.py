"""Work that must be done in the window's thread, cut into steps with a turn of the event loop between them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from qgis.PyQt.QtCore import QObject, QTimer


class Stepwise(QObject):
    """Takes one step of an iterator a turn; ``on_done`` gets the last value, ``on_error`` what a step raised.

    With ``stop`` it takes no further step and says nothing.
    """

    def __init__(self, steps: Iterator, on_done: Callable, on_error: Callable[[Exception], None], parent=None) -> None:
        super().__init__(parent)
        self._steps, self._on_done, self._on_error = steps, on_done, on_error
        self._last: object = None
        self._timer = QTimer(self)
        self._timer.setInterval(0)
        self._timer.timeout.connect(self._step)
        self._timer.start()

    def stop(self) -> None:
        """Take no further step."""
        self._timer.stop()

    def _step(self) -> None:
        try:
            self._last = next(self._steps)
            return
        except StopIteration:
            self._timer.stop()
        except Exception as error:
            self._timer.stop()
            self._on_error(error)
            return
        self._on_done(self._last)
