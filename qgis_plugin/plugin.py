"""What QGIS loads: menu, toolbar, docks, options page and Processing provider; ``unload`` leaves nothing of them."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from qgis.core import Qgis, QgsApplication, QgsMapLayerType, QgsMessageLog, QgsProject
from qgis.PyQt.QtCore import QCoreApplication, Qt
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import QAction, QDialog, QDockWidget, QMenu

from .messages import TITLE, Messages
from .overlay import sweep
from .translation import install_translator, tr

HERE = Path(__file__).parent
ICON = HERE / "icon.svg"
MENU = "photomap"


@dataclass(frozen=True)
class Context:
    """What every part of the plugin is handed: QGIS's window, the engine, and the way to say something."""

    iface: object
    engine: object
    messages: Messages
    open_dock: Callable[[str], QDockWidget]
    show_help: Callable[[], None] = lambda: None


@dataclass(frozen=True)
class DockEntry:
    """A dock to be plugged in: ``module`` is relative to the plugin, ``factory`` takes a ``Context``.

    What the factory returns is a ``QDockWidget`` with a method ``release()``, called once before it is deleted: it
    gives back map tools, rubber bands, layers and jobs. It is made when it is first asked for.
    """

    key: str
    title: str
    module: str
    factory: str
    icon: str = "icon.svg"
    area: Qt.DockWidgetArea = Qt.DockWidgetArea.RightDockWidgetArea


DOCKS: tuple[DockEntry, ...] = (
    DockEntry("map", "Photo map", ".main_dock.dock", "MainDock"),
    DockEntry("planner", "Flight planner", ".planner.dock", "PlannerDock", "icons/planner.svg"),
    DockEntry("live", "Live map", ".live.dock", "LiveDock", "icons/live.svg"),
    DockEntry("georeference", "Georeference", ".georeference.dock", "GeoreferenceDock", "icons/georeference.svg"),
)
"""The registration table: one line a dock, in the order of the menu."""


class PhotomapPlugin:
    """The plugin as QGIS knows it."""

    def __init__(self, iface) -> None:
        self._iface = iface
        self._undo: list[Callable[[], None]] = []
        self._docks: dict[str, QDockWidget] = {}
        self._actions: dict[str, QAction] = {}
        self._help: QDialog | None = None
        self._menu: QMenu | None = None
        self.context: Context | None = None

    def initGui(self) -> None:
        """Put the plugin into QGIS's window; every step leaves its way back."""
        from .engine import Engine

        translator = install_translator()
        if translator is not None:
            self._undo.append(lambda: QCoreApplication.removeTranslator(translator))
        messages = Messages(self._iface)
        engine = Engine()
        engine.said.connect(messages.log)
        engine.ended.connect(messages.log)  # whoever waited for it says so in the message bar
        self._undo.append(engine.shutdown)
        self.context = Context(self._iface, engine, messages, self.open_dock, self.show_help)
        # What docks put into the project is theirs: a project that was saved meanwhile is rid of it when it is opened.
        QgsProject.instance().readProject.connect(sweep)
        self._undo.append(lambda: QgsProject.instance().readProject.disconnect(sweep))
        self._add_options()
        self.initProcessing()
        self._add_actions()

    def initProcessing(self) -> None:
        """Register the Processing provider; ``qgis_process`` calls this alone, without a window."""
        from .processing.provider import PhotomapProvider

        provider = PhotomapProvider()
        QgsApplication.processingRegistry().addProvider(provider)
        self._undo.append(lambda: QgsApplication.processingRegistry().removeProvider(provider))

    def unload(self) -> None:
        """Take everything back, last things first; a step that fails is written down and does not keep the others."""
        for key in list(self._docks):
            _safely(lambda key=key: self._close_dock(key))
        while self._undo:
            _safely(self._undo.pop())
        if self._help is not None:
            self._help.close()
            self._help.deleteLater()
            self._help = None
        self._actions.clear()
        self.context = None
        if self._iface is None:  # in qgis_process
            return
        if self._iface.mapCanvas().mapTool() is None:  # one of ours was in hand
            self._iface.actionPan().trigger()

    def open_dock(self, key: str) -> QDockWidget:
        """Show a dock of the table, made now if it was not there yet, and return it."""
        dock = self.dock(key)
        dock.show()
        dock.raise_()
        return dock

    def dock(self, key: str) -> QDockWidget:
        """Return a dock of the table; it is made, hidden, when it is first asked for."""
        if key not in self._docks:
            entry = next(e for e in DOCKS if e.key == key)
            factory = getattr(import_module(entry.module, __package__), entry.factory)
            dock = factory(self.context)
            dock.setObjectName(f"photomap_{key}")
            dock.setWindowTitle(f"photomap: {tr(entry.title)}")
            dock.hide()
            self._iface.addDockWidget(entry.area, dock)
            dock.visibilityChanged.connect(self._actions[key].setChecked)
            self._docks[key] = dock
        return self._docks[key]

    def show_help(self) -> None:
        """Show the help page."""
        from .help_window import HelpWindow

        if self._help is None:
            self._help = HelpWindow(self._iface.mainWindow())
        self._help.show()
        self._help.raise_()

    def _close_dock(self, key: str) -> None:
        dock = self._docks.pop(key)
        dock.visibilityChanged.disconnect(self._actions[key].setChecked)
        try:
            dock.release()
        finally:
            self._iface.removeDockWidget(dock)
            dock.setParent(None)
            dock.deleteLater()

    def _show(self, key: str, shown: bool) -> None:
        if shown:
            self.open_dock(key)
        elif key in self._docks:
            self._docks[key].hide()

    def _add_options(self) -> None:
        from .options import OptionsFactory

        factory = OptionsFactory(QIcon(str(ICON)))
        self._iface.registerOptionsWidgetFactory(factory)
        self._undo.append(lambda: self._iface.unregisterOptionsWidgetFactory(factory))

    def _add_actions(self) -> None:
        window = self._iface.mainWindow()
        # A menu of our own in the menu Raster: what QGIS's own helper makes outlives the plugin.
        self._menu = QMenu(MENU, window)
        self._menu.setObjectName("photomapMenu")
        self._menu.setIcon(QIcon(str(ICON)))
        self._iface.rasterMenu().addMenu(self._menu)
        self._undo.append(self._take_menu)
        bar = self._iface.addToolBar("photomap")
        bar.setObjectName("photomapToolBar")

        def take_bar() -> None:
            window.removeToolBar(bar)
            bar.setParent(None)
            bar.deleteLater()

        self._undo.append(take_bar)
        for entry in DOCKS:
            action = self._add_action(entry.key, tr(entry.title) + "…", entry.icon, bar)
            action.setCheckable(True)
            action.triggered.connect(lambda shown, key=entry.key: self._show(key, shown))
        self._add_imagery_actions(bar)
        action = self._add_action("options", tr("Settings…"))
        action.triggered.connect(lambda: self._iface.showOptionsDialog(window, currentPage="photomapOptions"))
        action = self._add_action("help", tr("Help"))
        action.triggered.connect(lambda: self.show_help())

    def _take_menu(self) -> None:
        menu, self._menu = self._menu, None
        self._iface.rasterMenu().removeAction(menu.menuAction())
        menu.setParent(None)
        menu.deleteLater()

    def _add_imagery_actions(self, bar) -> None:
        from .imagery import ImageryTools

        tools = ImageryTools(self.context)
        self._undo.append(tools.release)
        replace = self._add_action("replace", tr("Replace imagery…"), "icons/replace.svg", bar)
        replace.triggered.connect(lambda: tools.replace())
        undo = self._add_action("undo", tr("Undo the last replacement"))
        undo.setEnabled(False)
        undo.triggered.connect(lambda: tools.undo())
        tools.undo_available.connect(undo.setEnabled)
        swipe = self._add_action("swipe", tr("Swipe the active layer"), "icons/swipe.svg", bar)
        swipe.setCheckable(True)
        swipe.triggered.connect(tools.swipe)
        tools.swiping.connect(swipe.setChecked)
        compare = self._add_action("compare", tr("What has changed…"), "icons/compare.svg", bar)
        compare.triggered.connect(lambda: tools.compare())
        # The same offer where people look for it: in the context menu of a raster layer.
        self._iface.addCustomActionForLayerType(replace, "photomap", QgsMapLayerType.RasterLayer, True)
        self._undo.append(lambda: self._iface.removeCustomActionForLayerType(replace))

    def _add_action(self, key: str, text: str, icon: str = "", bar=None) -> QAction:
        action = QAction(QIcon(str(HERE / icon)) if icon else QIcon(), text, self._iface.mainWindow())
        action.setObjectName(f"photomap_action_{key}")
        action.setToolTip(text.rstrip("…"))
        self._menu.addAction(action)
        if bar is not None:
            bar.addAction(action)

        def take() -> None:
            action.setParent(None)
            action.deleteLater()

        self._undo.append(take)
        self._actions[key] = action
        return action


def _safely(step: Callable[[], None]) -> None:
    """Take a step of unloading; what it raises goes to the log."""
    try:
        step()
    except Exception:
        QgsMessageLog.logMessage(traceback.format_exc(), TITLE, Qgis.MessageLevel.Critical, False)
