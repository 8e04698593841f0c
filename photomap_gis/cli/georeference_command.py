"""``photomap georeference``: a map gets its place by points picked on it, or is moved by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from photomap_gis.cli.map_command import tell
from photomap_gis.cli.progress import ProgressBars
from photomap_gis.core.errors import UsageError

if TYPE_CHECKING:
    from photomap_gis.pipeline import Pick


@click.command(name="georeference", short_help="Give a map its place by picked points, or nudge it.")
@click.argument("mission", type=click.Path(path_type=Path))
@click.option(
    "--pick",
    "picks",
    multiple=True,
    metavar="X,Y=LAT,LON",
    help="A place of map.tif in its own coordinates, and where it is on Earth; two or more, far apart.",
)
@click.option(
    "--check-pick",
    "check_picks",
    multiple=True,
    metavar="X,Y=LAT,LON",
    help="The same, to test the map: it has no part in the fit, and what the map misses it by is told.",
)
@click.option(
    "--nudge",
    metavar="E,N[,DEG]",
    help="Move the map by metres east and north, and degrees clockwise about its middle.",
)
@click.option(
    "--piece",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    metavar="N",
    help="Which of map-1.tif, map-2.tif, ... the picks are on.",
)
@click.option("--reset", is_flag=True, help="Forget earlier picks and nudges first.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(
    mission: Path,
    *,
    picks: tuple[str, ...],
    check_picks: tuple[str, ...],
    nudge: str | None,
    piece: int,
    reset: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Give MISSION's map its place on Earth, or correct it by hand; draw and export it again.

    \b
    photomap georeference flight-1 --pick 120.5,-340=51.50012,7.40034 --pick 980,-95=51.50101,7.40312
    photomap georeference flight-1 --pick ... --pick ... --check-pick 400,-210=51.50044,7.40201
    photomap georeference flight-1 --nudge 1.5,-0.8
    photomap georeference flight-1 --nudge 0,0,2     # two degrees clockwise

    X,Y are what a GIS shows under the cursor on map.tif. Nothing is registered again; later solves keep it.
    """  # fmt: skip
    from photomap_gis.pipeline import georeference

    picked = [parse_pick(text) for text in picks]
    picked += [replace(parse_pick(text, "--check-pick"), check=True) for text in check_picks]
    motion = None if nudge is None else parse_nudge(nudge)
    with ProgressBars(quiet=quiet) as bars:
        summary = georeference(mission, picks=picked, nudge=motion, piece=piece, reset=reset, on_progress=bars)
    tell(summary, as_json=as_json)


def parse_pick(text: str, option: str = "--pick") -> Pick:
    """Return the pick that ``X,Y=LAT,LON`` says; ``UsageError`` for anything else."""
    from photomap_gis.pipeline import Pick

    sides = [_numbers(side) for side in text.split("=")]
    if len(sides) != 2 or any(side is None or len(side) != 2 for side in sides):
        raise UsageError(f"{option} {text}: write X,Y=LAT,LON, such as 120.5,-340=51.50012,7.40034")
    (x, y), (lat, lon) = (side or [] for side in sides)
    if not (abs(lat) <= 90.0 and abs(lon) <= 360.0):
        raise UsageError(
            f"{option} {text}: latitude {lat:g}, longitude {lon:g} is no place on Earth; latitude comes first"
        )
    return Pick(x, y, lat, lon)


def parse_nudge(text: str) -> tuple[float, float, float]:
    """Return metres east, metres north and degrees clockwise of ``E,N[,DEG]``; ``UsageError`` for anything else."""
    numbers = _numbers(text)
    if numbers is None or len(numbers) not in (2, 3):
        raise UsageError(f"--nudge {text}: write EAST,NORTH or EAST,NORTH,DEGREES, such as 1.5,-0.8")
    east, north, clockwise = (*numbers, 0.0)[:3]
    return east, north, clockwise


def _numbers(text: str) -> list[float] | None:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return None
    return numbers if all(map(math.isfinite, numbers)) else None
