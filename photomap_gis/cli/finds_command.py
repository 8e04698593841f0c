"""``photomap finds``: what was marked on a mission's map, listed, or written for other programs."""

from __future__ import annotations

import json
from pathlib import Path

import click

from photomap_gis.core.errors import DataError, UsageError

_SUFFIXES = (".geojson", ".kml", ".gpx", ".cot")


@click.command(name="finds", short_help="List a mission's finds, or write them as GeoJSON, KML, GPX, CoT.")
@click.argument("mission", type=click.Path(path_type=Path), default=Path(), required=False)
@click.option("-o", "--output", "outputs", type=click.Path(path_type=Path), multiple=True, metavar="FILE",
              help="Write them: .geojson, .kml, .gpx, .cot. May be given several times.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document (GeoJSON) on stdout.")
def command(mission: Path, outputs: tuple[Path, ...], as_json: bool) -> None:
    """List the finds that were marked on MISSION's map (default: the current folder), or write them.

    Finds are marked on the page of ``photomap serve`` or ``photomap live``; each has a picture in MISSION/finds.

    \b
    photomap finds flight-1
    photomap finds flight-1 -o finds.kml -o finds.gpx
    """
    from datetime import UTC, datetime

    from photomap_gis.export.find_files import FindFormat, finds_text
    from photomap_gis.export.finds import read_finds
    from photomap_gis.find_store import FINDS_FILE, FindStore
    from photomap_gis.publish import write_file

    if not mission.is_dir():
        raise DataError(f"{mission} is no folder: name the mission folder that 'photomap map' wrote")
    for path in outputs:
        if path.suffix.lower() not in _SUFFIXES:
            raise UsageError(f"{path.name} must end in {', '.join(_SUFFIXES)}")
    own = mission / FINDS_FILE
    if not own.is_file() and not (mission / "mission.json").is_file():
        raise DataError(f"{mission} is no mission and holds no {FINDS_FILE}: name a mission folder")
    finds = read_finds(own, may_be_none=True) if own.is_file() else ()
    without = sum(f.lon_lat is None for f in FindStore(mission).all())
    title, now = f"{mission.resolve().name}: finds", datetime.now(UTC)
    if without:
        click.echo(f"{without} of the finds have no place on Earth (their map had none): they are left out", err=True)
    for path in outputs:
        text = finds_text(finds, FindFormat(path.suffix.lower()[1:]), title=title, now=now)
        write_file(path.absolute(), text.encode())
        click.echo(f"{path}: {_count(len(finds))}", err=True)
    if as_json:
        click.echo(json.dumps(json.loads(finds_text(finds, FindFormat.GEOJSON, title=title, now=now)), indent=1))
        return
    for f in finds if not outputs else ():
        sure = "" if f.ce90_m is None else f"  CE90 {f.ce90_m:.1f} m"
        click.echo(f"{f.name}  {f.lat_deg:.6f}, {f.lon_deg:.6f}{sure}  {f.time_utc or ''}  {f.remarks}".rstrip())
    if not finds and not outputs:
        click.echo("no finds: mark them on the page of 'photomap serve'", err=True)


def _count(n: int) -> str:
    return "1 find" if n == 1 else f"{n} finds"
