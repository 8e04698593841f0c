"""``photomap cot``: finds of a mission, or a try, on the team's ATAK devices."""

from __future__ import annotations

import json
import time
from pathlib import Path

import click

from photomap_gis.cli.cot_options import cot_options, cot_receiver
from photomap_gis.core.errors import LinkError, UsageError

FINDS = "finds.geojson"
_PATIENCE_S = 15.0


@click.command(name="cot", short_help="Push finds (or a try) to ATAK devices as Cursor on Target.")
@click.argument("url", metavar="URL")
@click.argument("finds", type=click.Path(path_type=Path), required=False, metavar="[FINDS]")
@click.option("--at", "at", metavar="LAT,LON", help="A drone at this place, to try whether the devices show it.")
@cot_options
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
def command(
    url: str, finds: Path | None, at: str | None, cot_callsign: str, as_json: bool, *, cot_cert: Path | None,
    cot_key: Path | None, cot_ca: Path | None, cot_server_name: str | None,
) -> None:  # fmt: skip
    """Push FINDS (a mission, or any vector file of points) to URL once; with --at, a drone at that place.

    \b
    photomap cot udp://239.2.3.1:6969 --at 51.5,7.4          # does the team's network carry it?
    photomap cot udp://239.2.3.1:6969 flight-1               # the finds of a mission
    photomap cot tls://tak.example.org:8089 finds.gpkg --cot-cert me.pem --cot-ca ca.pem

    Datagrams are not acknowledged: sent does not mean received. Over tcp:// and tls:// a server must be there.
    """
    from photomap_gis.export.cot import CotDrone, CotFind, CotPusher, cot_find, stable_uid
    from photomap_gis.export.finds import read_finds

    if finds is None and at is None:
        raise UsageError("nothing to push: name a mission or a file with finds, or try with --at LAT,LON")
    address = cot_receiver(url, cot_cert=cot_cert, cot_key=cot_key, cot_ca=cot_ca, cot_server_name=cot_server_name)
    assert address is not None  # a URL was given
    values: list[CotDrone | CotFind] = []
    if at is not None:
        lat_deg, lon_deg = _place(at)
        values.append(CotDrone(stable_uid("try", cot_callsign), cot_callsign, lat_deg, lon_deg, remarks="a try"))
    if finds is not None:
        path = finds / FINDS if finds.is_dir() else finds
        values += [cot_find(find) for find in read_finds(path)]
    with CotPusher(address) as push:
        for value in values:
            push.put(value)
        until_s = time.monotonic() + _PATIENCE_S
        while (state := push.state()).sent + state.dropped < len(values) and state.problem is None:
            if time.monotonic() > until_s:
                break
            time.sleep(0.02)
    state = push.state()
    if state.problem is not None or state.sent < len(values):
        raise LinkError(state.problem or f"{address.name}: {state.sent} of {len(values)} events could be sent")
    if as_json:
        click.echo(json.dumps({"receiver": address.name, "sent": state.sent}, indent=1))
    else:
        click.echo(f"{address.name}: {state.sent} event(s) sent")


def _place(text: str) -> tuple[float, float]:
    try:
        lat, lon = (float(v) for v in text.split(","))
    except ValueError:
        raise UsageError(f"--at {text}: write latitude,longitude in degrees, e.g. 51.5,7.4") from None
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
        raise UsageError(f"--at {text}: latitudes lie within ±90 degrees, longitudes within ±180")
    return lat, lon
