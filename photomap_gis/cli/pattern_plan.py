"""``photomap plan --pattern``: a search pattern from a datum, an area or a line becomes flights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from photomap_gis.cli.search_options import lat_lon, search_request, terrain_request
from photomap_gis.core.errors import UsageError
from photomap_gis.core.plan import GeoPolygon, SurveyPlan

if TYPE_CHECKING:
    from photomap_gis.mission_planner.survey import SurveySettings
    from photomap_gis.pipeline.search import SearchPlace

_OF_SURVEYS = (
    "corridor_width", "inset", "side_overlap", "angle", "crosshatch", "overshoot", "lead_in", "trigger_in_turns",
    "heading", "heading_tolerance", "tilt_tolerance", "height_tolerance", "gaps", "coarser_than", "older_than",
    "picture",
)  # fmt: skip
"""Options of coverage flights that mean nothing to a pattern."""
_OF_PATTERNS = (
    "datum", "radius", "sweep_width", "track_spacing", "coverage_factor", "first_leg", "passes",
)  # fmt: skip


def check_options(context: click.Context, pattern: str | None) -> None:
    """Refuse options that would be ignored."""
    for name in _OF_PATTERNS if pattern is None else _OF_SURVEYS:
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            option = f"--{name.replace('_', '-')}"
            raise UsageError(
                f"{option} needs a --pattern" if pattern is None else f"{option} means nothing to --pattern {pattern}"
            )


def plan_by_pattern(
    area: str | None, chosen: Mapping[str, Any], settings: SurveySettings, context: click.Context
) -> tuple[SurveyPlan, dict[str, Any]]:
    """Return the plan and what is told of it."""
    from photomap_gis.pipeline.plan import target_size_m
    from photomap_gis.pipeline.plan_report import plan_facts, search_facts, terrain_facts
    from photomap_gis.pipeline.search import over_terrain, plan_search

    place, zones, warnings = _places(area, chosen)
    request = search_request(
        chosen,
        settings.optics,
        height_m=settings.height_m,
        target_m=None if chosen["target"] is None else target_size_m(chosen["target"]),
        front_overlap=_told(context, "front_overlap", lambda percent: percent / 100.0),
        least_interval_s=settings.least_interval_s,
    )
    result = plan_search(
        place,
        request,
        settings.model,
        avoid=zones,
        home=settings.home,
        transit_height_m=settings.transit_height_m,
        endurance_s=settings.endurance_s,
        lands=settings.lands,
        zone_margin_m=settings.avoid_margin_m,
    )
    plan, facts = result.plan, search_facts(result)
    terrain = terrain_request(chosen, settings.height_m)
    if terrain is not None:
        plan, report = over_terrain(plan, terrain)
        facts |= terrain_facts(report, plan.gsd_m_per_px, settings.height_m)
    facts = plan_facts(plan) | facts | {"height_m": round(settings.height_m, 2)}
    if settings.home is None:
        facts["warnings"].append("no --home was given: take-off is planned where the pattern begins")
    facts["warnings"] = [*warnings, *facts["warnings"]]
    return plan, facts


def say_pattern(facts: Mapping[str, Any]) -> None:
    """Tell people what was planned and what it is worth."""
    pod = facts["pod"]
    click.echo(
        f"{facts['pattern']}: {len(facts['sorties'])} sorties, {facts['length_m'] / 1000:.2f} km, "
        f"{facts['duration_s'] / 60:.1f} min, {facts['photos']} photos at {100 * facts['gsd_m_per_px']:.2f} cm/px from "
        f"{facts['height_m']:.1f} m\n"
        f"sweep width {facts['sweep_width_m']:.1f} m, track spacing {facts['track_spacing_m']:.1f} m, coverage factor "
        f"{facts['coverage_factor']:.2f}: POD {100 * pod['random_search']:.0f} % (random search), "
        f"{100 * pod['inverse_cube']:.0f} % (inverse cube law); {100 * facts['covered_share']:.1f} % of the area swept",
        err=True,
    )
    for warning in facts["warnings"]:
        click.echo(f"warning: {warning}", err=True)


def _told(context: click.Context, name: str, value_of: Callable[[Any], float]) -> float | None:
    """The option's value where the user gave one: its default is that of coverage flights."""
    given = context.get_parameter_source(name) is ParameterSource.COMMANDLINE
    return value_of(context.params[name]) if given else None


def _places(area: str | None, chosen: Mapping[str, Any]) -> tuple[SearchPlace, tuple[GeoPolygon, ...], tuple[str, ...]]:
    from photomap_gis.mission_planner.area import geo_polygons, survey_area
    from photomap_gis.mission_planner.places import read_places
    from photomap_gis.pipeline.search import SearchPlace

    datum = None if chosen["datum"] is None else lat_lon(chosen["datum"], "--datum")
    zones = tuple(polygon for text in chosen["avoid"] for polygon in read_places(text).polygons)
    if area is None:
        return SearchPlace(datum=datum), zones, ()
    places = read_places(area)
    if not places.polygons:
        return SearchPlace(datum=datum, line=places.line), zones, ()
    sound = survey_area(places.polygons, zones)
    polygons = geo_polygons(sound.frame, sound.area)
    return SearchPlace(datum, polygons, places.line), geo_polygons(sound.frame, sound.avoid), sound.warnings
