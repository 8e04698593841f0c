"""``photomap demo``: the whole product in a minute, judged against the truth."""

from __future__ import annotations

import json
from pathlib import Path

import click

from photomap_gis.cli.map_command import describe
from photomap_gis.cli.progress import ProgressBars
from photomap_gis.core.errors import OutputError, UsageError

FRAMES = 40


@click.command(name="demo", short_help="Simulate a flight, map it and compare with the truth.")
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("photomap-demo"), show_default=True,
              metavar="DIR", help="Folder to fill; an earlier demo in it is replaced.")  # fmt: skip
@click.option("--frames", type=click.IntRange(4, 400), default=FRAMES, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True, help="The same seed gives the same flight.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(output: Path, frames: int, seed: int, as_json: bool, quiet: bool) -> None:
    """Simulate a short flight over a made scene, map it, and say where the map is and how good it is.

    \b
    photomap demo
    photomap demo -o /tmp/demo --seed 7
    """
    from photomap_gis.pipeline import map_flight
    from photomap_gis.simulate import FlightSpec, GpsError, Motion, run_simulation
    from photomap_gis.simulate.evaluate import evaluate_map

    _clear(output)
    spec = FlightSpec(
        frames=frames,
        altitude_m=60.0,
        width_px=1200,
        height_px=900,
        gps=GpsError(bias_east_m=0.8, bias_north_m=-0.6),
        motion=Motion(tilt_deg=1.5),
        seed=seed,
    )
    with ProgressBars(quiet=quiet) as bars:
        flight = run_simulation(
            "procedural", output / "flight", spec, on_progress=lambda done, total: bars("simulate", done, total)
        )
        summary = map_flight([flight.source], output / "mission", on_progress=bars)
        bars("compare", 0, 1)
        errors = evaluate_map(summary.map, flight.truth.folder)
        bars("compare", 1, 1)
    if as_json:
        click.echo(json.dumps({"map": summary.as_document(), "errors": dict(errors.as_dict())}, indent=1))
        return
    click.echo(describe(summary))
    gsd = summary.gsd_m_per_px
    click.echo(
        f"\nagainst the truth of the simulated flight ({errors.patches} patches)\n"
        f"absolute   {errors.absolute_rmse_m:.2f} m RMSE (this flight's GPS allows {errors.floor_rmse_m:.2f} m)\n"
        f"relative   {errors.relative_rmse_m:.3f} m RMSE = {errors.relative_rmse_m / gsd:.1f} pixels\n"
        f"coverage   {100 * errors.coverage:.1f} % of what the camera saw\n"
        f"open       {summary.map} in QGIS, {output / 'mission' / 'map.kmz'} in Google Earth"
    )


def _clear(output: Path) -> None:
    """Remove an earlier demo; refuse a folder that holds anything else."""
    import shutil

    if not output.exists():
        return
    if not output.is_dir() or {p.name for p in output.iterdir()} - {"flight", "mission"}:
        raise UsageError(f"{output} holds other things than a demo: name a new folder by -o")
    try:
        shutil.rmtree(output)
    except OSError as error:
        raise OutputError(f"cannot replace {output}: {error.strerror}; name another folder by -o") from error
