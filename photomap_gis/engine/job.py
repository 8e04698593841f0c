"""One job: a command's process, what it has said so far, and how it ended."""

from __future__ import annotations

import contextlib
import subprocess
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

from photomap_gis.engine.documents import (
    ENDS,
    EndDocument,
    JobDocument,
    JobErrorDocument,
    JobState,
    JobSummaryDocument,
    LogDocument,
    OutputDocument,
    ProgressDocument,
    StateDocument,
)
from photomap_gis.engine.history import History
from photomap_gis.engine.kinds import Kind
from photomap_gis.engine.output import Documents, error_of, progress_of, words_of
from photomap_gis.engine.process import ask_to_stop, kill_tree, start_process, wait_for_end

_MAX_RESULT_BYTES = 64 << 20
_MAX_LINE_BYTES = 1 << 16
_LOG_KEPT = 200
_STAGES_KEPT = 64
_LAST_WORDS_S = 5.0
"""How long to read on after a process has ended, where something it started still holds its pipes."""


class Job:
    """A running or ended command; safe among threads. Three threads read its pipes and wait for its end."""

    def __init__(self, id: str, kind: Kind, arguments: Mapping[str, Any], argv: Sequence[str], folder: Path) -> None:
        """Start the command ``argv`` in ``folder``; ``PhotomapError`` where that cannot be."""
        self.id, self.kind = id, kind
        self.history = History()
        self._arguments, self._argv = dict(arguments), list(argv)
        self._state = JobState.RUNNING
        self._progress: ProgressDocument | None = None
        self._stages: set[str] = set()
        self._log: deque[str] = deque(maxlen=_LOG_KEPT)
        self._documents = Documents(_MAX_RESULT_BYTES)
        self._result: Any = None
        self._error: JobErrorDocument | None = None
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._timer: threading.Timer | None = None
        self._started_utc = _utc_now()
        self._ended_utc: str | None = None
        self._process = start_process(argv, folder)
        self.history.add("state", StateDocument(state=JobState.RUNNING))
        readers = [
            self._thread(self._read, self._process.stderr, self._hear),
            self._thread(self._read, self._process.stdout, self._take),
        ]
        self._thread(self._wait, readers)

    @property
    def ended(self) -> bool:
        """Whether its process is gone and all is told."""
        return self._ended.is_set()

    @property
    def result_bytes(self) -> int:
        """About what its result takes of memory."""
        return self._documents.bytes

    def stop(self, *, at_once: bool = False) -> None:
        """Ask it to stop, and kill it when its kind's patience is over, or now."""
        with self._lock:
            if self._state in ENDS:
                return
            first = self._state is JobState.RUNNING
            self._state = JobState.STOPPING
            if first and not at_once:
                self._timer = threading.Timer(self.kind.grace_s, self._kill)
                self._timer.daemon = True
                self._timer.start()
        if first:
            self.history.add("state", StateDocument(state=JobState.STOPPING))
            ask_to_stop(self._process)
        if at_once:
            self._kill()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for its end; return whether it came."""
        return self._ended.wait(timeout_s)

    def summary(self) -> JobSummaryDocument:
        """Return what a list of jobs shows."""
        with self._lock:
            return JobSummaryDocument(**self._summary())

    def document(self) -> JobDocument:
        """Return all that is known of it."""
        with self._lock:
            return JobDocument(
                **self._summary(),
                arguments=self._arguments,
                command=["photomap", *self._argv],
                result=self._result,
                error=self._error,
                log=list(self._log),
            )

    def _summary(self) -> dict[str, Any]:
        return {
            "id": self.id,
            "kind": self.kind.name,
            "state": self._state,
            "progress": self._progress,
            "started_utc": self._started_utc,
            "ended_utc": self._ended_utc,
        }

    def _thread(self, run: Callable[..., None], *arguments: Any) -> threading.Thread:
        thread = threading.Thread(target=run, args=arguments, name=f"job-{self.id}", daemon=True)
        thread.start()
        return thread

    def _read(self, pipe: IO[bytes], take: Callable[[bytes], None]) -> None:
        limit = _MAX_LINE_BYTES if pipe is self._process.stderr else _MAX_RESULT_BYTES + 1
        with contextlib.suppress(OSError, ValueError):  # closed under our hands: the job was killed
            while line := pipe.readline(limit):
                take(line)

    def _hear(self, line: bytes) -> None:
        words = words_of(line)
        progress = progress_of(words)
        if progress is None:
            if words:
                with self._lock:
                    self._log.append(words)
                self.history.add("log", LogDocument(line=words))
            return
        with self._lock:
            if len(self._stages) >= _STAGES_KEPT and progress.stage not in self._stages:
                return
            self._stages.add(progress.stage)
            self._progress = progress
        self.history.add("progress", progress, key=progress.stage)

    def _take(self, line: bytes) -> None:
        document = self._documents.feed(line)
        if document is not None:
            self.history.add("output", OutputDocument(document=document))

    def _wait(self, readers: Sequence[threading.Thread]) -> None:
        code = wait_for_end(self._process)
        for reader in readers:
            reader.join(_LAST_WORDS_S)
        if self._timer is not None:
            self._timer.cancel()
        result = self._documents.result()
        with self._lock:
            asked = self._state is JobState.STOPPING
            if code == 0 and result is not None:
                state, error = JobState.DONE, None
            elif code == 0:
                why = "is too large" if self._documents.overflowed else "is missing"
                state = JobState.FAILED
                error = JobErrorDocument(error="fault", message=f"the result of {self.kind.name} {why}", exit_code=0)
            else:
                state = JobState.CANCELLED if asked else JobState.FAILED
                error = error_of(code, list(self._log), result)
            if state is JobState.CANCELLED and error is not None and error.error in ("crashed", "fault"):
                # Killed; or interrupted in the middle of an import, where some libraries make another error of it.
                error = JobErrorDocument(error="stopped", message="stopped before it was done", exit_code=code)
            self._state, self._result, self._error, self._ended_utc = state, result, error, _utc_now()
        _close(self._process)
        self.history.add("end", EndDocument(state=state, result=result, error=error))
        self._ended.set()

    def _kill(self) -> None:
        kill_tree(self._process)


def _close(process: subprocess.Popen[bytes]) -> None:
    for pipe in (process.stdin, process.stdout, process.stderr):
        if pipe is not None:
            with contextlib.suppress(OSError, ValueError):
                pipe.close()


def _utc_now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
