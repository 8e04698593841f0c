"""``photomap compare``: what has changed between old imagery and a new map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from photomap_gis.cli.progress import ProgressBars

if TYPE_CHECKING:
    from photomap_gis.pipeline.compare_values import CompareSummary


@click.command(name="compare", short_help="Say what has changed between old imagery and a new map.")
@click.argument("old", type=click.Path(path_type=Path))
@click.argument("new", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="OUT",
              help="GeoTIFF of scores (the rest beside it), or a folder; default: change.tif here.")  # fmt: skip
@click.option("--polygons", type=click.Path(path_type=Path), metavar="FILE",
              help="Changed areas: .geojson or .gpkg; default: beside the GeoTIFF.")  # fmt: skip
@click.option(
    "--picture", type=click.Path(path_type=Path), metavar="FILE.png", help="Old, new and change side by side."
)
@click.option("--threshold", type=float, default=0.5, show_default=True, help="Score from which ground has changed.")
@click.option("--min-area", type=float, metavar="M2", help="Smallest polygon; default: 1 m2 or 40 pixels if more.")
@click.option("--gsd", type=float, metavar="M", help="Pixel of the comparison; default: the coarser imagery's.")
@click.option("--crs", help="CRS of the comparison; default: NEW's where it is in metres, else the UTM zone.")
@click.option("--workers", type=click.IntRange(1), help="Threads; default: one a processor.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(
    old: Path,
    new: Path,
    *,
    output: Path | None,
    polygons: Path | None,
    picture: Path | None,
    threshold: float,
    min_area: float | None,
    gsd: float | None,
    crs: str | None,
    workers: int | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Compare OLD imagery with a NEW map: GeoTIFFs or mission folders, any CRS, pixel size, grey or colour.

    \b
    photomap compare orthophoto-2019.tif flight-1 -o change.tif
    photomap compare flight-1 flight-2 -o changes/ --min-area 4
    photomap compare old.tif new.tif -o change.tif --polygons change.gpkg --json

    The two are laid on each other first and freed of light and season. The GeoTIFF holds the probability that a pixel
    has changed, 0 to 1, and -1 where either shows nothing.
    """
    from photomap_gis.pipeline.compare import compare_maps
    from photomap_gis.pipeline.compare_values import CompareOutputs, CompareSettings

    settings = CompareSettings(crs, gsd, threshold, min_area, workers)
    outputs = CompareOutputs.of(output, polygons, picture)
    with ProgressBars(quiet=quiet) as bars:
        summary = compare_maps(old, new, outputs, settings, on_progress=bars)
    if as_json:
        click.echo(json.dumps(summary.as_document(), indent=1))
    else:
        click.echo(describe(summary))
    for warning in summary.warnings:
        click.echo(f"warning: {warning}", err=True)


def describe(s: CompareSummary) -> str:
    """Return the summary as a person reads it."""
    r = s.registration
    share = 100.0 * s.changed_m2 / s.compared_m2
    residual = "" if r.residual_px is None else f"; {r.residual_px:.2f} px left between neighbours"
    lines = [
        f"change     {s.areas} area(s), {s.changed_m2:.1f} of {s.compared_m2:.0f} m2 compared ({share:.2f} %), "
        f"score {s.threshold:g} or more, {s.min_area_m2:.3g} m2 or larger",
        f"laid on    {r.agreed} of {r.places} places agree; old lies {r.shift_east_m:+.2f} m east, "
        f"{r.shift_north_m:+.2f} m north of new{residual}" + ("" if r.sure else "; NOT SURE"),
        f"pixel      {100.0 * s.gsd_m_per_px:.1f} cm, {s.crs}",
        *(f"{'written' if k == 0 else '':<10} {p}" for k, p in enumerate(s.outputs)),
    ]
    return "\n".join(lines)
