"""A small view of the mission's map alone, in its own coordinates: places on the map are picked here.

A map without a place on Earth can be shown nowhere else: its units are pixels of its first frame.
"""

from __future__ import annotations

from collections.abc import Callable

from qgis.core import QgsCoordinateReferenceSystem, QgsPointXY, QgsRasterLayer
from qgis.gui import QgsMapCanvas
from qgis.PyQt.QtGui import QColor
from qgis.PyQt.QtWidgets import QVBoxLayout, QWidget

from ..layers import open_map
from ..mission import MapFile, MissionError
from ..translation import tr
from .pair_table import PairMarks
from .pairs import Pair
from .tools import PickTool

HEIGHT_PX = 220


class MapView(QWidget):
    """Shows one map; a left click picks, the wheel zooms, the middle button or Space pans."""

    def __init__(self, on_pick: Callable[[QgsPointXY], None], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.canvas = QgsMapCanvas(self)
        self.canvas.setObjectName("photomapGeoreferenceView")
        self.canvas.setAccessibleName(tr("The mission's map"))
        self.canvas.setCanvasColor(QColor("#ffffff"))
        self.canvas.enableAntiAliasing(True)
        self.canvas.setMinimumHeight(HEIGHT_PX)
        self._layer: QgsRasterLayer | None = None
        self._tool = PickTool(self.canvas, on_pick)
        self.canvas.setMapTool(self._tool)
        self.marks = PairMarks(self.canvas, _on_map)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.canvas)

    def crs(self) -> QgsCoordinateReferenceSystem:
        """Return the map's coordinate system; not valid where the map has no place on Earth."""
        return QgsCoordinateReferenceSystem() if self._layer is None else self._layer.crs()

    def show_map(self, found: MapFile | None) -> None:
        """Show this map, or nothing; what is shown is read anew, since a solution may have moved it."""
        self.canvas.setLayers([])
        self._layer = None
        if found is not None:
            try:
                self._layer = open_map(found, found.path.stem)
            except MissionError:
                self._layer = None
        if self._layer is not None:
            self.canvas.setDestinationCrs(self._layer.crs())
            self.canvas.setLayers([self._layer])
            self.canvas.setExtent(self._layer.extent())
        self.canvas.refresh()

    def release(self) -> None:
        """Close the map's file."""
        self.marks.clear()
        self.canvas.unsetMapTool(self._tool)
        self.canvas.setLayers([])
        self._layer = None


def _on_map(pair: Pair) -> QgsPointXY | None:
    return None if pair.map_xy is None else QgsPointXY(*pair.map_xy)
