"""A command that works for another program: it tells progress as JSON, and stops when its standard input ends."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def command(*words: object, **environment: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "photomap_gis.cli", *map(str, words)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT,
        env={**os.environ, "PHOTOMAP_PROGRESS": "json", **environment},
    )  # fmt: skip


def test_progress_is_json_lines_for_a_program_that_watches(tmp_path):
    ran = command(
        "simulate", "procedural", "-o", tmp_path / "f", "--frames", 3, "--width", 320, "--frame-height", 240, "-q"
    )
    _, err = ran.communicate(timeout=120)
    assert ran.returncode == 0
    lines = [json.loads(line) for line in err.splitlines()]
    assert set(lines[0]) == {"progress", "done", "total", "rate", "eta_s"}
    assert (lines[-1]["progress"], lines[-1]["done"], lines[-1]["total"]) == ("simulate", 3, 3)


def test_the_end_of_stdin_stops_it_as_ctrl_c_does(tmp_path):
    size = ("--frames", 12, "--width", 1600, "--frame-height", 1200)
    ran = command("simulate", "procedural", "-o", tmp_path / "f", *size, PHOTOMAP_LIFELINE="stdin")
    assert json.loads(ran.stderr.readline())["progress"] == "simulate"  # it is at work
    out, err = ran.communicate(timeout=120)  # closes stdin
    assert ran.returncode == 130
    assert b"stopped" in err
    assert out == b""


@pytest.mark.skipif(os.name != "posix", reason="closes a file descriptor by the shell")
def test_no_stdin_at_all_is_one_that_has_ended():
    words = ["sh", "-c", 'exec "$0" -m photomap_gis.cli engine <&-', sys.executable]
    ran = subprocess.run(words, cwd=ROOT, capture_output=True, timeout=120, check=False)
    assert ran.returncode == 0
    assert ran.stderr == b""
    assert json.loads(ran.stdout)["event"] == "ready"


def test_without_the_word_stdin_means_nothing(tmp_path):
    ran = command("info", tmp_path / "nothing")
    ran.communicate(timeout=120)
    assert ran.returncode == 3
