"""Places on the command line: half the world's latitudes begin with a minus, as options do."""

from __future__ import annotations

import re

import click

_COORDINATES = re.compile(r"-\d[\d.]*\s*,")


class TakesCoordinates(click.Command):
    """A command to which ``-35.36,149.16;...`` is a place and no option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse arguments; those that begin with a coordinate are set apart from options by a blank."""
        return super().parse_args(ctx, [f" {a}" if _COORDINATES.match(a) else a for a in args])
