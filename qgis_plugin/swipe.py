"""Swipe: the map without its upper layer, drawn right of the cursor: old and new are wiped over each other."""

from __future__ import annotations

from qgis.core import QgsMapRendererParallelJob
from qgis.gui import QgsMapCanvas, QgsMapCanvasItem, QgsMapTool
from qgis.PyQt.QtCore import QPointF, QRectF, Qt
from qgis.PyQt.QtGui import QColor, QImage, QPainter, QPen

STEP_PX = 20


class SwipeCurtain(QgsMapCanvasItem):
    """What lies below, painted from the divider to the right edge of the canvas; ``x_px`` is where the divider is."""

    def __init__(self, canvas: QgsMapCanvas) -> None:
        super().__init__(canvas)
        self._canvas = canvas
        self.image: QImage | None = None
        self.x_px = canvas.width() // 2

    def boundingRect(self) -> QRectF:
        """Return the whole canvas."""
        return QRectF(0, 0, self._canvas.width(), self._canvas.height())

    def paint(self, painter: QPainter, option=None, widget=None) -> None:
        """Paint the lower map right of the divider, and the divider."""
        height, right = self._canvas.height(), self._canvas.width() - self.x_px
        if self.image is not None and right > 0:
            painter.save()
            painter.setClipRect(QRectF(self.x_px, 0, right, height))
            painter.fillRect(self.boundingRect(), self._canvas.canvasColor())
            painter.drawImage(QPointF(0, 0), self.image)
            painter.restore()
        for colour, width in (("#ffffff", 4), ("#263238", 2)):
            painter.setPen(QPen(QColor(colour), width))
            painter.drawLine(QPointF(self.x_px, 0), QPointF(self.x_px, height))


class SwipeTool(QgsMapTool):
    """Moves the curtain with the cursor, or with the arrow keys; Esc ends it.

    ``layer`` is what is wiped away. The map below is rendered in the background whenever the view has changed.
    """

    def __init__(self, canvas: QgsMapCanvas, layer, on_end) -> None:
        super().__init__(canvas)
        self._layer_id = layer.id()
        self._on_end = on_end
        self._curtain: SwipeCurtain | None = None
        self._job: QgsMapRendererParallelJob | None = None
        self._stale = False
        self.setCursor(Qt.CursorShape.SplitHCursor)

    @property
    def curtain(self) -> SwipeCurtain | None:
        """Return what is painted over the canvas while the tool is active."""
        return self._curtain

    def activate(self) -> None:
        """Begin: draw the map below."""
        super().activate()
        self._curtain = SwipeCurtain(self.canvas())
        self.canvas().mapCanvasRefreshed.connect(self._render)
        self._render()

    def deactivate(self) -> None:
        """End: nothing stays on the canvas."""
        self.canvas().mapCanvasRefreshed.disconnect(self._render)
        if self._job is not None:
            self._job.finished.disconnect(self._rendered)
            self._job.cancelWithoutBlocking()
            self._job = None
        if self._curtain is not None:
            self.canvas().scene().removeItem(self._curtain)
            self._curtain = None
        super().deactivate()
        self._on_end()

    def canvasMoveEvent(self, event) -> None:
        """Follow the cursor."""
        self._move(int(event.pos().x()))

    def keyPressEvent(self, event) -> None:
        """Move by the arrow keys; end with Esc."""
        key = event.key()
        if key == Qt.Key.Key_Escape:
            self.canvas().unsetMapTool(self)
        elif key in (Qt.Key.Key_Left, Qt.Key.Key_Right) and self._curtain is not None:
            self._move(self._curtain.x_px + (STEP_PX if key == Qt.Key.Key_Right else -STEP_PX))
            event.accept()

    def _move(self, x_px: int) -> None:
        if self._curtain is not None:
            self._curtain.x_px = min(max(x_px, 0), self.canvas().width())
            self._curtain.update()

    def _render(self) -> None:
        if self._job is not None:
            self._stale = True  # the view moved on while the last picture was being drawn
            return
        settings = self.canvas().mapSettings()
        settings.setLayers([layer for layer in settings.layers() if layer.id() != self._layer_id])
        self._stale = False
        self._job = QgsMapRendererParallelJob(settings)
        self._job.finished.connect(self._rendered)
        self._job.start()

    def _rendered(self) -> None:
        job, self._job = self._job, None
        if job is None or self._curtain is None:
            return
        if self._stale:
            self._render()
            return
        self._curtain.image = job.renderedImage()
        self._curtain.update()
