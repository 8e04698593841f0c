"""Many machines, here as processes on loopback: the same results as alone, also where a worker dies half way."""

import os
import sys
from pathlib import Path

import pytest

from photomap_gis.cli.app import main
from photomap_gis.core.errors import LinkError, MissingExtraError, UsageError
from photomap_gis.parallel import check_scheduler, map_jobs
from tests.cluster import local_cluster


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    with local_cluster(tmp_path_factory.mktemp("cluster")) as running:
        yield running


def test_results_come_in_order_and_from_other_processes(cluster):
    seen = []
    results = list(map_jobs(divmod_ten, range(40), scheduler=cluster.address, on_progress=lambda *p: seen.append(p)))
    assert [r[:2] for r in results] == [divmod(x, 10) for x in range(40)]
    assert os.getpid() not in {r[2] for r in results}
    assert seen == [(i, 40) for i in range(1, 41)]


def divmod_ten(x: int) -> tuple[int, int, int]:
    return (*divmod(x, 10), os.getpid())


def test_an_exception_of_a_job_comes_at_its_turn(cluster):
    results = map_jobs(abs, [1, -2, "three", 4], scheduler=cluster.address)
    assert [next(results), next(results)] == [1, 2]
    with pytest.raises(TypeError):
        next(results)


def die_once(job: tuple[str, int]) -> int:
    folder, number = job
    mark = Path(folder) / "died"
    if number == 5 and not mark.exists():
        mark.touch()
        os._exit(1)
    return number * number


def test_a_worker_that_dies_half_way_loses_nothing(cluster, tmp_path):
    jobs = [(str(tmp_path), n) for n in range(20)]
    assert list(map_jobs(die_once, jobs, scheduler=cluster.address)) == [n * n for n in range(20)]
    assert (tmp_path / "died").exists()
    cluster.workers.append(cluster.add_worker())


def test_an_address_that_is_none_and_one_where_nobody_answers(monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    with pytest.raises(UsageError, match="tcp://"):
        check_scheduler("localhost")
    monkeypatch.setattr("photomap_gis.parallel._CONNECT_S", 0.2)
    with pytest.raises(LinkError, match="no Dask scheduler answers"):
        check_scheduler("tcp://127.0.0.1:9")


def test_without_the_extra_the_error_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"photomap-gis\[cluster\]"):
        check_scheduler("tcp://127.0.0.1:8786")


def test_the_command_says_what_is_wrong_with_a_scheduler_before_it_looks_at_anything(tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    monkeypatch.setattr("photomap_gis.parallel._CONNECT_S", 0.2)
    for address, exit_code in (("here", 2), ("tcp://127.0.0.1:9", 4)):
        assert main(["map", str(tmp_path), "-o", str(tmp_path / "m"), "--scheduler", address, "-q"]) == exit_code
        assert not (tmp_path / "m").exists()
