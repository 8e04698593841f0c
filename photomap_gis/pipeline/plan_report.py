"""A plan as the one JSON document that scripts read."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from photomap_gis.core.plan import GeoPolygon, SurveyPlan
from photomap_gis.mission_planner.terrain import TerrainReport
from photomap_gis.pipeline.search import SearchResult

Json = dict[str, Any]


def plan_facts(plan: SurveyPlan) -> Json:
    """Return the contract: waypoints, frame, proof, totals, sorties and warnings."""
    return {
        "pattern": plan.pattern,
        "waypoints": [[w.lat_deg, w.lon_deg, w.alt_m] for s in plan.sorties for w in s.waypoints],
        "frame": plan.frame.value,
        "covered_share": plan.covered_share,
        "uncovered": _multipolygon(plan.uncovered),
        "photos": sum(s.photos for s in plan.sorties),
        "length_m": round(sum(s.length_m for s in plan.sorties), 1),
        "duration_s": round(sum(s.duration_s for s in plan.sorties), 1),
        "gsd_m_per_px": plan.gsd_m_per_px,
        "home": list(plan.home) if plan.home else None,
        "home_alt_amsl_m": plan.home_alt_amsl_m,
        "sorties": [
            {
                "waypoints": [[w.lat_deg, w.lon_deg, w.alt_m] for w in s.waypoints],
                "photos": s.photos,
                "length_m": round(s.length_m, 1),
                "duration_s": round(s.duration_s, 1),
            }
            for s in plan.sorties
        ],
        "warnings": list(plan.warnings),
    }


def search_facts(result: SearchResult) -> Json:
    """Return what a search is worth, with the models that say so."""
    found = result.detection
    return {
        "sweep_width_m": round(found.sweep_width_m, 2),
        "track_spacing_m": round(found.track_spacing_m, 2),
        "area_searched_m2": round(result.area_searched_m2, 1),
        "coverage_factor": round(found.coverage_factor, 4),
        "pod": {
            "random_search": round(found.pod_random, 4),
            "inverse_cube": round(found.pod_inverse_cube, 4),
            "models": "random search: 1 - exp(-C) (Koopman); inverse cube law: erf(sqrt(pi)/2 C)",
        },
    }


def terrain_facts(report: TerrainReport | None, gsd_m_per_px: float, height_m: float) -> Json:
    """Return how high the flight is above the ground that is there, and the range of ``gsd_m_per_px`` for it."""
    if report is None:
        return {}
    per_metre = gsd_m_per_px / height_m
    return {
        "terrain": {k: v if isinstance(v, int) else _rounded(v) for k, v in asdict(report).items()},
        "gsd_range_m_per_px": [per_metre * report.lowest_survey_m, per_metre * report.highest_survey_m],
    }


def _rounded(value: float | tuple[float, ...]) -> float | list[float]:
    return round(value, 2) if isinstance(value, float) else [round(v, 2) for v in value]


def _multipolygon(polygons: tuple[GeoPolygon, ...]) -> Json | None:
    if not polygons:
        return None
    return {
        "type": "MultiPolygon",
        "coordinates": [[[[lon, lat] for lon, lat in ring] for ring in p.rings] for p in polygons],
    }
