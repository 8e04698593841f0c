"""``photomap clear``: a vehicle's lists emptied, and read back as empty."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from photomap_gis.cli.link_options import GentleStop, link_options, saved_path, tell_report
from photomap_gis.cli.progress import ProgressBars

if TYPE_CHECKING:
    from photomap_gis.mission_planner.mavlink.session import Connection


@click.command(name="clear", short_help="Clear an autopilot's mission, fence and rally points.")
@link_options
@click.option("--mission", "wants_mission", is_flag=True, help="Clear the mission.")
@click.option("--fence", "wants_fence", is_flag=True, help="Clear the fence.")
@click.option("--rally", "wants_rally", is_flag=True, help="Clear the rally points.")
@click.option("--save-previous", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE",
              help="Where to keep what the vehicle holds; default: here, with the time.")  # fmt: skip
@click.option("--wait-mode", is_flag=True, help="Wait while the vehicle flies its mission, until the pilot switches.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(
    connection: Connection,
    system: int | None,
    wants_mission: bool,
    wants_fence: bool,
    wants_rally: bool,
    save_previous: Path | None,
    wait_mode: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Clear the mission, the fence and the rally points, or those that are named.

    \b
    photomap clear --connect udpin:0.0.0.0:14550
    photomap clear --mission --connect tcp:127.0.0.1:5760

    What the vehicle holds is saved first; photomap upload --restore puts it back.
    """
    from photomap_gis.mission_planner.mavlink.ask import Wanted
    from photomap_gis.mission_planner.mavlink.procedure import UploadOptions, clear_lists
    from photomap_gis.mission_planner.mavlink.report import Holds, Outcome, Report
    from photomap_gis.mission_planner.mavlink.saved import write_lists
    from photomap_gis.mission_planner.mavlink.session import run
    from photomap_gis.mission_planner.mavlink.state import VehicleState
    from photomap_gis.mission_planner.mavlink.wire import Kind, Lists

    named = {Kind.MISSION: wants_mission, Kind.FENCE: wants_fence, Kind.RALLY: wants_rally}
    kinds = tuple(k for k, wanted in named.items() if wanted) or tuple(Kind)
    options = UploadOptions(wanted=Wanted(system), waits_for_mode=wait_mode)

    def save(vehicle: VehicleState, lists: Lists) -> str:
        path = saved_path(None, save_previous, vehicle.system)
        write_lists(path, vehicle, lists)
        return str(path)

    stop = GentleStop("stopping (Ctrl-C again leaves the vehicle as it is)")
    with ProgressBars(quiet=quiet) as bars, stop.handled():
        try:
            report = run(
                connection,
                lambda talk: clear_lists(talk, kinds, options, save=save, say=lambda w: click.echo(w, err=True)),
                on_progress=bars,
                on_open=stop.opened,
            )
        except KeyboardInterrupt:
            report = Report(Outcome.UNKNOWN, Holds.UNKNOWN, "left at the user's word: some lists may be cleared")
    return tell_report(report, connection, as_json=as_json, stopped=stop.asked)
