"""``photomap map``: from photos or videos to a mission with its map."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from photomap_gis.cli.control_options import control_options, control_request
from photomap_gis.cli.drawing_options import drawing_options
from photomap_gis.cli.progress import ProgressBars
from photomap_gis.cli.source_options import ingest_options, source_options
from photomap_gis.core.errors import UsageError

if TYPE_CHECKING:
    from photomap_gis.pipeline import MapSummary
    from photomap_gis.store import LensRecord


@click.command(name="map", short_help="Make a georeferenced photo map from photos or a video.")
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@click.option("-o", "--output", "mission", type=click.Path(path_type=Path), help="The mission folder to make.")
@click.option("--add", "add", type=click.Path(path_type=Path), metavar="MISSION", help="Extend this mission instead.")
@click.option("--crs", help="CRS of the map, e.g. EPSG:25832; default: the right UTM zone.")
@click.option("--gsd", type=float, help="Pixel of the map in metres; default: what the camera saw.")
@click.option("--max-off-nadir", type=float, default=35.0, show_default=True, metavar="DEG",
              help="Frames looking further off the plumb line are not pasted.")  # fmt: skip
@click.option("--antenna-offset", metavar="F,R,D",
              help="Metres from camera to GPS antenna: forward, right, down of the vehicle.")  # fmt: skip
@click.option(
    "--reference",
    "references",
    type=click.Path(path_type=Path),
    multiple=True,
    metavar="ORTHO.tif",
    help="Lay the map on this existing imagery (another season will do); may be repeated.",
)
@click.option(
    "--reference-sigma",
    type=float,
    metavar="M",
    help="How far that imagery may be off, one sigma; default: one of its pixels.",
)
@click.option("--dem", type=click.Path(path_type=Path), metavar="FILE",
              help="Heights of the ground (GeoTIFF); default: found from the pictures.")  # fmt: skip
@source_options
@control_options
@drawing_options
@click.option("--scheduler", metavar="tcp://HOST:PORT",
              help="Register and draw on the workers of this Dask scheduler (extra 'cluster').")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(
    sources: tuple[str, ...],
    mission: Path | None,
    add: Path | None,
    crs: str | None,
    gsd: float | None,
    max_off_nadir: float,
    antenna_offset: str | None,
    references: tuple[Path, ...],
    reference_sigma: float | None,
    prefer: str | None,
    layers: bool | None,
    dem: Path | None,
    workers: int | None,
    scheduler: str | None,
    memory_mb: int | None,
    gcp: Path | None,
    gcp_crs: str | None,
    check: str | None,
    as_json: bool,
    quiet: bool,
    **source: object,
) -> None:
    """Make a georeferenced photo map from SOURCES: folders or globs of photos, or videos with their track.

    \b
    photomap map DCIM/100MEDIA -o flight-1
    photomap map DJI_0001.MP4 DJI_0002.MP4 -o flight-2        # .SRT files lie beside
    photomap map flight.mp4 --track flight.tlog --fov-deg 78 -o flight-3
    photomap map --add flight-1 SECOND_CARD
    photomap map --add flight-1 DJI_0001.SRT                  # a log that came later
    photomap map flight-1/recording -o again                  # what was recorded live
    photomap map DCIM/100MEDIA --reference orthophoto-2019.tif -o flight-1
    photomap map DCIM/100MEDIA -o flight-4 --gcp gcp_list.txt --check every-third
    photomap map DCIM/100MEDIA -o flight-5 --layers --prefer newest
    photomap map /data/flight -o /data/flight-6 --scheduler tcp://10.0.0.5:8786

    MISSION then holds map.tif (cloud-optimised GeoTIFF), map.kmz and all that is needed to export again. The same
    command on the same folder resumes a run that was stopped.
    """
    from photomap_gis.mosaic import Prefer
    from photomap_gis.pipeline import MapSettings, map_flight

    if (mission is None) == (add is None):
        raise UsageError("name the mission folder: -o MISSION makes one, --add MISSION extends one")
    settings = MapSettings(
        ingest=ingest_options(source),
        crs=crs,
        gsd_m_per_px=gsd,
        max_off_nadir_deg=max_off_nadir,
        workers=workers,
        scheduler=scheduler,
        **({} if memory_mb is None else {"memory_mb": memory_mb}),
        antenna_offset_m=antenna_offset_m(antenna_offset),
        references=tuple(str(r.absolute()) for r in references),
        reference_sigma_m=reference_sigma,
        prefer=None if prefer is None else Prefer(prefer),
        layers=layers,
        dem=None if dem is None else str(dem.absolute()),
    )
    folder = add or mission
    assert folder is not None  # told apart above
    control = control_request(gcp, gcp_crs, check)
    with ProgressBars(quiet=quiet) as bars:
        summary = map_flight(sources, folder, settings, add=add is not None, control=control, on_progress=bars)
    tell(summary, as_json=as_json)


def tell(summary: MapSummary, *, as_json: bool) -> None:
    """Print what a run tells: one document or words on stdout, warnings on stderr."""
    if as_json:
        click.echo(json.dumps(summary.as_document(), indent=1))
    else:
        click.echo(describe(summary))
    for warning in summary.warnings:
        click.echo(f"warning: {warning}", err=True)


def antenna_offset_m(text: str | None) -> tuple[float, float, float]:
    """Return forward, right, down of ``--antenna-offset F,R,D``; zeros where it was not given."""
    if text is None:
        return 0.0, 0.0, 0.0
    try:
        forward, right, down = (float(v) for v in text.split(","))
    except ValueError:
        raise UsageError(
            f"--antenna-offset {text}: write three metres with commas, e.g. 0.15,0,-0.3 (ahead, no side, above)"
        ) from None
    return forward, right, down


def describe(summary: MapSummary) -> str:
    """Return the summary as a person reads it."""
    from photomap_gis.pipeline.summary import control_lines

    total = summary.frames["total"]
    seconds = sum(summary.seconds.values())
    lines = [f"map        {summary.map}"]
    if not summary.georeferenced:
        lines.append(
            "           NOT GEOREFERENCED: a relative map in pixels of its first frame; there was no GPS; "
            "see 'photomap georeference'"
        )
    for status, count in summary.frames.items():
        if status != "total" and count:
            reasons = ", ".join(f"{n} {why}" for why, n in summary.reasons.get(status, {}).items() if why)
            lines.append(f"{'frames' if lines[-1].startswith(('map', '    ')) else '':<10} {count:>5} {status}"
                         + (f" ({reasons})" if reasons else ""))  # fmt: skip
    lines.append(f"matches    {summary.registrations['sequential']} from frame to frame, "
                 f"{summary.registrations['loop']} across; {summary.segments} connected piece(s)")  # fmt: skip
    unit = "m" if summary.georeferenced else "units"
    width, height = summary.size_m
    lines.append(f"extent     {width:.1f} x {height:.1f} {unit}"
                 + (f", {summary.area_m2 / 1e4:.2f} ha seen" if summary.area_m2 is not None else "")
                 + (f", {summary.crs}" if summary.crs else ""))  # fmt: skip
    lines.append(f"pixel      {summary.gsd_m_per_px * (100 if summary.georeferenced else 1):.2f} "
                 f"{'cm on the ground' if summary.georeferenced else 'units'}")  # fmt: skip
    if summary.fit_to_gps_rms_m is not None:
        lines.append(
            f"fit to GPS {summary.fit_to_gps_rms_m:.2f} m RMS (how well map and track agree; not the accuracy)"
        )
    for flight, lag in summary.track_lags.items():
        lines.append(f"clocks     {flight}: positions {lag['lag_s']:+.2f} s older than the pictures, "
                     f"sigma {lag['sigma_s']:.2f} s{'; corrected' if lag['corrected'] else ''}")  # fmt: skip
    lines += [f"lens       {words_of(lens)}" for lens in summary.lenses]
    lines += control_lines(summary.control)
    for r in summary.references:
        lines.append(f"reference  {Path(r.path).name}: {r.word}; {r.gsd_m_per_px:.2f} m pixels, "
                     f"{r.sigma_m:.2f} m of its own error taken")  # fmt: skip
    if summary.predicted_ce90_m is not None and any(r.check for r in summary.control):
        lines.append(f"predicted  CE90 {summary.predicted_ce90_m:.2f} m by the solution's covariances")
    elif summary.predicted_ce90_m is not None:
        bias = "" if summary.fit_to_gps_rms_m is None else ", GPS bias included"
        lines.append(f"accuracy   CE90 {summary.predicted_ce90_m:.1f} m predicted{bias}; no check points")
    for n in summary.nudges:
        lines.append(
            f"by hand    moved {n.east_m:+.2f} m east, {n.north_m:+.2f} m north, {n.clockwise_deg:+.2f} degrees"
        )
    stages = ", ".join(f"{stage} {s:.1f}" for stage, s in summary.seconds.items())
    lines.append(f"time       {seconds:.1f} s ({stages}); {total / max(seconds, 1e-9):.1f} frames/s")
    return "\n".join(lines)


def words_of(lens: LensRecord) -> str:
    """Return what the flight told of a lens, as a person reads it."""
    if lens.focal_observed and math.isclose(lens.focal_px, lens.focal_before_px):
        sure = f"the flight agrees to {100 * lens.focal_sigma_rel:.2f} %"
        focal = f"focal length {lens.focal_px:.1f} px as the file says; {sure}"
    elif lens.focal_observed:
        sure = f"± {100 * lens.focal_sigma_rel:.2f} %"
        focal = f"focal length {lens.focal_px:.1f} px {sure} (file: {lens.focal_before_px:.1f})"
    else:
        focal = f"focal length {lens.focal_px:.1f} px as the file says: not observable in this flight"
    if lens.k1_observed and lens.k1 == lens.k1_before:
        return f"{focal}; no other distortion than known, to {lens.k1_sigma:.4f} of k1"
    if lens.k1_observed:
        return f"{focal}; distortion k1 {lens.k1:+.4f} ± {lens.k1_sigma:.4f}"
    return f"{focal}; distortion not observable in this flight"
