"""``photomap download``: what an autopilot holds, as a file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from photomap_gis.cli.link_options import GentleStop, link_options
from photomap_gis.cli.progress import ProgressBars
from photomap_gis.core.errors import UsageError

if TYPE_CHECKING:
    from photomap_gis.mission_planner.mavlink.session import Connection


@click.command(name="download", short_help="Download an autopilot's mission, fence and rally points.")
@link_options
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, metavar="FILE",
              help=".plan, .waypoints (the mission alone), or .json: every item as it came.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(connection: Connection, system: int | None, output: Path, as_json: bool, quiet: bool) -> None:
    """Read the mission, the fence and the rally points of a vehicle. Nothing on it is changed.

    \b
    photomap download --connect udpin:0.0.0.0:14550 -o on-board.plan
    photomap download --connect tcp:127.0.0.1:5760 -o on-board.json    # for photomap upload --restore
    """
    from photomap_gis.mission_planner.files import MISSION_SUFFIXES, write_mission
    from photomap_gis.mission_planner.mavlink.ask import Wanted
    from photomap_gis.mission_planner.mavlink.procedure import UploadOptions, download_lists
    from photomap_gis.mission_planner.mavlink.saved import write_lists
    from photomap_gis.mission_planner.mavlink.session import run
    from photomap_gis.mission_planner.mavlink.wire import Kind

    suffix = output.suffix.lower()
    if suffix not in (*MISSION_SUFFIXES, ".json"):
        raise UsageError(f"{output}: a mission is written as {', '.join(MISSION_SUFFIXES)} or .json")
    kinds = tuple(Kind) if suffix in (".plan", ".json") else (Kind.MISSION,)
    stop = GentleStop("stopping")
    with ProgressBars(quiet=quiet) as bars, stop.handled():
        got = run(
            connection,
            lambda talk: download_lists(talk, kinds, UploadOptions(wanted=Wanted(system))),
            on_progress=bars,
            on_open=stop.opened,
        )
    if suffix == ".json":
        write_lists(output, got.vehicle, got.lists)
    else:
        write_mission(output, got.mission)
    counts = {
        "items": len(got.mission.items),
        "fence": len(got.lists.get(Kind.FENCE, ())),
        "rally": len(got.lists.get(Kind.RALLY, ())),
    }
    if as_json:
        document = {
            "output": str(output),
            **counts,
            "warnings": list(got.warnings),
            "vehicle": got.vehicle.as_json(),
            "outputs": [str(output)],
        }
        click.echo(json.dumps(document, allow_nan=False))
        return
    for warning in got.warnings:
        click.echo(f"warning: {warning}", err=True)
    click.echo(
        f"{output}: {counts['items']} mission items, {counts['fence']} fence items, {counts['rally']} rally points"
    )
