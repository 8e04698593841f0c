"""Progress on stderr: bars with rate and time left on a terminal, one line a finished stage elsewhere.

With ``PHOTOMAP_PROGRESS=json`` in the environment it is JSON lines for a program that watches (``docs/protocol.md``).
"""

from __future__ import annotations

import json
import os
import time

import click
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

MACHINE_VARIABLE = "PHOTOMAP_PROGRESS"
_MACHINE_EVERY_S = 0.1


class RateColumn(ProgressColumn):
    """Steps a second."""

    def render(self, task: Task) -> Text:
        """Return the task's speed, empty while it is unknown."""
        return Text(f"{task.speed:.1f}/s" if task.speed else "", style="progress.data.speed")


class ProgressBars:
    """A callback ``(stage, done, total)`` that shows one bar a stage; use as a context manager."""

    def __init__(self, *, quiet: bool = False) -> None:
        self._quiet = quiet
        self._machine = MachineProgress() if os.environ.get(MACHINE_VARIABLE) == "json" else None
        self._console = Console(stderr=True)
        self._live = self._console.is_terminal and not quiet and self._machine is None
        self._bars = Progress(
            TextColumn("{task.description:<10}"),
            BarColumn(),
            MofNCompleteColumn(),
            RateColumn(),
            TimeRemainingColumn(),
            console=self._console,
        )
        self._tasks: dict[str, TaskID] = {}
        self._started: dict[str, float] = {}
        self._finished: set[str] = set()

    def __enter__(self) -> ProgressBars:
        if self._live:
            self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._bars.stop()

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Move a stage's bar; a stage may start anew after it was full (a second pass)."""
        if self._machine is not None:  # whoever set the variable wants to know, whatever --quiet says to people
            if (line := self._machine.line(stage, done, total, time.monotonic())) is not None:
                click.echo(line, err=True)
            return
        if self._live:
            if stage not in self._tasks:
                self._tasks[stage] = self._bars.add_task(stage, total=total)
            self._bars.update(self._tasks[stage], completed=done, total=total)
            return
        started = self._started.setdefault(stage, time.monotonic())
        if done < total:
            self._finished.discard(stage)
        elif not self._quiet and stage not in self._finished:
            self._finished.add(stage)
            click.echo(f"{stage}: {total} in {time.monotonic() - started:.1f} s", err=True)


class MachineProgress:
    """Progress as JSON lines: at most ten a second and stage, its beginning and its end always."""

    def __init__(self) -> None:
        self._started: dict[str, tuple[float, int]] = {}
        self._told: dict[str, tuple[float, int, int]] = {}

    def line(self, stage: str, done: int, total: int, now_s: float) -> str | None:
        """Return the line to print at a monotonic time in seconds, ``None`` where it can wait."""
        told = self._told.get(stage)
        if told is None or done < told[1]:
            self._started[stage] = (now_s, done)  # a stage that was resumed does not count what was done before
        elif (done, total) == told[1:] or (done < total and now_s - told[0] < _MACHINE_EVERY_S):
            return None
        self._told[stage] = (now_s, done, total)
        started_s, first = self._started[stage]
        elapsed_s = now_s - started_s
        rate = (done - first) / elapsed_s if elapsed_s > 0 and done > first else None
        eta_s = None if rate is None else max(0, total - done) / rate
        return json.dumps(
            {
                "progress": stage,
                "done": done,
                "total": total,
                "rate": None if rate is None else round(rate, 3),
                "eta_s": None if eta_s is None else round(eta_s, 1),
            }
        )
