"""Areas from layers: features of any CRS become GeoJSON in WGS 84, with words on what cannot be used or is unsound."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsCsException,
    QgsFeature,
    QgsGeometry,
    QgsProject,
    QgsVectorLayer,
    QgsWkbTypes,
)

from ..translation import tr

WGS84 = "EPSG:4326"
MOST_FEATURES = 10_000
"""As many as the engine reads of a file."""
MOST_VERTICES = 100_000


class UnusableLayerError(Exception):
    """A layer that cannot be an area, in words that say what to do."""


@dataclass(frozen=True)
class Taken:
    """Geometries in WGS 84 and what is to be said of them."""

    geometries: tuple[QgsGeometry, ...]
    warnings: tuple[str, ...] = field(default=())

    def geojson(self) -> str:
        """Return a FeatureCollection (RFC 7946)."""
        return json.dumps(
            {
                "type": "FeatureCollection",
                "features": [
                    {"type": "Feature", "properties": {}, "geometry": json.loads(g.asJson(9))} for g in self.geometries
                ],
            }
        )


def selected(layer: QgsVectorLayer | None, *, lines: bool = False) -> Taken:
    """Return the selected features of a layer, or its only one where none is selected."""
    layer = _usable(layer, lines=lines)
    if layer.selectedFeatureCount():
        return _taken(layer, layer.getSelectedFeatures(), lines=lines)
    if layer.featureCount() == 1:
        return _taken(layer, layer.getFeatures(), lines=lines)
    raise UnusableLayerError(
        tr("Nothing is selected in “{}”: select the feature to fly over, and press this again.").format(layer.name())
    )


def every(layer: QgsVectorLayer | None) -> Taken:
    """Return all polygons of a layer."""
    layer = _usable(layer)
    return _taken(layer, layer.getFeatures(), may_be_empty=True)


def _usable(layer, *, lines: bool = False) -> QgsVectorLayer:
    if not isinstance(layer, QgsVectorLayer) or not layer.isValid():
        raise UnusableLayerError(tr("Choose a vector layer in the layer panel first: its selected feature is taken."))
    wanted = QgsWkbTypes.GeometryType.LineGeometry if lines else QgsWkbTypes.GeometryType.PolygonGeometry
    if layer.geometryType() != wanted:
        words = (
            tr("“{}” holds no lines: choose a line layer, or draw the line.")
            if lines
            else tr("“{}” holds no polygons: choose a polygon layer, or draw the area.")
        )
        raise UnusableLayerError(words.format(layer.name()))
    if not layer.crs().isValid():
        raise UnusableLayerError(
            tr("“{}” has no CRS, so its place is not known: set it in the layer's properties.").format(layer.name())
        )
    return layer


def _taken(
    layer: QgsVectorLayer, features: Iterable[QgsFeature], *, lines: bool = False, may_be_empty: bool = False
) -> Taken:
    to_wgs84 = QgsCoordinateTransform(layer.crs(), QgsCoordinateReferenceSystem(WGS84), QgsProject.instance())
    geometries: list[QgsGeometry] = []
    warnings: list[str] = []
    vertices = 0
    for count, feature in enumerate(features):
        if count >= MOST_FEATURES:
            raise UnusableLayerError(
                tr("“{}” has more than {} features: select those that matter.").format(layer.name(), MOST_FEATURES)
            )
        geometry = QgsGeometry(feature.geometry())
        if geometry.isNull() or geometry.isEmpty():
            warnings.append(tr("Feature {} has no geometry and is left out.").format(feature.id()))
            continue
        if not lines and not geometry.isGeosValid():
            warnings.append(_what_is_wrong(feature.id(), geometry))
        if QgsWkbTypes.isCurvedType(geometry.wkbType()):
            geometry.convertToStraightSegment()
        try:
            geometry.transform(to_wgs84)
        except QgsCsException:
            raise UnusableLayerError(
                tr("Feature {} of “{}” has no place on Earth: is the layer's CRS ({}) right?").format(
                    feature.id(), layer.name(), layer.crs().authid()
                )
            ) from None
        vertices += geometry.constGet().nCoordinates()
        if vertices > MOST_VERTICES:
            raise UnusableLayerError(
                tr("“{}” has more than {} corners: simplify it first.").format(layer.name(), MOST_VERTICES)
            )
        geometries.append(geometry)
    if not geometries and not may_be_empty:
        raise UnusableLayerError(" ".join([*warnings, tr("Nothing is left of “{}” to fly over.").format(layer.name())]))
    return Taken(tuple(geometries), tuple(warnings))


def _what_is_wrong(number: int, geometry: QgsGeometry) -> str:
    errors = geometry.validateGeometry()
    what = errors[0].what() if errors else tr("it is not sound")
    return tr("Feature {} is not valid ({}): the planner repairs it where that is safe; look at the result.").format(
        number, what
    )
