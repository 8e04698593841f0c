"""The options of ground control; shared by ``map`` and ``solve``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from photomap_gis.core.errors import UsageError

if TYPE_CHECKING:
    from photomap_gis.pipeline import ControlRequest

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS = (
    click.option("--gcp", type=click.Path(path_type=Path), metavar="FILE",
                 help="Ground control points: ODM's gcp_list.txt, or a CSV with a header."),
    click.option("--gcp-crs", metavar="CRS", help="CRS of x and y in a CSV that does not say."),
    click.option("--check", metavar="NAMES",
                 help="Points that test the map and never enter the fit: names with commas, or every-third."),
)  # fmt: skip


def control_options(function: F) -> F:
    """Add the options to a command; it receives ``gcp``, ``gcp_crs`` and ``check``."""
    for option in reversed(_OPTIONS):
        function = option(function)
    return function


def control_request(gcp: Path | None, gcp_crs: str | None, check: str | None) -> ControlRequest | None:
    """Return the options' value; ``None`` where nothing was said of ground control."""
    from photomap_gis.pipeline import ControlRequest

    if gcp_crs is not None and gcp is None:
        raise UsageError("--gcp-crs goes with --gcp FILE")
    if gcp is None and check is None:
        return None
    words = None if check is None else tuple(w for w in (word.strip() for word in check.split(",")) if w)
    return ControlRequest(gcp, gcp_crs, words)
