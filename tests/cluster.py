"""A Dask scheduler and worker processes on loopback, for tests of many machines."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

_READY_S = 60.0


class LocalCluster:
    """A scheduler and its workers, each a process of its own."""

    def __init__(self, folder: Path, workers: int) -> None:
        self._folder = folder
        file = folder / "scheduler.json"
        self._scheduler = self._start(
            "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)
        )
        self.address = self._address_of(self._scheduler)
        self.workers = [self.add_worker() for _ in range(workers)]

    def add_worker(self) -> subprocess.Popen[str]:
        """Start a worker with one thread; the scheduler hears of it when it is up."""
        return self._start(
            "worker", self.address, "--nthreads", "1", "--no-dashboard", "--no-nanny", "--host", "127.0.0.1",
            "--local-directory", str(self._folder),
        )  # fmt: skip

    def close(self) -> None:
        """End all processes."""
        for process in [*self.workers, self._scheduler]:
            process.kill()
            process.wait()
            if process.stderr is not None:
                process.stderr.close()

    def _start(self, *words: str) -> subprocess.Popen[str]:
        root = Path(__file__).resolve().parents[1]
        environment = {**os.environ, "PYTHONPATH": f"{root}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
        quiet = subprocess.PIPE if words[0] == "scheduler" else subprocess.DEVNULL
        return subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]], env=environment, text=True,
            stdout=subprocess.DEVNULL, stderr=quiet,
        )  # fmt: skip

    @staticmethod
    def _address_of(scheduler: subprocess.Popen[str]) -> str:
        assert scheduler.stderr is not None
        for line in scheduler.stderr:
            if "Scheduler at:" in line:
                return line.split()[-1]
        raise RuntimeError("the scheduler did not start")


@contextmanager
def local_cluster(folder: Path, workers: int = 2) -> Iterator[LocalCluster]:
    """Yield a running cluster; skip where Dask is absent."""
    pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    cluster = LocalCluster(folder, workers)
    try:
        yield cluster
    finally:
        cluster.close()
