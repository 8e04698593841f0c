"""``python -m photomap_gis.simulate.vehicle``: a simulated vehicle to try ``photomap upload`` on."""

from __future__ import annotations

import time
from pathlib import Path

import click

from photomap_gis.core.errors import PhotomapError
from photomap_gis.simulate.vehicle.airframe import Airframe, Misbehaviour, Place
from photomap_gis.simulate.vehicle.ardupilot import COPTER_AUTO, COPTER_LOITER, ArduPilot
from photomap_gis.simulate.vehicle.channel import Weather
from photomap_gis.simulate.vehicle.flying import Flier, FlownPath
from photomap_gis.simulate.vehicle.px4 import PX4, PX4_HOLD, PX4_MISSION
from photomap_gis.simulate.vehicle.serve import Server


@click.command()
@click.option("--autopilot", type=click.Choice(["ardupilot", "px4"]), default="ardupilot", show_default=True)
@click.option("--link", type=click.Choice(["tcp", "udp", "udpout"]), default="tcp", show_default=True,
              help="tcp and udp wait for a ground station, udpout sends to one.")  # fmt: skip
@click.option("--port", type=int, default=5760, show_default=True, help="0: a free one, told on stdout.")
@click.option("--home", type=(float, float, float), default=(51.5, 7.4, 100.0), show_default=True)
@click.option("--system", type=click.IntRange(1, 255), default=1, show_default=True)
@click.option("--armed", is_flag=True)
@click.option("--height", type=float, default=0.0, show_default=True, help="Metres above home: it hovers.")
@click.option("--mode", type=click.Choice(["LOITER", "AUTO"]), default="LOITER", show_default=True)
@click.option("--loss", type=click.FloatRange(0, 1), default=0.0)
@click.option("--duplicate", type=click.FloatRange(0, 1), default=0.0)
@click.option("--reorder", type=click.FloatRange(0, 1), default=0.0)
@click.option("--delay", type=click.FloatRange(0), default=0.0, help="Seconds, each way.")
@click.option("--no-space-after-boot", type=float, default=0.0, help="Seconds.")
@click.option("--reboot-at-item", type=int)
@click.option("--mission-mode-at-item", type=int)
@click.option("--silent-at-item", type=int)
@click.option("--refuses-command", type=int)
@click.option("--wrong-echoes", type=int, default=0)
@click.option("--keeps-wrong", type=int, default=0)
@click.option("--signing-key", type=click.Path(path_type=Path), help="32 bytes: what is not signed is not heard.")
@click.option(
    "--fly",
    type=click.Path(path_type=Path),
    metavar="SIMULATION",
    help="Stream position and gimbal of a flight of 'photomap simulate', at once or at {\"fly\": true} on stdin.",
)
@click.option("--wait", is_flag=True, help="Take off at {\"fly\": true} on stdin only.")  # fmt: skip
@click.option("--stream-hz", type=click.FloatRange(0.1, 50), default=10.0, show_default=True, help="With --fly.")
@click.option("--seed", type=int, default=0)
def main(
    autopilot: str, link: str, port: int, home: tuple[float, float, float], system: int, armed: bool, height: float,
    mode: str, loss: float, duplicate: float, reorder: float, delay: float, no_space_after_boot: float,
    reboot_at_item: int | None, mission_mode_at_item: int | None, silent_at_item: int | None,
    refuses_command: int | None, wrong_echoes: int, keeps_wrong: int, signing_key: Path | None, fly: Path | None,
    wait: bool, stream_hz: float, seed: int,
) -> None:  # fmt: skip
    """Hold missions as ArduPilot or PX4 does, with the faults that are asked for.

    \b
    python -m photomap_gis.simulate.vehicle --port 5760 --loss 0.2
    photomap upload area.plan --connect tcp:127.0.0.1:5760
    python -m photomap_gis.simulate.vehicle --link udpout --port 14550 --fly sim-video
    """
    faults = Misbehaviour(
        no_space_after_boot_s=no_space_after_boot,
        reboot_at_item=reboot_at_item,
        mission_mode_at_item=mission_mode_at_item,
        silent_at_item=silent_at_item,
        refuses_command=refuses_command,
        wrong_echoes=wrong_echoes,
        keeps_wrong=keeps_wrong,
    )
    is_ardupilot = autopilot == "ardupilot"
    modes = (COPTER_AUTO, COPTER_LOITER) if is_ardupilot else (PX4_MISSION, PX4_HOLD)
    lat_deg, lon_deg, alt_m = home
    make: type[Airframe] = ArduPilot if is_ardupilot else PX4
    vehicle = make(
        system=system,
        place=Place(lat_deg, lon_deg, alt_m + height, height),
        home=home,
        armed=armed,
        mode=modes[0] if mode == "AUTO" else modes[1],
        params={
            "FENCE_ENABLE": 0.0,
            "FENCE_TYPE": 7.0,
            "FENCE_ALT_MAX": 100.0,
            "FENCE_RADIUS": 300.0,
            "MIS_RESTART": 0.0,
        },
        faults=faults,
    )
    vehicle.now_s = time.monotonic()
    vehicle.boot()
    key = signing_key.read_bytes() if signing_key else None
    flier = None
    if fly is not None:
        try:
            flier = Flier(FlownPath.of_simulation(fly), vehicle, stream_hz)
        except PhotomapError as error:
            raise click.ClickException(str(error)) from error
        if not wait:
            flier.start(vehicle.now_s)
    weather = Weather(loss, duplicate, reorder, delay)
    Server(vehicle, scheme=link, port=port, weather=weather, seed=seed, key=key, flier=flier).run()


if __name__ == "__main__":
    main()
