"""``photomap package``: a mission in one file for the incident commander."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from photomap_gis.cli.progress import ProgressBars

if TYPE_CHECKING:
    from photomap_gis.pipeline.package import PackageSummary


@click.command(name="package", short_help="Pack a mission into one file for the incident commander.")
@click.argument("mission", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="FILE.zip",
              help="The package; default: handover.zip in MISSION.")  # fmt: skip
@click.option("--max-size", metavar="SIZE", help="Make it fit, e.g. 20MB: with loss, then coarser; says what was lost.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(mission: Path, output: Path | None, max_size: str | None, as_json: bool, quiet: bool) -> None:
    """Pack MISSION's map (GeoTIFF, KMZ, MBTiles), vectors, finds, checksums and a page of summary into one zip.

    \b
    photomap package flight-1 -o handover.zip
    photomap package flight-1 -o handover.zip --max-size 20MB    # for a slow link

    summary.html in it opens in any browser and prints on one page: map, accuracy, flight times, frames. The same
    mission gives the same bytes.
    """
    from photomap_gis.pipeline.package import package_mission, parse_size

    limit = None if max_size is None else parse_size(max_size)
    with ProgressBars(quiet=quiet) as bars:
        summary = package_mission(mission, output or mission / "handover.zip", max_bytes=limit, on_progress=bars)
    click.echo(json.dumps(summary.as_document(), indent=1) if as_json else describe(summary))


def describe(s: PackageSummary) -> str:
    """Return the summary as a person reads it."""
    from photomap_gis.report.page import size_text

    pixel = "" if s.gsd_m_per_px is None else f", pixel {100 * s.gsd_m_per_px:.1f} cm"
    lines = [f"package    {s.package}: {size_text(s.bytes)}{pixel}"]
    lines += [f"{'files' if k == 0 else '':<10} {f.name}, {size_text(f.bytes)}" for k, f in enumerate(s.files)]
    lines += [f"lost       {line}" for line in s.lost]
    return "\n".join(lines)
