"""The plan as it is edited: asked of the engine when edits pause, an answer that is no longer wanted is dropped."""

from __future__ import annotations

import itertools
import json
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from qgis.PyQt.QtCore import QObject, QTimer, pyqtSignal

from ..translation import tr
from .request import PlanRequest

PAUSE_MS = 300
MOST_KEPT = 20
"""Files of areas: jobs that were started a moment ago still read theirs."""


class Preview(QObject):
    """Runs the engine's job ``plan`` for the newest request only.

    ``planned`` carries the plan's document and drawing (dicts), ``failed`` words, ``busy`` whether a job runs.
    """

    planned = pyqtSignal(object, object)
    failed = pyqtSignal(str)
    busy = pyqtSignal(bool)

    def __init__(self, start: Callable[[str, dict], object], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._start = start
        self._folder = Path(tempfile.mkdtemp(prefix="photomap-plan-"))
        self._number = 0
        self._kept: list[Path] = []
        self._names = itertools.count(1)
        self._job: object | None = None
        self._request: Callable[[], PlanRequest | None] | None = None
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(PAUSE_MS)
        self._timer.timeout.connect(self._run)

    @property
    def folder(self) -> Path:
        """Where this dock's passing files lie."""
        return self._folder

    def release(self) -> None:
        """Stop what runs and take the files away."""
        self.stop()
        shutil.rmtree(self._folder, ignore_errors=True)

    def want(self, request: Callable[[], PlanRequest | None]) -> None:
        """Plan what ``request`` gives when edits pause; ``None``: nothing can be planned now."""
        self._request = request
        self._timer.start()

    def stop(self) -> None:
        """Want nothing any more."""
        self._timer.stop()
        self._drop()

    def keep(self, name: str, text: str) -> str:
        """Write a file for the next job and return its path; earlier jobs keep theirs."""
        self._kept.append(self._folder / f"kept-{next(self._names)}-{name}")
        self._kept[-1].write_text(text, encoding="utf-8")
        while len(self._kept) > MOST_KEPT:
            self._kept.pop(0).unlink()
        return str(self._kept[-1])

    def _drop(self) -> None:
        job, self._job = self._job, None
        self._number += 1  # whatever still answers is stale
        if job is not None:
            job.cancel()
            self.busy.emit(False)

    def _run(self) -> None:
        self._drop()
        request = self._request() if self._request is not None else None
        if request is None:
            return
        number = self._number
        drawing = self._folder / f"{number}-drawing.geojson"
        job = self._start("plan", request.arguments(drawing=str(drawing)))
        if job is None:
            return
        self._job = job
        self.busy.emit(True)
        job.finished.connect(lambda result: self._finished(number, result, drawing))
        job.failed.connect(lambda message: self._failed(number, message))

    def _finished(self, number: int, result: dict, drawing: Path) -> None:
        if number != self._number:
            self._forget(number)
            return
        self._job = None
        self.busy.emit(False)
        try:
            drawn = json.loads(drawing.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            self.failed.emit(tr("The plan's drawing cannot be read: {}").format(error))
            return
        self._forget(number)
        self.planned.emit(result, drawn)

    def _failed(self, number: int, message: str) -> None:
        self._forget(number)
        if number != self._number:
            return
        self._job = None
        self.busy.emit(False)
        self.failed.emit(message)

    def _forget(self, number: int) -> None:
        for path in self._folder.glob(f"{number}-*"):
            path.unlink(missing_ok=True)
