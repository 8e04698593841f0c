"""One function over many jobs: serially, in threads, in processes or on a cluster, in order and bounded in flight.

Jobs are small (indices, references), never pixels: a job opens its pixels where it runs. Every executor gives the
same results in the same order; they differ only in where the work is done. OpenCV, NumPy and zlib release the
interpreter lock, so threads suffice for pixels; processes are for pure Python. ``dask`` sends jobs to the workers of a
Dask scheduler: a job that is lost with its worker is run again by another one, so it must do no harm twice.
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import re
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sized
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache
from typing import Any, Literal, TypeVar, get_args

from photomap_gis.core.errors import LinkError, MissingExtraError, PhotomapError, UsageError

Job = TypeVar("Job")
Result = TypeVar("Result")
ExecutorName = Literal["threads", "serial", "processes", "dask"]
Progress = Callable[[int, int], None]

_CONNECT_S = 10.0
_POLL_S = 1.0  # a wait without a timeout cannot be interrupted by Ctrl-C on Windows


def map_jobs(
    fn: Callable[[Job], Result],
    jobs: Iterable[Job],
    *,
    executor: ExecutorName = "threads",
    workers: int | None = None,
    scheduler: str | None = None,
    on_progress: Progress | None = None,
) -> Iterator[Result]:
    """Yield ``fn(job)`` for every job, in the order of the jobs.

    Work starts with the first ``next``. At most two jobs a worker are in flight or waiting to be taken, and ``jobs``
    is read no further than that: it may be an endless generator, and a slow consumer slows the workers.
    An exception of ``fn`` is raised when its job's turn comes; then, and on ``KeyboardInterrupt`` or when the
    iterator is closed, jobs that have not started are dropped and those that run are waited for.

    ``workers`` defaults to the processors this process may use. ``on_progress(done, total)`` is called in the
    consumer's thread before each result is handed over; where ``jobs`` has no length, ``total`` is how many were read.
    With ``"processes"`` and ``"dask"`` ``fn``, jobs and results must be picklable and ``fn`` importable. ``"dask"``
    takes the address of a ``scheduler`` (``tcp://HOST:PORT``); where one is given, it is the executor.
    """
    if executor not in get_args(ExecutorName):
        raise ValueError(f"executor must be one of {', '.join(get_args(ExecutorName))}, got {executor!r}")
    if workers is not None and workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    if scheduler is not None:
        return _on_cluster(fn, jobs, scheduler, on_progress)
    if executor == "dask":
        raise ValueError("executor 'dask' needs the address of a scheduler")
    if executor == "serial":
        return _serial(fn, jobs, on_progress)
    return _pooled(fn, jobs, executor, workers or usable_cpus(), on_progress)


def give_back_memory() -> None:
    """Return memory that was freed to the system, where the C library keeps it for each thread (glibc).

    Threads come and go with each pool; what their heaps hold would add up from stage to stage. To be called between
    stages, when large arrays have been dropped: it takes some milliseconds.
    """
    trim = _malloc_trim()
    if trim is not None:
        trim(0)


@lru_cache(maxsize=1)
def _malloc_trim() -> Callable[[int], int] | None:
    if not sys.platform.startswith("linux"):
        return None
    try:
        trim: Callable[[int], int] = ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError):  # another C library
        return None
    return trim


def usable_cpus() -> int:
    """Return how many processors this process may use (a container or ``taskset`` may grant fewer than there are)."""
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return os.cpu_count() or 1


def _serial(fn: Callable[[Job], Result], jobs: Iterable[Job], on_progress: Progress | None) -> Iterator[Result]:
    total = _length(jobs)
    for done, job in enumerate(jobs, start=1):
        result = fn(job)
        if on_progress is not None:
            on_progress(done, max(done, total))
        yield result


def _pooled(
    fn: Callable[[Job], Result],
    jobs: Iterable[Job],
    executor: ExecutorName,
    workers: int,
    on_progress: Progress | None,
) -> Iterator[Result]:
    total, done, read = _length(jobs), 0, 0
    pending: deque[Future[Result]] = deque()
    source = iter(jobs)
    pool = _open_pool(executor, workers)
    try:
        while True:
            while len(pending) < 2 * workers:
                try:
                    job = next(source)
                except StopIteration:
                    break
                read += 1
                pending.append(pool.submit(fn, job))
            if not pending:
                break
            result = _result_of(pending.popleft())
            done += 1
            if on_progress is not None:
                on_progress(done, max(read, total))
            yield result
            del result  # the consumer's now: do not keep it alive while the next one is waited for
    except BrokenProcessPool as error:
        raise PhotomapError("a worker process died, most likely for want of memory: use fewer workers") from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def check_scheduler(address: str) -> int:
    """Return how many threads the workers of a Dask scheduler have together; ``PhotomapError`` children say why not.

    ``UsageError`` for what is no address, ``MissingExtraError`` without the extra, ``LinkError`` where nobody answers.
    """
    with contextlib.closing(_connect(address)) as client:
        return _threads(client, address)


def _connect(address: str) -> Any:
    """Return a client of a Dask scheduler that can be used."""
    if not re.fullmatch(r"(tcp|tls)://[^/\s:]+(:\d+)|(tcp|tls)://\[[0-9a-fA-F:]+\]:\d+", address):
        raise UsageError(f"--scheduler {address}: write the scheduler's address, such as tcp://10.0.0.5:8786")
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingExtraError(
            "--scheduler needs Dask: install the extra by 'pip install photomap-gis[cluster]'"
        ) from error
    try:
        return Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError) as error:
        raise LinkError(
            f"no Dask scheduler answers at {address}: start one by 'dask scheduler', workers by 'dask worker {address}'"
        ) from error


def _threads(client: Any, address: str) -> int:
    try:
        client.wait_for_workers(1, timeout=_CONNECT_S)
    except TimeoutError as error:
        raise LinkError(f"the scheduler {address} has no workers: start some by 'dask worker {address}'") from error
    return max(1, sum(client.nthreads().values()))


def _on_cluster(
    fn: Callable[[Job], Result], jobs: Iterable[Job], address: str, on_progress: Progress | None
) -> Iterator[Result]:
    total, done, read = _length(jobs), 0, 0
    source = iter(jobs)
    client = _connect(address)
    pending: deque[Any] = deque()
    try:
        from distributed import CancelledError, KilledWorker

        try:
            while True:
                # Counted anew for every job: workers come and go.
                room = 2 * max(1, sum(client.nthreads().values()))
                while len(pending) < room:
                    try:
                        job = next(source)
                    except StopIteration:
                        break
                    read += 1
                    pending.append(client.submit(fn, job, pure=False))
                if not pending:
                    break
                result = pending.popleft().result()
                done += 1
                if on_progress is not None:
                    on_progress(done, max(read, total))
                yield result
                del result
        except KilledWorker as error:
            raise PhotomapError(
                "a job took several workers down with it, most likely for want of memory: give them more"
            ) from error
        except CancelledError as error:
            raise LinkError(
                f"the scheduler {address} was lost; what was finished is kept, run the same again"
            ) from error
        except ModuleNotFoundError as error:
            raise PhotomapError(
                f"the workers of {address} lack {error.name}: install the same photomap on every machine"
            ) from error
    finally:
        for future in pending:
            future.cancel()
        client.close()


def _open_pool(executor: ExecutorName, workers: int) -> Executor:
    if executor == "threads":
        return ThreadPoolExecutor(workers, thread_name_prefix="photomap")
    # Never fork: the parent's OpenCV and OpenMP threads may hold locks that nobody would release in the child.
    methods = multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=_leave_interrupts_to_the_parent)


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _result_of(future: Future[Result]) -> Result:
    while not future.done():
        wait([future], timeout=_POLL_S)
    return future.result()


def _length(jobs: Iterable[object]) -> int:
    return len(jobs) if isinstance(jobs, Sized) else 0
