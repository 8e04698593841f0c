"""How a plan looks on the map: what is flown is a strong line, what is not seen shouts, the rest stays quiet."""

from __future__ import annotations

from qgis.core import (
    QgsFillSymbol,
    QgsLinePatternFillSymbolLayer,
    QgsLineSymbol,
    QgsMarkerLineSymbolLayer,
    QgsMarkerSymbol,
    QgsProperty,
    QgsRuleBasedRenderer,
    QgsSimpleLineSymbolLayer,
    QgsSingleSymbolRenderer,
    QgsSymbolLayer,
    QgsUnitTypes,
    QgsVectorLayer,
)
from qgis.PyQt.QtGui import QColor

from ..symbols import fill_style, label_style

SORTIE_COLOURS = ("#1f5fbf", "#c2570c", "#17803d", "#8b2fa8", "#b01030", "#0e7c86", "#7a6a00", "#555555")
"""One a sortie, over again after the last; dark enough on imagery and on maps."""

_OF_SORTIE = (
    "array_get(array(" + ",".join(f"'{c}'" for c in SORTIE_COLOURS) + f'), ("sortie" - 1) % {len(SORTIE_COLOURS)})'
)


def sortie_colour() -> QgsProperty:
    """Return the colour of a feature's sortie as a data-defined property."""
    return QgsProperty.fromExpression(_OF_SORTIE)


def style_area(layer: QgsVectorLayer) -> None:
    """A dashed outline: what was asked for."""
    fill_style(layer, style="no", outline_color="20,90,200,255", outline_width="0.6", outline_style="dash")


def style_avoid(layer: QgsVectorLayer) -> None:
    """Hatched red: never over here."""
    _hatched(layer, QColor(190, 30, 30), line_angle=45.0)


def style_covered(layer: QgsVectorLayer) -> None:
    """A breath of green: sure to be seen."""
    fill_style(layer, color="60,170,90,50", outline_style="no")


def style_uncovered(layer: QgsVectorLayer) -> None:
    """Magenta: not sure to be seen."""
    fill_style(layer, color="220,0,160,150", outline_color="160,0,120,255", outline_width="0.4")


def style_footprints(layer: QgsVectorLayer) -> None:
    """Hair lines: with the usual overlaps each spot lies in a dozen of them."""
    symbol = QgsFillSymbol.createSimple({"style": "no", "outline_color": "40,70,120,90", "outline_width": "0.1"})
    layer.setRenderer(QgsSingleSymbolRenderer(symbol))


def style_path(layer: QgsVectorLayer) -> None:
    """A line in its sortie's colour, with arrows."""
    line = QgsSimpleLineSymbolLayer(QColor(SORTIE_COLOURS[0]), 0.45)
    line.setDataDefinedProperty(QgsSymbolLayer.Property.PropertyStrokeColor, sortie_colour())
    arrows = QgsMarkerLineSymbolLayer(True, 22.0)
    arrow = QgsMarkerSymbol.createSimple({"name": "filled_arrowhead", "size": "2.2", "outline_style": "no"})
    arrow.symbolLayer(0).setDataDefinedProperty(QgsSymbolLayer.Property.PropertyFillColor, sortie_colour())
    arrows.setSubSymbol(arrow)
    symbol = QgsLineSymbol()
    symbol.changeSymbolLayer(0, line)
    symbol.appendSymbolLayer(arrows)
    layer.setRenderer(QgsSingleSymbolRenderer(symbol))


def style_lanes(layer: QgsVectorLayer) -> None:
    """Broad and pale under the path: here the camera is on."""
    line = QgsSimpleLineSymbolLayer(QColor(255, 214, 64, 170), 1.3)
    symbol = QgsLineSymbol()
    symbol.changeSymbolLayer(0, line)
    layer.setRenderer(QgsSingleSymbolRenderer(symbol))


def style_waypoints(layer: QgsVectorLayer) -> None:
    """Dots in the sortie's colour; numbers when one is near enough to read them."""
    dot = QgsMarkerSymbol.createSimple(
        {"name": "circle", "size": "1.8", "outline_color": "255,255,255,220", "outline_width": "0.2"}
    )
    dot.symbolLayer(0).setDataDefinedProperty(QgsSymbolLayer.Property.PropertyFillColor, sortie_colour())
    layer.setRenderer(QgsSingleSymbolRenderer(dot))
    label_style(layer, '"seq"', 7.0, most_scale=6_000)


def style_places(layer: QgsVectorLayer) -> None:
    """A green triangle where it takes off, a cross where a search's datum is, a blue drone where the vehicle is."""
    root = QgsRuleBasedRenderer.Rule(None)
    for kind, look in (
        ("home", {"name": "triangle", "color": "20,130,50", "size": "4.2"}),
        ("datum", {"name": "cross", "color": "200,30,30", "outline_color": "200,30,30", "size": "4.5"}),
        ("vehicle", {"name": "arrow", "color": "20,90,200", "size": "5.5"}),
    ):
        symbol = QgsMarkerSymbol.createSimple({"outline_color": "255,255,255", "outline_width": "0.3", **look})
        rule = QgsRuleBasedRenderer.Rule(symbol, filterExp=f"\"kind\" = '{kind}'", label=kind)
        root.appendChild(rule)
    layer.setRenderer(QgsRuleBasedRenderer(root))


def style_stored(layer: QgsVectorLayer) -> None:
    """A dashed violet line: what the vehicle holds, beside what is planned."""
    line = QgsSimpleLineSymbolLayer(QColor("#6a1b9a"), 0.7)
    line.setUseCustomDashPattern(True)
    line.setCustomDashVector([3.0, 2.0])
    line.setCustomDashPatternUnit(QgsUnitTypes.RenderUnit.RenderMillimeters)
    arrows = QgsMarkerLineSymbolLayer(True, 26.0)
    arrows.setSubSymbol(
        QgsMarkerSymbol.createSimple(
            {"name": "filled_arrowhead", "size": "2.4", "color": "106,27,154", "outline_style": "no"}
        )
    )
    symbol = QgsLineSymbol()
    symbol.changeSymbolLayer(0, line)
    symbol.appendSymbolLayer(arrows)
    layer.setRenderer(QgsSingleSymbolRenderer(symbol))


def style_stored_items(layer: QgsVectorLayer) -> None:
    """Violet squares with the item's number."""
    symbol = QgsMarkerSymbol.createSimple(
        {"name": "square", "size": "2.2", "color": "106,27,154", "outline_color": "255,255,255"}
    )
    layer.setRenderer(QgsSingleSymbolRenderer(symbol))
    label_style(layer, '"seq"', 7.0, most_scale=8_000)


def style_fence(layer: QgsVectorLayer) -> None:
    """A dotted violet outline."""
    fill_style(layer, style="no", outline_color="106,27,154,255", outline_width="0.5", outline_style="dot")


def _hatched(layer: QgsVectorLayer, colour: QColor, *, line_angle: float) -> None:
    symbol = QgsFillSymbol.createSimple(
        {"style": "no", "outline_color": f"{colour.red()},{colour.green()},{colour.blue()}", "outline_width": "0.5"}
    )
    hatch = QgsLinePatternFillSymbolLayer()
    hatch.setLineAngle(line_angle)
    hatch.setDistance(2.0)
    hatch.subSymbol().setColor(colour)
    hatch.subSymbol().setWidth(0.25)
    symbol.appendSymbolLayer(hatch)
    layer.setRenderer(QgsSingleSymbolRenderer(symbol))
