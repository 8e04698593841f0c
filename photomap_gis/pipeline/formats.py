"""The formats of an export: their flags, names and suffixes, what each of them can be asked, and who may have them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from photomap_gis.core.errors import UsageError
from photomap_gis.export.crs import WEB_MERCATOR, parse_crs, same_crs


class Format(StrEnum):
    """The formats of ``photomap export``; each is a flag of that name."""

    GEOTIFF = "geotiff"
    KML = "kml"
    TILES = "tiles"
    MBTILES = "mbtiles"
    PMTILES = "pmtiles"
    GPKG = "gpkg"
    VECTORS = "vectors"
    ATAK = "atak"
    GEOPDF = "geopdf"
    TMS = "tms"
    WORLDFILE = "worldfile"
    POSES = "poses"
    LAYERS = "layers"
    STAC = "stac"


DEFAULT_NAMES = {
    Format.GEOTIFF: "map.tif",
    Format.KML: "map.kmz",
    Format.TILES: "tiles",
    Format.MBTILES: "map.mbtiles",
    Format.PMTILES: "map.pmtiles",
    Format.GPKG: "map.gpkg",
    Format.VECTORS: "vectors.gpkg",
    Format.ATAK: "map-atak.zip",
    Format.GEOPDF: "map.pdf",
    Format.TMS: "tms",
    Format.WORLDFILE: "map.png",
    Format.POSES: "poses.csv",
    Format.LAYERS: "layers",
    Format.STAC: "map.json",
}

SUFFIXES = {
    Format.GEOTIFF: (".tif", ".tiff"),
    Format.KML: (".kmz", ".kml"),
    Format.TILES: ("",),
    Format.MBTILES: (".mbtiles",),
    Format.PMTILES: (".pmtiles",),
    Format.GPKG: (".gpkg",),
    Format.VECTORS: (".gpkg", ".geojson", ".json", ".kml"),
    Format.ATAK: (".zip", ".dpk"),
    Format.GEOPDF: (".pdf",),
    Format.TMS: ("",),
    Format.WORLDFILE: (".png", ".jpg", ".jpeg"),
    Format.POSES: (".csv", ".geojson", ".json"),
    Format.LAYERS: ("",),
    Format.STAC: (".json", ".geojson"),
}

FOLDERS = {Format.TILES, Format.TMS, Format.LAYERS}
"""Formats that are folders of files."""

NEEDS_PLACE = {
    Format.KML, Format.TILES, Format.MBTILES, Format.PMTILES, Format.TMS, Format.ATAK, Format.GEOPDF, Format.STAC,
}  # fmt: skip
_ANY_CRS = {Format.GEOTIFF, Format.GPKG, Format.VECTORS, Format.GEOPDF, Format.WORLDFILE, Format.LAYERS}
_MERCATOR = {Format.TILES, Format.TMS, Format.MBTILES, Format.PMTILES, Format.ATAK}


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """What may be asked of an export besides its formats; ``None`` and empty are the format's own defaults.

    ``bbox`` is ``west,south,east,north`` in ``bbox_crs``; ``quality`` (1-100) is of lossy pictures. ``attribution`` is
    written into every format, ``finds`` (a vector file of points) into those that hold them.
    """

    compress: str = "deflate"
    quality: int | None = None
    bbox: str | None = None
    bbox_crs: str | None = None
    cutline: Path | None = None
    tile_format: str = "auto"
    min_zoom: int | None = None
    max_zoom: int | None = None
    attribution: str = ""
    finds: Path | None = None


def check_request(
    formats: Sequence[Format], over: Path | None, crs: str | None, gsd: float | None, options: ExportOptions
) -> None:
    """Raise ``UsageError`` where options contradict each other or no format asked for can follow them."""
    clips = options.bbox is not None or options.cutline is not None
    if over is not None:
        if list(formats) != [Format.GEOTIFF]:
            raise UsageError("--over goes with --geotiff alone: it writes a raster on OLD's grid")
        if crs is not None or gsd is not None:
            raise UsageError("--over takes CRS and pixel from OLD: leave --crs and --gsd away")
        if clips or options.compress.lower() != "deflate":
            raise UsageError("--over keeps all of OLD without loss: leave --bbox, --cutline and --compress away")
    if options.bbox is not None and options.cutline is not None:
        raise UsageError("clip by --bbox or by --cutline, not by both")
    if options.bbox_crs is not None and options.bbox is None:
        raise UsageError("--bbox-crs says what --bbox is in: give --bbox too")
    if clips and Format.LAYERS in formats:
        raise UsageError("--layers is always of the whole map: export it without --bbox and --cutline")
    if gsd is not None and not (math.isfinite(gsd) and gsd > 0):
        raise UsageError(f"--gsd must be a positive number, got {gsd:g}")
    if crs is not None:
        asked = parse_crs(crs)
        mercator = same_crs(asked.to_wkt(), parse_crs(WEB_MERCATOR).to_wkt())
        if not (_ANY_CRS & set(formats) or (mercator and _MERCATOR & set(formats)) or Format.STAC in formats):
            named = ", ".join(f"--{f}" for f in formats)
            raise UsageError(
                f"{named} has the coordinate reference system of its standard: leave --crs away, "
                "or ask for --geotiff or --gpkg"
            )


def targets(folder: Path, formats: Sequence[Format], out: Path | None, over: Path | None) -> list[tuple[Format, Path]]:
    """Return where each format goes, catalogues last: they describe the files before them.

    ``out`` is the file of one format and the folder of several.
    """
    formats = sorted(formats, key=lambda f: f is Format.STAC)
    names = dict(DEFAULT_NAMES)
    if over is not None:
        names[Format.GEOTIFF] = f"{over.stem}-updated.tif"  # map.tif stays the map
    if out is None:
        return [(f, folder / names[f]) for f in formats]
    if len(formats) > 1 or (out.is_dir() and formats[0] not in FOLDERS):
        if len(formats) > 1 and out.is_file():
            raise UsageError(f"{out} is a file: with several formats -o names the folder for them")
        return [(f, out / names[f]) for f in formats]
    if formats[0] not in FOLDERS and out.suffix.lower() not in SUFFIXES[formats[0]]:
        raise UsageError(f"-o {out} must end in {' or '.join(SUFFIXES[formats[0]])} for --{formats[0]}")
    return [(formats[0], out)]
