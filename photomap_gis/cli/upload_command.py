"""``photomap upload``: a plan onto an autopilot, read back and verified."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from photomap_gis.cli.link_options import GentleStop, link_options, saved_path, tell_report
from photomap_gis.cli.progress import ProgressBars
from photomap_gis.core.errors import UsageError

if TYPE_CHECKING:
    from photomap_gis.mission_planner.mavlink.procedure import UploadOptions
    from photomap_gis.mission_planner.mavlink.report import Report
    from photomap_gis.mission_planner.mavlink.session import Connection


class StartAt(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """An item's number, or ``nearest``."""

    name = "N|nearest"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> int | str:
        """Return the number, or the word."""
        text = str(value).strip().lower()
        if text == "nearest":
            return text
        if text.isdigit() and int(text) >= 1:
            return int(text)
        self.fail(f"{value!r} is neither an item's number (1 is the first) nor 'nearest'", param, ctx)


@click.command(name="upload", short_help="Upload a plan to an autopilot, verify it, restore on failure.")
@click.argument("plan", type=click.Path(path_type=Path), required=False)
@link_options
@click.option("--restore", type=click.Path(path_type=Path), metavar="FILE",
              help="Put back what an earlier run saved (or a .plan), instead of PLAN.")  # fmt: skip
@click.option("--save-previous", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE",
              help="Where to keep what the vehicle holds; default: beside PLAN, with the time.")  # fmt: skip
@click.option("--wait-mode", is_flag=True, help="Wait while the vehicle flies its mission, until the pilot switches.")
@click.option("--start-at", type=StartAt(),
              help="The item to go on with; default: in the air the first survey item.")  # fmt: skip
@click.option("--replace-active", is_flag=True, help="PX4 only: replace the mission while it is flown.")
@click.option("--max-height", type=click.FloatRange(1.0), default=120.0, show_default=True, metavar="M",
              help="Refuse items higher above home.")  # fmt: skip
@click.option("--max-distance", type=click.FloatRange(1.0), default=5000.0, show_default=True, metavar="M",
              help="Refuse items farther from home.")  # fmt: skip
@click.option("--hand-launch", is_flag=True, help="The pilot takes off by hand: no take-off item is needed.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(
    plan: Path | None,
    connection: Connection,
    system: int | None,
    restore: Path | None,
    save_previous: Path | None,
    wait_mode: bool,
    start_at: int | str | None,
    replace_active: bool,
    max_height: float,
    max_distance: float,
    hand_launch: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Upload PLAN (.plan or .waypoints): mission, fence and rally points, each as far as PLAN has it.

    \b
    photomap upload area.plan --connect udpin:0.0.0.0:14550
    photomap upload area.plan --connect serial:/dev/ttyUSB0:57600 --tlog upload.tlog
    photomap upload second.plan --connect tcp:127.0.0.1:5760 --wait-mode --start-at nearest
    photomap upload --restore area-before-sys1-20260501T101500Z.json --connect udpin:0.0.0.0:14550

    What the vehicle holds is saved first. What was sent is read back and compared; where it is not the same, the saved
    lists are put back. The last line is one of: verified, restored, refused, unknown. Nothing is armed, no mode
    is changed, no mission is started.
    """
    from photomap_gis.mission_planner.mavlink.ask import Wanted
    from photomap_gis.mission_planner.mavlink.procedure import UploadOptions
    from photomap_gis.mission_planner.mavlink.rules import Limits

    if (plan is None) == (restore is None):
        raise UsageError("give either PLAN or --restore FILE: photomap upload area.plan --connect URL")
    options = UploadOptions(
        wanted=Wanted(system),
        limits=Limits(max_height, max_distance, hand_launch),
        waits_for_mode=wait_mode,
        replaces_active=replace_active,
        start_at=start_at,
    )
    return _run(plan, restore, save_previous, connection, options, as_json=as_json, quiet=quiet)


def _run(
    plan: Path | None,
    restore: Path | None,
    save_previous: Path | None,
    connection: Connection,
    options: UploadOptions,
    *,
    as_json: bool,
    quiet: bool,
) -> int:
    from photomap_gis.mission_planner.files import read_mission
    from photomap_gis.mission_planner.mavlink.procedure import restore_lists, upload_mission
    from photomap_gis.mission_planner.mavlink.saved import is_lists_file, read_lists, write_lists
    from photomap_gis.mission_planner.mavlink.session import run
    from photomap_gis.mission_planner.mavlink.state import VehicleState
    from photomap_gis.mission_planner.mavlink.talk import Steps, Talk
    from photomap_gis.mission_planner.mavlink.wire import Lists, lists_of

    saved: list[Path] = []

    def save(vehicle: VehicleState, lists: Lists) -> str:
        path = saved_path(plan or restore, save_previous, vehicle.system)
        write_lists(path, vehicle, lists)
        saved.append(path)
        return str(path)

    def say(words: str) -> None:
        click.echo(words, err=True)

    if plan is not None:
        if is_lists_file(plan):
            raise UsageError(f"{plan} was saved from a vehicle: give it as --restore {plan}")
        mission = read_mission(plan)
        if not (mission.items or mission.fence_polygons or mission.fence_circles or mission.rally):
            raise UsageError(f"{plan} holds nothing to upload; to empty a vehicle use photomap clear")

        def make_steps(talk: Talk) -> Steps[Report]:
            return upload_mission(talk, mission, options, save=save, say=say)

    elif restore is not None:
        if is_lists_file(restore):
            autopilot, lists = read_lists(restore)
        else:
            mission = read_mission(restore)
            if mission.autopilot is None:
                raise UsageError(f"{restore} does not say for which autopilot it is: give it as PLAN")
            autopilot, lists = mission.autopilot, lists_of(mission, mission.autopilot)

        def make_steps(talk: Talk) -> Steps[Report]:
            return restore_lists(talk, lists, options, autopilot=autopilot, save=save, say=say)

    stop = GentleStop("stopping: bringing the vehicle to a known state first (Ctrl-C again leaves it as it is)")
    with ProgressBars(quiet=quiet) as bars, stop.handled():
        try:
            report = run(connection, make_steps, on_progress=bars, on_open=stop.opened)
        except KeyboardInterrupt:
            report = _left(saved)
    return tell_report(report, connection, as_json=as_json, stopped=stop.asked)


def _left(saved: list[Path]) -> Report:
    from photomap_gis.mission_planner.mavlink.report import Holds, Outcome, Report

    if not saved:
        return Report(Outcome.REFUSED, Holds.PREVIOUS, "stopped before anything was sent")
    return Report(
        Outcome.UNKNOWN,
        Holds.UNKNOWN,
        "left in mid upload at the user's word: the vehicle may hold a mixture; do not fly, finish with --restore",
        saved_previous=str(saved[-1]),
    )
