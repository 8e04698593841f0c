"""``photomap live``: the map grows while the drone flies."""

from __future__ import annotations

import contextlib
import json
import signal
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photomap_gis.cli.cot_options import cot_options, cot_receiver, cot_url_option
from photomap_gis.cli.progress import ProgressBars
from photomap_gis.cli.source_options import ingest_options, source_options
from photomap_gis.core.errors import PhotomapError, UsageError

if TYPE_CHECKING:
    from photomap_gis.export.cot import CotAddress
    from photomap_gis.live.flight import Flight
    from photomap_gis.live.landing import LiveSummary
    from photomap_gis.server.live_view import LivePose


MOST_LINES = 20
"""So many intervals are printed for people."""


@click.command(name="live", short_help="Grow the map while the drone flies, on a page and in QGIS.")
@click.argument("source", required=False, metavar="SOURCE")
@click.option("-o", "--output", "mission", type=click.Path(path_type=Path), help="The mission folder to make.")
@click.option("--resume", type=click.Path(path_type=Path), metavar="MISSION",
              help="Go on with a session that was cut off.")  # fmt: skip
@click.option("--mavlink", metavar="CONN", help="Positions from an autopilot, e.g. udpin:0.0.0.0:14550.")
@click.option("--request-streams", is_flag=True, help="Ask the autopilot for positions (sends to it).")
@cot_url_option
@cot_options
@click.option("--as-fast-as-possible", "fast", is_flag=True,
              help="Do not play a file at its rate; nothing is dropped, no page unless --port is given.")  # fmt: skip
@click.option("--area", type=click.Path(path_type=Path, exists=True), metavar="FILE",
              help="The polygon to cover (GeoJSON, KML, GeoPackage ...): the page shows its gaps.")  # fmt: skip
@click.option("--crs", help="CRS of the final map, e.g. EPSG:25832; default: the right UTM zone.")
@click.option("--gsd", type=float, help="Pixel of the final map in metres; default: what the camera saw.")
@click.option("--max-off-nadir", type=float, default=35.0, show_default=True, metavar="DEG",
              help="Frames looking further off the plumb line are not pasted.")  # fmt: skip
@source_options
@click.option("--port", type=int, metavar="N", help="Port of the page; 0 takes any.  [default: 8765, or a free one]")
@click.option("--host", default="127.0.0.1", show_default=True, metavar="ADDRESS",
              help="Where to listen; 0.0.0.0 lets other machines in, with a token.")  # fmt: skip
@click.option("--token", metavar="TEXT", help="The token that must be shown; default: a new one.")
@click.option("--no-serve", is_flag=True, help="No page.")
@click.option("--stay", is_flag=True, help="Go on showing the finished mission after landing, until ^C.")
@click.option("--no-finalise", is_flag=True, help="End without the final map; 'photomap live --resume' goes on.")
@click.option("--json", "as_json", is_flag=True,
              help="One JSON document on stdout at the end (with a page a 'ready' line comes first).")  # fmt: skip
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(
    source: str | None,
    mission: Path | None,
    resume: Path | None,
    mavlink: str | None,
    request_streams: bool,
    cot_url: str | None,
    cot_callsign: str,
    cot_cert: Path | None,
    cot_key: Path | None,
    cot_ca: Path | None,
    cot_server_name: str | None,
    fast: bool,
    area: Path | None,
    crs: str | None,
    gsd: float | None,
    max_off_nadir: float,
    port: int | None,
    host: str,
    token: str | None,
    no_serve: bool,
    stay: bool,
    no_finalise: bool,
    as_json: bool,
    quiet: bool,
    **chosen: Any,
) -> None:
    """Map SOURCE while it flies: a video file, a stream, a capture device, or a folder that is being filled.

    \b
    photomap live rtsp://192.168.1.1/live -o flight-1 --mavlink udpin:0.0.0.0:14550
    photomap live DJI_0001.MP4 -o flight-2                        # played at its rate; its .SRT lies beside it
    photomap live DJI_0001.MP4 -o flight-3 --as-fast-as-possible
    photomap live --resume flight-1                               # after a crash or a dead battery

    The address of the page is printed. q, ^C, or the end of the stream land the flight: the final map is solved and
    drawn, and MISSION is an ordinary mission. 'photomap export MISSION' works at any moment, in mid flight too.
    Without positions the map is relative; it snaps to the ground once enough of them have come.
    """
    from photomap_gis.live.flight import FlightRequest, open_flight
    from photomap_gis.pipeline.settings import MapSettings

    if (resume is None) == (source is None):
        raise UsageError("name a SOURCE and -o MISSION, or --resume MISSION to go on with a session that was cut off")
    if resume is None and mission is None:
        raise UsageError("name the mission folder to make: -o MISSION")
    if resume is not None and mission is not None:
        raise UsageError("--resume goes on in its own folder: leave -o away")
    settings = MapSettings(
        ingest=replace(ingest_options(chosen), frame_rate_hz=None), crs=crs, gsd_m_per_px=gsd,
        max_off_nadir_deg=max_off_nadir,
    )  # fmt: skip
    request = FlightRequest(
        source, mission, resume, settings, mavlink=mavlink, request_streams=request_streams, realtime=not fast,
        area=area,
    )  # fmt: skip
    serve = not no_serve and (not fast or port is not None)
    receiver = cot_receiver(
        cot_url, cot_cert=cot_cert, cot_key=cot_key, cot_ca=cot_ca, cot_server_name=cot_server_name
    )  # fmt: skip
    with (
        open_flight(request) as flight,
        _pushed(flight, receiver, cot_callsign),
        _page(flight, serve, host, port, token, as_json),
    ):
        for warning in flight.warnings:
            click.echo(f"warning: {warning}", err=True)
        with _ends(flight):
            if not quiet:
                flight.on_second, flight.on_words = _line, _say
            flight.fly()
        if not quiet:
            click.echo("", err=True)
        summary, error = _landed(flight, no_finalise=no_finalise, quiet=quiet)
        _tell(summary, as_json=as_json)
        if error is not None:
            raise error
        if stay and serve:
            click.echo("the mission is shown until ^C", err=True)
            with contextlib.suppress(KeyboardInterrupt):
                threading.Event().wait()


def _landed(flight: Flight, *, no_finalise: bool, quiet: bool) -> tuple[LiveSummary, PhotomapError | None]:
    """Make the final map; where none can be made, how the flight went is told all the same."""
    if no_finalise:
        return flight.summary(None), None
    try:
        with ProgressBars(quiet=quiet) as bars:
            return flight.summary(flight.land(bars)), None
    except PhotomapError as error:
        return flight.summary(None), error


@contextlib.contextmanager
def _pushed(flight: Flight, receiver: CotAddress | None, callsign: str) -> Iterator[None]:
    """Push drone and footprint to a team's devices while the block lasts."""
    if receiver is None:
        yield
        return
    from photomap_gis.cli.cot_values import cot_values
    from photomap_gis.export.cot import CotPusher

    with CotPusher(receiver) as push:

        def tell(pose: LivePose) -> None:
            for value in cot_values(pose, flight.folder, callsign):
                push.put(value)

        flight.on_pose = tell
        yield


@contextlib.contextmanager
def _ends(flight: Flight) -> Iterator[None]:
    """End the flight by ^C, SIGTERM, or the key q; a second ^C ends the program."""

    def stop(*_: object) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        click.echo("\nlanding: what has come is worked off (^C again ends at once)", err=True)
        flight.stop()

    before = {s: signal.signal(s, stop) for s in (signal.SIGINT, signal.SIGTERM)}
    if sys.stdin is not None and sys.stdin.isatty():
        threading.Thread(target=_listen_for_q, args=(stop,), daemon=True).start()
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _listen_for_q(stop: Any) -> None:
    for line in sys.stdin:
        if line.strip().lower() == "q":
            signal.raise_signal(signal.SIGINT)
            return


@contextlib.contextmanager
def _page(flight: Flight, serve: bool, host: str, port: int | None, token: str | None, as_json: bool) -> Iterator[None]:
    """Serve the page while the block lasts."""
    if not serve:
        yield
        return
    from photomap_gis.cli.serve_view import open_view
    from photomap_gis.server import Access, BoundServer, Host, create_app, is_loopback, new_token
    from photomap_gis.server.protocol import ReadyDocument

    if token is not None and not (token.isascii() and token.isprintable() and len(token) >= 8 and " " not in token):
        raise UsageError("--token must be 8 or more ASCII characters without spaces")
    served = Host(open_view)
    served.open_live(flight.view)
    local = is_loopback(host)
    if not local and token is None:
        token = new_token()
    server = BoundServer(host, port)
    url = server.url + ("" if token is None else f"?token={token}")
    app = create_app(served, Access(token, loopback_only=local, cookie=f"photomap-{server.port}"))
    started = threading.Event()

    def ready() -> None:
        if as_json:
            click.echo(ReadyDocument(port=server.port, token=token, url=url).model_dump_json())
        else:
            click.echo(url)
        sys.stdout.flush()
        started.set()

    thread = threading.Thread(target=server.serve, args=(app, ready), name="server", daemon=True)
    thread.start()
    started.wait(20.0)
    try:
        yield
    finally:
        server.stop()
        thread.join(timeout=5.0)


def _line(words: str) -> None:
    """Say how it goes on one line of a terminal; elsewhere once in a while."""
    if sys.stderr.isatty():
        click.echo(f"\r{words[:118]:<118}", nl=False, err=True)


def _say(words: str) -> None:
    """Say what has happened on a line of its own, at once: to which address to send, a link lost, a disk full."""
    click.echo(("\n" if sys.stderr.isatty() else "") + words, err=True)


def _tell(summary: LiveSummary, *, as_json: bool) -> None:
    from photomap_gis.cli.map_command import describe

    if as_json:
        click.echo(json.dumps(summary.as_document()))
    else:
        t = summary.tally
        click.echo(
            f"flight     {t.frames} frames, {t.tracked} placed, {summary.keyframes} key frames, {t.dropped} dropped, "
            f"{t.error_frames} error frames; {t.segments_begun} breaks, {t.joined} recognised again"
        )
        for i in t.intervals[:MOST_LINES]:
            until = "" if i.until_s is None else f" to {i.until_s:.1f}"
            click.echo(f"           {i.kind} at {i.since_s:.1f}{until} s: {i.words}")
        if len(t.intervals) > MOST_LINES:
            click.echo(f"           and {len(t.intervals) - MOST_LINES} more: --json lists them")
        if summary.map is not None:
            click.echo(describe(summary.map))
    for warning in (*summary.warnings, *(() if summary.map is None else summary.map.warnings)):
        click.echo(f"warning: {warning}", err=True)
