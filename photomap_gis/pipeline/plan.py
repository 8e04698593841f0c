"""The corridor of a survey: an area, a camera and what must be seen become flights with their proof."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from rasterio import features
from rasterio.transform import Affine
from rasterio.warp import transform_geom

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.grid import Window
from photomap_gis.core.plan import GeoPolygon
from photomap_gis.ingest.lenses import camera_for
from photomap_gis.ingest.stills import read_still
from photomap_gis.mission_planner.optics import Optics
from photomap_gis.mission_planner.survey import Survey
from photomap_gis.mosaic import TileStore
from photomap_gis.pipeline.plan_camera import LensNumbers, camera_optics, check_raster
from photomap_gis.pipeline.plan_report import plan_facts
from photomap_gis.pipeline.solved import Solved
from photomap_gis.store import Mission

TARGET_PX = 8.0
"""How many pixels the smaller side of a target must span to be told from clutter."""
TARGETS_M = {
    "card": (0.4, 0.3),  # the hazard card (ERI-card) of the ELROB paper
    "person": (0.5, 0.5),
    "vehicle": (4.5, 1.8),
}
_GAP_CELLS = 1500


def planned_camera(
    named: str | None, lens: LensNumbers, *, width_px: int | None = None, height_px: int | None = None
) -> Optics:
    """Return the optics of a photo that the camera took, of a known camera, or of numbers."""
    if named is None or not Path(named).is_file():
        return camera_optics(named, lens, width_px=width_px, height_px=height_px)
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


def gaps_of(
    folder: Path, *, area: Sequence[GeoPolygon], gsd_m: float | None = None, before_s: float | None = None
) -> tuple[GeoPolygon, ...]:
    """Return what a mission's map does not show of ``area`` (of the map's hull where none is given).

    Ground counts as shown where the map has pixels and a frame that is fine enough (``gsd_m``, metres a pixel) and not
    older than ``before_s`` (seconds since 1970) lies over it. Raises ``DataError`` where nothing is left to fly.
    """
    with Mission.open(folder) as mission:
        solved = Solved.load(mission)
        if not solved.georeferenced:
            raise DataError(f"{folder} has no place on Earth: a flight over its gaps cannot be planned")
        crs = solved.map_frame.crs_wkt
        shown = _shown(TileStore(mission.mosaic_folder()))
        if gsd_m is not None or before_s is not None:
            times = {f.index: f.time_s for f in solved.frames}
            good = [
                shapely.Polygon(solved.map_frame.to_crs(p.outline_xy_map_m())).buffer(0)
                for p in solved.trajectory.placements
                if (gsd_m is None or p.gsd_m_per_px <= 1.05 * gsd_m)
                and (before_s is None or (times.get(p.frame) or 0.0) >= before_s)
            ]
            shown = shown.intersection(shapely.union_all(good)) if good else shapely.Polygon()
        cell = TileStore(mission.mosaic_folder()).grid
        grain = max(cell.width, cell.height) * cell.pixel_size / _GAP_CELLS
        if area:
            shapes = [
                shapely.geometry.shape(transform_geom("EPSG:4326", crs, {"type": "Polygon", "coordinates": p.rings}))
                for p in area
            ]
            whole = shapely.union_all([shapely.make_valid(g) for g in shapes])
        else:
            whole = shapely.convex_hull(_shown(TileStore(mission.mosaic_folder())))
    gap = whole.difference(shown.buffer(-2.0 * grain)).buffer(-grain).buffer(3.0 * grain, join_style="mitre")
    gap = gap.intersection(whole).simplify(grain)
    parts = [p for p in shapely.get_parts(gap) if isinstance(p, shapely.Polygon) and p.area > 1.0]
    if not parts:
        raise DataError(f"{folder} shows all of the area already: there is no gap to fly")
    return tuple(
        GeoPolygon(tuple(tuple((float(x), float(y)) for x, y in ring) for ring in g["coordinates"]))
        for g in (transform_geom(crs, "EPSG:4326", shapely.geometry.mapping(p)) for p in parts)
    )


def _shown(store: TileStore) -> Any:
    """The ground that has pixels in the map, in its CRS, a cell a ``_GAP_CELLS``-th of its longer side."""
    grid = store.grid
    skip = max(1, math.ceil(max(grid.width, grid.height) / _GAP_CELLS))
    rows = [
        store.read(Window(0, top, grid.width, min(skip, grid.height - top)))[0, ::skip, 3] > 0
        for top in range(0, grid.height, skip)
    ]
    alpha = np.array(rows, np.uint8)
    size = grid.pixel_size * skip
    place = Affine(size, 0.0, grid.west, 0.0, -size, grid.north)
    found = [shapely.geometry.shape(g) for g, v in features.shapes(alpha, mask=alpha > 0, transform=place) if v]
    return shapely.union_all(found) if found else shapely.Polygon()
