"""Map tools: pick a place by a click, and drag the map to where it belongs."""

from __future__ import annotations

from collections.abc import Callable

from qgis.core import QgsGeometry, QgsPointXY, QgsRectangle, QgsWkbTypes
from qgis.gui import QgsMapCanvas, QgsMapTool, QgsMapToolEmitPoint, QgsRubberBand
from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtGui import QColor


class PickTool(QgsMapToolEmitPoint):
    """A click picks a place, in the canvas's own coordinates; Esc ends it."""

    def __init__(self, canvas: QgsMapCanvas, on_pick: Callable[[QgsPointXY], None], on_end=lambda: None) -> None:
        super().__init__(canvas)
        self._on_pick, self._on_end = on_pick, on_end
        self.setCursor(Qt.CursorShape.CrossCursor)

    def canvasReleaseEvent(self, event) -> None:
        """Take the place under a left click."""
        if event.button() == Qt.MouseButton.LeftButton:
            self._on_pick(self.toMapCoordinates(event.pos()))

    def keyPressEvent(self, event) -> None:
        """End with Esc."""
        if event.key() == Qt.Key.Key_Escape:
            self.canvas().unsetMapTool(self)

    def deactivate(self) -> None:
        """Say that the tool has ended."""
        super().deactivate()
        self._on_end()


class NudgeTool(QgsMapTool):
    """A drag says where the map belongs: from a place that it shows to where that is; its outline moves along.

    ``outline`` is the map's extent in the canvas's coordinates. Esc while dragging lets go; Esc otherwise ends it.
    """

    def __init__(
        self,
        canvas: QgsMapCanvas,
        outline: QgsRectangle,
        on_nudge: Callable[[QgsPointXY, QgsPointXY], None],
        on_end=lambda: None,
    ) -> None:
        super().__init__(canvas)
        self._outline, self._on_nudge, self._on_end = outline, on_nudge, on_end
        self._start: QgsPointXY | None = None
        self._arrow = QgsRubberBand(canvas, QgsWkbTypes.GeometryType.LineGeometry)
        self._ghost = QgsRubberBand(canvas, QgsWkbTypes.GeometryType.PolygonGeometry)
        for band in (self._arrow, self._ghost):
            band.setColor(QColor("#d81b60"))
            band.setWidth(2)
        self._ghost.setFillColor(QColor(216, 27, 96, 30))
        self.setCursor(Qt.CursorShape.SizeAllCursor)

    def canvasPressEvent(self, event) -> None:
        """Take hold of the map."""
        if event.button() == Qt.MouseButton.LeftButton:
            self._start = self.toMapCoordinates(event.pos())

    def canvasMoveEvent(self, event) -> None:
        """Show where it would lie."""
        if self._start is not None:
            self._draw(self.toMapCoordinates(event.pos()))

    def canvasReleaseEvent(self, event) -> None:
        """Let go: that is where it belongs."""
        start, self._start = self._start, None
        self._clear()
        if start is None or event.button() != Qt.MouseButton.LeftButton:
            return
        end = self.toMapCoordinates(event.pos())
        if end != start:
            self._on_nudge(start, end)

    def keyPressEvent(self, event) -> None:
        """Esc: leave the map where it is."""
        if event.key() != Qt.Key.Key_Escape:
            return
        if self._start is not None:
            self._start = None
            self._clear()
        else:
            self.canvas().unsetMapTool(self)

    def deactivate(self) -> None:
        """Take what was drawn off the canvas."""
        self._start = None
        self._clear()
        super().deactivate()
        self._on_end()

    def take_off(self) -> None:
        """Remove the tool's drawings from the canvas for good."""
        for band in (self._arrow, self._ghost):
            self.canvas().scene().removeItem(band)

    def _draw(self, end: QgsPointXY) -> None:
        self._arrow.setToGeometry(QgsGeometry.fromPolylineXY([self._start, end]), None)
        ghost = QgsGeometry.fromRect(self._outline)
        ghost.translate(end.x() - self._start.x(), end.y() - self._start.y())
        self._ghost.setToGeometry(ghost, None)

    def _clear(self) -> None:
        self._arrow.reset(QgsWkbTypes.GeometryType.LineGeometry)
        self._ghost.reset(QgsWkbTypes.GeometryType.PolygonGeometry)
