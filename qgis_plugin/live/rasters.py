"""The growing map as XYZ layers of QGIS: new ground is fetched out of sight first, then the layer is turned to it.

QGIS keeps tiles by their address, for as long as it runs: new pixels need a new address (the template carries the
epoch, we add an edition). A layer that is turned to addresses it never fetched goes blank until they come: so a layer
of the same source is drawn into an image that nobody sees, which fills QGIS's cache of tiles, and only then the visible
one is turned, while the edition of before still lies under it. Only ground in view counts, and one edition at a time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from urllib.parse import quote

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsCsException,
    QgsMapLayer,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsProject,
    QgsRasterLayer,
    QgsRectangle,
)
from qgis.PyQt.QtCore import QObject, QTimer

LEAST_PAUSE_MS = 1000
"""Between two editions of what is on screen."""
MOST_ZOOM = 24


_ending: set = set()


def _let_end(job: QgsMapRendererParallelJob, layer: QgsRasterLayer) -> None:
    """Stop a drawing and keep it until it has stopped: deleting it would make the window wait for its downloads."""
    kept = (job, layer)
    _ending.add(kept)
    job.finished.connect(lambda: _ending.discard(kept))
    job.cancelWithoutBlocking()


_last_edition = 0


def _next_edition() -> int:
    global _last_edition
    _last_edition = max(_last_edition + 1, int(time.time() * 1000))
    return _last_edition


def xyz_source(template: str, most_zoom: int) -> str:
    """Return the source of an XYZ layer of the provider ``wms``; the address is encoded as QGIS does it.

    The least zoom is 0 whatever the server has: seen from afar QGIS would ask for the whole world at a larger one,
    which may be sixteen thousand tiles.
    """
    address = quote(template, safe=":/{}")
    return f"type=xyz&url={address}&zmin=0&zmax={min(most_zoom, MOST_ZOOM)}"


class LiveRaster(QObject):
    """One layer of the server in the project; ``source`` makes the layer's source of an edition's number.

    Editions are ours and only grow, from session to session and from one run of QGIS to the next: the server's versions
    begin anew with each server, and addresses that were used before would show what was there then.
    """

    def __init__(self, canvas, name: str, source: Callable[[int], str]) -> None:
        super().__init__()
        self._canvas, self._source = canvas, source
        self.edition = self.wanted = _next_edition()
        """What the layer shows, and what it is to show."""
        self.made = QgsRasterLayer(source(self.edition), name, "wms")
        self.under = QgsRasterLayer(source(self.edition), name, "wms")
        """The edition of before, out of the legend: it shows while the other is still being drawn, however slowly."""
        self.under.setFlags(self.under.flags() | QgsMapLayer.LayerFlag.Private)
        self._layer_id, self._under_id = self.made.id(), self.under.id()
        self.swaps = 0
        self._under_is_old = self._being_drawn = False
        self._job: QgsMapRendererParallelJob | None = None
        self._hidden: QgsRasterLayer | None = None
        self._fetching = self.edition
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(LEAST_PAUSE_MS)
        self._timer.timeout.connect(self._begin)
        canvas.extentsChanged.connect(self.look_again)
        canvas.renderStarting.connect(self._drawing)
        canvas.mapCanvasRefreshed.connect(self._drawn)

    def release(self) -> None:
        """Fetch nothing any more; the layer stays where it is."""
        self._timer.stop()
        self._canvas.extentsChanged.disconnect(self.look_again)
        self._canvas.renderStarting.disconnect(self._drawing)
        self._canvas.mapCanvasRefreshed.disconnect(self._drawn)
        job, self._job = self._job, None
        if job is not None:
            job.finished.disconnect(self._fetched)
            _let_end(job, self._hidden)
        self._hidden = None

    @property
    def layer(self) -> QgsRasterLayer | None:
        """The layer, ``None`` where the user has removed it."""
        return QgsProject.instance().mapLayer(self._layer_id)

    @property
    def resting(self) -> bool:
        """Whether what is in view is as new as is known."""
        return self._job is None and not self._timer.isActive()

    def turn_to(self, source: Callable[[int], str]) -> None:
        """Take another template: colours have changed."""
        self._source = source
        self.changed(None)

    def changed(self, boxes: Sequence[Sequence[float]] | None) -> None:
        """Know that ground has changed: boxes west, south, east, north in degrees, ``None`` where all may have."""
        self.wanted = _next_edition()
        if boxes is None or self._in_view(boxes):
            self._soon()

    def look_again(self) -> None:
        """Something else is in view, or the layer was ticked: it may have been fetched at an older edition."""
        root = QgsProject.instance().layerTreeRoot()
        upper, under = root.findLayer(self._layer_id), root.findLayer(self._under_id)
        if upper and under and under.itemVisibilityChecked() != upper.itemVisibilityChecked():
            under.setItemVisibilityChecked(upper.itemVisibilityChecked())
        if self.wanted > self.edition:
            self._soon()

    def _soon(self) -> None:
        if not self._timer.isActive() and self._job is None:
            self._timer.start()

    def _in_view(self, boxes: Sequence[Sequence[float]]) -> bool:
        to_map = QgsCoordinateTransform(
            QgsCoordinateReferenceSystem("EPSG:4326"),
            self._canvas.mapSettings().destinationCrs(),
            QgsProject.instance(),
        )
        view = self._canvas.extent()
        for west, south, east, north in boxes:
            try:
                if view.intersects(to_map.transformBoundingBox(QgsRectangle(west, south, east, north))):
                    return True
            except QgsCsException:
                return True
        return False

    def _begin(self) -> None:
        """Draw the newest edition where nobody sees it."""
        layer = self.layer
        if layer is None or self.wanted <= self.edition or self._job is not None:
            return
        node = QgsProject.instance().layerTreeRoot().findLayer(layer.id())
        if node is None or not node.isVisible():
            return  # fetched when it is ticked: see ``look_again``
        self._fetching = self.wanted
        self._hidden = QgsRasterLayer(self._source(self._fetching), "next", "wms")
        if not self._hidden.isValid():
            self._hidden = None
            return
        settings = QgsMapSettings(self._canvas.mapSettings())
        settings.setLayers([self._hidden])
        self._job = QgsMapRendererParallelJob(settings)
        self._job.finished.connect(self._fetched)
        self._job.start()

    def _fetched(self) -> None:
        job, self._job = self._job, None
        if job is not None:
            job.deleteLater()
        self._hidden = None
        layer = self.layer
        if layer is None:
            return
        self.edition = self._fetching
        self.swaps += 1
        self._turn(layer)
        self._under_is_old, self._being_drawn = True, False
        if self.wanted > self.edition:
            self._timer.start()

    def _drawing(self) -> None:
        """What the window begins to draw now has the new edition: a picture begun before may still end after it."""
        self._being_drawn = True

    def _drawn(self) -> None:
        """The window shows the new edition: the one below may follow, behind it."""
        under = QgsProject.instance().mapLayer(self._under_id)
        if self._under_is_old and self._being_drawn and under is not None:
            self._under_is_old = False
            self._turn(under)

    def _turn(self, layer: QgsRasterLayer) -> None:
        project = QgsProject.instance()
        was_dirty = project.isDirty()
        layer.setDataSource(self._source(self.edition), layer.name(), "wms")
        project.setDirty(was_dirty)
        layer.triggerRepaint()
