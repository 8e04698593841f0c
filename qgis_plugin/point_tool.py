"""One place by a click: the take-off place, a search's datum, a find."""

from __future__ import annotations

import math

from qgis.core import QgsCoordinateReferenceSystem, QgsCoordinateTransform, QgsCsException, QgsPointXY, QgsProject
from qgis.gui import QgsMapCanvas, QgsMapTool
from qgis.PyQt.QtCore import Qt, pyqtSignal

from .translation import tr

WGS84 = "EPSG:4326"


class PointTool(QgsMapTool):
    """Sends ``picked`` with longitude and latitude in degrees; Esc sends ``left``."""

    picked = pyqtSignal(float, float)
    refused = pyqtSignal(str)
    left = pyqtSignal()

    def __init__(self, canvas: QgsMapCanvas) -> None:
        super().__init__(canvas)
        self._canvas = canvas
        self.setCursor(Qt.CursorShape.CrossCursor)

    def release(self) -> None:
        """Take the tool off the canvas."""
        if self._canvas.mapTool() is self:
            self._canvas.unsetMapTool(self)
        self.deleteLater()

    def to_degrees(self, x: float, y: float) -> tuple[float, float] | None:
        """Return longitude and latitude of a place in the map's units, ``None`` where it has none."""
        to_wgs84 = QgsCoordinateTransform(
            self._canvas.mapSettings().destinationCrs(), QgsCoordinateReferenceSystem(WGS84), QgsProject.instance()
        )
        try:
            place = to_wgs84.transform(QgsPointXY(x, y))
        except QgsCsException:
            return None
        sound = math.isfinite(place.x()) and abs(place.x()) <= 360 and abs(place.y()) <= 90
        return (place.x(), place.y()) if sound else None

    def canvasReleaseEvent(self, event) -> None:
        """Hand the place over."""
        if event.button() != Qt.MouseButton.LeftButton:
            return
        place = self.to_degrees(event.mapPoint().x(), event.mapPoint().y())
        if place is None:
            self.refused.emit(tr("This place cannot be said in degrees: choose a projection that reaches there."))
            return
        self.picked.emit(*place)

    def keyPressEvent(self, event) -> None:
        """Esc leaves."""
        if event.key() == Qt.Key.Key_Escape:
            event.accept()
            self.left.emit()
