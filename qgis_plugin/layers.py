"""A mission as a tidy group of layers in the open project."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsCsException,
    QgsDataProvider,
    QgsLayerTreeGroup,
    QgsLayerTreeLayer,
    QgsMapLayer,
    QgsProject,
    QgsRasterLayer,
    QgsRectangle,
    QgsVectorLayer,
)

from .mission import VECTOR_LAYERS, MapFile, MissionError, MissionFiles
from .styles import style_map, style_raster_layer, style_vector
from .translation import tr

FOLDER = "photomap/folder"
ROLE = "photomap/role"
"""Custom properties of the layers and of their group: which mission, and as what. They are kept in the project."""
FIRST_BAND = "vrt://{}?bands=1"
SHOWN = frozenset({"map", "finds", "track"})


def titles() -> dict[str, str]:
    """Return the layers' names by role, in the user's language."""
    return {
        "finds": tr("Finds"),
        "track": tr("Track"),
        "cameras": tr("Cameras"),
        "footprints": tr("Footprints of the frames"),
        "sigma": tr("Accuracy: one sigma of the place"),
        "last_seen": tr("Age: when last seen"),
        "searched": tr("Searched: smallest detail that shows"),
        "views": tr("Views: how many frames saw it"),
        "change": tr("Changed areas"),
    }


def add_mission(
    mission: MissionFiles, project: QgsProject, *, parent: QgsLayerTreeGroup | None = None, index: int = 0
) -> Iterator[QgsLayerTreeGroup | None]:
    """Add a mission's layers as one group at a place of the tree, in small steps; the last value is the group.

    From top to bottom: finds, track, cameras, footprints, a closed group of what is known of each pixel, and the map.
    Only finds, track and map are ticked. A mission that is in the project already is shown anew in its group.
    Raises ``MissionError`` where a map does not open; nothing has been added then.
    """
    there = mission_group(mission.folder, project)
    if there is not None:
        yield from refresh_mission(mission, project, there)
        return
    maps = []
    for found in mission.maps:
        maps.append(_map_layer(found))
        yield None
    group = (parent or project.layerTreeRoot()).insertGroup(index, mission.title)
    group.setCustomProperty(FOLDER, str(mission.folder))
    known = None
    for layer in maps:
        _add(layer, "map", mission, project, group)
        yield group
    for at, (role, layer) in enumerate(_overlays(mission)):
        yield group
        _add(layer, role, mission, project, group, index=at)
        yield group
    for role, layer in _known(mission):
        yield group
        if known is None:
            known = group.insertGroup(len(group.children()) - len(maps), tr("What is known of each pixel"))
            known.setExpanded(False)
        _add(layer, role, mission, project, known)
        yield group


def refresh_mission(
    mission: MissionFiles, project: QgsProject, group: QgsLayerTreeGroup
) -> Iterator[QgsLayerTreeGroup]:
    """Show a mission that was solved again in its group: sources opened anew, names renewed, new layers added.

    QGIS never reloads a changed raster by itself: the provider is made anew on the same source, styles stay. So are
    stale layers that show the map since it was swapped into them. A piece that is part of another now is taken away.
    """
    group.setName(mission.title)
    by_path = {str(m.path): m for m in mission.maps}
    layers = mission_layers(mission.folder, project)
    present = {(str(layer.customProperty(ROLE)), _path(layer)) for layer in layers}
    swapped = [x for x in project.mapLayers().values() if _path(x) in by_path and x not in layers]
    for layer in (*layers, *swapped):
        found = by_path.get(_path(layer))
        if Path(_path(layer)).is_file():
            if found is not None:
                layer.setName(_renewed(layer.name(), mission, found))
            reopen(layer)
            _without_place(layer, mission.georeferenced)
        elif layer.customProperty(ROLE) == "map":
            project.removeMapLayer(layer.id())
        yield group
    for found in mission.maps:
        if ("map", str(found.path)) not in present:
            _add(_map_layer(found), "map", mission, project, group)
            yield group
    shown = frozenset(role for role, _ in present)
    for layers_of in (_overlays, _known):
        for role, layer in layers_of(mission, shown):
            _add(layer, role, mission, project, group, index=0)
            yield group


def whole(steps: Iterator[QgsLayerTreeGroup | None]) -> QgsLayerTreeGroup:
    """Take all steps at once and return the group: for scripts; a window takes one a turn of its event loop."""
    return list(steps)[-1]


def reopen(layer: QgsMapLayer) -> None:
    """Open a layer's source anew; its style stays."""
    layer.setDataSource(layer.source(), layer.name(), layer.dataProvider().name(), QgsDataProvider.ProviderOptions())
    layer.triggerRepaint()


def mission_group(folder: Path | str, project: QgsProject) -> QgsLayerTreeGroup | None:
    """Return the group of a mission, where it is in the project."""
    for group in _groups(project.layerTreeRoot()):
        if group.customProperty(FOLDER) == str(folder):
            return group
    return None


def mission_layers(folder: Path | str, project: QgsProject) -> list[QgsMapLayer]:
    """Return a mission's layers that are in the project."""
    return [layer for layer in project.mapLayers().values() if layer.customProperty(FOLDER) == str(folder)]


def map_layers(folder: Path | str, project: QgsProject) -> list[QgsRasterLayer]:
    """Return the maps of a mission that are in the project."""
    return [layer for layer in mission_layers(folder, project) if layer.customProperty(ROLE) == "map"]


def open_map(found: MapFile, name: str) -> QgsRasterLayer:
    """Return a styled layer of a map's GeoTIFF; ``MissionError`` where QGIS cannot show it."""
    layer = QgsRasterLayer(str(found.path), name, "gdal")
    if not layer.isValid():
        raise MissionError(f"{found.path} cannot be shown: {layer.error().summary() or 'make the map again'}")
    _without_place(layer, found.georeferenced)
    style_map(layer)
    return layer


def map_title(found: MapFile, pieces: int = 1) -> str:
    """Return the name of a map's layer: which, how old, how good."""
    name = tr("Map") if pieces == 1 else tr("Map, piece {}").format(found.path.stem.split("-")[-1])
    return f"{name}: {found.statement}"


def zoom_to(layer: QgsMapLayer, canvas) -> None:
    """Show the whole of a layer in a canvas, whatever its CRS."""
    settings = canvas.mapSettings()
    extent = layer.extent()
    if layer.crs().isValid() and settings.destinationCrs().isValid():
        change = QgsCoordinateTransform(
            layer.crs(), settings.destinationCrs(), QgsProject.instance().transformContext()
        )
        try:
            extent = change.transformBoundingBox(extent)
        except QgsCsException:  # the window's CRS does not reach there: the view stays where it is
            return
    extent = QgsRectangle(extent)
    extent.scale(1.1)
    canvas.setExtent(extent)
    canvas.refresh()


def _map_layer(found: MapFile) -> QgsRasterLayer:
    pieces = 1 if found.path.stem == "map" else 2
    return open_map(found, map_title(found, pieces))


def _overlays(mission: MissionFiles, shown: frozenset[str] = frozenset()) -> Iterator[tuple[str, QgsVectorLayer]]:
    sources = {} if mission.vectors is None else {n: f"{mission.vectors}|layername={n}" for n in VECTOR_LAYERS}
    if mission.finds is not None:
        sources = {"finds": str(mission.finds), **sources}
    for role, source in sources.items():
        if role in shown:
            continue
        layer = QgsVectorLayer(source, titles()[role], "ogr")
        if layer.isValid():
            style_vector(layer, role)
            yield role, layer


def _known(mission: MissionFiles, shown: frozenset[str] = frozenset()) -> Iterator[tuple[str, QgsRasterLayer]]:
    for role, path in mission.layers.items():
        if role in shown:
            continue
        # Of a file of several bands QGIS would first take a histogram of three: a tenth of a second without an answer.
        layer = QgsRasterLayer(FIRST_BAND.format(path), titles()[role], "gdal")
        if not layer.isValid():  # a name that GDAL cannot take apart
            layer = QgsRasterLayer(str(path), titles()[role], "gdal")
        if layer.isValid():
            style_raster_layer(layer, role)
            yield role, layer


def _add(layer, role: str, mission: MissionFiles, project: QgsProject, group: QgsLayerTreeGroup, *, index: int = -1):
    layer.setCustomProperty(FOLDER, str(mission.folder))
    layer.setCustomProperty(ROLE, role)
    _without_place(layer, mission.georeferenced)
    project.addMapLayer(layer, False)
    node: QgsLayerTreeLayer = group.addLayer(layer) if index < 0 else group.insertLayer(index, layer)
    node.setItemVisibilityChecked(role in SHOWN)
    node.setExpanded(False)


def _renewed(name: str, mission: MissionFiles, found: MapFile) -> str:
    """Return a layer's name with the new date and accuracy, whichever of the plugin's ways it was named in."""
    if re.search(r" \[[^\[\]]*\]$", name):
        return re.sub(r" \[[^\[\]]*\]$", lambda _: f" [{mission.name}: {found.statement}]", name)
    return f"{name.partition(': ')[0]}: {found.statement}" if ": " in name else name


def _without_place(layer: QgsMapLayer, georeferenced: bool) -> None:
    """Take the engineering CRS off a layer that has no place on Earth: QGIS would try to bring it to another one."""
    if not georeferenced:
        layer.setCrs(QgsCoordinateReferenceSystem())


def _path(layer: QgsMapLayer) -> str:
    return re.sub(r"^vrt://(.*)\?bands=1$", r"\1", layer.source().split("|", 1)[0])


def _groups(root: QgsLayerTreeGroup) -> Iterator[QgsLayerTreeGroup]:
    for child in root.children():
        if isinstance(child, QgsLayerTreeGroup):
            yield child
            yield from _groups(child)
