"""The endings of the export formats, and which of them QGIS reads as a layer; a test holds them to the engine's."""

from __future__ import annotations

from pathlib import PurePath

ENDINGS: dict[str, tuple[str, ...]] = {
    "geotiff": (".tif", ".tiff"),
    "kml": (".kmz", ".kml"),
    "tiles": (),
    "mbtiles": (".mbtiles",),
    "pmtiles": (".pmtiles",),
    "gpkg": (".gpkg",),
    "vectors": (".gpkg", ".geojson", ".json", ".kml"),
    "atak": (".zip", ".dpk"),
    "geopdf": (".pdf",),
    "tms": (),
    "worldfile": (".png", ".jpg", ".jpeg"),
    "poses": (".csv", ".geojson", ".json"),
    "layers": (),
    "stac": (".json", ".geojson"),
}
"""The first is the usual one; a format without any is a folder."""

RASTERS = frozenset({"geotiff", "gpkg", "mbtiles", "worldfile", "geopdf"})
VECTORS = frozenset({"vectors"})


def named_for(flag: str, path: str) -> str:
    """Return ``path`` with an ending that the format takes: Processing knows one ending for all of them."""
    endings = ENDINGS[flag]
    suffix = PurePath(path).suffix.lower()
    if not endings:
        return str(PurePath(path).with_suffix("")) if suffix == ".file" else path
    if suffix in endings:
        return path
    return str(PurePath(path).with_suffix(endings[0])) if suffix in ("", ".file") else path + endings[0]
