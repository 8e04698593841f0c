"""``photomap search``: a search pattern from a datum, an area or a line becomes flights."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import click

from photomap_gis.cli.search_options import (
    file_options,
    lat_lon,
    rally_points,
    search_options,
    search_request,
    terrain_options,
    terrain_request,
)
from photomap_gis.core.errors import UsageError


@click.command(name="search", short_help="Plan a search pattern: SS, VS, PS, CS, spiral, orbit.")
@click.argument("area", required=False)
@search_options
@click.option("--avoid", multiple=True, metavar="ZONE", help="Never fly here: file, WKT or LAT,LON;...; may repeat.")
@click.option("--camera", metavar="NAME", help="A known camera, as FC6310 or 'Mavic 3E'.")
@click.option("--fov-deg", type=click.FloatRange(1, 170), metavar="DEG", help="Horizontal field of view.")
@click.option("--image-width", type=click.IntRange(1, 100_000), metavar="PX", help="Raster, with --fov-deg.")
@click.option("--image-height", type=click.IntRange(1, 100_000), metavar="PX", help="Raster, with --fov-deg.")
@click.option("--height", type=float, metavar="M", help="Height above ground.")
@click.option("--gsd", type=float, metavar="M", help="Metres a pixel, instead of --height.")
@click.option(
    "--target",
    metavar="WHAT",
    help="What must be seen, instead of --height: person, vehicle, or its smaller side in metres.",
)
@click.option(
    "--trigger",
    type=click.Choice(["distance", "time", "hover"]),
    default="distance",
    show_default=True,
    help="How pictures are taken.",
)
@click.option("--speed", type=float, default=10.0, show_default=True, metavar="M/S", help="Through the air.")
@click.option("--wind", metavar="M/S,FROM_DEG", help="Speed and direction from which the wind blows.")
@click.option("--home", metavar="LAT,LON", help="Take-off place; default: where the pattern begins.")
@click.option("--transit-height", type=float, metavar="M", help="Height on the way there and back.")
@click.option("--endurance-min", type=float, metavar="MIN", help="What one battery flies: several sorties if needed.")
@click.option("--end", type=click.Choice(["rtl", "land"]), default="rtl", show_default=True, help="How a sortie ends.")
@terrain_options
@file_options
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="OUT", help="The plan's file.")
@click.option("--json", "as_json", is_flag=True, help="Print plan and probability of detection as JSON on stdout.")
def command(area: str | None, output: Path | None, as_json: bool, **chosen: Any) -> None:
    """Plan a search of AREA (file, WKT or LAT,LON;LAT,LON;...) or about a datum, and say what it will find.

    \b
    photomap search --pattern expanding-square --datum 47.05,8.31 --radius 400 --first-leg 230
                    --camera FC6310 --target person -o search.plan
    photomap search lake.geojson --pattern creeping --camera FC6310 --height 60 -o search.plan
    photomap search valley.kml --pattern parallel --dem dtm.tif --camera FC6310 --height 80 -o search.plan
    """
    from photomap_gis.mission_planner.flight_time import FlightModel
    from photomap_gis.pipeline.plan_camera import camera_optics
    from photomap_gis.pipeline.plan_report import plan_facts, search_facts, terrain_facts
    from photomap_gis.pipeline.search import over_terrain, plan_search

    if chosen["pattern"] is None:
        raise UsageError("say which --pattern: `photomap search --help` lists them")
    optics = camera_optics(
        chosen["camera"], fov_deg=chosen["fov_deg"], width_px=chosen["image_width"], height_px=chosen["image_height"]
    )
    request = search_request(
        chosen, optics, height_m=chosen["height"], gsd=chosen["gsd"], target_m=_target_m(chosen["target"])
    )
    east, north = _wind(chosen["wind"])
    place, zones = _places(area, chosen)
    endurance = chosen["endurance_min"]
    result = plan_search(
        place,
        request,
        FlightModel(
            speed_m_s=chosen["speed"],
            climb_m_s=chosen["climb"],
            descent_m_s=chosen["descent"],
            wind_east_m_s=east,
            wind_north_m_s=north,
        ),
        avoid=zones,
        home=None if chosen["home"] is None else lat_lon(chosen["home"], "--home"),
        transit_height_m=chosen["transit_height"],
        endurance_s=None if endurance is None else 60.0 * endurance,
        lands=chosen["end"] == "land",
    )
    plan, facts = result.plan, search_facts(result)
    terrain = terrain_request(chosen, plan.gsd_m_per_px * optics.focal_px)
    if terrain is not None:
        plan, report = over_terrain(plan, terrain)
        facts |= terrain_facts(report)
    written = _write(output, plan, chosen)
    facts = plan_facts(plan) | facts | {"files": [str(p) for p in written]}
    if as_json:
        click.echo(json.dumps(facts, indent=1, allow_nan=False))
        return
    for path in written:
        click.echo(path)
    _say(facts)


def _places(area: str | None, chosen: dict[str, Any]) -> tuple[Any, Any]:
    from photomap_gis.mission_planner.places import read_places
    from photomap_gis.pipeline.search import SearchPlace

    datum = None if chosen["datum"] is None else lat_lon(chosen["datum"], "--datum")
    zones = [polygon for text in chosen["avoid"] for polygon in read_places(text).polygons]
    if area is None:
        return SearchPlace(datum=datum), zones
    places = read_places(area)
    return SearchPlace(datum=datum, area=places.polygons, line=places.line), zones


def _write(output: Path | None, plan: Any, chosen: dict[str, Any]) -> list[Path]:
    if output is None:
        return []
    from photomap_gis.core.mission import Autopilot
    from photomap_gis.mission_planner.files import write_plan

    return write_plan(
        output,
        plan,
        file_format=chosen["file_format"],
        autopilot=Autopilot(chosen["autopilot"]),
        rally=rally_points(chosen["rally"]),
        fence_margin_m=chosen["fence_margin"],
    )


_TARGETS_M = {"person": 0.5, "vehicle": 1.8}  # the smaller side seen from above


def _target_m(text: str | None) -> float | None:
    if text is None:
        return None
    try:
        size = _TARGETS_M[text.lower()] if text.lower() in _TARGETS_M else min(float(t) for t in text.split("x"))
    except ValueError:
        size = math.nan
    if not 0.001 <= size <= 1000:
        raise UsageError(f"--target {text}: person, vehicle, or metres as 0.5 or 0.4x0.3")
    return size


def _wind(text: str | None) -> tuple[float, float]:
    """The wind's way to the east and north, metres a second."""
    if text is None:
        return 0.0, 0.0
    try:
        speed, origin = (float(t) for t in text.split(","))
    except ValueError:
        raise UsageError(f"--wind {text}: SPEED,FROM_DEG as 5,270") from None
    angle = math.radians(origin)
    return -speed * math.sin(angle), -speed * math.cos(angle)


def _say(facts: dict[str, Any]) -> None:
    pod = facts["pod"]
    click.echo(
        f"{facts['pattern']}: {len(facts['sorties'])} sorties, {facts['length_m'] / 1000:.2f} km, "
        f"{facts['duration_s'] / 60:.1f} min, {facts['photos']} photos at {100 * facts['gsd_m_per_px']:.1f} cm/px",
        err=True,
    )
    click.echo(
        f"sweep width {facts['sweep_width_m']:.1f} m, track spacing {facts['track_spacing_m']:.1f} m, coverage factor "
        f"{facts['coverage_factor']:.2f}: POD {100 * pod['random_search']:.0f} % (random search), "
        f"{100 * pod['inverse_cube']:.0f} % (inverse cube law); {100 * facts['covered_share']:.1f} % of the area swept",
        err=True,
    )
    for warning in facts["warnings"]:
        click.echo(f"warning: {warning}", err=True)
