"""The engine in QGIS: its process, its jobs as signals, and calls that never make the window wait.

    engine = Engine()                                     # nothing starts yet
    job = engine.start("map", {"sources": [...], "output": "..."})     # starts the engine if need be; returns at once
    job.progress.connect(...); job.finished.connect(...); job.failed.connect(...)
    engine.ask(lambda client: client.open_mission(folder), done=show, failed=messages.fail)
    engine.shutdown()                                     # QGIS closes, or the plugin is unloaded

All signals and callbacks come in the thread of the window. What waits (HTTP, streams of events) does so on threads.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping
from typing import Any

from qgis.PyQt.QtCore import QCoreApplication, QObject, QProcess, QProcessEnvironment, Qt, QTimer, pyqtSignal

from .client import Address, Client, EngineError, EngineGone, JobCancelled, JobFailed, result_of
from .environment import clean_environment, qgis_roots
from .finder import EngineNotFound, find_engine
from .kept_engine import KeptEngine
from .settings import Settings, load_settings

_LINES_KEPT = 40
_READY_MS = 60_000


def where_is_the_engine(settings: Settings) -> str:
    """Return words for the options page: the engine that these settings lead to, or how to get one."""
    try:
        found = find_engine(settings.engine_path, settings.environment)
    except EngineNotFound as error:
        return str(error)
    return f"{' '.join(found.command)} ({found.how})"


class EngineJob(QObject):
    """A job as signals. Exactly one of ``finished`` and ``failed`` comes, then ``ended``; never within ``start``.

    ``progress`` is stage, steps done, steps in all, steps a second, seconds left; 0 where unknown. A job that was
    cancelled fails: ``state`` is then ``"cancelled"``. ``error`` is the engine's document of a failure (``error``,
    ``message``, ``exit_code``), ``result`` what a command told although it failed, as uploads do.
    """

    started = pyqtSignal()
    progress = pyqtSignal(str, float, float, float, float)
    log = pyqtSignal(str)
    output = pyqtSignal(object)
    finished = pyqtSignal(object)
    failed = pyqtSignal(str)
    ended = pyqtSignal()

    def __init__(self, engine: Engine, kind: str, arguments: Mapping[str, Any], folder: str) -> None:
        super().__init__(engine)
        self._engine = engine
        self.kind, self.arguments, self.folder = kind, dict(arguments), folder
        self.id = ""
        self.state = "waiting"
        self.error: dict[str, Any] = {}
        self.result: Any = None
        self._stop_asked = False

    @property
    def running(self) -> bool:
        """Whether its end is still to come."""
        return self.state in ("waiting", "running", "stopping")

    def cancel(self, force: bool = False) -> None:
        """Ask it to stop (what is finished is kept); ``force`` kills it. Its end is still told by ``failed``."""
        if not self.running:
            return
        self._stop_asked = True
        if self.state == "waiting" and not self.id:
            return  # told to the engine as soon as it has begun
        self.state = "stopping"
        id = self.id
        self._engine.ask(lambda client: client.stop_job(id, force), failed=lambda words: None)

    # What follows is called by the engine, in the window's thread.

    def _begun(self, document: Mapping[str, Any]) -> None:
        self.id, self.state = document["id"], "running"
        self.started.emit()
        if self._stop_asked:
            self.cancel()

    def _heard(self, name: str, data: Mapping[str, Any]) -> None:
        if not self.running:
            return
        if name == "progress":
            numbers = (float(data.get(key) or 0.0) for key in ("done", "total", "rate", "eta_s"))
            self.progress.emit(str(data.get("stage", "")), *numbers)
        elif name == "log":
            self.log.emit(str(data.get("line", "")))
        elif name == "output":
            self.output.emit(data.get("document"))
        elif name == "end":
            self._end(data)

    def _end(self, data: Mapping[str, Any]) -> None:
        if not self.running:
            return
        self.result, self.error = data.get("result"), dict(data.get("error") or {})
        try:
            result = result_of(data)
        except JobCancelled as error:
            self.state = "cancelled"
            self._fail(str(error))
        except JobFailed as error:
            self.state = "failed"
            self._fail(error.message)
        else:
            self.state = "done"
            self._engine._forget(self)
            self.finished.emit(result)
            self.ended.emit()

    def _lost(self, words: str) -> None:
        if self.running:
            self.state = "cancelled" if self._stop_asked else "failed"
            self.error = self.error or {"error": "engine", "message": words, "exit_code": 0}
            self._fail(words)

    def _fail(self, words: str) -> None:
        self._engine._forget(self)
        self.failed.emit(words)
        self.ended.emit()


class Engine(QObject):
    """One engine for all of the plugin; started when first needed, and again after it ended.

    ``ready`` carries nothing; ``ended`` why the engine is gone, in words for the user, unless ``shutdown`` ended it.
    """

    ready = pyqtSignal()
    ended = pyqtSignal(str)
    said = pyqtSignal(str)
    _call = pyqtSignal(object)

    def __init__(self, parent: QObject | None = None, settings: Callable[[], Settings] = load_settings) -> None:
        super().__init__(parent)
        self._settings = settings
        self._client: Client | None = None
        self._process: QProcess | None = None
        self._kept: KeptEngine | None = None
        self._waiting: list[tuple[Callable[[Client], None], Callable[[str], None]]] = []
        self._jobs: list[EngineJob] = []
        self._last_lines: list[str] = []
        self._closed = False
        self._call.connect(self._do, Qt.ConnectionType.QueuedConnection)

    @property
    def is_ready(self) -> bool:
        """Whether an engine answers, as far as is known."""
        return self._client is not None

    @property
    def address(self) -> Address | None:
        """Where the engine listens, for tile URLs; ``None`` while there is none."""
        return None if self._client is None else self._client.address

    @property
    def jobs(self) -> list[EngineJob]:
        """The jobs whose end is still to come."""
        return list(self._jobs)

    @property
    def pid(self) -> int:
        """The number of the engine's process where we hold it, else 0."""
        return 0 if self._process is None else int(self._process.processId())

    def start(self, kind: str, arguments: Mapping[str, Any], folder: str = "") -> EngineJob:
        """Return a new job at once; paths in ``arguments`` should be absolute, or begin in ``folder``.

        ``arguments`` are the command's options by their long names: ``{"sources": [...], "gcp_crs": "EPSG:25832"}``.
        """
        job = EngineJob(self, kind, arguments, folder)
        self._jobs.append(job)

        def begin(client: Client) -> None:
            threading.Thread(target=self._follow, args=(client, job), name=f"photomap-{kind}", daemon=True).start()

        self._when_ready(begin, job._lost)
        return job

    def ask(
        self,
        call: Callable[[Client], Any],
        done: Callable[[Any], None] = lambda answer: None,
        failed: Callable[[str], None] | None = None,
    ) -> None:
        """Make a call on a thread; its answer comes to ``done``, words of a failure to ``failed`` (default: ``ended``).

        An engine is started for it where there is none.
        """
        on_failure = self.ended.emit if failed is None else failed

        def begin(client: Client) -> None:
            threading.Thread(target=work, args=(client,), name="photomap-call", daemon=True).start()

        def work(client: Client) -> None:
            try:
                answer = call(client)
            except EngineError as error:
                words, gone = error.message, isinstance(error, EngineGone)
                self._later(lambda: self._refused(client, words, gone, on_failure))
                return
            except Exception as error:  # a fault of ours must reach the user, not vanish with the thread
                words = f"{type(error).__name__}: {error}"
                self._later(lambda: on_failure(words))
                return
            self._later(lambda: done(answer))

        self._when_ready(begin, on_failure)

    def ensure(self) -> None:
        """Start the engine now, so that the first job need not wait for it."""
        self._when_ready(lambda client: None, lambda words: None)

    def shutdown(self) -> None:
        """End the engine and its jobs, unless the settings say that it stays; returns at once, and then is silent."""
        self._closed = True
        stays = self._settings().stay
        if self._kept is not None:
            self._kept.let_go(None if stays else self._client)
            self._kept = None
        if self._process is not None:
            process, self._process = self._process, None
            process.disconnect()
            # It ends by the end of its stdin. The object lives on with the application until then, as Qt demands.
            process.setParent(QCoreApplication.instance())
            process.finished.connect(process.deleteLater)
            process.closeWriteChannel()
        self._client = None
        self._waiting.clear()
        for job in list(self._jobs):
            job.state = "cancelled"
        self._jobs.clear()

    def _when_ready(self, begin: Callable[[Client], None], failed: Callable[[str], None]) -> None:
        if self._closed:
            self._later(lambda: failed("The plugin is being unloaded."))
        elif self._client is not None:
            begin(self._client)
        else:
            self._waiting.append((begin, failed))
            if self._process is None and self._kept is None:
                self._launch()

    def _launch(self) -> None:
        settings = self._settings()
        try:
            found = find_engine(settings.engine_path, settings.environment)
        except EngineNotFound as error:
            words = str(error)
            QTimer.singleShot(0, lambda: self._gone(words, told=False))
            return
        self._last_lines = []
        environment = clean_environment(os.environ, qgis_roots())
        if settings.stay:
            self._kept = KeptEngine(self, found.command, environment)
            self._kept.found.connect(self._at)
            self._kept.failed.connect(lambda words: self._gone(words, told=False))
            self._kept.begin()
            return
        process = QProcess(self)
        variables = QProcessEnvironment()
        for name, value in environment.items():
            variables.insert(name, value)
        process.setProcessEnvironment(variables)
        process.setWorkingDirectory(os.path.expanduser("~"))  # noqa: PTH111
        process.setProcessChannelMode(QProcess.ProcessChannelMode.SeparateChannels)
        process.readyReadStandardOutput.connect(self._read_ready_line)
        process.readyReadStandardError.connect(self._read_words)
        process.errorOccurred.connect(self._not_started)
        process.finished.connect(self._finished)
        self._process = process
        process.start(found.command[0], [*found.command[1:], "engine"])
        QTimer.singleShot(_READY_MS, lambda: self._too_slow(process))

    def _read_ready_line(self) -> None:
        process = self._process
        if process is None or self._client is not None or not process.canReadLine():
            return
        line = bytes(process.readLine()).decode("utf-8", "replace")
        try:
            address = Address.of_ready_line(line)
        except EngineError as error:
            self._drop_process()
            self._gone(error.message, told=False)
            return
        self._at(address)

    def _at(self, address: Address) -> None:
        self._client = Client(address)
        waiting, self._waiting = self._waiting, []
        for begin, _ in waiting:
            begin(self._client)
        self.ready.emit()

    def _read_words(self) -> None:
        if self._process is None:
            return
        for line in bytes(self._process.readAllStandardError()).decode("utf-8", "replace").splitlines():
            self._last_lines = [*self._last_lines, line][-_LINES_KEPT:]
            self.said.emit(line)

    def _not_started(self, error: QProcess.ProcessError) -> None:
        if error == QProcess.ProcessError.FailedToStart and self._process is not None:
            program, why = self._process.program(), self._process.errorString()
            self._drop_process()
            self._gone(f"The engine {program} cannot be started: {why}", told=False)

    def _too_slow(self, process: QProcess) -> None:
        if self._process is process and self._client is None:
            self._drop_process()
            self._gone("The engine did not get ready within a minute: try again, or see what it says in a terminal.")

    def _finished(self, *_: object) -> None:
        told = self._client is not None
        self._read_words()
        self._drop_process()
        if told:
            words = EngineGone("its process has ended").message
        else:
            said = "\n".join(self._last_lines[-5:]) or "nothing"
            words = f"The engine ended before it was ready. It said: {said}"
        self._gone(words, told=told)

    def _drop_process(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        process.disconnect()
        if process.state() == QProcess.ProcessState.NotRunning:
            process.deleteLater()
        else:
            process.finished.connect(process.deleteLater)
            process.kill()

    def _gone(self, words: str, told: bool = True) -> None:
        """No engine any more: whoever waits is told, and the next call starts a new one."""
        self._client = None
        if self._kept is not None:
            self._kept.let_go(None)
            self._kept = None
        waiting, self._waiting = self._waiting, []
        jobs = list(self._jobs)
        for job in jobs:
            job._lost(words)
        for _, failed in waiting:
            if not isinstance(getattr(failed, "__self__", None), EngineJob):
                failed(words)
        if told:
            self.ended.emit(words)

    def _refused(self, client: Client, words: str, gone: bool, failed: Callable[[str], None]) -> None:
        if gone:
            self._lost_touch(client, words)
        failed(words)

    def _lost_touch(self, client: Client, words: str) -> None:
        """A call found nobody. Where we hold the process its end tells more; another's engine is simply gone."""
        if self._client is client and self._process is None:
            self._gone(words)

    def _follow(self, client: Client, job: EngineJob) -> None:
        """On a thread: start a job and hand on what happens in it."""
        try:
            document = client.start_job(job.kind, job.arguments, job.folder or None)
            self._later(lambda: job._begun(document))
            for event in client.events(document["id"]):
                self._later(lambda event=event: job._heard(event.name, event.data))
        except EngineError as error:
            words, kind, gone = error.message, error.error, isinstance(error, EngineGone)

            def lost() -> None:
                if gone:
                    self._lost_touch(client, words)
                else:
                    job.error = {"error": kind, "message": words, "exit_code": 2}
                job._lost(words)

            self._later(lost)
        except Exception as error:  # a fault of ours must end the job, not leave it running for ever
            words = f"{type(error).__name__}: {error}"
            self._later(lambda: job._lost(words))

    def _forget(self, job: EngineJob) -> None:
        if job in self._jobs:
            self._jobs.remove(job)

    def _later(self, call: Callable[[], None]) -> None:
        """Have something done in the window's thread; called from any thread."""
        try:
            self._call.emit(call)
        except RuntimeError:  # QGIS is closing and the object is gone
            return

    def _do(self, call: Callable[[], None]) -> None:
        if not self._closed:
            call()
