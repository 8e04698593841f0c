"""A flight's events as signals in the window's thread, and calls that do not make it wait; lost links are mended."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Any

from qgis.PyQt.QtCore import QObject, Qt, pyqtSignal

from .connection import LiveConnection, LiveError

FIRST_WAIT_S, LONGEST_WAIT_S = 0.5, 8.0


class LiveFeed(QObject):
    """Follows one server until ``close``.

    ``opened`` carries the mission's document each time a connection is made, ``happened`` an event's name and document,
    ``lost`` words once a connection has ended. The feed tries again by itself, more and more seldom; ``refused`` is for
    what trying again cannot mend.
    """

    opened = pyqtSignal(object)
    happened = pyqtSignal(str, object)
    lost = pyqtSignal(str)
    refused = pyqtSignal(str)
    _call = pyqtSignal(object)

    def __init__(self, connection: LiveConnection, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._connection = connection
        self._closed = threading.Event()
        self._asked: queue.Queue = queue.Queue()
        self._call.connect(self._do, Qt.ConnectionType.QueuedConnection)
        for work, name in ((self._follow, "events"), (self._answer, "calls")):
            threading.Thread(target=work, name=f"photomap-live-{name}", daemon=True).start()

    def close(self) -> None:
        """Say nothing any more; the threads end by themselves."""
        self._closed.set()
        self._asked.put(None)

    def ask(
        self,
        call: Callable[[LiveConnection], Any],
        done: Callable[[Any], None] = lambda answer: None,
        failed: Callable[[str], None] = lambda words: None,
    ) -> None:
        """Make a call on the calls' thread, one after the other; the answer comes in the window's thread."""
        self._asked.put((call, done, failed))

    def _answer(self) -> None:
        while (asked := self._asked.get()) is not None:
            call, done, failed = asked
            try:
                answer = call(self._connection)
            except LiveError as error:
                words = str(error)
                self._later(lambda failed=failed, words=words: failed(words))
            except Exception as error:  # a fault of ours must reach the user, not end the thread
                words = f"{type(error).__name__}: {error}"
                self._later(lambda failed=failed, words=words: failed(words))
            else:
                self._later(lambda done=done, answer=answer: done(answer))

    def _follow(self) -> None:
        wait_s, after = FIRST_WAIT_S, ""
        while not self._closed.is_set():
            try:
                mission = self._connection.mission()
                self._later(lambda mission=mission: self.opened.emit(mission))
                wait_s = FIRST_WAIT_S
                path = (mission.get("links") or {}).get("events") or "events"
                for event in self._connection.events(path, after):
                    if self._closed.is_set():
                        return
                    after = event.id
                    self._later(lambda e=event: self.happened.emit(e.name, e.data))
                words = f"The connection to {self._connection.address.origin} has ended."
            except LiveError as error:
                words = str(error)
                if not error.gone:
                    self._later(lambda words=words: self.refused.emit(words))
                    return
            except Exception as error:
                words = f"{type(error).__name__}: {error}"
            self._later(lambda words=words: self.lost.emit(words))
            self._closed.wait(wait_s)
            wait_s = min(2.0 * wait_s, LONGEST_WAIT_S)

    def _later(self, call: Callable[[], None]) -> None:
        try:
            self._call.emit(call)
        except RuntimeError:  # QGIS is closing and the object is gone
            return

    def _do(self, call: Callable[[], None]) -> None:
        if not self._closed.is_set():
            call()
