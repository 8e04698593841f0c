"""Stale imagery replaced by a new map: in the layer tree or in the layer itself, and back again."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from qgis.core import (
    QgsDataProvider,
    QgsLayerTreeGroup,
    QgsLayerTreeLayer,
    QgsMapLayerStyle,
    QgsProject,
    QgsRasterLayer,
)

from .layers import FOLDER, ROLE, map_layers, open_map
from .mission import MapFile, MissionError, MissionFiles
from .styles import style_map
from .translation import tr


@dataclass(frozen=True)
class Replacement:
    """What was done, in words, the layer that shows the new map, and the way back.

    ``undo`` raises ``MissionError`` where a layer that it needs has been removed meanwhile.
    """

    words: str
    layer_id: str
    undo: Callable[[], None]


def place_above(stale: QgsRasterLayer, mission: MissionFiles, found: MapFile, project: QgsProject) -> Replacement:
    """Show the new map directly above the stale layer, in the same group; the stale one stays there, unticked.

    Where the mission's map is in the project already, it is moved there, else it is opened.
    """
    root = project.layerTreeRoot()
    node = root.findLayer(stale.id())
    if node is None:
        raise MissionError(tr("The layer “{}” is not in the layer tree: add it there first.").format(stale.name()))
    stale_id, ticked = stale.id(), node.itemVisibilityChecked()
    new = next((m for m in map_layers(mission.folder, project) if m.source() == str(found.path)), None)
    origin = None if new is None else _position(root.findLayer(new.id()))
    name = f"{mission.name}: {found.statement}"
    if new is None:
        new = open_map(found, name)
        new.setCustomProperty(FOLDER, str(mission.folder))
        new.setCustomProperty(ROLE, "map")
        project.addMapLayer(new, False)
        parent, index = _position(node)
        parent.insertLayer(index, new)
    else:
        _move(root.findLayer(new.id()), *_position(node))
    order = list(root.customLayerOrder()) if root.hasCustomLayerOrder() else None
    if order is not None and stale in order:
        moved = [layer for layer in order if layer is not new]
        moved.insert(moved.index(stale), new)
        root.setCustomLayerOrder(moved)
    old_name, new_id = new.name(), new.id()
    new.setName(name)
    root.findLayer(new_id).setItemVisibilityChecked(True)
    root.findLayer(stale_id).setItemVisibilityChecked(False)

    def undo() -> None:
        there = root.findLayer(stale_id)
        if there is None:
            raise MissionError(tr("The replaced layer has been removed from the project: nothing can be put back."))
        there.setItemVisibilityChecked(ticked)
        placed = root.findLayer(new_id)
        if placed is None:
            return  # taken out by hand: the old one is shown again, and that is all there was to do
        if origin is None:
            project.removeMapLayer(new_id)
            return
        placed.layer().setName(old_name)
        _move(placed, *origin)
        if order is not None:
            root.setCustomLayerOrder([layer for layer in order if project.mapLayer(layer.id()) is not None])

    return Replacement(tr("“{}” takes the place of “{}”.").format(name, stale.name()), new_id, undo)


def swap_source(stale: QgsRasterLayer, mission: MissionFiles, found: MapFile, project: QgsProject) -> Replacement:
    """Make the stale layer itself show the new map: whatever refers to the layer (layouts, themes) shows it too.

    Opacity and blending stay; how bands become colours is made anew, since the old imagery may have had others.
    """
    layer_id = stale.id()
    before = (stale.source(), stale.name(), stale.dataProvider().name(), stale.crs())
    style = QgsMapLayerStyle()
    style.readFromLayer(stale)
    opacity, blending = stale.opacity(), stale.blendMode()
    base = re.sub(r" \[[^\[\]]*CE90[^\[\]]*\]$", "", before[1])
    name = f"{base} [{mission.name}: {found.statement}]"
    stale.setDataSource(str(found.path), name, "gdal", QgsDataProvider.ProviderOptions(), True)
    if not stale.isValid():
        _restore(stale, before, style)
        raise MissionError(tr("{} cannot be shown: make the map again.").format(found.path))
    style_map(stale)
    stale.setOpacity(opacity)
    stale.setBlendMode(blending)
    stale.triggerRepaint()

    def undo() -> None:
        layer = project.mapLayer(layer_id)
        if layer is None:
            raise MissionError(tr("The replaced layer has been removed from the project: nothing can be put back."))
        _restore(layer, before, style)

    return Replacement(tr("“{}” shows the new map.").format(before[1]), layer_id, undo)


def _restore(layer: QgsRasterLayer, before, style: QgsMapLayerStyle) -> None:
    source, name, provider, crs = before
    layer.setDataSource(source, name, provider, QgsDataProvider.ProviderOptions())
    style.writeToLayer(layer)
    layer.setCrs(crs)
    layer.setName(name)
    layer.triggerRepaint()


def _position(node: QgsLayerTreeLayer) -> tuple[QgsLayerTreeGroup, int]:
    parent = node.parent()
    return parent, parent.children().index(node)


def _move(node: QgsLayerTreeLayer, parent: QgsLayerTreeGroup, index: int) -> None:
    copy = node.clone()
    parent.insertChildNode(index, copy)
    node.parent().removeChildNode(node)
