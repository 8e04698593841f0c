"""``photomap info``: what is in a source, before anyone waits for a map."""

from __future__ import annotations

import json
from pathlib import Path

import click

from photomap_gis.cli.progress import ProgressBars
from photomap_gis.cli.source_options import ingest_options, source_options


@click.command(name="info", short_help="Say what is in a source before anyone waits for a map.")
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@source_options
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
def command(sources: tuple[str, ...], as_json: bool, **source: object) -> None:
    """Say what is in SOURCES: frames, camera, track, heights, expected pixel, overlap, problems; or in a mission.

    \b
    photomap info DCIM/100MEDIA
    photomap info DJI_0001.MP4
    photomap info flight-1                           # a mission: its place and its accuracy
    """
    if len(sources) == 1 and (Path(sources[0]) / "mission.json").is_file():
        from photomap_gis.pipeline.statement import mission_statement

        document, words = mission_statement(Path(sources[0]))
        click.echo(json.dumps(document, indent=1) if as_json else words)
        return
    from photomap_gis.ingest import describe, open_sources

    with ProgressBars(quiet=as_json) as bars:
        footage = open_sources(
            sources, ingest_options(source), on_progress=lambda done, total: bars("look", done, total)
        )
    info = describe(footage)
    click.echo(json.dumps(info.as_dict(), indent=1, default=str) if as_json else str(info))
