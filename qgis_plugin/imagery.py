"""The actions on imagery that is in the project: replace it, undo that, swipe, and see what has changed."""

from __future__ import annotations

from qgis.core import QgsProject, QgsRasterLayer
from qgis.PyQt.QtCore import QObject, pyqtSignal
from qgis.PyQt.QtWidgets import QDialog

from .layers import zoom_to
from .mission import MapFile, MissionError, MissionFiles
from .replacement import Replacement, place_above, swap_source
from .swipe import SwipeTool
from .translation import tr


class ImageryTools(QObject):
    """Owns the replacements that can be undone, the swipe tool and the dialogs of its actions."""

    undo_available = pyqtSignal(bool)
    swiping = pyqtSignal(bool)

    def __init__(self, context) -> None:
        super().__init__()
        self._context = context
        self._done: list[Replacement] = []
        self._tool: SwipeTool | None = None
        self._tool_before = None
        self._compare = None
        QgsProject.instance().cleared.connect(self._forget)

    def replace(self) -> None:
        """Ask which layer is stale and which map is new, and put the one in the place of the other."""
        from .replace_dialog import ReplaceDialog

        active = self._context.iface.activeLayer()
        active = active if isinstance(active, QgsRasterLayer) else None
        dialog = ReplaceDialog(self._context.iface.mainWindow(), active, QgsProject.instance())
        accepted = dialog.exec() == QDialog.DialogCode.Accepted
        choice = dialog.choice() if accepted else None
        dialog.deleteLater()
        if choice is not None:
            self.replace_by(*choice)

    def replace_by(self, stale: QgsRasterLayer, mission: MissionFiles, found: MapFile, swap: bool) -> None:
        """Put a map in the place of a stale layer: above it, or (``swap``) into it."""
        try:
            done = (swap_source if swap else place_above)(stale, mission, found, QgsProject.instance())
        except MissionError as error:
            self._context.messages.fail(str(error))
            return
        self._done.append(done)
        self.undo_available.emit(True)
        layer = QgsProject.instance().mapLayer(done.layer_id)
        self._context.iface.setActiveLayer(layer)
        zoom_to(layer, self._context.iface.mapCanvas())
        self._context.messages.info(done.words)

    def undo(self) -> None:
        """Take the last replacement back."""
        if not self._done:
            return
        try:
            self._done.pop().undo()
            self._context.messages.info(tr("The replaced layer is back."))
        except MissionError as error:
            self._context.messages.fail(str(error))
        except RuntimeError:  # a group that the layer belonged into is gone, and Qt's object with it
            self._context.messages.fail(
                tr("The layer's group has been removed from the project: nothing was put back.")
            )
        self.undo_available.emit(bool(self._done))
        self._context.iface.mapCanvas().refresh()

    def swipe(self, on: bool = True) -> None:
        """Wipe the active layer away right of the cursor, or end that."""
        canvas = self._context.iface.mapCanvas()
        if not on:
            if self._tool is not None:
                canvas.unsetMapTool(self._tool)
            return
        layer = self._context.iface.activeLayer()
        if layer is None or layer not in canvas.layers():
            self._context.messages.warn(tr("Choose the new map in the layer tree (ticked), then swipe it away."))
            self.swiping.emit(False)
            return
        before = canvas.mapTool()
        self._tool = SwipeTool(canvas, layer, self._swiped)
        canvas.setMapTool(self._tool)
        self._tool_before = before
        self.swiping.emit(True)

    def compare(self) -> None:
        """Ask what is to be compared, have the engine do it, and show what has changed."""
        from .compare_dialog import CompareDialog

        if self._compare is None:
            self._compare = CompareDialog(self._context)
        self._compare.begin()

    def release(self) -> None:
        """Give back what is on the canvas and end what runs; the replaced layers stay replaced."""
        self._tool_before = None  # it may be a dock's, which is gone by now
        self.swipe(False)
        if self._compare is not None:
            self._compare.release()
            self._compare.deleteLater()
            self._compare = None
        QgsProject.instance().cleared.disconnect(self._forget)
        self._done.clear()

    def _swiped(self) -> None:
        tool, self._tool = self._tool, None
        before, self._tool_before = self._tool_before, None
        canvas = self._context.iface.mapCanvas()
        if tool is not None:
            tool.deleteLater()
            if before is not None and canvas.mapTool() is None:
                canvas.setMapTool(before)
        self.swiping.emit(False)

    def _forget(self) -> None:
        self._done.clear()
        self.undo_available.emit(False)
