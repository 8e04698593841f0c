"""The engine as the plugin has it: jobs as signals, an engine that is killed, one that stays, one that is not there."""

import os
import signal
from pathlib import Path

import pytest
from qgis.core import QgsApplication

from qgis_plugin.engine import Engine, where_is_the_engine
from qgis_plugin.settings import Settings


@pytest.fixture
def engine(qgis_app, program, wait_until):
    engine = Engine(settings=lambda: Settings(engine_path=program))
    yield engine
    pid = engine.pid
    engine.shutdown()
    if pid:
        wait_until(lambda: not alive(pid), "the end of the engine")


class Heard:
    """What a job said, in order."""

    def __init__(self, job):
        self.events = []
        for name in ("started", "progress", "log", "output", "finished", "failed", "ended"):
            getattr(job, name).connect(lambda *said, name=name: self.events.append((name, *said)))

    def names(self):
        return [name for name, *_ in self.events]

    def said(self, name):
        return [said for event, *said in self.events if event == name]


def alive(pid: int) -> bool:
    status = Path(f"/proc/{pid}/stat")
    try:
        return status.read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_job_tells_its_progress_and_its_result(engine, tmp_path, wait_until):
    job = engine.start("simulate", {"ground": "procedural", "output": str(tmp_path / "s"), "frames": 4, "width": 320,
                                    "frame_height": 240})  # fmt: skip
    heard = Heard(job)
    assert heard.events == []  # nothing comes before whoever started it could listen
    wait_until(lambda: "ended" in heard.names(), "the job's end")
    assert heard.names()[0] == "started"
    assert heard.names()[-2:] == ["finished", "ended"]
    stage, done, total, _, _ = heard.said("progress")[-1]
    assert (stage, done, total) == ("simulate", 4.0, 4.0)
    (result,) = heard.said("finished")[0]
    assert result["frames"] == 4
    assert Path(result["source"]).is_dir()
    assert engine.jobs == []


def test_a_job_that_fails_says_what_to_do(engine, tmp_path, wait_until):
    job = engine.start("info", {"sources": [str(tmp_path / "nothing")]})
    heard = Heard(job)
    wait_until(lambda: "ended" in heard.names(), "the job's end")
    assert heard.names()[-2:] == ["failed", "ended"]
    assert "check the name" in heard.said("failed")[0][0]
    assert job.error["exit_code"] == 3


def test_arguments_that_cannot_be_are_told_without_a_process(engine, wait_until):
    job = engine.start("export", {"mission": "x", "colour": "red"})
    heard = Heard(job)
    wait_until(lambda: "ended" in heard.names(), "the refusal")
    assert heard.names() == ["failed", "ended"]
    assert "no argument 'colour'" in heard.said("failed")[0][0]


def test_a_job_is_cancelled_even_before_it_has_begun(engine, tmp_path, wait_until):
    job = engine.start("simulate", {"ground": "procedural", "output": str(tmp_path / "s"), "frames": 400})
    heard = Heard(job)
    job.cancel()
    wait_until(lambda: "ended" in heard.names(), "the job's end")
    assert job.state == "cancelled"
    assert "finished" not in heard.names()


def test_an_engine_that_is_killed_in_mid_job_is_told_and_started_anew(engine, tmp_path, wait_until):
    gone = []
    engine.ended.connect(gone.append)
    job = engine.start("simulate", {"ground": "procedural", "output": str(tmp_path / "s"), "frames": 400})
    heard = Heard(job)
    wait_until(lambda: job.state == "running", "the start")
    first = engine.pid
    os.kill(first, signal.SIGKILL)
    wait_until(lambda: "ended" in heard.names(), "the job's end")
    assert job.state == "failed"
    assert "Try again" in heard.said("failed")[0][0]
    wait_until(lambda: gone, "the word of its end")  # the job's stream breaks off first, or the process is seen to end
    assert len(gone) == 1
    answers = []
    engine.ask(lambda client: client.about(), answers.append)
    wait_until(lambda: answers, "the new engine's answer")
    assert engine.pid not in (0, first)
    assert answers[0]["product"] == "photomap"


def test_missions_are_opened_and_their_tiles_have_an_address(engine, mission, wait_until):
    answers, refused = [], []
    engine.ask(lambda client: (client.open_mission(str(mission)), client.address), answers.append)
    engine.ask(lambda client: client.open_mission("/nowhere"), answers.append, refused.append)
    wait_until(lambda: answers and refused, "both answers")
    document, address = answers[0]
    assert document["georeferenced"] is True
    assert address == engine.address
    assert "/nowhere" in refused[0]


def test_shutdown_ends_the_engine_and_its_jobs_without_waiting(qgis_app, program, tmp_path, wait_until):
    engine = Engine(settings=lambda: Settings(engine_path=program))
    job = engine.start("simulate", {"ground": "procedural", "output": str(tmp_path / "s"), "frames": 400})
    heard = Heard(job)
    wait_until(lambda: job.state == "running", "the start")
    pid = engine.pid
    children = [int(p) for task in Path(f"/proc/{pid}/task").glob("*/children") for p in task.read_text().split()]
    assert len(children) == 1
    engine.shutdown()
    assert engine.pid == 0
    wait_until(lambda: not any(map(alive, [pid, *children])), "the end of engine and job")
    assert "finished" not in heard.names()


def test_no_engine_is_one_clear_message(qgis_app, wait_until, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    engine = Engine(settings=Settings)
    job = engine.start("info", {"sources": ["x"]})
    heard = Heard(job)
    wait_until(lambda: "ended" in heard.names(), "the message")
    (words,) = heard.said("failed")
    assert "pip install photomap-gis" in words[0]
    assert where_is_the_engine(Settings()) == words[0]
    engine.shutdown()


def test_a_program_that_is_no_engine_is_told(qgis_app, wait_until, tmp_path):
    liar = tmp_path / "photomap"
    liar.write_text("#!/bin/sh\necho hello\nsleep 60\n")
    liar.chmod(0o755)
    engine = Engine(settings=lambda: Settings(engine_path=str(liar)))
    heard = Heard(engine.start("info", {"sources": ["x"]}))
    wait_until(lambda: "ended" in heard.names(), "the message")
    assert "is the program in the settings photomap?" in heard.said("failed")[0][0]
    liar.write_text("#!/bin/sh\necho 'no such module' >&2\nexit 1\n")
    heard = Heard(engine.start("info", {"sources": ["x"]}))
    wait_until(lambda: "ended" in heard.names(), "the message")
    assert "no such module" in heard.said("failed")[0][0]
    engine.shutdown()


def test_an_engine_that_stays_is_found_again_and_ends_when_it_need_not_stay(qgis_app, program, wait_until):
    chosen = {"stay": True}

    def settings():
        return Settings(engine_path=program, stay=chosen["stay"])

    pids = []
    first = Engine(settings=settings)
    first.ask(lambda client: client.about()["pid"], pids.append)
    wait_until(lambda: len(pids) == 1, "the first answer")
    first.shutdown()
    kept = Path(QgsApplication.qgisSettingsDirPath()) / "photomap-engine.json"
    assert kept.stat().st_mode & 0o077 == 0
    second = Engine(settings=settings)
    second.ask(lambda client: client.about()["pid"], pids.append)
    wait_until(lambda: len(pids) == 2, "the second answer")
    assert pids[0] == pids[1]
    chosen["stay"] = False
    second.shutdown()
    wait_until(lambda: not alive(pids[0]), "the end of the engine that stayed")
    assert not kept.exists()
