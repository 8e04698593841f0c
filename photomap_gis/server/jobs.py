"""Jobs: commands of ``photomap`` in processes of their own, so that one can be cancelled, or crash, alone.

Whatever the command line can do, a job can, with the same arguments and the same ``--json`` result. Progress comes as
JSON lines on the process's stderr (``PHOTOMAP_PROGRESS=json``).
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import signal
import subprocess
import sys
import threading
from collections import deque
from typing import IO, Any

from photomap_gis.core.errors import UsageError
from photomap_gis.server.events import Events
from photomap_gis.server.protocol import EventDocument, JobDocument, JobRequest, JobState, StageDocument

_NO_JOBS = {"serve", "engine", "live"}
_WORDS_KEPT = 40
_FINISHED_KEPT = 200
_MAX_LINE = 1 << 16
_MAX_RESULT_BYTES = 64 << 20
_GRACE_S = 20.0
EXIT_STOPPED = 130


class UnknownJob(KeyError):
    """No job has that name."""


class Jobs:
    """The jobs of a server and their processes; safe among threads."""

    def __init__(self, events: Events, command: tuple[str, ...] = (sys.executable, "-m", "photomap_gis.cli")) -> None:
        self._events, self._command = events, command
        self._jobs: dict[str, _Job] = {}
        self._lock = threading.Lock()

    def start(self, request: JobRequest) -> JobDocument:
        """Start a job; ``UsageError`` for a command that cannot be one."""
        if request.kind in _NO_JOBS or not request.kind.replace("-", "").isalnum():
            raise UsageError(f"{request.kind!r} cannot be a job: name a command like map, export or solve")
        if any("\0" in a for a in request.arguments):
            raise UsageError("arguments must not hold NUL characters")
        job = _Job(secrets.token_hex(6), request, self._command, self._tell)
        with self._lock:
            self._jobs[job.id] = job
            finished = [j for j in self._jobs.values() if j.state != "running"]
            for old in finished[: max(0, len(finished) - _FINISHED_KEPT)]:
                del self._jobs[old.id]
        job.start()
        return job.document

    def get(self, id: str) -> JobDocument:
        """Return a job; ``UnknownJob``."""
        return self._job(id).document

    def all(self) -> list[JobDocument]:
        """Return every job, the oldest first."""
        with self._lock:
            jobs = list(self._jobs.values())
        return [job.document for job in jobs]

    def cancel(self, id: str) -> JobDocument:
        """Ask a job to stop, as ^C does (what it finished is kept); ``UnknownJob``."""
        job = self._job(id)
        job.cancel()
        return job.document

    def close(self) -> None:
        """Stop all jobs and wait until they have ended."""
        with self._lock:
            jobs = list(self._jobs.values())
        for job in jobs:
            job.cancel()
        for job in jobs:
            job.wait()

    def _job(self, id: str) -> _Job:
        with self._lock:
            if id not in self._jobs:
                raise UnknownJob(id)
            return self._jobs[id]

    def _tell(self, document: JobDocument) -> None:
        self._events.send_soon(EventDocument(event="job", job=document))


class _Job:
    """One process, the threads that read it, and what is known of it."""

    def __init__(self, id: str, request: JobRequest, command: tuple[str, ...], tell: Any) -> None:
        self.id, self._request, self._command, self._tell = id, request, command, tell
        self._lock = threading.Lock()
        self._stages: dict[str, StageDocument] = {}
        self._words: deque[str] = deque(maxlen=_WORDS_KEPT)
        self._state: JobState = "running"
        self._exit_code: int | None = None
        self._result: Any = None
        self._cancelled = False
        self._process: subprocess.Popen[bytes] | None = None
        self._ended = threading.Event()

    @property
    def state(self) -> JobState:
        with self._lock:
            return self._state

    @property
    def document(self) -> JobDocument:
        with self._lock:
            return JobDocument(
                id=self.id,
                kind=self._request.kind,
                arguments=self._request.arguments,
                state=self._state,
                stages=list(self._stages.values()),
                exit_code=self._exit_code,
                message="\n".join(self._words) if self._state in ("failed", "cancelled") else "",
                result=self._result,
            )

    def start(self) -> None:
        arguments = list(self._request.arguments)
        if "--json" not in arguments:
            arguments.append("--json")
        self._process = subprocess.Popen(
            [*self._command, self._request.kind, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "PHOTOMAP_PROGRESS": "json"},
            start_new_session=True,  # a ^C at the server's terminal is ours to pass on
        )
        threading.Thread(target=self._follow, name=f"job-{self.id}", daemon=True).start()
        self._tell(self.document)

    def cancel(self) -> None:
        with self._lock:
            if self._state != "running" or self._cancelled:
                return
            self._cancelled = True
        process = self._process
        if process is None:
            return
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(signal.SIGINT if os.name == "posix" else signal.SIGTERM)
        killer = threading.Timer(_GRACE_S, self._kill)
        killer.daemon = True
        killer.start()

    def wait(self) -> None:
        if self._process is not None:
            self._ended.wait(_GRACE_S + 5.0)

    def _kill(self) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.kill()

    def _follow(self) -> None:
        process = self._process
        assert process is not None and process.stdout is not None and process.stderr is not None
        out = bytearray()
        reader = threading.Thread(target=_read_all, args=(process.stdout, out), daemon=True)
        reader.start()
        for line in iter(lambda: process.stderr.readline(_MAX_LINE), b""):  # type: ignore[union-attr]
            self._hear(line.decode("utf-8", "replace").rstrip())
        code = process.wait()
        reader.join()
        with self._lock:
            self._exit_code = code
            self._state = "done" if code == 0 else "cancelled" if self._cancelled or code == EXIT_STOPPED else "failed"
            with contextlib.suppress(ValueError):
                self._result = json.loads(out)
        self._ended.set()
        self._tell(self.document)

    def _hear(self, line: str) -> None:
        if line.startswith("{"):
            with contextlib.suppress(ValueError, TypeError, KeyError):
                told = json.loads(line)
                stage = StageDocument(stage=str(told["stage"]), done=int(told["done"]), total=int(told["total"]))
                with self._lock:
                    self._stages[stage.stage] = stage
                self._tell(self.document)
                return
        if line:
            with self._lock:
                self._words.append(line)


def _read_all(stream: IO[bytes], out: bytearray) -> None:
    """Read a stream to its end; beyond a limit it is read and dropped, so that the process is not held up."""
    while chunk := stream.read(1 << 16):
        if len(out) < _MAX_RESULT_BYTES:
            out += chunk
