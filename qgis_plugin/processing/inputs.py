"""What the user gives to an algorithm, as the engine wants it: files of layers, areas as GeoJSON, places in degrees."""

from __future__ import annotations

import json
from pathlib import Path

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsCsException,
    QgsGeometry,
    QgsPointXY,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeatureSource,
    QgsProcessingUtils,
    QgsProviderRegistry,
    QgsRasterLayer,
)

from ..translation import tr

WGS84 = "EPSG:4326"
MOST_FEATURES = 10_000
"""As many as the engine reads of a file."""


def file_of_raster(layer: QgsRasterLayer) -> str:
    """Return the file that a raster layer shows; ``QgsProcessingException`` where it shows none."""
    parts = QgsProviderRegistry.instance().decodeUri(layer.providerType(), layer.source())
    path = parts.get("path") or ""
    if layer.providerType() != "gdal" or not Path(path).exists():
        raise QgsProcessingException(
            tr("“{}” is no file: save it as a GeoTIFF first (Layer > Save As), and choose that.").format(layer.name())
        )
    return path


def area_file(source: QgsProcessingFeatureSource, what: str, context: QgsProcessingContext) -> str:
    """Write the geometries of a source as GeoJSON in WGS 84 and return the file's name.

    ``what`` names the input for the user. ``QgsProcessingException`` where it is empty or has no place on Earth.
    """
    if not source.sourceCrs().isValid():
        raise QgsProcessingException(
            tr("{}: the layer has no CRS, so its place is not known: set it in the layer's properties.").format(what)
        )
    to_wgs84 = QgsCoordinateTransform(
        source.sourceCrs(), QgsCoordinateReferenceSystem(WGS84), context.transformContext()
    )
    geometries = []
    for feature in source.getFeatures():
        geometry = QgsGeometry(feature.geometry())
        if geometry.isNull() or geometry.isEmpty():
            continue
        if len(geometries) >= MOST_FEATURES:
            raise QgsProcessingException(
                tr("{}: more than {} features: select those that matter.").format(what, MOST_FEATURES)
            )
        geometry.convertToStraightSegment()
        try:
            geometry.transform(to_wgs84)
        except QgsCsException:
            raise QgsProcessingException(
                tr("{}: feature {} has no place on Earth: is the layer's CRS right?").format(what, feature.id())
            ) from None
        geometries.append(json.loads(geometry.asJson(9)))
    if not geometries:
        raise QgsProcessingException(tr("{}: there is no feature with a geometry.").format(what))
    path = QgsProcessingUtils.generateTempFilename("area.geojson")
    features = [{"type": "Feature", "properties": {}, "geometry": g} for g in geometries]
    Path(path).write_text(json.dumps({"type": "FeatureCollection", "features": features}), encoding="utf-8")
    return path


def lat_lon(point: QgsPointXY) -> str:
    """Return a place in WGS 84 as the engine reads it."""
    return f"{point.y():.9f},{point.x():.9f}"
