"""A window for docks and dialogs to live in: real widgets and a real canvas, and an engine whose jobs a check ends."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from qgis.core import QgsCoordinateReferenceSystem, QgsProject
from qgis.gui import QgsLayerTreeMapCanvasBridge, QgsMapCanvas, QgsMapToolPan, QgsMessageBar
from qgis.PyQt.QtCore import QObject, pyqtSignal
from qgis.PyQt.QtWidgets import QAction, QMainWindow, QMenu

from qgis_plugin.messages import Messages
from qgis_plugin.plugin import Context
from qgis_plugin.settings import Settings, save_settings


class FakeJob(QObject):
    """A job that a check tells what happens to it, with the signals of ``qgis_plugin.engine.EngineJob``."""

    progress = pyqtSignal(str, float, float, float, float)
    log = pyqtSignal(str)
    finished = pyqtSignal(object)
    failed = pyqtSignal(str)

    def __init__(self, kind: str, arguments: dict) -> None:
        super().__init__()
        self.kind, self.arguments, self.cancelled = kind, arguments, 0

    def cancel(self) -> None:
        self.cancelled += 1


class FakeEngine:
    """Notes the jobs that are started; ``last`` is the newest."""

    def __init__(self) -> None:
        self.jobs: list[FakeJob] = []

    def start(self, kind: str, arguments: dict) -> FakeJob:
        self.jobs.append(FakeJob(kind, arguments))
        return self.jobs[-1]

    @property
    def last(self) -> FakeJob:
        return self.jobs[-1]


class Window:
    """QGIS's interface as far as the plugin needs it; what it does not know is an error, not a silent mock."""

    def __init__(self) -> None:
        self.main = QMainWindow()
        self.main.resize(1100, 800)
        self.canvas = QgsMapCanvas(self.main)
        self.canvas.setDestinationCrs(QgsCoordinateReferenceSystem("EPSG:32632"))
        self.main.setCentralWidget(self.canvas)
        self.bar = QgsMessageBar(self.main)
        self.bridge = QgsLayerTreeMapCanvasBridge(QgsProject.instance().layerTreeRoot(), self.canvas)
        self.bridge.setAutoSetupOnFirstLayer(False)
        self.active = None
        self.options: list[object] = []
        self.menu = QMenu(self.main)
        self.pan = QAction(self.main)
        self.pan.triggered.connect(lambda: self.canvas.setMapTool(self.pan_tool))
        self.pan_tool = QgsMapToolPan(self.canvas)
        self.canvas.setMapTool(self.pan_tool)
        self.layer_actions: list[object] = []

    def mainWindow(self):
        return self.main

    def mapCanvas(self):
        return self.canvas

    def messageBar(self):
        return self.bar

    def activeLayer(self):
        return self.active

    def setActiveLayer(self, layer):
        self.active = layer

    def addDockWidget(self, area, dock):
        self.main.addDockWidget(area, dock)

    def removeDockWidget(self, dock):
        self.main.removeDockWidget(dock)

    def addToolBar(self, name):
        return self.main.addToolBar(name)

    def actionPan(self):
        return self.pan

    def rasterMenu(self):
        return self.menu

    def registerOptionsWidgetFactory(self, factory):
        self.options.append(factory)

    def unregisterOptionsWidgetFactory(self, factory):
        self.options.remove(factory)

    def addCustomActionForLayerType(self, action, menu, kind, all_layers):
        self.layer_actions.append(action)

    def removeCustomActionForLayerType(self, action):
        self.layer_actions.remove(action)
        return True


@pytest.fixture
def window(qgis_app, tmp_path):
    """A window with a canvas that shows the project; the project is empty, missions go to a folder of the check."""
    save_settings(Settings(folder=str(tmp_path / "missions")))
    QgsProject.instance().clear()
    made = Window()
    made.main.show()
    yield made
    made.canvas.stopRendering()
    QgsProject.instance().clear()
    made.main.close()


@pytest.fixture
def said(window, monkeypatch):
    """What was said in the message bar: ``(level, words)``."""
    words: list[tuple[str, str]] = []
    for level in ("info", "warn", "fail"):
        monkeypatch.setattr(Messages, level, lambda self, text, level=level: words.append((level, text)))
    return words


@pytest.fixture
def context(window, said):
    """What a dock is handed, with an engine whose jobs the check ends."""
    return Context(window, FakeEngine(), Messages(window), lambda key: SimpleNamespace(choose=lambda folder: None))


def role_layers(project=None):
    """The layers of the project by their role."""
    layers = (project or QgsProject.instance()).mapLayers().values()
    return {layer.customProperty("photomap/role"): layer for layer in layers if layer.customProperty("photomap/role")}
