"""How the map is drawn; shared by ``map`` and ``solve``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])

PREFERENCES = ("nadir", "sharp", "newest")
"""As ``mosaic.preference.Prefer`` has them; named here so that ``--help`` need not load the mosaic room."""

_OPTIONS = (
    click.option("--prefer", type=click.Choice(PREFERENCES),
                 help="Which of several frames is shown: the one that looks down most steeply (default), the sharpest, "
                 "or the newest."),
    click.option("--layers/--no-layers", default=None,
                 help="Write layers/ too: when each spot was last seen, by which frame it is shown, by how many it was "
                 "seen, how sure its place is, and what of it could be made out."),
    click.option("--workers", type=click.IntRange(1), help="Threads; default: one a processor."),
    click.option("--memory", "memory_mb", type=click.IntRange(128), metavar="MB",
                 help="Memory for pictures while the map is drawn; default: 512."),
)  # fmt: skip


def drawing_options(function: F) -> F:
    """Add the options to a command; it receives ``prefer``, ``layers``, ``workers`` and ``memory_mb``."""
    for option in reversed(_OPTIONS):
        function = option(function)
    return function
