"""Every executor is the serial loop: same results, same order, bounded, and it stops when told."""

import sys
import threading
from itertools import count, islice
from pathlib import Path

import numpy as np
import pytest

from photomap_gis.parallel import give_back_memory, map_jobs, usable_cpus

EXECUTORS = ("serial", "threads", "processes")


def square(x: int) -> int:
    return x * x


def fail_at_three(x: int) -> int:
    if x == 3:
        raise LookupError("three")
    return x


@pytest.mark.parametrize("executor", EXECUTORS)
def test_results_come_in_order(executor):
    seen = []
    results = list(map_jobs(square, range(40), executor=executor, workers=2, on_progress=lambda *p: seen.append(p)))
    assert results == [x * x for x in range(40)]
    assert seen == [(i, 40) for i in range(1, 41)]


@pytest.mark.parametrize("executor", EXECUTORS)
def test_no_jobs_no_results(executor):
    assert list(map_jobs(square, [], executor=executor, workers=2)) == []


@pytest.mark.parametrize("executor", EXECUTORS)
def test_an_exception_comes_at_its_turn(executor):
    results = map_jobs(fail_at_three, range(10), executor=executor, workers=2)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(LookupError, match="three"):
        next(results)
    with pytest.raises(StopIteration):
        next(results)


@pytest.mark.parametrize("executor", ["serial", "threads"])
def test_jobs_are_read_no_further_than_needed(executor):
    taken = []

    def endless():
        for i in count():
            taken.append(i)
            yield i

    results = map_jobs(square, endless(), executor=executor, workers=3)
    assert list(islice(results, 5)) == [0, 1, 4, 9, 16]
    assert len(taken) <= 5 + 2 * 3
    results.close()
    assert len(taken) <= 5 + 2 * 3


def test_progress_of_a_generator_counts_what_was_read():
    seen = []
    list(map_jobs(square, iter(range(5)), executor="threads", workers=1, on_progress=lambda *p: seen.append(p)))
    assert seen[-1] == (5, 5) and all(done <= total for done, total in seen)


def test_nothing_starts_before_the_first_result_is_asked_for():
    started = threading.Event()
    results = map_jobs(lambda _: started.set(), [1], executor="threads", workers=1)
    assert not started.is_set()
    next(results)
    assert started.is_set()


def test_workers_run_side_by_side():
    barrier = threading.Barrier(2, timeout=20)
    assert sorted(map_jobs(lambda _: barrier.wait(), range(2), executor="threads", workers=2)) == [0, 1]


@pytest.mark.parametrize("executor", ["serial", "threads"])
def test_an_interrupt_in_the_consumer_drops_what_has_not_started(executor):
    ran = []
    results = map_jobs(lambda x: ran.append(x) or x, range(1000), executor=executor, workers=2)

    def consume():
        for _ in results:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        consume()
    results.close()
    assert len(ran) <= 5


def test_wrong_arguments_are_named_at_once():
    with pytest.raises(ValueError, match="executor"):
        map_jobs(square, [], executor="dusk")
    with pytest.raises(ValueError, match="workers"):
        map_jobs(square, [], workers=0)


def test_there_is_a_processor():
    assert usable_cpus() >= 1


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a matter of Linux' C library")
def test_freed_memory_can_be_given_back():
    """Many middling arrays leave a heap full of holes; what is held stays as it was."""
    held = [np.full(50_000, k % 256, np.uint8) for k in range(400)]
    kept = held[::7]
    del held
    before = _resident_pages()
    give_back_memory()
    assert _resident_pages() <= before
    assert all((a == 7 * k % 256).all() for k, a in enumerate(kept))


def _resident_pages() -> int:
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
