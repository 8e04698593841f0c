"""Tests in real QGIS: every ``test_*`` of ``inside/check_*.py`` is a case here, run by QGIS's own Python.

QGIS brings its Python and cannot be imported from ours. So a file of checks runs in one process of the system's Python
with its QGIS, with pytest and pytest-qgis from the folder ``qgis-tests`` in our environment (``make setup`` puts
them there, where our own pytest does not see them). ``inside/qgis_fixtures.py`` says what checks may use.

    python -m pytest tests/qgis_plugin                          # all of them
    python -m pytest tests/qgis_plugin/inside/check_engine.py -k progress
"""

from __future__ import annotations

import ast
import fcntl
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
INSIDE = HERE / "inside"
SYSTEM_PYTHON = Path(os.environ.get("PHOTOMAP_QGIS_PYTHON", "/usr/bin/python3"))
QGIS_PATHS = ("/usr/share/qgis/python", "/usr/share/qgis/python/plugins")
PYTEST_FOLDER = Path(sys.prefix) / "qgis-tests"
TIMEOUT_S = 600


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Take in the files of checks; one that is named on the command line comes by ``pytest_pycollect_makemodule``."""
    if _is_checks(file_path) and not parent.session.isinitpath(file_path):
        return QgisFile.from_parent(parent, path=file_path)
    return None


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Keep pytest from importing a file of checks."""
    return QgisFile.from_parent(parent, path=module_path) if _is_checks(module_path) else None


def _is_checks(path: Path) -> bool:
    return path.parent == INSIDE and path.name.startswith("check_") and path.suffix == ".py"


class QgisFile(pytest.File):
    """A file of checks: its test functions are read, not imported."""

    def collect(self) -> Iterator[pytest.Item]:
        """Yield an item for each test function."""
        for node in ast.parse(self.path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                yield QgisItem.from_parent(self, name=node.name)


class QgisItem(pytest.Item):
    """One check: what the file's run in QGIS said of it, all of its parameters together."""

    def runtest(self) -> None:
        """Run the file if nobody did yet, and fail or skip as the check did."""
        if (why := _missing()) is not None:
            pytest.skip(why)
        said = _results_of(self)
        found = said["cases"].get(self.name)
        if not found:
            raise QgisFailure(f"QGIS did not come to this check (exit code {said['exit_code']})\n{said['output']}")
        if broken := [c["text"] for c in found if c["outcome"] == "failed"]:
            raise QgisFailure("\n\n".join([*broken, f"in QGIS: {said['again']}"]))
        if all(c["outcome"] == "skipped" for c in found):
            pytest.skip(found[0]["text"])

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: object = None) -> object:
        """Show QGIS's own words instead of ours."""
        if isinstance(excinfo.value, QgisFailure):
            return str(excinfo.value)
        return super().repr_failure(excinfo)

    def reportinfo(self) -> tuple[Path, int, str]:
        """Say where the check stands."""
        return self.path, 0, self.name


class QgisFailure(Exception):
    """A check failed in QGIS."""


@cache
def _missing() -> str | None:
    """Return why no check can run here, ``None`` where they can."""
    if not SYSTEM_PYTHON.is_file():
        return "no system Python with QGIS (apt install python3-qgis)"
    if not (PYTEST_FOLDER / "pytest_qgis").is_dir():
        return f"no pytest-qgis in {PYTEST_FOLDER.name} beside the environment (make setup puts it there)"
    look = [str(SYSTEM_PYTHON), "-c", "import qgis.core, qgis.gui"]
    seen = subprocess.run(look, env=_environment(Path()), capture_output=True, check=False)
    return None if seen.returncode == 0 else "QGIS is not installed (apt install qgis python3-qgis)"


def _environment(folder: Path) -> dict[str, str]:
    """An environment for QGIS's Python: none of ours leaks in, and no settings of a user."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "GDAL", "PROJ", "VIRTUAL", "QGIS"))}
    return {
        **clean,
        # Ours holds another Python first, and QGIS takes what it finds for its own.
        "PATH": "/usr/local/bin:/usr/bin:/bin",
        "PYTHONPATH": os.pathsep.join([str(PYTEST_FOLDER), str(INSIDE), str(ROOT), *QGIS_PATHS]),
        "QT_QPA_PLATFORM": "offscreen",
        "QGIS_CUSTOM_CONFIG_PATH": str(folder / "profile"),
        "HOME": str(folder),
        "XDG_RUNTIME_DIR": str(folder),
        "PHOTOMAP_TEST_PROGRAM": str(folder / "photomap"),
        "PHOTOMAP_TEST_PYTHON": sys.executable,
        "PHOTOMAP_TEST_SHARED": str(folder.parent / "shared"),
    }


def _results_of(item: QgisItem) -> dict:
    """Return what a run of the item's file said; the first item of a file that comes here runs it, for all workers."""
    base = item.config._tmp_path_factory.getbasetemp()
    if hasattr(item.config, "workerinput"):
        base = base.parent  # what all workers of xdist share
    folder = base / f"qgis-{item.path.stem}"
    folder.mkdir(exist_ok=True, mode=0o700)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        kept = folder / "results.json"
        if not kept.is_file():
            wanted = [i.name for i in item.session.items if isinstance(i, QgisItem) and i.path == item.path]
            kept.write_text(json.dumps(_run(item.path, wanted, folder)))
        return json.loads(kept.read_text())


def _run(path: Path, names: list[str], folder: Path) -> dict:
    program = folder / "photomap"
    program.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" -m photomap_gis.cli "$@"\n')
    program.chmod(0o755)
    report = folder / "report.jsonl"
    command = [
        str(SYSTEM_PYTHON), "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "qgis_fixtures",
        "-c", str(INSIDE / "qgis.ini"),
        "--rootdir", str(INSIDE), "--confcutdir", str(INSIDE), "--import-mode=importlib",
        f"--basetemp={folder / 'tmp'}", *(f"{path}::{name}" for name in names),
    ]  # fmt: skip
    try:
        ran = subprocess.run(
            command, cwd=folder, env=_environment(folder) | {"PHOTOMAP_TEST_REPORT": str(report)},
            capture_output=True, timeout=TIMEOUT_S, check=False,
        )  # fmt: skip
        code, output = ran.returncode, (ran.stdout + ran.stderr).decode("utf-8", "replace")[-20_000:]
    except subprocess.TimeoutExpired as error:
        code, output = -1, f"not done after {TIMEOUT_S} s\n{(error.stdout or b'').decode('utf-8', 'replace')[-20_000:]}"
    cases: dict[str, list[dict[str, str]]] = {}
    for line in report.read_text(encoding="utf-8").splitlines() if report.is_file() else ():
        case = json.loads(line)
        cases.setdefault(case["name"].partition("[")[0], []).append(case)
    if code < 0 and all(name in cases for name in names):
        # QGIS 3.22 now and then falls over its own feet in exitQgis, when every check has been made and told.
        print(f"{path.name}: QGIS ended by signal {-code} after its last check", file=sys.stderr)
    return {"exit_code": code, "output": output, "cases": cases, "again": " ".join(command)}
