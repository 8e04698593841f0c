"""Short words for the symbols that several docks draw with."""

from __future__ import annotations

from qgis.core import (
    QgsFillSymbol,
    QgsPalLayerSettings,
    QgsSingleSymbolRenderer,
    QgsTextBufferSettings,
    QgsTextFormat,
    QgsVectorLayer,
    QgsVectorLayerSimpleLabeling,
)


def fill_style(layer: QgsVectorLayer, **look: str) -> None:
    """Draw polygons with one simple fill; ``look`` as ``QgsFillSymbol.createSimple`` takes it."""
    layer.setRenderer(QgsSingleSymbolRenderer(QgsFillSymbol.createSimple(look)))


def label_style(layer: QgsVectorLayer, expression: str, size_pt: float, *, most_scale: float = 0.0) -> None:
    """Label with an expression, on a light halo; only nearer than 1 : ``most_scale`` where that is given."""
    settings = QgsPalLayerSettings()
    settings.fieldName, settings.isExpression = expression, True
    text, halo = QgsTextFormat(), QgsTextBufferSettings()
    text.setSize(size_pt)
    halo.setEnabled(True)
    halo.setSize(0.7)
    text.setBuffer(halo)
    settings.setFormat(text)
    if most_scale > 0:
        settings.scaleVisibility = True
        settings.minimumScale, settings.maximumScale = most_scale, 0.0
    layer.setLabeling(QgsVectorLayerSimpleLabeling(settings))
    layer.setLabelsEnabled(True)
