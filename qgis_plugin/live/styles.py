"""How a flight under way looks: the drone and where it looks strong, what is covered and missing quiet."""

from __future__ import annotations

from qgis.core import (
    QgsLineSymbol,
    QgsMarkerSymbol,
    QgsProperty,
    QgsRuleBasedRenderer,
    QgsSingleSymbolRenderer,
    QgsSymbolLayer,
    QgsVectorLayer,
)

from ..symbols import fill_style, label_style

FIND_COLOURS = {"intruder": "#8e24aa", "victim": "#e53935", "hazard": "#fb8c00", "other": "#1e88e5"}


def style_drone(layer: QgsVectorLayer) -> None:
    """An arrow to where the picture's top points."""
    arrow = QgsMarkerSymbol.createSimple(
        {"name": "arrow", "color": "25,118,210", "outline_color": "255,255,255", "outline_width": "0.5", "size": "8"}
    )
    arrow.symbolLayer(0).setDataDefinedProperty(
        QgsSymbolLayer.Property.PropertyAngle, QgsProperty.fromExpression('coalesce("heading_deg", 0)')
    )
    layer.setRenderer(QgsSingleSymbolRenderer(arrow))


def style_footprint(layer: QgsVectorLayer) -> None:
    """The outline of what the camera sees now."""
    fill_style(layer, color="25,118,210,35", outline_color="25,118,210", outline_width="0.7")


def style_ellipse(layer: QgsVectorLayer) -> None:
    """Within this the drone's picture lies, nine times of ten."""
    fill_style(layer, color="255,255,255,50", outline_color="255,255,255", outline_width="0.5", outline_style="dot")


def style_track(layer: QgsVectorLayer) -> None:
    """A thin light line on the map."""
    symbol = QgsLineSymbol.createSimple({"line_color": "255,235,59,220", "line_width": "0.5"})
    layer.setRenderer(QgsSingleSymbolRenderer(symbol))


def style_gaps(layer: QgsVectorLayer) -> None:
    """What of the area nobody has seen yet."""
    fill_style(layer, color="220,0,160,70", outline_color="220,0,160,160", outline_width="0.3")


def style_area(layer: QgsVectorLayer) -> None:
    """A dashed outline: what is to be covered."""
    fill_style(layer, style="no", outline_color="20,90,200", outline_width="0.6", outline_style="dash")


def style_finds(layer: QgsVectorLayer) -> None:
    """A disc in the kind's colour with its name beside it."""
    root = QgsRuleBasedRenderer.Rule(None)
    for kind, colour in FIND_COLOURS.items():
        disc = QgsMarkerSymbol.createSimple(
            {"name": "circle", "color": colour, "outline_color": "255,255,255", "outline_width": "0.5", "size": "4.2"}
        )
        root.appendChild(QgsRuleBasedRenderer.Rule(disc, filterExp=f"\"kind\" = '{kind}'", label=kind))
    layer.setRenderer(QgsRuleBasedRenderer(root))
    label_style(layer, 'coalesce("name", "kind")', 9.0)
