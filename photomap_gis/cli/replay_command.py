"""``photomap replay``: a recorded live session flown again and compared."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import click

from photomap_gis.cli.progress import ProgressBars

EXIT_DIFFERENT = 1


@click.command(name="replay", short_help="Fly a recorded live session again and compare.")
@click.argument("mission", type=click.Path(path_type=Path))
@click.option("-o", "--output", "out", type=click.Path(path_type=Path), metavar="FOLDER",
              help="Keep the replayed map in this new folder.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(mission: Path, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Fly the live session in MISSION again from its recording and journal, and say whether the same came out.

    \b
    photomap replay flight-1
    photomap replay flight-1 -o flight-1-again       # look at the map as it was in the air

    The same frames are taken and dropped, solutions are adopted at the same frames, the same tiles drawn anew. Poses
    must agree to 1e-9 and pixels be equal; exit code 1 says that they do not.
    """
    from photomap_gis.live.replay import replay

    with ProgressBars(quiet=quiet) as bars:
        if out is None:
            with tempfile.TemporaryDirectory(prefix="photomap-replay-") as scratch:
                result = replay(mission, Path(scratch) / "mission", on_progress=bars)
        else:
            result = replay(mission, out, on_progress=bars)
    if as_json:
        click.echo(json.dumps(result.as_document()))
    else:
        pixels = {True: "equal", False: "DIFFERENT", None: "not known: the flight was cut off before it landed"}
        click.echo(f"frames     {result.frames}, {result.poses} with a pose, {result.keyframes} key frames")
        click.echo(f"solutions  {result.solutions} adopted at the same frames")
        same = "the same" if result.first_difference is None else f"DIFFERENT from frame {result.first_difference} on"
        click.echo(f"poses      {same}; largest difference {result.largest_difference:.3g}")
        click.echo(f"pixels     {pixels[result.pixels_equal]}")
    if not result.same:
        raise click.exceptions.Exit(EXIT_DIFFERENT)
