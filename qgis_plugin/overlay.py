"""A group of memory layers that belongs to a dock: made when needed, updated in place, gone with the dock."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from qgis.core import QgsJsonUtils, QgsLayerTreeGroup, QgsMapLayer, QgsProject, QgsRasterLayer, QgsVectorLayer

MARK = "photomap/passing"
"""The custom property of layers and groups that a project need not keep."""

Features = Sequence[dict]


@dataclass(frozen=True)
class LayerSpec:
    """One layer of an overlay. ``fields`` is the memory provider's wording, as ``field=sortie:integer``."""

    key: str
    title: str
    geometry: str
    fields: tuple[str, ...]
    style: Callable[[QgsVectorLayer], None]
    shown: bool = True

    @property
    def uri(self) -> str:
        """Return the source of an empty memory layer in WGS 84."""
        return "&".join([f"{self.geometry}?crs=EPSG:4326", *(f"field={f}" for f in self.fields)])


class Overlay:
    """Layers by ``LayerSpec``, the first on top, in one group at the top of the layer tree.

    A user may remove a layer or the group: it comes again with the next features. A project that was saved with such
    layers has them empty: they are taken out when it is opened (``sweep``).
    """

    def __init__(self, title: str, specs: Sequence[LayerSpec]) -> None:
        self._title = title
        self._specs = {spec.key: spec for spec in specs}
        self._ids: dict[str, str] = {}
        self._raster_ids: list[str] = []
        self._held: dict[str, Features] = {}

    @property
    def layers(self) -> dict[str, QgsVectorLayer]:
        """The layers that are there, by key."""
        found = {key: QgsProject.instance().mapLayer(number) for key, number in self._ids.items()}
        return {key: layer for key, layer in found.items() if layer is not None}

    def show(self, features: dict[str, Features]) -> None:
        """Set what the layers of these keys hold: GeoJSON features; the others stay as they are."""
        for key, items in features.items():
            self.set_features(key, items)

    def set_features(self, key: str, items: Features) -> None:
        """Set what one layer holds, and draw it anew where that is something else."""
        layer = self.layers.get(key)
        if layer is not None and self._held.get(key) == items:
            return
        self._held[key] = items
        if layer is None:
            if not items:
                return
            layer = self._add(self._specs[key])
        provider = layer.dataProvider()
        provider.truncate()
        if items:
            provider.addFeatures(_qgis_features(items, layer))
        layer.updateExtents()
        layer.triggerRepaint()

    def clear(self, keys: Iterable[str] | None = None) -> None:
        """Empty the layers (of these keys)."""
        for key in list(self.layers) if keys is None else keys:
            self.set_features(key, ())

    def remove(self) -> None:
        """Take layers and group out of the project."""
        project = QgsProject.instance()
        project.removeMapLayers([layer.id() for layer in self.layers.values()])
        self._ids, self._held = {}, {}
        self.remove_rasters()
        group = self._group()
        if group is not None and not group.children():
            group.parent().removeChildNode(group)

    def _group(self) -> QgsLayerTreeGroup | None:
        for group in QgsProject.instance().layerTreeRoot().findGroups():
            if group.customProperty(MARK) == self._title:
                return group
        return None

    def add_raster(self, layer: QgsRasterLayer, *, shown: bool) -> None:
        """Put a raster layer under all that is there."""
        self._insert(layer, len(self._made_group().children()), shown=shown)
        self._raster_ids.append(layer.id())

    def remove_rasters(self) -> None:
        """Take the raster layers out of the project."""
        there = [number for number in self._raster_ids if QgsProject.instance().mapLayer(number) is not None]
        QgsProject.instance().removeMapLayers(there)
        self._raster_ids = []

    def _made_group(self) -> QgsLayerTreeGroup:
        group = self._group()
        if group is None:
            group = QgsProject.instance().layerTreeRoot().insertGroup(0, self._title)
            group.setCustomProperty(MARK, self._title)
        return group

    def _add(self, spec: LayerSpec) -> QgsVectorLayer:
        layer = QgsVectorLayer(spec.uri, spec.title, "memory")
        layer.setCustomProperty("skipMemoryLayersCheck", 1)  # closing QGIS must not ask about it
        layer.setReadOnly(True)
        spec.style(layer)
        order = list(self._specs)
        above = sum(key in self.layers and order.index(key) < order.index(spec.key) for key in self._ids)
        self._insert(layer, above, shown=spec.shown)
        self._ids[spec.key] = layer.id()
        return layer

    def _insert(self, layer: QgsMapLayer, at: int, *, shown: bool) -> None:
        project = QgsProject.instance()
        layer.setCustomProperty(MARK, self._title)
        was_dirty = project.isDirty()
        group = self._made_group()
        project.addMapLayer(layer, False)
        node = group.insertLayer(at, layer)
        node.setExpanded(False)
        node.setItemVisibilityChecked(shown)
        project.setDirty(was_dirty)  # nothing of the user's was changed


def _qgis_features(items: Features, layer: QgsVectorLayer) -> list:
    """GeoJSON as QGIS's features, by C++: thousands in milliseconds. It reads properties by order, not by name."""
    names = layer.fields().names()
    ordered = [
        {"type": "Feature", "geometry": f["geometry"], "properties": {n: f["properties"].get(n) for n in names}}
        for f in items
    ]
    return QgsJsonUtils.stringToFeatureList(
        json.dumps({"type": "FeatureCollection", "features": ordered}), layer.fields()
    )


def sweep(*_: object) -> None:
    """Take out what an earlier session left in a project that was saved meanwhile."""
    project = QgsProject.instance()
    left = [layer.id() for layer in project.mapLayers().values() if layer.customProperty(MARK)]
    project.removeMapLayers(left)
    for group in project.layerTreeRoot().findGroups():
        if group.customProperty(MARK) and not group.children():
            group.parent().removeChildNode(group)
