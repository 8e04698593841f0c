"""An engine that stays when QGIS closes: started on its own feet, and found again by the next QGIS."""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QObject, QProcess, QProcessEnvironment, QTimer, pyqtSignal

from .client import Address, Client, EngineError

_LOOK_MS = 50
_PATIENCE_MS = 60_000
_QUESTION_S = 3.0


class KeptEngine(QObject):
    """Finds the engine that an earlier QGIS left running, or starts one with ``--stay``.

    Its first line, with the token, is kept in the user's profile, in a file that only the user can read. ``found`` or
    ``failed`` comes after ``begin``, never within it.
    """

    found = pyqtSignal(object)
    failed = pyqtSignal(str)
    _answered = pyqtSignal(object)

    def __init__(self, parent: QObject, command: Sequence[str], environment: Mapping[str, str]) -> None:
        super().__init__(parent)
        self._command, self._environment = list(command), dict(environment)
        self._file = Path(QgsApplication.qgisSettingsDirPath()) / "photomap-engine.json"
        self._timer = QTimer(self)
        self._timer.setInterval(_LOOK_MS)
        self._timer.timeout.connect(self._look)
        self._waited_ms = 0
        self._answered.connect(self._asked)

    def begin(self) -> None:
        """Look for the engine of the file; ask it on a thread whether it is there."""
        address = self._kept_address()
        if address is None:
            QTimer.singleShot(0, self._start)
            return

        def ask() -> None:
            try:
                Client(address, _QUESTION_S).about()
                answer = address
            except EngineError:
                answer = None
            try:
                self._answered.emit(answer)
            except RuntimeError:  # let go meanwhile
                return

        threading.Thread(target=ask, name="photomap-kept", daemon=True).start()

    def let_go(self, client: Client | None) -> None:
        """Forget about it; with a client, have the engine end as well."""
        self._timer.stop()
        self.blockSignals(True)
        if client is not None:
            self._file.unlink(missing_ok=True)

            def end() -> None:
                try:
                    client.stop_engine()
                except EngineError:
                    return  # it has ended already

            threading.Thread(target=end, name="photomap-goodbye").start()  # QGIS waits for this one: it takes moments
        self.deleteLater()

    def _asked(self, address: Address | None) -> None:
        if address is not None:
            self.found.emit(address)
        else:
            self._start()

    def _start(self) -> None:
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            self._file.unlink(missing_ok=True)
            # Made by us before the engine writes to it, so that the token is never readable by others.
            os.close(os.open(self._file, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
        except OSError as error:
            self.failed.emit(f"The engine's address cannot be kept in {self._file}: {error.strerror}")
            return
        process = QProcess()
        variables = QProcessEnvironment()
        for name, value in self._environment.items():
            variables.insert(name, value)
        process.setProcessEnvironment(variables)
        process.setWorkingDirectory(str(Path.home()))
        process.setStandardInputFile(QProcess.nullDevice())
        process.setStandardOutputFile(str(self._file))
        process.setStandardErrorFile(QProcess.nullDevice())
        process.setProgram(self._command[0])
        process.setArguments([*self._command[1:], "engine", "--stay"])
        started = process.startDetached()
        if not (started[0] if isinstance(started, tuple) else started):
            self.failed.emit(f"The engine {self._command[0]} cannot be started.")
            return
        self._waited_ms = 0
        self._timer.start()

    def _look(self) -> None:
        address = self._kept_address()
        self._waited_ms += _LOOK_MS
        if address is not None:
            self._timer.stop()
            self.found.emit(address)
        elif self._waited_ms > _PATIENCE_MS:
            self._timer.stop()
            self.failed.emit("The engine did not get ready within a minute: try 'photomap engine' in a terminal.")

    def _kept_address(self) -> Address | None:
        try:
            text = self._file.read_text(encoding="utf-8")
            return Address.of_ready_line(text) if text.endswith("\n") else None
        except (OSError, UnicodeDecodeError, EngineError):
            return None
