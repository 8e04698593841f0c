"""``photomap graph``: a mission's pose graph as a picture, for a GIS, or for another solver."""

from __future__ import annotations

import json
from pathlib import Path

import click

from photomap_gis.cli.progress import ProgressBars


@click.command(name="graph", short_help="Draw a mission's pose graph, or write it as GeoJSON or g2o.")
@click.argument("mission", type=click.Path(path_type=Path), default=Path(), required=False)
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="FILE",
              help="The ending says the format: .png, .geojson, .g2o; default: graph.png in MISSION.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print the written file as JSON on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(mission: Path, output: Path | None, as_json: bool, quiet: bool) -> None:
    """Show how MISSION's frames (default: the current folder) hang together.

    \b
    photomap graph flight-1                          before and after loops, loops coloured by residual
    photomap graph flight-1 -o flight-1.geojson      frames as points, registrations as lines
    photomap graph flight-1 -o flight-1.g2o          for other solvers: the scale is taken out
    """
    from photomap_gis.pipeline import export_graph

    with ProgressBars(quiet=quiet) as bars:
        written = export_graph(mission, output, on_progress=bars)
    if as_json:
        click.echo(json.dumps({"mission": str(mission), "outputs": [str(written)]}, indent=1))
    else:
        click.echo(written)
