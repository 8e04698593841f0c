"""The corridor of a survey: an area, a camera and what must be seen become flights with their proof."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.mission_planner.optics import Optics
from photomap_gis.mission_planner.survey import Survey
from photomap_gis.pipeline.plan_camera import LensNumbers, camera_optics, check_raster
from photomap_gis.pipeline.plan_report import plan_facts

TARGET_PX = 8.0
"""How many pixels the smaller side of a target must span to be told from clutter."""
TARGETS_M = {
    "card": (0.4, 0.3),  # the hazard card (ERI-card) of the ELROB paper
    "person": (0.5, 0.5),
    "vehicle": (4.5, 1.8),
}


def planned_camera(
    named: str | None, lens: LensNumbers, *, width_px: int | None = None, height_px: int | None = None
) -> Optics:
    """Return the optics of a photo that the camera took, of a known camera, or of numbers."""
    if named is None or not Path(named).is_file():
        return camera_optics(named, lens, width_px=width_px, height_px=height_px)
    from photomap_gis.ingest.lenses import camera_for  # a preview that names its camera starts without picture readers
    from photomap_gis.ingest.stills import read_still

    still = read_still(Path(named))
    check_raster(Path(named).name, (still.width_px, still.height_px), (width_px, height_px))
    camera = camera_for(still.width_px, still.height_px, still.lens)
    focal = lens.focal_px(camera.width_px, camera.height_px) or camera.focal_px
    if focal is None:
        raise DataError(f"{named} does not tell its lens: give --fov-deg, or --focal-mm and --sensor-width-mm, too")
    return Optics(camera.width_px, camera.height_px, focal, camera.name or Path(named).name)


def planned_height_m(
    optics: Optics, *, height_m: float | None = None, gsd_m: float | None = None, target: str | None = None
) -> float:
    """Return the height above ground for exactly one of height, ground sampling distance and target."""
    if sum(v is not None for v in (height_m, gsd_m, target)) != 1:
        raise UsageError("say how fine to look by one of --gsd, --height and --target")
    if height_m is not None:
        return height_m
    return optics.height_m(gsd_m if gsd_m is not None else target_size_m(str(target)) / TARGET_PX)


def target_size_m(text: str) -> float:
    """Return the smaller side of a target in metres: a word of ``TARGETS_M``, or ``0.4x0.3``."""
    key = text.strip().lower()
    if key in TARGETS_M:
        return min(TARGETS_M[key])
    try:
        sides = [float(v) for v in key.removesuffix("m").split("x")]
    except ValueError:
        sides = []
    if not 1 <= len(sides) <= 2 or not all(0.005 <= v <= 1000 for v in sides):
        raise UsageError(f"--target {text!r}: write {', '.join(TARGETS_M)}, or its size in metres as 0.4x0.3")
    return min(sides)


def survey_facts(survey: Survey, optics: Optics, height_m: float) -> dict[str, Any]:
    """Return the plan as the document that scripts read, with what a survey has besides."""
    return plan_facts(survey.plan) | {
        "camera": asdict(optics),
        "height_m": round(height_m, 2),
        "photo_spacing_m": survey.spacing.step_m,
        "lane_spacing_m": round(survey.spacing.lane_m, 2),
        "front_overlap": round(survey.spacing.front_overlap, 4),
        "side_overlap": round(survey.spacing.side_overlap, 4),
        "sweep_deg": list(survey.headings_deg),
        "lanes": sum(not lane.spot for lane in survey.lanes),
        "single_photos": sum(lane.spot for lane in survey.lanes),
        "speed_m_s": round(survey.ground_speed_m_s, 2),
        "area_m2": round(survey.area.target.area, 1),
    }
