"""The formats of ``photomap export``: one table for the dialog and for Processing."""

from __future__ import annotations

from dataclasses import dataclass

from .translation import tr


@dataclass(frozen=True)
class Format:
    """A format by the flag of ``photomap export``; ``needs_place`` where a map without a place cannot be written."""

    flag: str
    words: str
    needs_place: bool = False


def formats() -> tuple[Format, ...]:
    """Return all formats in the order in which people look for them, in the user's language."""
    return (
        Format("geotiff", tr("GeoTIFF, cloud-optimised: QGIS, ArcGIS, ATAK")),
        Format("kml", tr("KMZ: Google Earth, ATAK"), True),
        Format("mbtiles", tr("MBTiles: QGIS, ATAK, phones"), True),
        Format("gpkg", tr("GeoPackage with overviews: QGIS, ArcGIS, ATAK")),
        Format("atak", tr("ATAK data package: map, outline and finds"), True),
        Format("geopdf", tr("GeoPDF: paper, Avenza Maps"), True),
        Format("vectors", tr("Vectors: track, cameras, footprints, outline, finds")),
        Format("layers", tr("Layers: accuracy, age, searched, views")),
        Format("poses", tr("Poses: a row a frame (CSV)")),
        Format("tiles", tr("XYZ tiles with a page that works offline"), True),
        Format("tms", tr("TMS tiles"), True),
        Format("pmtiles", tr("PMTiles: any web server"), True),
        Format("worldfile", tr("PNG with world file")),
        Format("stac", tr("STAC item: catalogues"), True),
    )


COMPRESSIONS = ("deflate", "zstd", "lzw", "jpeg", "webp", "none")
TILE_FORMATS = ("auto", "png", "webp", "jpg", "mixed")
