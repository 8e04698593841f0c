"""A session that is killed at any moment goes on by ``--resume``."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from photomap_gis.cli import main
from tests.live.conftest import Flown

KILLED = """
import os, signal, sys
from pathlib import Path
from photomap_gis.live.flight import FlightRequest, open_flight

flight = open_flight(FlightRequest(sys.argv[1], Path(sys.argv[2]), realtime=False))
left = int(sys.argv[3])

def count(words):
    pass

step = flight.session._on_step

def killed(one):
    global left
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    step(one)

flight.session._on_step = killed
with flight:
    flight.fly()
"""


@pytest.mark.slow
def test_killed_and_resumed(flown: Flown, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "mission"
    done = subprocess.run([sys.executable, "-c", KILLED, str(flown.video), str(folder), "61"], check=False)
    assert done.returncode == -signal.SIGKILL
    frames = [json.loads(line) for line in (folder / "live" / "journal.jsonl").read_text().splitlines()]
    assert sum(line["t"] == "frame" for line in frames) == 61  # what was decided is there
    before = len((folder / "frames.jsonl").read_text().splitlines())
    with (folder / "frames.jsonl").open("ab") as file:
        file.write(b'{"index": 99, "na')  # the line that it was writing
    capsys.readouterr()
    code = main(["live", "--resume", str(folder), "--as-fast-as-possible", "--no-finalise", "--json", "-q"])
    assert code == 0
    document = json.loads(capsys.readouterr().out)
    assert document["keyframes"] > before
    assert document["segments"]["pieces_at_landing"] == 1
    assert document["frames"] >= len(flown.refs) - 61 - 1
    assert main(["export", str(folder), "--geotiff", "-o", str(tmp_path / "map.tif")]) == 0
