"""``photomap solve``: a mission solved again from its journals."""

from __future__ import annotations

from pathlib import Path

import click

from photomap_gis.cli.control_options import control_options, control_request
from photomap_gis.cli.drawing_options import drawing_options
from photomap_gis.cli.map_command import tell
from photomap_gis.cli.progress import ProgressBars


@click.command(name="solve", short_help="Solve a mission again, with ground control or without.")
@click.argument("mission", type=click.Path(path_type=Path))
@control_options
@drawing_options
@click.option("--dem", type=click.Path(path_type=Path), metavar="FILE",
              help="Heights of the ground (GeoTIFF), kept in the mission.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(
    mission: Path,
    *,
    gcp: Path | None,
    gcp_crs: str | None,
    check: str | None,
    dem: Path | None,
    prefer: str | None,
    layers: bool | None,
    workers: int | None,
    memory_mb: int | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Solve MISSION again without registering anything anew; draw and export its map.

    \b
    photomap solve flight-1 --gcp gcp_list.txt --check every-third
    photomap solve flight-1 --gcp points.csv --gcp-crs EPSG:25832 --check P3,P7
    photomap solve flight-1 --check P3               # the points that are kept in the mission
    photomap solve flight-1 --prefer newest --layers # the same map, drawn another way
    photomap solve flight-1 --dem dtm.tif            # heights of the ground

    The control points are kept in the mission, and how the map is drawn: later runs and solves use them.
    """
    from photomap_gis.mosaic import Prefer
    from photomap_gis.pipeline import Drawing, solve_again

    drawing = Drawing(None if prefer is None else Prefer(prefer), layers, workers, memory_mb)
    with ProgressBars(quiet=quiet) as bars:
        summary = solve_again(mission, control_request(gcp, gcp_crs, check), dem=dem, drawing=drawing, on_progress=bars)
    tell(summary, as_json=as_json)
