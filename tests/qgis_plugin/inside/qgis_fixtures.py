"""What checks inside QGIS may use besides those of pytest-qgis (``qgis_app``, ``qgis_iface``, ...).

This file runs in QGIS's Python: it imports nothing of photomap_gis. Engine commands run by ``program``.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import pytest
from qgis.PyQt.QtCore import QCoreApplication, QEventLoop

pytest_plugins = ["window"]


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Tell what became of a check as soon as it is known: whatever becomes of QGIS afterwards, it has been made."""
    path = os.environ.get("PHOTOMAP_TEST_REPORT")
    if path is None or (report.when != "call" and report.outcome == "passed"):
        return
    text = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longreprtext
    case = {"name": report.nodeid.rpartition("::")[2], "outcome": report.outcome, "text": text}
    with Path(path).open("a", encoding="utf-8") as told:
        told.write(json.dumps(case) + "\n")


@pytest.fixture(scope="session")
def program() -> str:
    """The ``photomap`` command of this checkout: what a user would put into the settings."""
    return os.environ["PHOTOMAP_TEST_PROGRAM"]


@pytest.fixture(scope="session")
def photomap(program):
    """Run a command of photomap and return its ``--json`` document."""

    def run(*words: object) -> dict:
        clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        ran = subprocess.run(
            [program, *map(str, words), "--json"], env=clean, capture_output=True, text=True, check=False
        )
        assert ran.returncode == 0, ran.stderr
        return json.loads(ran.stdout)

    return run


@pytest.fixture(scope="session")
def flight(photomap) -> Path:
    """A folder of a few simulated photos: ``flight / "photos"``; made once for all checks: change nothing."""
    return _made_once("flight", lambda folder: photomap(
        "simulate", "procedural", "-o", folder, "--frames", 6, "--width", 480, "--frame-height", 360, "--altitude", 80
    ))  # fmt: skip


@pytest.fixture(scope="session")
def mission(photomap, flight) -> Path:
    """A mission of that flight with its layers; shared, so copy it before changing it."""

    def make(folder: Path) -> None:
        photomap("map", flight / "photos", "-o", folder)
        photomap("export", folder, "--layers", "--vectors")

    return _made_once("mission", make)


@pytest.fixture
def wait_until(qgis_app):
    """Let events run until a condition holds; fails with its words after ``seconds`` (a bound, not a measure)."""

    def wait(condition, words: str = "the condition", seconds: float = 60.0):
        deadline = time.monotonic() + seconds
        while not (found := condition()):
            if time.monotonic() > deadline:
                raise AssertionError(f"{words} did not come within {seconds:g} s")
            QCoreApplication.processEvents(QEventLoop.ProcessEventsFlag.AllEvents, 50)
            time.sleep(0.005)
        return found

    return wait


def _made_once(name: str, make) -> Path:
    shared = Path(os.environ["PHOTOMAP_TEST_SHARED"])
    shared.mkdir(exist_ok=True)
    if not (shared / name).is_dir():
        own = Path(tempfile.mkdtemp(dir=shared))
        make(own / name)
        try:
            (own / name).rename(shared / name)
        except OSError:  # another file's run was quicker
            shutil.rmtree(own)
    return shared / name
