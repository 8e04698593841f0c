"""The live map in the project: rasters that keep up with the server, and what is drawn over them."""

from __future__ import annotations

from collections.abc import Callable

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsCsException,
    QgsPointXY,
    QgsProject,
    QgsRectangle,
)
from qgis.PyQt.QtCore import QObject

from ..styles import style_map
from ..translation import tr
from .connection import LiveAddress
from .layers import live_overlay
from .rasters import LiveRaster, xyz_source

_MIDDLE = 0.5
"""The drone may move in this share of the view before the view follows."""


class LiveScreen(QObject):
    """Layers of one session; ``show_mission`` begins or renews them, ``release`` takes them away."""

    def __init__(self, canvas) -> None:
        super().__init__()
        self._canvas = canvas
        self.overlay = live_overlay()
        self.rasters: dict[str, LiveRaster] = {}
        self._templates: dict[str, str] = {}
        self._epoch = ""
        self.heard = 0
        """The server's version of the tiles that the last event told."""
        QgsProject.instance().layerTreeRoot().visibilityChanged.connect(self._ticked)

    def release(self) -> None:
        """Take all layers away."""
        QgsProject.instance().layerTreeRoot().visibilityChanged.disconnect(self._ticked)
        self.clear()

    def clear(self) -> None:
        """Take the layers of the session away."""
        self._drop_rasters()
        self.overlay.remove()
        self._epoch = ""

    def show_mission(self, mission: dict, address: LiveAddress) -> bool:
        """Show the layers of a mission's document; whether anything of it can be shown on Earth."""
        placed = [layer for layer in mission.get("layers", []) if layer["scheme"]["kind"] == "webmercator"]
        if not mission.get("georeferenced") or not placed:
            self._drop_rasters()
            return False
        epoch = str((mission.get("live") or {}).get("epoch") or mission.get("epoch") or "")
        if epoch != self._epoch or {layer["id"] for layer in placed} != set(self.rasters):
            self._drop_rasters()
            for layer in placed:
                self._add(layer, address)
            self._epoch = epoch
        for layer in placed:
            if layer["id"] in self.rasters and layer["tiles"] != self._templates[layer["id"]]:
                self._templates[layer["id"]] = layer["tiles"]
                self.rasters[layer["id"]].turn_to(_source_of(layer, address))
        return True

    def tiles_changed(self, event: dict) -> None:
        """Take a ``tiles`` event."""
        self.heard = int(event["version"])
        boxes = None if event.get("all") else event.get("areas")
        for raster in self.rasters.values():
            raster.changed(boxes)

    def everything_changed(self) -> None:
        """Every tile may be another: all of them are fetched again."""
        for raster in self.rasters.values():
            raster.changed(None)

    def zoom_to(self, bounds) -> None:
        """Show west, south, east, north in degrees, with some room."""
        box = QgsRectangle(*bounds)
        if box.isEmpty() or not box.isFinite():
            return
        try:
            extent = self._to_map().transformBoundingBox(box)
        except QgsCsException:
            return
        extent.scale(1.3)
        self._canvas.setExtent(extent)
        self._canvas.refresh()

    def follow(self, lon_lat) -> None:
        """Keep a place in the middle part of the view; the view moves in steps, since each is drawn anew."""
        try:
            place = self._to_map().transform(QgsPointXY(*lon_lat))
        except QgsCsException:
            return
        inner = QgsRectangle(self._canvas.extent())
        inner.scale(_MIDDLE)
        if not inner.contains(place):
            self._canvas.setCenter(place)
            self._canvas.refresh()

    def _to_map(self) -> QgsCoordinateTransform:
        return QgsCoordinateTransform(
            QgsCoordinateReferenceSystem("EPSG:4326"),
            self._canvas.mapSettings().destinationCrs(),
            QgsProject.instance(),
        )

    def _add(self, layer: dict, address: LiveAddress) -> None:
        raster = LiveRaster(self._canvas, _title(layer), _source_of(layer, address))
        if not raster.made.isValid():
            raster.release()
            return
        for each in (raster.made, raster.under):
            style_map(each)
            self.overlay.add_raster(each, shown=layer.get("role") == "map")
        self._templates[layer["id"]] = layer["tiles"]
        self.rasters[layer["id"]] = raster

    def _drop_rasters(self) -> None:
        for raster in self.rasters.values():
            raster.release()
        self.rasters, self._templates, self._epoch = {}, {}, ""
        self.overlay.remove_rasters()

    def _ticked(self, node) -> None:
        for raster in self.rasters.values():
            if raster.layer is not None:
                raster.look_again()


def _source_of(layer: dict, address: LiveAddress) -> Callable[[int], str]:
    scheme, tiles = layer["scheme"], layer["tiles"]

    def source(edition: int) -> str:
        return xyz_source(address.url(tiles, v=edition), scheme["max_zoom"])

    return source


def _title(layer: dict) -> str:
    legend = layer.get("legend")
    title = tr(layer["title"])
    if not legend:
        return title
    return f"{title} ({legend['low']:g} – {legend['high']:g} {legend['units']})"
