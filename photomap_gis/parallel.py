"""One function over many jobs: serially, in threads or in processes, in order and bounded in flight.

Jobs are small (indices, references), never pixels: a job opens its pixels where it runs. Every executor gives the
same results in the same order; they differ only in where the work is done. OpenCV, NumPy and zlib release the
interpreter lock, so threads suffice for pixels; processes are for pure Python.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sized
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Literal, TypeVar, get_args

from photomap_gis.core.errors import PhotomapError

Job = TypeVar("Job")
Result = TypeVar("Result")
ExecutorName = Literal["threads", "serial", "processes"]
Progress = Callable[[int, int], None]

_POLL_S = 1.0  # a wait without a timeout cannot be interrupted by Ctrl-C on Windows


def map_jobs(
    fn: Callable[[Job], Result],
    jobs: Iterable[Job],
    *,
    executor: ExecutorName = "threads",
    workers: int | None = None,
    on_progress: Progress | None = None,
) -> Iterator[Result]:
    """Yield ``fn(job)`` for every job, in the order of the jobs.

    Work starts with the first ``next``. At most two jobs a worker are in flight or waiting to be taken, and ``jobs``
    is read no further than that: it may be an endless generator, and a slow consumer slows the workers.
    An exception of ``fn`` is raised when its job's turn comes; then, and on ``KeyboardInterrupt`` or when the
    iterator is closed, jobs that have not started are dropped and those that run are waited for.

    ``workers`` defaults to the processors this process may use. ``on_progress(done, total)`` is called in the
    consumer's thread before each result is handed over; where ``jobs`` has no length, ``total`` is how many were read.
    With ``"processes"`` ``fn``, jobs and results must be picklable and ``fn`` importable.
    """
    if executor not in get_args(ExecutorName):
        raise ValueError(f"executor must be one of {', '.join(get_args(ExecutorName))}, got {executor!r}")
    if workers is not None and workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    if executor == "serial":
        return _serial(fn, jobs, on_progress)
    return _pooled(fn, jobs, executor, workers or usable_cpus(), on_progress)


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
