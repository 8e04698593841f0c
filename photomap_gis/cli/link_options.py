"""What the commands that speak with a vehicle share: the options of the link, Ctrl-C, and how a report is told."""

from __future__ import annotations

import contextlib
import functools
import json
import signal
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, TypeVar

import click

from photomap_gis.core.errors import LinkError

if TYPE_CHECKING:
    from photomap_gis.mission_planner.mavlink.report import Report
    from photomap_gis.mission_planner.mavlink.session import Connection
    from photomap_gis.mission_planner.mavlink.talk import Talk

F = TypeVar("F", bound=Callable[..., Any])

EXIT_STOPPED = 130


def link_options(function: F) -> F:
    """Add the options of the link; the command takes them as one ``connection``, and ``system``."""

    @click.option("--connect", "url", required=True, metavar="URL",
                  help="udpin:0.0.0.0:14550 (listen), udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT, "
                       "serial:/dev/ttyUSB0:57600.")  # fmt: skip
    @click.option("--system", type=click.IntRange(1, 255), metavar="N",
                  help="The vehicle's system id, where several are on the link.")  # fmt: skip
    @click.option("--timeout", type=click.FloatRange(1.0, 3600.0), default=60.0, show_default=True, metavar="SECONDS",
                  help="Give up when the vehicle did not answer for so long.")  # fmt: skip
    @click.option("--tlog", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE",
                  help="Keep all that is said as a telemetry log.")  # fmt: skip
    @click.option("--signing-key", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE",
                  help="Sign messages (MAVLink 2): 32 bytes, 64 hex digits, or the passphrase.")  # fmt: skip
    @click.option("--source-system", type=click.IntRange(1, 255), default=254, show_default=True, metavar="N",
                  help="Our own system id; 255 where the vehicle obeys only that one.")  # fmt: skip
    @functools.wraps(function)
    def with_connection(
        *args: Any,
        url: str,
        timeout: float,
        tlog: Path | None,
        signing_key: Path | None,
        source_system: int,
        **kwargs: Any,
    ) -> Any:
        from photomap_gis.mission_planner.mavlink.link import read_signing_key
        from photomap_gis.mission_planner.mavlink.session import GROUND_STATION, Connection
        from photomap_gis.mission_planner.mavlink.talk import Address

        connection = Connection(
            url=url,
            timeout_s=timeout,
            tlog=tlog,
            key=read_signing_key(signing_key) if signing_key else None,
            me=Address(source_system, GROUND_STATION.component),
        )
        return function(*args, connection=connection, **kwargs)

    return with_connection  # type: ignore[return-value]


class GentleStop:
    """Ctrl-C (or SIGTERM) once asks the conversation to come to a known end; twice leaves at once."""

    def __init__(self, words: str) -> None:
        self._words = words
        self._talk: Talk | None = None
        self.asked = False

    def opened(self, talk: Talk) -> None:
        """Know whom to ask."""
        self._talk = talk
        talk.stop_asked = self.asked

    @contextlib.contextmanager
    def handled(self) -> Iterator[None]:
        """Catch the signals within the block."""
        before = {}
        for number in (signal.SIGINT, signal.SIGTERM):
            with contextlib.suppress(ValueError):  # not in the main thread: the caller's own business
                before[number] = signal.signal(number, self._stop)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _stop(self, number: int, frame: FrameType | None) -> None:
        if self.asked or self._talk is None:
            raise KeyboardInterrupt
        self.asked = True
        self._talk.stop_asked = True
        click.echo(self._words, err=True)


def saved_path(beside: Path | None, given: Path | None, system: int) -> Path:
    """Return where to keep what a vehicle held: a name that no earlier run has, so that no copy is lost."""
    if given is not None:
        return given
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    folder = beside.parent if beside is not None else Path()
    stem = beside.stem if beside is not None else "vehicle"
    path = folder / f"{stem}-before-sys{system}-{stamp}.json"
    number = 2
    while path.exists():
        path = folder / f"{stem}-before-sys{system}-{stamp}-{number}.json"
        number += 1
    return path


def tell_report(report: Report, connection: Connection, *, as_json: bool, stopped: bool) -> int:
    """Print a report and return the exit code: 0 where it is verified, 4 where it is not, 130 where it was stopped."""
    from photomap_gis.mission_planner.mavlink.report import Outcome

    if as_json:
        click.echo(json.dumps(report.as_json(), allow_nan=False))
    else:
        for warning in report.warnings:
            click.echo(f"warning: {warning}", err=True)
        for difference in report.differences[:10]:
            click.echo(f"difference: {difference}", err=True)
        click.echo(f"{report.outcome}: {report.message}")
        click.echo(f"items: {report.items}   seconds: {report.seconds:.1f}   the vehicle holds: {report.holds}")
        if report.saved_previous:
            click.echo(f"what it held before: {report.saved_previous}")
        if report.outcome is not Outcome.VERIFIED and report.saved_previous and report.holds not in ("previous",):
            click.echo(f"to put it back: photomap upload --restore {report.saved_previous} --connect {connection.url}")
    if report.outcome is Outcome.VERIFIED:
        return 0
    return EXIT_STOPPED if stopped else LinkError.exit_code
