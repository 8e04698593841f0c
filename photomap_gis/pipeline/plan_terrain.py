"""A survey over an elevation model: planned, bent to the ground, proved there, and planned wider where that shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from photomap_gis.core.errors import UsageError
from photomap_gis.mission_planner.area import SurveyArea
from photomap_gis.mission_planner.optics import Optics
from photomap_gis.mission_planner.survey import Survey, SurveySettings, plan_survey
from photomap_gis.mission_planner.terrain import TerrainReport, by_the_vehicles_terrain, follow_terrain, open_dem
from photomap_gis.mission_planner.terrain.proof import GroundProof, prove_over_ground
from photomap_gis.pipeline.search import TerrainRequest

Progress = Callable[[str, int, int], None]

_ROUNDS = 3
_MOST_SHARE = 0.5
"""Lanes are laid for cameras down to this share too low: beyond it the uncovered rest is told instead."""


def survey_over_terrain(
    area: SurveyArea, settings: SurveySettings, request: TerrainRequest, on_progress: Progress
) -> tuple[Survey, TerrainReport | None, GroundProof | None]:
    """Return the survey bent to the ground, with its proof there; the last two are None without a model.

    The camera comes lower over the ground than was asked: by the terrain's tolerance, and where ground rises towards a
    picture's edge. Lanes are laid for that, more so where the first proof leaves something out.
    """
    if request.dem is None:
        survey = plan_survey(area, settings, on_progress)
        return replace(survey, plan=by_the_vehicles_terrain(survey.plan)), None, None
    ground = open_dem(request.dem, request.vertical)
    tolerance = settings.tolerances.height_share
    share = 1.0 - (1.0 - tolerance) * (1.0 - request.settings.tolerance_m / settings.height_m)
    best: tuple[Survey, TerrainReport, GroundProof] | None = None
    for _ in range(_ROUNDS):
        share = min(share, max(_MOST_SHARE, tolerance))
        wider = replace(settings, tolerances=replace(settings.tolerances, height_share=share))
        try:
            flat = plan_survey(area, wider, on_progress)
        except UsageError:
            if best is None and share > tolerance:  # a small picture, or no battery for more: as without terrain
                share, wider = tolerance, settings
                flat = plan_survey(area, settings, on_progress)
            elif best is not None:
                break
            else:
                raise
        bent, report = follow_terrain(flat.plan, ground, request.settings, request.frame)
        survey, proof = prove_over_ground(flat, bent, ground, settings, share, on_progress)
        if best is None or survey.plan.covered_share > best[0].plan.covered_share:
            best = survey, report, proof
        needed = 1.0 - (1.0 - tolerance) * proof.least_height_m / settings.height_m
        if survey.plan.covered_share >= 1.0 or needed <= share + 0.005:
            break
        share = needed
    return best  # type: ignore[return-value]


def ground_facts(proof: GroundProof | None, optics: Optics) -> dict[str, Any]:
    """Return what holds over the ground, for the plan's document."""
    if proof is None:
        return {}
    return {
        "gsd_range_m_per_px": [optics.gsd_m_per_px(h) for h in proof.height_range_m],
        "overlap_over_terrain": {
            "front": round(proof.front_overlap, 4),
            "side": round(proof.side_overlap, 4),
            "at": list(proof.lowest_at),
        },
        "proof_cell_m": round(proof.cell_m, 3),
    }
