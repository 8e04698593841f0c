"""``photomap plan``: an area becomes coverage flights with proven coverage."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from photomap_gis.cli.pattern_plan import check_options, plan_by_pattern, say_pattern
from photomap_gis.cli.places import TakesCoordinates
from photomap_gis.cli.progress import ProgressBars
from photomap_gis.cli.search_options import (
    FiniteRange,
    file_options,
    lat_lon,
    rally_points,
    search_options,
    terrain_options,
    terrain_request,
)
from photomap_gis.core.errors import UsageError

_DEFAULT_RASTER = (5472, 3648, 73.74)  # a one-inch camera as most mapping drones carry


# fmt: off
@click.command(
    name="plan", cls=TakesCoordinates, short_help="Plan a coverage flight over an area, with proof of what it sees."
)
@click.argument("area", required=False)
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="OUT", help="The plan's file; .plan, ...")
@click.option("--avoid", multiple=True, metavar="ZONE", help="Never fly here: file, WKT or LAT,LON;...; may repeat.")
@click.option("--avoid-margin", type=FiniteRange(0.1, 1000), metavar="M",
              help="Distance kept from no-fly zones; default: the cross-track tolerance.")
@click.option("--corridor-width", type=FiniteRange(0.5, 20_000), metavar="M",
              help="AREA is a line: survey a strip this wide about it.")
@click.option("--inset", is_flag=True, help="Never leave the polygon; then what can be seen from inside is covered.")
@click.option("--camera", metavar="NAME|PHOTO", help="A known camera, as FC6310 or 'Mavic 3E', or a photo it took.")
@click.option("--fov-deg", type=FiniteRange(1, 160), metavar="DEG", help="Horizontal field of view.")
@click.option("--focal-mm", type=FiniteRange(0.1, 5000), metavar="MM", help="Focal length, with --sensor-width-mm.")
@click.option("--sensor-width-mm", type=FiniteRange(0.5, 500), metavar="MM", help="Of the sensor, with --focal-mm.")
@click.option("--focal-35mm", type=FiniteRange(1, 5000), metavar="MM", help="35 mm equivalent of the focal length.")
@click.option("--image-width", type=click.IntRange(1, 100_000), metavar="PX",
              help="Of pictures, with --fov-deg or a focal length.")
@click.option("--image-height", type=click.IntRange(1, 100_000), metavar="PX",
              help="Of pictures, with --fov-deg or a focal length.")
@click.option("--gsd", metavar="M", help="Ground sampling distance in metres a pixel: 0.02, or 2cm.")
@click.option("--height", type=FiniteRange(1, 10_000), metavar="M", help="Height above ground, instead of --gsd.")
@click.option("--target", metavar="WHAT",
              help="What must be seen (8 pixels), instead: person, card, vehicle, or metres as 0.4x0.3.")
@click.option("--front-overlap", type=FiniteRange(0, 97), default=80.0, show_default=True, metavar="PERCENT",
              help="Of successive pictures.")
@click.option("--side-overlap", type=FiniteRange(0, 97), default=65.0, show_default=True, metavar="PERCENT",
              help="Of neighbouring lanes.")
@click.option("--angle", type=FiniteRange(-360, 360), metavar="DEG",
              help="Heading of the lanes, clockwise from north; default: the fastest.")
@click.option("--crosshatch", is_flag=True, help="A second sweep across the first.")
@click.option("--overshoot", type=FiniteRange(0, 1000), default=0.0, metavar="M", help="Fly on beyond lanes.")
@click.option("--lead-in", type=FiniteRange(0, 1000), default=0.0, metavar="M", help="Fly straight before lanes.")
@click.option("--trigger", type=click.Choice(["distance", "time", "hover"]), default="distance", show_default=True,
              help="How pictures are taken.")
@click.option("--trigger-in-turns", is_flag=True, help="Leave the camera on between lanes.")
@click.option("--heading", default="path", show_default=True, metavar="path|fixed|DEG",
              help="The nose along the path; along the first lane all the time; or at DEG from north all the time.")
@click.option("--speed", type=FiniteRange(0.1, 100), default=10.0, show_default=True, metavar="M/S",
              help="Through the air.")
@click.option("--accel", type=FiniteRange(0.1, 30), default=2.5, show_default=True, metavar="M/S2",
              help="How hard the vehicle speeds up and brakes.")
@click.option("--exposure", type=FiniteRange(1e-6, 10), metavar="S",
              help="Shutter time: the speed is limited to half a pixel of blur.")
@click.option("--min-interval", type=FiniteRange(0, 60), default=0.7, show_default=True, metavar="S",
              help="The camera's shortest time between pictures.")
@click.option("--wind", metavar="M/S,FROM_DEG", help="Speed and direction from which the wind blows.")
@click.option("--max-crab-deg", type=FiniteRange(0, 80), default=30.0, show_default=True, metavar="DEG",
              help="How far the wind may turn the nose off a lane.")
@click.option("--home", metavar="LAT,LON", help="Take-off place; default: where the survey begins.")
@click.option("--transit-height", type=FiniteRange(1, 10_000), metavar="M", help="On the way there and back.")
@click.option("--end", type=click.Choice(["rtl", "land"]), default="rtl", show_default=True, help="How a sortie ends.")
@click.option("--endurance-min", type=FiniteRange(0.5, 10_000), metavar="MIN",
              help="What one battery flies from take-off to landing: several sorties if needed.")
@click.option("--battery-wh", type=FiniteRange(0.1, 1e6), metavar="WH",
              help="What one battery holds, with --power-w: energy and share of it in the report.")
@click.option("--power-w", type=FiniteRange(0.1, 1e6), metavar="W", help="What the vehicle draws on average.")
@click.option("--cross-track", type=FiniteRange(0, 999), default=2.0, show_default=True, metavar="M",
              help="Tolerance of the proof: off the lane.")
@click.option("--heading-tolerance", type=FiniteRange(0, 44), default=5.0, show_default=True, metavar="DEG",
              help="Tolerance of the proof: nose off the lane.")
@click.option("--tilt-tolerance", type=FiniteRange(0, 44), default=5.0, show_default=True, metavar="DEG",
              help="Tolerance of the proof: camera off the plumb line.")
@click.option("--height-tolerance", type=FiniteRange(0, 89), default=5.0, show_default=True, metavar="PERCENT",
              help="Tolerance of the proof: too low or too high.")
@click.option("--gaps", type=click.Path(path_type=Path), metavar="MISSION",
              help="Only what this mission's map does not show of AREA (default: of its own extent).")
@click.option("--coarser-than", metavar="M", help="With --gaps: also what was seen coarser; default: the plan's GSD.")
@click.option("--older-than", metavar="TIME", help="With --gaps: also what was last seen before, as 2026-11-25T10:00.")
@search_options
@terrain_options
@file_options
@click.option("--picture", type=click.Path(path_type=Path), metavar="PNG", help="Default: beside the plan.")
@click.option("--drawing", type=click.Path(path_type=Path), metavar="GEOJSON",
              help="Write what a GIS draws: path, lanes, photo footprints, sure coverage, gaps, waypoints.")
@click.option("--json", "as_json", is_flag=True, help="Print the plan and its proof as JSON on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(area: str | None, output: Path | None, as_json: bool, quiet: bool, **chosen: Any) -> None:
    """Plan flights that are sure to see all of AREA: a file (GeoJSON, KML/KMZ, GeoPackage, Shapefile), WKT, or
    LAT,LON;LAT,LON;...

    \b
    photomap plan field.geojson --camera FC6310 --gsd 2cm -o field.plan
    photomap plan town.kml --avoid hospital.kml --target person --endurance-min 25 --home 47.05,8.31 -o town.plan
    photomap plan "47.050,8.310;47.058,8.321" --corridor-width 120 --height 80 -o road.kmz
    photomap plan --gaps flight-1 --gsd 2cm -o second.plan
    photomap plan --pattern expanding-square --datum 47.05,8.31 --radius 400 --target person -o search.plan
    """
    from photomap_gis.mission_planner.area import survey_area
    from photomap_gis.mission_planner.picture import survey_picture
    from photomap_gis.mission_planner.places import read_places
    from photomap_gis.mission_planner.survey import plan_survey
    from photomap_gis.pipeline.plan import survey_facts
    from photomap_gis.pipeline.plan_energy import Battery, add_energy
    from photomap_gis.pipeline.plan_report import terrain_facts
    from photomap_gis.pipeline.plan_terrain import ground_facts, survey_over_terrain

    context = click.get_current_context()
    check_options(context, chosen["pattern"])
    if area is None and chosen["gaps"] is None and chosen["pattern"] is None:
        raise UsageError("say which AREA to survey (a file, WKT or LAT,LON;LAT,LON;...), or --gaps MISSION")
    if output is None and not as_json and chosen["picture"] is None and chosen["drawing"] is None:
        raise UsageError("say where the plan goes: -o PLAN.plan (or .waypoints .kml .geojson .gpx .csv), or --json")
    if output is not None:
        from photomap_gis.mission_planner.files import plan_format

        plan_format(output, chosen["file_format"])
    battery = Battery.of(chosen["battery_wh"], chosen["power_w"])
    settings, assumed = _settings(chosen)
    if chosen["pattern"] is not None:
        plan, facts = plan_by_pattern(area, chosen, settings, context)
        facts["warnings"] = [*assumed, *facts["warnings"]]
        add_energy(facts, battery, settings.endurance_s)
        facts["warnings"] += _storage(plan, chosen)
        written = [*_write(output, plan, chosen), *_draw(plan, settings, chosen["drawing"])]
        _tell(written, facts, as_json, say_pattern)
        return
    gsd = settings.optics.gsd_m_per_px(settings.height_m)
    places = read_places(area) if area is not None else None
    polygons = places.polygons if places else ()
    with ProgressBars(quiet=quiet) as bars:
        if chosen["gaps"] is not None:
            from photomap_gis.pipeline.plan_gaps import gaps_of

            coarser = _metres("--coarser-than", chosen["coarser_than"]) if chosen["coarser_than"] else gsd
            polygons = gaps_of(chosen["gaps"], area=polygons, gsd_m=coarser, before_s=_time(chosen["older_than"]))
        asked = survey_area(
            polygons,
            [polygon for text in chosen["avoid"] for polygon in read_places(text).polygons],
            line=_line(area, places) if chosen["corridor_width"] else (),
            corridor_width_m=chosen["corridor_width"],
        )
        terrain = terrain_request(chosen, settings.height_m)
        report = proof = None
        if terrain is None:
            survey = plan_survey(asked, settings, on_progress=bars)
        else:
            survey, report, proof = survey_over_terrain(asked, settings, terrain, bars)
    plan = survey.plan
    facts = survey_facts(survey, settings.optics, settings.height_m)
    facts |= terrain_facts(report, gsd, settings.height_m) | ground_facts(proof, settings.optics)
    facts["warnings"] = [*assumed, *facts["warnings"]]
    add_energy(facts, battery, settings.endurance_s)
    longest = max((s.duration_s for s in plan.sorties), default=0.0)
    if settings.endurance_s is None and longest > 1500.0:
        facts["warnings"].append(f"one flight of {longest / 60:.0f} min: --endurance-min splits it by batteries")
    facts["warnings"] += _storage(plan, chosen)
    written = [*_write(output, plan, chosen), *_draw(plan, settings, chosen["drawing"])]
    picture = chosen["picture"] or (output.with_suffix(".png") if output is not None else None)
    if picture is not None:
        from photomap_gis.publish import write_file

        write_file(picture, survey_picture(survey))
        written.append(picture)
    _tell(written, facts, as_json, _say)


def _tell(written: list[Path], facts: dict[str, Any], as_json: bool, say: Callable[[dict[str, Any]], None]) -> None:
    if as_json:
        files = [str(p) for p in written]
        click.echo(json.dumps(facts | {"files": files, "outputs": files}, indent=1, allow_nan=False))
        return
    for path in written:
        click.echo(path)
    say(facts)


def _line(area: str | None, places: Any) -> Any:
    """The line of a corridor; three and more places in a list are one too."""
    if places is None:
        return ()
    listed = area is not None and ";" in area and area.strip()[:1] in "+-.0123456789" and places.polygons
    return places.polygons[0].rings[0][:-1] if listed else places.line


def _settings(chosen: dict[str, Any]) -> tuple[Any, list[str]]:
    """The survey's settings, and what had to be assumed for them."""
    from photomap_gis.mission_planner.flight_time import FlightModel
    from photomap_gis.mission_planner.optics import Tolerances
    from photomap_gis.mission_planner.survey import SurveySettings
    from photomap_gis.pipeline.plan import planned_camera, planned_height_m
    from photomap_gis.pipeline.plan_camera import LensNumbers

    assumed = []
    camera, width, rows = (chosen[k] for k in ("camera", "image_width", "image_height"))
    lens = LensNumbers(*(chosen[k] for k in ("fov_deg", "focal_mm", "sensor_width_mm", "focal_35mm")))
    if camera is None and (lens == LensNumbers() or width is None or rows is None):
        if width is not None or rows is not None:
            raise UsageError(
                "a camera by numbers needs --image-width, --image-height and one of --fov-deg, --focal-35mm, or "
                "--focal-mm with --sensor-width-mm"
            )
        width, rows, usual = _DEFAULT_RASTER
        said = f"{width} x {rows} pixels"
        if lens == LensNumbers():
            lens = LensNumbers(fov_deg=usual)
            said += f" and {usual:g} degrees"
        assumed.append(f"no --camera was given: {said} are assumed")
    optics = planned_camera(camera, lens, width_px=width, height_px=rows)
    asked = {"height_m": chosen["height"], "target": chosen["target"],
             "gsd_m": None if chosen["gsd"] is None else _metres("--gsd", chosen["gsd"])}  # fmt: skip
    if all(v is None for v in asked.values()):
        asked["target"] = "card"
        assumed.append("none of --gsd, --height and --target was given: a hazard card of 40 x 30 cm is to be seen")
    height = planned_height_m(optics, **asked)
    east, north = _wind(chosen["wind"])
    blur = math.inf if chosen["exposure"] is None else 0.5 * optics.gsd_m_per_px(height) / chosen["exposure"]
    endurance = chosen["endurance_min"]
    settings = SurveySettings(
        optics=optics,
        height_m=height,
        front_overlap=chosen["front_overlap"] / 100.0,
        side_overlap=chosen["side_overlap"] / 100.0,
        tolerances=Tolerances(
            cross_track_m=chosen["cross_track"],
            heading_deg=chosen["heading_tolerance"],
            tilt_deg=chosen["tilt_tolerance"],
            height_share=chosen["height_tolerance"] / 100.0,
        ),
        model=FlightModel(
            speed_m_s=chosen["speed"],
            accel_m_s2=chosen["accel"],
            climb_m_s=chosen["climb"],
            descent_m_s=chosen["descent"],
            wind_east_m_s=east,
            wind_north_m_s=north,
            most_ground_speed_m_s=blur,
        ),
        angle_deg=chosen["angle"],
        crosshatch=chosen["crosshatch"],
        inset=chosen["inset"],
        overshoot_m=chosen["overshoot"],
        lead_in_m=chosen["lead_in"],
        trigger=chosen["trigger"],
        trigger_in_turns=chosen["trigger_in_turns"],
        fixed_heading=chosen["heading"] != "path",
        nose_deg=_nose(chosen["heading"]),
        transit_height_m=chosen["transit_height"],
        endurance_s=None if endurance is None else 60.0 * endurance,
        home=None if chosen["home"] is None else lat_lon(chosen["home"], "--home"),
        lands=chosen["end"] == "land",
        avoid_margin_m=max(chosen["avoid_margin"] or chosen["cross_track"], 0.1),
        most_crab_deg=chosen["max_crab_deg"],
        least_interval_s=chosen["min_interval"],
    )
    return settings, assumed


def _nose(text: str) -> float | None:
    """Where the nose points all the time; None along the path, or along the first lane."""
    if text in ("path", "fixed"):
        return None
    try:
        degrees = float(text)
    except ValueError:
        degrees = math.nan
    if not -360.0 <= degrees <= 360.0:
        raise UsageError(f"--heading {text}: path, fixed, or degrees clockwise from north as 45")
    return degrees % 360.0


def _metres(option: str, text: str) -> float:
    """A length a pixel: metres, or with a unit."""
    word = text.strip().lower().removesuffix("/px")
    units = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
    unit = next((u for u in units if word.endswith(u)), None)
    try:
        value = float(word.removesuffix(unit or "")) * units[unit or "m"]
    except ValueError:
        raise UsageError(f"{option} {text}: metres a pixel as 0.02, or 2cm") from None
    if not 1e-4 <= value <= (5.0 if unit else 1.0):
        raise UsageError(f"{option} {text}: that is {value:g} m a pixel; write 2cm or 0.02")
    return value


def _wind(text: str | None) -> tuple[float, float]:
    """The wind's way to the east and north, metres a second."""
    if text is None:
        return 0.0, 0.0
    try:
        speed, origin = (float(t) for t in text.split(","))
    except ValueError:
        raise UsageError(f"--wind {text}: SPEED,FROM_DEG as 5,270") from None
    if not (0.0 <= speed <= 100.0 and math.isfinite(origin)):
        raise UsageError(f"--wind {text}: SPEED,FROM_DEG as 5,270")
    angle = math.radians(origin)
    return -speed * math.sin(angle), -speed * math.cos(angle)


def _time(text: str | None) -> float | None:
    if text is None:
        return None
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        raise UsageError(f"--older-than {text}: a date and time (UTC) as 2026-11-25T10:00") from None
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()


def _storage(plan: Any, chosen: dict[str, Any]) -> list[str]:
    from photomap_gis.core.mission import Autopilot
    from photomap_gis.mission_planner.items import storage_warnings

    return storage_warnings(plan, Autopilot(chosen["autopilot"]))


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


def _draw(plan: Any, settings: Any, path: Path | None) -> list[Path]:
    if path is None:
        return []
    from photomap_gis.mission_planner.files.drawing import plan_drawing
    from photomap_gis.publish import write_file

    write_file(path, plan_drawing(plan, settings.optics, settings.height_m).encode())
    return [path]


def _say(facts: dict[str, Any]) -> None:
    front, side = 100 * facts["front_overlap"], 100 * facts["side_overlap"]
    click.echo(
        f"{facts['pattern']}: {facts['lanes']} lanes in {len(facts['sorties'])} sorties, "
        f"{facts['length_m'] / 1000:.2f} km, {facts['duration_s'] / 60:.1f} min, {facts['photos']} photos at "
        f"{100 * facts['gsd_m_per_px']:.2f} cm/px from {facts['height_m']:.1f} m\n"
        f"{100 * facts['covered_share']:.3f} % of {facts['area_m2'] / 1e4:.2f} ha is sure to be seen at the "
        f"tolerances; overlaps {front:.0f} / {side:.0f} %"
        + ("" if facts["energy_wh"] is None else f"; {facts['energy_wh']:.0f} Wh"),
        err=True,
    )
    for warning in facts["warnings"]:
        click.echo(f"warning: {warning}", err=True)
