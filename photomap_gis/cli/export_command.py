"""``photomap export``: a mission's map in the formats of the commander's tools."""

from __future__ import annotations

import json
from pathlib import Path

import click

from photomap_gis.cli.progress import ProgressBars
from photomap_gis.core.errors import UsageError


@click.command(name="export", short_help="Write a mission's map as GeoTIFF, KMZ, tiles, MBTiles, poses.")
@click.argument("mission", type=click.Path(path_type=Path), default=Path(), required=False)
@click.option("--geotiff", is_flag=True, help="Cloud-optimised GeoTIFF (map.tif).")
@click.option("--kml", is_flag=True, help="KMZ for Google Earth (map.kmz); KML where -o ends in .kml.")
@click.option("--tiles", is_flag=True, help="XYZ tiles with TileJSON (tiles/).")
@click.option("--mbtiles", is_flag=True, help="MBTiles (map.mbtiles).")
@click.option("--poses", is_flag=True, help="One row a frame (poses.csv); GeoJSON where -o ends in .geojson.")
@click.option("--layers", is_flag=True, help="When, by how many and how well each spot was seen (layers/).")
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="OUT",
              help="The file for one format, the folder for several; default: in MISSION.")  # fmt: skip
@click.option("--over", type=click.Path(path_type=Path), metavar="OLD.tif",
              help="With --geotiff: OLD's grid, CRS and bands, the new map in place of its stale pixels.")  # fmt: skip
@click.option("--crs", help="CRS of the GeoTIFF; default: the mission's.")
@click.option("--gsd", type=float, help="Pixel of the GeoTIFF in units of its CRS; default: the mission's.")
@click.option("--json", "as_json", is_flag=True, help="Print the written files as JSON on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(
    mission: Path,
    output: Path | None,
    over: Path | None,
    crs: str | None,
    gsd: float | None,
    as_json: bool,
    quiet: bool,
    **flags: bool,
) -> None:
    """Write MISSION's map (default: the current folder) in the formats asked for.

    \b
    photomap export flight-1 --geotiff -o incident.tif
    photomap export flight-1 --kml --mbtiles -o FOR_THE_FIELD/
    photomap export flight-1 --geotiff --over orthophoto-2019.tif -o orthophoto-new.tif
    """
    from photomap_gis.pipeline import Format, export_mission

    formats = [f for f in Format if flags.get(f.value)]
    if not formats:
        raise UsageError(
            "say which format: " + ", ".join(f"--{f.value}" for f in Format) + "; several may be asked at once"
        )
    with ProgressBars(quiet=quiet) as bars:
        written = export_mission(mission, formats, out=output, over=over, crs=crs, gsd=gsd, on_progress=bars)
    if as_json:
        click.echo(json.dumps({"mission": str(mission), "outputs": [str(p) for p in written]}, indent=1))
    else:
        for path in written:
            click.echo(path)
