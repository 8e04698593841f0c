"""The jobs of an engine: started, found again, bounded in number, and ended with it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click

from photomap_gis.core.errors import UsageError
from photomap_gis.engine.arguments import argv_of, command_document
from photomap_gis.engine.documents import CommandDocument
from photomap_gis.engine.job import Job
from photomap_gis.engine.kinds import KINDS, Kind

MOST_RUNNING = 8
_ENDED_KEPT = 50
_RESULTS_KEPT_BYTES = 128 << 20
_CLOSING_S = 30.0
_KILLED_S = 5.0

CommandOf = Callable[[str], click.Command]
"""Returns the command of a kind's name."""


class TooManyJobs(Exception):
    """As many jobs run as may at once."""


class Jobs:
    """All jobs of one engine; safe among threads."""

    def __init__(self, command_of: CommandOf, kinds: Mapping[str, Kind] = KINDS) -> None:
        self._command_of, self._kinds = command_of, kinds
        self._jobs: dict[str, Job] = {}
        self._count = 0
        self._closed = False
        self._lock = threading.Lock()

    @property
    def kinds(self) -> list[str]:
        """The names of what can be started."""
        return list(self._kinds)

    def commands(self) -> list[CommandDocument]:
        """Return every kind with its parameters."""
        return [command_document(name, self._command_of(name)) for name in self._kinds]

    def start(self, kind: str, arguments: Mapping[str, Any], folder: Path) -> Job:
        """Start a job; ``UsageError`` for arguments that cannot be, ``TooManyJobs`` where too many run."""
        known = self._kinds.get(kind)
        if known is None:
            raise UsageError(f"there is no job {kind!r}; there are {', '.join(self._kinds)}")
        argv = argv_of(kind, self._command_of(kind), arguments, known.forced, folder)
        with self._lock:
            if self._closed:
                raise TooManyJobs
            if sum(not job.ended for job in self._jobs.values()) >= MOST_RUNNING:
                raise TooManyJobs
            job = Job(str(self._count + 1), known, arguments, argv, folder)
            self._count += 1
            self._jobs[job.id] = job
            self._forget_old()
        return job

    def get(self, id: str) -> Job:
        """Return a job; ``KeyError`` where there is none of that name (any more)."""
        with self._lock:
            return self._jobs[id]

    def all(self) -> list[Job]:
        """Return the jobs that are still known, the newest last."""
        with self._lock:
            return list(self._jobs.values())

    def close(self) -> None:
        """End every job: each is asked, waited for a little, and killed."""
        with self._lock:
            self._closed = True
            running = [job for job in self._jobs.values() if not job.ended]
        for job in running:
            job.stop()
        deadline = time.monotonic() + _CLOSING_S
        for job in running:
            patience = min(job.kind.grace_s, deadline - time.monotonic())
            if not job.wait(max(0.0, patience)):
                job.stop(at_once=True)
                job.wait(_KILLED_S)

    def _forget_old(self) -> None:
        ended = [job for job in self._jobs.values() if job.ended]
        held = sum(job.result_bytes for job in ended)
        while ended and (len(ended) > _ENDED_KEPT or held > _RESULTS_KEPT_BYTES):
            oldest = ended.pop(0)
            held -= oldest.result_bytes
            del self._jobs[oldest.id]
