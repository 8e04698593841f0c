"""``photomap cameras``: the cameras that a plan can name."""

from __future__ import annotations

import json
import math

import click


@click.command(name="cameras", short_help="List the cameras that plans can name.")
@click.argument("words", nargs=-1, metavar="[WORD]...")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
def command(words: tuple[str, ...], as_json: bool) -> None:
    """List the cameras known to photomap, for photomap plan --camera NAME; WORDS narrow the list.

    \b
    photomap cameras mavic 3
    photomap plan field.geojson --camera "DJI Mini 2" --gsd 2cm -o field.plan
    """
    from photomap_gis.ingest.profiles import CameraRole, all_profiles

    asked = [w.lower() for text in words for w in text.split()]
    cameras = [
        {
            "name": p.name,
            "make": p.make,
            "models": list(p.models),
            "width_px": p.width_px,
            "height_px": p.height_px,
            "focal_mm": p.focal_mm,
            "fov_deg": None if p.focal_mm is None else _fov_deg(p.sensor_width_mm, p.focal_mm),
            "zoom": p.zoom,
            "role": str(p.role),
        }
        for p in all_profiles()
        if p.role is not CameraRole.BAND and not p.fisheye
        if all(w in f"{p.name} {p.make} {' '.join(p.models)}".lower() for w in asked)
    ]
    if as_json:
        click.echo(json.dumps({"cameras": cameras}, indent=1, allow_nan=False))
        return
    for camera in cameras:
        view = "lens exchanged" if camera["fov_deg"] is None else f"{camera['fov_deg']} degrees"
        click.echo(f"{camera['name']}: {camera['width_px']} x {camera['height_px']}, {view}")
    if not cameras:
        click.echo(f"no camera is known as {' '.join(words)!r}; photomap cameras lists all", err=True)


def _fov_deg(sensor_width_mm: float, focal_mm: float) -> float:
    return round(math.degrees(2.0 * math.atan(sensor_width_mm / 2.0 / focal_mm)), 1)
