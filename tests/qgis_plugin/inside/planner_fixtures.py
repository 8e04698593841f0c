"""What checks of the planner share: a field in the Alps' foreland, a canvas that is shown, mouse and keyboard."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import traceback
from pathlib import Path

import pytest
from qgis.core import QgsCoordinateReferenceSystem, QgsPointXY, QgsProject, QgsRectangle
from qgis.PyQt.QtCore import (
    QCoreApplication,
    QEvent,
    QPoint,
    QPointF,
    Qt,
)
from qgis.PyQt.QtGui import QMouseEvent
from qgis.PyQt.QtTest import QTest

from qgis_plugin.engine import Engine
from qgis_plugin.plugin import Context
from qgis_plugin.settings import Settings

SWISS = "EPSG:2056"
FIELD = ((2668000, 1211000), (2668300, 1211000), (2668320, 1211220), (2668000, 1211200))
"""In ``SWISS``, 6.5 ha."""


class Said:
    """Takes what the plugin says to the user."""

    def __init__(self) -> None:
        self.infos: list[str] = []
        self.warnings: list[str] = []
        self.failures: list[str] = []

    def info(self, text: str) -> None:
        self.infos.append(text)

    def warn(self, text: str) -> None:
        self.warnings.append(text)

    def fail(self, text: str) -> None:
        self.failures.append(text)

    def log(self, text: str) -> None:
        pass


class RecordingEngine(Engine):
    """The engine of this checkout; remembers what was asked of it."""

    def __init__(self, program: str) -> None:
        super().__init__(settings=lambda: Settings(engine_path=program))
        self.started: list[tuple[str, dict]] = []

    def start(self, kind, arguments, folder=""):
        self.started.append((kind, dict(arguments)))
        return super().start(kind, arguments, folder)


class Hand:
    """A mouse and a keyboard on a canvas, in map units."""

    def __init__(self, canvas) -> None:
        self.canvas = canvas

    def at(self, x: float, y: float) -> QPoint:
        point = self.canvas.mapSettings().mapToPixel().transform(QgsPointXY(x, y))
        return QPoint(round(point.x()), round(point.y()))

    def click(self, x: float, y: float, button=Qt.MouseButton.LeftButton) -> None:
        QTest.mouseMove(self.canvas.viewport(), self.at(x, y))
        QTest.mouseClick(self.canvas.viewport(), button, Qt.KeyboardModifier.NoModifier, self.at(x, y))

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 4) -> None:
        view, left, no = self.canvas.viewport(), Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
        QTest.mousePress(view, left, no, self.at(*start))
        for k in range(1, steps + 1):
            x, y = (a + k / steps * (b - a) for a, b in zip(start, end))  # noqa: B905 (Python 3.9)
            at = self.at(x, y)  # QTest.mouseMove moves the cursor, which an offscreen window does not follow
            QCoreApplication.sendEvent(
                view, QMouseEvent(QEvent.Type.MouseMove, QPointF(at), Qt.MouseButton.NoButton, left, no)
            )
        QTest.mouseRelease(view, left, no, self.at(*end))

    def key(self, key) -> None:
        QTest.keyClick(self.canvas, key)


@pytest.fixture(autouse=True)
def no_slot_raises(monkeypatch):
    """What a slot raises fails the check; by itself PyQt would end the process."""
    raised: list[str] = []
    monkeypatch.setattr(
        sys, "excepthook", lambda kind, error, trace: raised.append("".join(traceback.format_exception(error)))
    )
    yield
    assert not raised, "\n".join(raised)


@pytest.fixture
def said() -> Said:
    return Said()


@pytest.fixture
def canvas(qgis_iface, qgis_new_project):
    """A canvas of 900 x 700 pixels over the field, in Swiss metres."""
    canvas = qgis_iface.mapCanvas()
    crs = QgsCoordinateReferenceSystem(SWISS)
    QgsProject.instance().setCrs(crs)
    canvas.setDestinationCrs(crs)
    canvas.window().resize(900, 700)
    canvas.window().show()
    canvas.resize(900, 700)
    QCoreApplication.processEvents()
    canvas.setExtent(QgsRectangle(2667900, 1210900, 2668420, 1211320))
    canvas.refresh()
    QgsProject.instance().setDirty(False)
    return canvas


@pytest.fixture
def hand(canvas) -> Hand:
    return Hand(canvas)


@pytest.fixture(scope="session")
def shared_engine(program, qgis_app):
    engine = RecordingEngine(program)
    yield engine
    engine.shutdown()


@pytest.fixture
def engine(shared_engine):
    """One engine for all checks of a file, as in QGIS."""
    shared_engine.started.clear()
    return shared_engine


@pytest.fixture
def context(qgis_iface, engine, said, canvas) -> Context:
    return Context(qgis_iface, engine, said, lambda key: None)


@pytest.fixture
def vehicle():
    """A simulated vehicle near the field; yields its connection string and a way to ask what it truly holds."""
    python = os.environ["PHOTOMAP_TEST_PYTHON"]
    root = str(Path(__file__).resolve().parents[3])
    clean = {**{k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}, "PYTHONPATH": root}
    process = subprocess.Popen(
        [python, "-m", "photomap_gis.simulate.vehicle", "--port", "0", "--home", "47.0471", "8.3352", "480"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=clean,
    )  # fmt: skip
    port = json.loads(process.stdout.readline())["port"]

    def truth() -> dict:
        process.stdin.write('{"dump": true}\n')
        process.stdin.flush()
        return json.loads(process.stdout.readline())["lists"]

    yield f"tcp:127.0.0.1:{port}", truth
    process.stdin.close()
    process.wait(timeout=10)
    process.stdout.close()
