"""``photomap reference``: a map that was made already is laid on existing imagery."""

from __future__ import annotations

from pathlib import Path

import click

from photomap_gis.cli.map_command import tell
from photomap_gis.cli.progress import ProgressBars


@click.command(name="reference", short_help="Lay a mission's map on existing imagery.")
@click.argument("mission", type=click.Path(path_type=Path))
@click.argument("references", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="ORTHO.tif...")
@click.option("--reference-sigma", "sigma", type=float, metavar="M",
              help="How far the imagery may be off, one sigma; default: one of its pixels.")  # fmt: skip
@click.option("--workers", type=click.IntRange(1), help="Threads; default: one a processor.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(
    mission: Path, references: tuple[Path, ...], *, sigma: float | None, workers: int | None, as_json: bool, quiet: bool
) -> None:
    """Find the frames of MISSION in existing imagery and lay its map there; frames are not registered again.

    \b
    photomap reference flight-1 orthophoto-2019.tif
    photomap reference flight-1 east.tif west.tif --reference-sigma 0.5

    Old imagery, another season or another sensor will do: it is compared by its edges. The imagery may have any CRS.
    map.tif and map.kmz are written anew. Where nothing fits, a warning says so and the map stays where it was.
    """
    from photomap_gis.pipeline import reference_mission

    with ProgressBars(quiet=quiet) as bars:
        summary = reference_mission(mission, references, sigma_m=sigma, workers=workers, on_progress=bars)
    tell(summary, as_json=as_json)
