"""``photomap export``: a mission's map in the formats of the commander's tools."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from photomap_gis.cli.progress import ProgressBars
from photomap_gis.core.errors import UsageError

_FILE = click.Path(path_type=Path)


@click.command(name="export", short_help="Write a mission's map as GeoTIFF, KMZ, tiles, GeoPackage, ATAK, PDF ...")
@click.argument("mission", type=_FILE, default=Path(), required=False)
@click.option("--geotiff", is_flag=True, help="Cloud-optimised GeoTIFF (map.tif).")
@click.option("--kml", "--kmz", is_flag=True, help="KMZ for Google Earth (map.kmz); KML where -o ends in .kml.")
@click.option("--tiles", "--xyz", is_flag=True, help="XYZ tiles with TileJSON (tiles/).")
@click.option("--mbtiles", is_flag=True, help="MBTiles (map.mbtiles).")
@click.option("--pmtiles", is_flag=True, help="PMTiles, for any web server (map.pmtiles).")
@click.option("--gpkg", "--geopackage", is_flag=True, help="GeoPackage with overviews (map.gpkg).")
@click.option(
    "--vectors",
    is_flag=True,
    help="Track, cameras, footprints, registrations, outline, finds (vectors.gpkg); GeoJSON or KML by -o.",
)
@click.option("--atak", is_flag=True, help="ATAK data package: map, outline and finds (map-atak.zip).")
@click.option("--geopdf", "--pdf", is_flag=True, help="GeoPDF page, for Avenza Maps and paper (map.pdf).")
@click.option("--tms", is_flag=True, help="TMS tiles, rows from the south (tms/).")
@click.option(
    "--worldfile",
    "--world-file",
    is_flag=True,
    help="PNG with world file and .prj (map.png); JPEG where -o ends in .jpg.",
)
@click.option("--stac", is_flag=True, help="STAC item of the files written beside it, or of map.tif (map.json).")
@click.option("--poses", is_flag=True, help="One row a frame (poses.csv); GeoJSON where -o ends in .geojson.")
@click.option("--layers", is_flag=True, help="When, by how many and how well each spot was seen (layers/).")
@click.option(
    "-o",
    "--output",
    type=_FILE,
    metavar="OUT",
    help="The file for one format, the folder for several; default: in MISSION.",
)
@click.option(
    "--bbox",
    metavar="W,S,E,N",
    help="Only this box: degrees where the numbers can be, else the map's CRS; --bbox-crs decides.",
)
@click.option("--bbox-crs", metavar="CRS", help="What --bbox is in, e.g. EPSG:25832.")
@click.option(
    "--cutline",
    type=_FILE,
    metavar="FILE",
    help="Only inside the polygons of FILE: GeoJSON, GPKG, KML or SHP, any CRS.",
)
@click.option("--crs", help="CRS of GeoTIFF, GeoPackage, PDF, world file and vectors; default: the mission's.")
@click.option(
    "--gsd",
    type=float,
    help="Finest pixel, in units of the CRS (metres on the ground for tiles, KMZ and CRS in degrees).",
)
@click.option(
    "--compress",
    type=click.Choice(["deflate", "zstd", "lzw", "jpeg", "webp", "none"], case_sensitive=False),
    default="deflate",
    show_default=True,
    help="Of the GeoTIFF; jpeg (with mask) and webp lose detail.",
)
@click.option("--quality", type=click.IntRange(1, 100), metavar="1-100", help="Of JPEG and WEBP pictures.")
@click.option(
    "--tile-format",
    type=click.Choice(["auto", "png", "webp", "jpg", "jpeg", "mixed"], case_sensitive=False),
    default="auto",
    show_default=True,
    help="Of tiles. mixed: JPEG, PNG where a tile is partly empty (auto of --gpkg; else auto is png).",
)
@click.option("--min-zoom", type=int, metavar="Z", help="Widest zoom of tiles.")
@click.option("--max-zoom", type=int, metavar="Z", help="Finest zoom of tiles.")
@click.option("--attribution", default="", metavar="TEXT", help="Whom to credit, written into every format.")
@click.option(
    "--finds",
    type=_FILE,
    metavar="FILE",
    help="Points for --atak and --vectors (name, ce90_m, time, remarks); default: MISSION/finds.geojson.",
)
@click.option(
    "--over",
    type=_FILE,
    metavar="OLD.tif",
    help="With --geotiff: OLD's grid, CRS and bands, the new map in place of its stale pixels.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the written files as JSON on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")  # fmt: skip
def command(
    mission: Path,
    output: Path | None,
    over: Path | None,
    crs: str | None,
    gsd: float | None,
    as_json: bool,
    quiet: bool,
    **asked: Any,
) -> None:
    """Write MISSION's map (default: the current folder) in the formats asked for.

    \b
    photomap export flight-1 --geotiff --compress jpeg -o incident.tif
    photomap export flight-1 --kml --mbtiles --vectors -o FOR_THE_FIELD/
    photomap export flight-1 --gpkg --cutline sector-4.geojson --crs EPSG:3857
    photomap export flight-1 --atak --finds finds.geojson --attribution "Fire Dept"
    photomap export flight-1 --geotiff --over orthophoto-2019.tif -o orthophoto-new.tif
    """
    from photomap_gis.pipeline import ExportOptions, Format, export_files

    formats = [f for f in Format if asked.pop(f.value)]
    if not formats:
        raise UsageError(
            "say which format: " + ", ".join(f"--{f.value}" for f in Format) + "; several may be asked at once"
        )
    options = ExportOptions(**asked)
    with ProgressBars(quiet=quiet) as bars:
        written = export_files(
            mission, formats, out=output, over=over, crs=crs, gsd=gsd, options=options, on_progress=bars
        )
    if as_json:
        files = [
            {
                "format": str(w.format),
                "path": str(w.path),
                "bytes": w.bytes,
                "gsd_m_per_px": w.gsd_m_per_px,
                "note": w.note or None,
            }
            for w in written
        ]
        document = {"mission": str(mission), "outputs": [str(w.path) for w in written], "files": files}
        click.echo(json.dumps(document, indent=1))
        return
    for w in written:
        click.echo(w.path)
        if w.note:
            click.echo(f"{w.path.name}: {w.note}", err=True)
