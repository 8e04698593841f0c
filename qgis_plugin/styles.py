"""How the layers of a mission look: written in code, so that they need no files and work in every QGIS."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timezone

from qgis.core import (
    QgsBilinearRasterResampler,
    QgsColorRampShader,
    QgsFillSymbol,
    QgsLineSymbol,
    QgsMarkerSymbol,
    QgsPalLayerSettings,
    QgsProperty,
    QgsRasterBandStats,
    QgsRasterLayer,
    QgsRasterShader,
    QgsRectangle,
    QgsRuleBasedRenderer,
    QgsSingleBandPseudoColorRenderer,
    QgsSingleSymbolRenderer,
    QgsSymbolLayer,
    QgsTextBufferSettings,
    QgsTextFormat,
    QgsVectorLayer,
    QgsVectorLayerSimpleLabeling,
)
from qgis.PyQt.QtGui import QColor

from .translation import tr

RAMP = ("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725")
"""Dark to light at even steps of brightness: people with any colour vision can read it."""
SAMPLE_PX = 200_000
"""How many pixels are looked at for the ends of a ramp: overviews, so that nobody waits."""
PERSON_M = 0.5
DETAIL_M = (0.05, 0.1, 0.25, PERSON_M)
VIEWS = (1, 2, 3, 5)


def style_map(layer: QgsRasterLayer) -> None:
    """Show a photo map smoothly at every scale."""
    layer.resampleFilter().setZoomedInResampler(QgsBilinearRasterResampler())
    layer.resampleFilter().setZoomedOutResampler(QgsBilinearRasterResampler())
    layer.resampleFilter().setMaxOversampling(2.0)


def style_raster_layer(layer: QgsRasterLayer, name: str) -> None:
    """Give a layer of ``layers/`` its colours and a legend that says units; ``name`` is the file's stem."""
    if name == "sigma":
        low, high = _range(layer, 1)
        _ramp(layer, 1, _even(low, high), [f"{v:.2f} m" for v in _even(low, high)])
    elif name == "last_seen":
        low, high = _range(layer, 1)
        _ramp(layer, 1, _even(low, high), [_clock(v, high - low) for v in _even(low, high)])
    elif name == "searched":
        words = [tr("{} cm or finer").format(f"{v * 100:g}") for v in DETAIL_M[:-1]]
        words += [tr("{} m: a person, just").format(f"{PERSON_M:g}"), tr("coarser: no person would show")]
        _steps(layer, 1, DETAIL_M, words)
    elif name == "views":
        words = [str(VIEWS[0]), str(VIEWS[1]), str(VIEWS[2]), f"{VIEWS[2] + 1}-{VIEWS[3]}", tr("more")]
        _steps(layer, 1, VIEWS, words)
    layer.setOpacity(0.75)


def style_vector(layer: QgsVectorLayer, name: str) -> None:
    """Give track, cameras, footprints or finds their symbols."""
    if name == "track":
        symbol = QgsLineSymbol.createSimple({"line_color": "#ffffff", "line_width": "1.2", "capstyle": "round"})
        inner = QgsLineSymbol.createSimple({"line_color": "#d81b60", "line_width": "0.5", "capstyle": "round"})
        symbol.appendSymbolLayer(inner.symbolLayer(0).clone())
        layer.setRenderer(QgsSingleSymbolRenderer(symbol))
    elif name == "cameras":
        symbol = QgsMarkerSymbol.createSimple(
            {"name": "triangle", "color": "#ffd54a", "outline_color": "#263238", "size": "2.4"}
        )
        heading = QgsProperty.fromExpression('coalesce("heading_deg", 0)')
        symbol.symbolLayer(0).setDataDefinedProperty(QgsSymbolLayer.Property.PropertyAngle, heading)
        layer.setRenderer(QgsSingleSymbolRenderer(symbol))
    elif name == "footprints":
        layer.setRenderer(_by_status())
    elif name == "finds":
        symbol = QgsMarkerSymbol.createSimple(
            {"name": "circle", "color": "#e53935", "outline_color": "#ffffff", "outline_width": "0.6", "size": "4"}
        )
        layer.setRenderer(QgsSingleSymbolRenderer(symbol))
        label(layer, "name")
    elif name == "change":
        fill = {"color": "255,152,0,70", "outline_color": "#e65100", "outline_width": "0.6"}
        layer.setRenderer(QgsSingleSymbolRenderer(QgsFillSymbol.createSimple(fill)))


def label(layer: QgsVectorLayer, field: str) -> None:
    """Write a field beside each feature, readable over a picture; a field that is not there writes nothing."""
    if layer.fields().indexOf(field) < 0:
        return
    buffer, text, settings = QgsTextBufferSettings(), QgsTextFormat(), QgsPalLayerSettings()
    buffer.setEnabled(True)
    buffer.setSize(0.9)
    text.setBuffer(buffer)
    text.setSize(9)
    settings.setFormat(text)
    settings.fieldName = field
    layer.setLabeling(QgsVectorLayerSimpleLabeling(settings))
    layer.setLabelsEnabled(True)


def _by_status() -> QgsRuleBasedRenderer:
    """Footprints by how surely their frame was placed."""
    rules = (
        (tr("registered"), "\"status\" = 'registered'", "#1e88e5"),
        (tr("placed by GPS alone"), "\"status\" = 'gps_only'", "#fb8c00"),
        (tr("not shown in the map"), "ELSE", "#757575"),
    )
    root = QgsRuleBasedRenderer.Rule(None)
    for words, expression, colour in rules:
        symbol = QgsFillSymbol.createSimple({"color": "0,0,0,0", "outline_color": colour, "outline_width": "0.3"})
        root.appendChild(QgsRuleBasedRenderer.Rule(symbol, 0, 0, expression, words))
    return QgsRuleBasedRenderer(root)


def _range(layer: QgsRasterLayer, band: int) -> tuple[float, float]:
    both = QgsRasterBandStats.Stats.Min | QgsRasterBandStats.Stats.Max
    found = layer.dataProvider().bandStatistics(band, both, QgsRectangle(), SAMPLE_PX)
    low, high = found.minimumValue, found.maximumValue
    if not (low <= high):  # nothing but no-data
        return 0.0, 1.0
    return low, high if high > low else low + max(1.0, abs(low)) * 1e-6


def _even(low: float, high: float) -> list[float]:
    return [low + (high - low) * k / (len(RAMP) - 1) for k in range(len(RAMP))]


def _ramp(layer: QgsRasterLayer, band: int, values: Sequence[float], words: Sequence[str]) -> None:
    _shade(layer, band, QgsColorRampShader.Type.Interpolated, values, words)


def _steps(layer: QgsRasterLayer, band: int, tops: Sequence[float], words: Sequence[str]) -> None:
    _shade(layer, band, QgsColorRampShader.Type.Discrete, [*map(float, tops), float("inf")], words)


def _shade(layer: QgsRasterLayer, band: int, kind, values: Sequence[float], words: Sequence[str]) -> None:
    function = QgsColorRampShader(values[0], values[-1])
    function.setColorRampType(kind)
    items = [QgsColorRampShader.ColorRampItem(v, QColor(c), w) for v, c, w in zip(values, RAMP, words)]
    function.setColorRampItemList(items)
    shader = QgsRasterShader()
    shader.setRasterShaderFunction(function)
    layer.setRenderer(QgsSingleBandPseudoColorRenderer(layer.dataProvider(), band, shader))


def _clock(seconds: float, span_s: float) -> str:
    moment = datetime.fromtimestamp(seconds, tz=timezone.utc)
    return moment.strftime("%Y-%m-%d %H:%M UTC" if span_s > 86_400 else "%H:%M:%S UTC")


def style_change(layer: QgsRasterLayer, threshold: float) -> None:
    """Show the probability of change from the threshold on, clear below."""
    function = QgsColorRampShader(0.0, 1.0)
    function.setColorRampType(QgsColorRampShader.Type.Interpolated)
    edge, clear = max(1e-3, threshold), QColor(255, 235, 59, 0)
    function.setColorRampItemList(
        [
            QgsColorRampShader.ColorRampItem(0.0, clear, tr("no change")),
            QgsColorRampShader.ColorRampItem(edge - 1e-3, clear, ""),
            QgsColorRampShader.ColorRampItem(edge, QColor("#ffeb3b"), f"{edge:.2f}"),
            QgsColorRampShader.ColorRampItem(1.0, QColor("#d50000"), tr("changed")),
        ]
    )
    shader = QgsRasterShader()
    shader.setRasterShaderFunction(function)
    layer.setRenderer(QgsSingleBandPseudoColorRenderer(layer.dataProvider(), 1, shader))
