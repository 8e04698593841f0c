"""``photomap convert``: a mission from one ground station's file into another's."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import click

from photomap_gis.core.mission import Autopilot, Mission


@click.command(name="convert", short_help="Convert a mission: .plan to .waypoints and back.")
@click.argument("source", type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), metavar="OUT", required=True, help=".plan or .waypoints."
)
@click.option(
    "--autopilot", type=click.Choice([a.value for a in Autopilot]), help="For a .plan; default: as SOURCE says."
)
@click.option("--json", "as_json", is_flag=True, help="Print what was written and lost as JSON on stdout.")
def command(source: Path, output: Path, autopilot: str | None, as_json: bool) -> None:
    """Read a mission (QGroundControl's .plan, Mission Planner's .waypoints) and write it in the other format.

    \b
    photomap convert search.plan -o search.waypoints
    photomap convert old.waypoints --autopilot ardupilot -o old.plan
    """
    from photomap_gis.mission_planner.files import read_mission, write_mission

    mission = read_mission(source)
    if autopilot is not None:
        mission = replace(mission, autopilot=Autopilot(autopilot))
    write_mission(output, mission)
    lost = _lost(mission) if output.suffix.lower() != ".plan" else []
    if as_json:
        document = {"file": str(output), "items": len(mission.items), "warnings": lost, "outputs": [str(output)]}
        click.echo(json.dumps(document, indent=1))
        return
    click.echo(output)
    for words in lost:
        click.echo(f"warning: {words}", err=True)


def _lost(mission: Mission) -> list[str]:
    found = []
    if mission.fence_polygons or mission.fence_circles:
        found.append("a .waypoints file holds no fence: upload the .plan, or set the fence in the ground station")
    if mission.rally:
        found.append("a .waypoints file holds no rally points")
    return found
