"""``photomap vehicle``: who is on the link and how it is."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

from photomap_gis.cli.link_options import GentleStop, link_options

if TYPE_CHECKING:
    from photomap_gis.mission_planner.mavlink.session import Connection
    from photomap_gis.mission_planner.mavlink.state import VehicleState


@click.command(name="vehicle", short_help="Say who is on a link: mode, position, battery, mission progress.")
@link_options
@click.option("--watch", "watches", is_flag=True, help="Go on: a JSON line every --every seconds.")
@click.option("--every", type=click.FloatRange(0.1, 3600.0), default=1.0, show_default=True, metavar="SECONDS",
              help="How often, with --watch.")  # fmt: skip
@click.option("--times", type=click.IntRange(1), metavar="N", help="Stop after N lines, with --watch.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
def command(
    connection: Connection, system: int | None, watches: bool, every: float, times: int | None, as_json: bool
) -> None:
    """Say who is there: autopilot, type, version, mode, armed, position, battery, mission progress.

    \b
    photomap vehicle --connect udpin:0.0.0.0:14550
    photomap vehicle --connect tcp:127.0.0.1:5760 --watch > flight.jsonl
    """
    from photomap_gis.mission_planner.mavlink.ask import Wanted
    from photomap_gis.mission_planner.mavlink.session import run
    from photomap_gis.mission_planner.mavlink.watch import look, watch

    stop = GentleStop("stopping")

    def tell(state: VehicleState) -> None:
        click.echo(json.dumps(state.as_json(), allow_nan=False))

    with stop.handled():
        if watches:
            run(
                connection,
                lambda talk: watch(talk, Wanted(system), every_s=every, times=times, tell=tell),
                on_open=stop.opened,
            )
            return
        state = run(connection, lambda talk: look(talk, Wanted(system)), on_open=stop.opened)
    if as_json:
        tell(state)
    else:
        for line in _words(state):
            click.echo(line)


def _words(s: VehicleState) -> list[str]:
    def known(value: object, unit: str = "", digits: int | None = None) -> str:
        if value is None:
            return "?"
        return f"{value:.{digits}f}{unit}" if digits is not None else f"{value}{unit}"

    total = s.as_json()["mission"]
    return [
        f"vehicle {s.system}: {s.autopilot or 'unknown autopilot'} {known(s.version)}, {s.type}",
        f"mode: {s.mode}, {'armed' if s.armed else 'disarmed'}, {s.status}",
        f"position: {known(s.lat_deg, '', 7)}, {known(s.lon_deg, '', 7)}, {known(s.height_m, ' m above home', 1)}, "
        f"{known(s.alt_amsl_m, ' m above sea level', 1)}",
        f"GPS: fix {known(s.fix)}, {known(s.satellites)} satellites",
        f"battery: {known(s.battery_v, ' V', 1)}, {known(s.battery_percent, ' %')}",
        f"mission: item {known(total['current'])} of {known(total['total'])}",
        *([f"says: {s.text}"] if s.text else []),
    ]
