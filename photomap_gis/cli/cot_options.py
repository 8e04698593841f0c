"""The options that say to whom Cursor on Target goes; shared by ``live`` and ``cot``."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from photomap_gis.core.errors import UsageError

if TYPE_CHECKING:
    from photomap_gis.export.cot import CotAddress

F = TypeVar("F", bound=Callable[..., Any])

PASSWORD_VARIABLE = "PHOTOMAP_COT_PASSWORD"
_FILE = click.Path(path_type=Path)

_OPTIONS = (
    click.option("--cot-cert", type=_FILE, metavar="PEM", help="Our certificate for tls:// (and its key, if inside)."),
    click.option("--cot-key", type=_FILE, metavar="PEM",
                 help=f"Its key, where that is a file of its own; a password is taken from {PASSWORD_VARIABLE}."),
    click.option("--cot-ca", type=_FILE, metavar="PEM", help="The authority of the TAK server's certificate."),
    click.option("--cot-server-name", metavar="NAME", help="The name in that certificate, where it is not the host's."),
    click.option("--cot-callsign", metavar="TEXT", default="photomap", show_default=True, help="The drone's name."),
)  # fmt: skip

cot_url_option = click.option(
    "--cot", "cot_url", metavar="URL",
    help="Push drone, footprint and finds to ATAK: udp://239.2.3.1:6969, udp://, tcp:// or tls://HOST:PORT.",
)  # fmt: skip


def cot_options(function: F) -> F:
    """Add the options to a command; it receives them as keywords for ``cot_receiver``."""
    for option in reversed(_OPTIONS):
        function = option(function)
    return function


def cot_receiver(
    url: str | None, *, cot_cert: Path | None, cot_key: Path | None, cot_ca: Path | None, cot_server_name: str | None
) -> CotAddress | None:
    """Return the receiver, ``None`` where none is asked for. Raises ``UsageError`` and ``DataError``."""
    from photomap_gis.export.cot import Tls, cot_address

    tls = Tls(cot_cert, cot_key, os.environ.get(PASSWORD_VARIABLE), cot_ca, cot_server_name)
    if url is None:
        if tls != Tls(password=tls.password):
            raise UsageError("certificates without --cot: add --cot tls://HOST:PORT")
        return None
    if not url.startswith(("tls:", "ssl:")) and tls == Tls(password=tls.password):
        tls = Tls()
    return cot_address(url, tls)
