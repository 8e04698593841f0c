"""Drawing an area or a line on the map: corners by clicks, undo, close, and corners dragged when it is there."""

from __future__ import annotations

import math
from collections.abc import Sequence

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsCsException,
    QgsGeometry,
    QgsPointXY,
    QgsProject,
    QgsWkbTypes,
)
from qgis.gui import QgsMapCanvas, QgsMapTool, QgsRubberBand, QgsVertexMarker
from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtGui import QColor, QKeySequence

from ..translation import tr

GRAB_PX = 10
MOST_HANDLES = 200
"""A shape of more corners is drawn without handles: it came from a layer, and is edited there."""
WGS84 = "EPSG:4326"

_LINE = QColor(20, 90, 200)
_FILL = QColor(20, 90, 200, 40)


class AreaTool(QgsMapTool):
    """Takes a polygon, or a line where ``is_line``, of corners in WGS 84 (longitude, latitude).

    ``shape_changed`` is sent when a shape is closed, while a corner is dragged, and when it is cleared; ``refused``
    with words when what is there cannot be closed; ``left`` when Esc is pressed with nothing begun.
    """

    shape_changed = pyqtSignal()
    refused = pyqtSignal(str)
    left = pyqtSignal()

    def __init__(self, canvas: QgsMapCanvas) -> None:
        super().__init__(canvas)
        self._canvas = canvas
        self.is_line = False
        self._corners: list[QgsPointXY] = []
        self._closed = False
        self._cursor: QgsPointXY | None = None
        self._dragged: int | None = None
        self._band = QgsRubberBand(canvas, QgsWkbTypes.GeometryType.PolygonGeometry)
        self._band.setColor(_LINE)
        self._band.setFillColor(_FILL)
        self._band.setWidth(2)
        self._handles: list[QgsVertexMarker] = []
        self.setCursor(Qt.CursorShape.CrossCursor)
        canvas.destinationCrsChanged.connect(self._redraw)

    def release(self) -> None:
        """Give everything on the canvas back; the tool is of no use afterwards."""
        self._canvas.destinationCrsChanged.disconnect(self._redraw)
        if self._canvas.mapTool() is self:
            self._canvas.unsetMapTool(self)
        for item in (*self._handles, self._band):
            self._canvas.scene().removeItem(item)
        self._handles = []
        self.deleteLater()

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """The closed shape's corners as (longitude, latitude) in degrees; empty where there is none."""
        return tuple((p.x(), p.y()) for p in self._corners) if self._closed else ()

    @property
    def begun(self) -> bool:
        """Whether there is a corner."""
        return bool(self._corners)

    def set_corners(self, corners: Sequence[tuple[float, float]]) -> None:
        """Take a closed shape from elsewhere, (longitude, latitude) in degrees."""
        self._corners = [QgsPointXY(x, y) for x, y in corners]
        self._closed = bool(self._corners)
        self._dragged = self._cursor = None
        self._redraw()

    def clear(self) -> None:
        """Begin anew."""
        had = self._closed
        self._corners, self._closed = [], False
        self._dragged = self._cursor = None
        self._redraw()
        if had:
            self.shape_changed.emit()

    # what Qt calls

    def deactivate(self) -> None:
        """Another tool is taken: what was begun and not closed is dropped."""
        if not self._closed:
            self._corners, self._cursor = [], None
        self._redraw()
        super().deactivate()

    def activate(self) -> None:
        """Show the handles of the shape that is there."""
        super().activate()
        self._redraw()

    def canvasPressEvent(self, event) -> None:
        """Grab a corner of the closed shape, or a new one in the middle of a side."""
        if not self._closed or event.button() != Qt.MouseButton.LeftButton:
            return
        at = event.pixelPoint()
        self._dragged = self._near(at, [self._pixel(p) for p in self._corners])
        if self._dragged is None:
            middle = self._near(at, [self._pixel(p) for p in self._middles()])
            if middle is not None:
                self._corners.insert(middle + 1, self._to_wgs84(self.toMapCoordinates(at)))
                self._dragged = middle + 1
                self._redraw()

    def canvasMoveEvent(self, event) -> None:
        """Draw the side that a click would make, or take the grabbed corner along."""
        place = self._place(event)
        if place is None:
            return
        if self._dragged is not None:
            self._corners[self._dragged] = place
            self._redraw()
            self.shape_changed.emit()
        elif not self._closed and self._corners:
            self._cursor = place
            self._redraw()

    def canvasReleaseEvent(self, event) -> None:
        """Set a corner, or close by the right button."""
        if event.button() == Qt.MouseButton.RightButton:
            self._right(event)
            return
        if event.button() != Qt.MouseButton.LeftButton:
            return
        if self._dragged is not None:
            place, corner, self._dragged = self._place(event), self._dragged, None
            if place is not None:
                self._corners[corner] = place
            self._redraw()
            self.shape_changed.emit()
            return
        if self._closed:
            return
        place = self._place(event)
        if place is None:
            return
        if self._corners and self._distance_px(self._pixel(self._corners[-1]), event.pixelPoint()) < 2:
            return  # the second click of a double click
        self._corners.append(place)
        self._redraw()

    def canvasDoubleClickEvent(self, event) -> None:
        """Close the shape: the first of the two clicks has set its last corner."""
        if not self._closed:
            self._close()

    def keyPressEvent(self, event) -> None:
        """Enter closes, Backspace or Ctrl+Z takes the last corner back, Esc begins anew or leaves."""
        key = event.key()
        if key in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self._close()
        elif key in (Qt.Key.Key_Backspace, Qt.Key.Key_Delete) or event.matches(QKeySequence.StandardKey.Undo):
            self._take_back()
        elif key == Qt.Key.Key_Escape:
            if self._corners and not self._closed:
                self.clear()
            else:
                self.left.emit()
        else:
            return
        event.accept()  # else the canvas pans, or QGIS takes the key for something else

    # what they do

    def _right(self, event) -> None:
        """Close; on a closed shape take the corner away that is clicked."""
        if not self._closed:
            self._close()
            return
        corner = self._near(event.pixelPoint(), [self._pixel(p) for p in self._corners])
        if corner is None:
            return
        if len(self._corners) <= self._fewest():
            self.refused.emit(self._too_few())
            return
        del self._corners[corner]
        self._redraw()
        self.shape_changed.emit()

    def _close(self) -> None:
        if self._closed:
            return
        if len(self._corners) < self._fewest():
            self.refused.emit(self._too_few())
            return
        self._closed, self._cursor = True, None
        self._redraw()
        self.shape_changed.emit()

    def _take_back(self) -> None:
        if self._closed:
            self._closed = False  # drawing goes on where it was closed
            self._redraw()
            self.shape_changed.emit()
            return
        if self._corners:
            self._corners.pop()
            self._redraw()

    def _fewest(self) -> int:
        return 2 if self.is_line else 3

    def _too_few(self) -> str:
        if self.is_line:
            return tr("A line needs two corners at least: click where it begins and where it turns.")
        return tr("An area needs three corners at least: click them one after the other.")

    def _middles(self) -> list[QgsPointXY]:
        if len(self._corners) > MOST_HANDLES:
            return []
        points = self._corners if self.is_line else [*self._corners, self._corners[0]]
        return [
            QgsPointXY((points[i].x() + points[i + 1].x()) / 2, (points[i].y() + points[i + 1].y()) / 2)
            for i in range(len(points) - 1)
        ]

    def _near(self, at, pixels) -> int | None:
        if len(self._corners) > MOST_HANDLES or not pixels:
            return None
        best = min(range(len(pixels)), key=lambda i: self._distance_px(pixels[i], at))
        return best if self._distance_px(pixels[best], at) <= GRAB_PX else None

    @staticmethod
    def _distance_px(a, b) -> float:
        return math.hypot(a.x() - b.x(), a.y() - b.y())

    # between the map's CRS and WGS 84

    def _transform(self) -> QgsCoordinateTransform:
        return QgsCoordinateTransform(
            QgsCoordinateReferenceSystem(WGS84), self._canvas.mapSettings().destinationCrs(), QgsProject.instance()
        )

    def _to_wgs84(self, point: QgsPointXY) -> QgsPointXY:
        crs = self._canvas.mapSettings().destinationCrs()
        return QgsCoordinateTransform(crs, QgsCoordinateReferenceSystem(WGS84), QgsProject.instance()).transform(point)

    def _place(self, event) -> QgsPointXY | None:
        try:
            place = self._to_wgs84(event.mapPoint())
        except QgsCsException:
            return None
        if not (math.isfinite(place.x()) and abs(place.x()) <= 360 and abs(place.y()) <= 90):
            return None
        return place

    def _pixel(self, place: QgsPointXY):
        return self.toCanvasCoordinates(self._transform().transform(place))

    def _redraw(self) -> None:
        points = list(self._corners)
        if not self._closed and self._cursor is not None:
            points.append(self._cursor)
        self._show_handles([])
        if not points:
            self._band.reset(QgsWkbTypes.GeometryType.PolygonGeometry)
            return
        as_line = self.is_line or len(points) < 3
        kind = QgsWkbTypes.GeometryType.LineGeometry if as_line else QgsWkbTypes.GeometryType.PolygonGeometry
        geometry = QgsGeometry.fromPolylineXY(points) if as_line else QgsGeometry.fromPolygonXY([points])
        try:
            geometry.transform(self._transform())
        except QgsCsException:  # the map's projection does not reach there
            self._band.reset(kind)
            return
        self._band.reset(kind)
        self._band.setToGeometry(geometry, None)
        if (self._canvas.mapTool() is self or not self._closed) and len(self._corners) <= MOST_HANDLES:
            transform = self._transform()
            box, cross = QgsVertexMarker.IconType.ICON_BOX, QgsVertexMarker.IconType.ICON_CROSS
            corners = [(transform.transform(p), box, 9) for p in self._corners]
            middles = [(transform.transform(p), cross, 7) for p in (self._middles() if self._closed else [])]
            self._show_handles([*corners, *middles])

    def _show_handles(self, wanted: list) -> None:
        """Show marks at places of the map; marks are kept and used again, since a drag moves them all the time."""
        while len(self._handles) < len(wanted):
            marker = QgsVertexMarker(self._canvas)
            marker.setColor(_LINE)
            marker.setPenWidth(2)
            self._handles.append(marker)
        for marker, (at, icon, size) in zip(self._handles, wanted):
            marker.setCenter(at)
            marker.setIconType(icon)
            marker.setIconSize(size)
        for number, marker in enumerate(self._handles):
            marker.setVisible(number < len(wanted))
