"""What a survey's pictures are sure to show of the ground that is there: footprints projected onto an elevation model.

A place is seen where the ray to it, from a camera as low as the tolerances let it be, lies within the directions that
are sure to be in the picture. Ground that hides other ground (overhangs, slopes steeper than the ray) is not looked
for: a camera that looks down sees past what is less steep than about 50 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from affine import Affine
from numpy.typing import NDArray
from rasterio import features
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.errors import DataError
from photomap_gis.core.plan import AltitudeFrame, SurveyPlan, WaypointRole
from photomap_gis.mission_planner.area import geo_polygons
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.optics import SureFootprint
from photomap_gis.mission_planner.proof import counted_shots, without_slivers
from photomap_gis.mission_planner.survey import Survey, SurveySettings
from photomap_gis.mission_planner.terrain.follow import Ground

FloatArray = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

_MOST_CELLS = 1_500_000
_MOST_LOOKS = 3e8
_NEAR_M = 0.5
_FEWEST_A_SIDE = 60
UNSEEN = "cannot be seen for sure"


@dataclass(frozen=True, slots=True)
class GroundProof:
    """What holds over the ground: nominal heights for GSD and overlaps, the worst of the tolerances for coverage."""

    cell_m: float
    """The raster in which coverage is counted."""
    height_range_m: tuple[float, float]
    """Lowest and highest camera above the places it shows, each place from its nearest picture."""
    front_overlap: float
    """Where the ground is highest below the camera; a share."""
    side_overlap: float
    least_height_m: float
    """The least of the camera above any place that it shows."""
    lowest_at: tuple[float, float]
    """(latitude, longitude) there."""


def prove_over_ground(
    survey: Survey,
    plan: SurveyPlan,
    ground: Ground,
    settings: SurveySettings,
    planned_share: float | None = None,
    on_progress: Progress = lambda stage, done, total: None,
) -> tuple[Survey, GroundProof]:
    """Return the survey with ``plan`` (bent to ``ground``) and what of its area is covered, and how well.

    ``settings`` are those whose tolerances must hold; the lanes may have been planned for ``planned_share`` as the
    height's tolerance. Where the model says nothing the ground counts as uncovered. Raises ``DataError`` where it says
    nothing of the whole area.
    """
    shots, headings = counted_shots(survey.lanes, survey.spacing)
    x, y, inside, cell = _raster(survey, ground, len(shots))
    frame = survey.area.frame
    elevation = np.full(inside.shape, np.nan)
    rows, cols = np.nonzero(inside)
    elevation[inside] = ground.elevation_m(frame.to_lat_lon(np.column_stack([x[cols], y[rows]])))
    if not np.isfinite(elevation).any():
        raise DataError("the elevation model says nothing of the area: give one that reaches there")
    below = ground.elevation_m(frame.to_lat_lon(shots))
    up = _altitudes(plan, frame, ground, shots)
    normals, unit, cross = _directions(survey.sure, settings, planned_share)
    reach = float(np.hypot(*survey.sure.ring.T).max()) + cross
    nearest = np.full(inside.shape, np.inf)
    closest, place = math.inf, 0
    for k, (at, heading) in enumerate(zip(shots, headings, strict=True)):
        if k % 200 == 0:
            on_progress("proof over the terrain", k, len(shots))
        over = up[k] - below[k]
        # Over lower ground a picture shows more, at most as far as the raster says that the ground goes down.
        wide = reach * max(1.0, (up[k] - float(np.nanmin(elevation))) / settings.height_m)
        cs = slice(*np.searchsorted(x, [at[0] - wide, at[0] + wide]))
        rs = slice(*np.searchsorted(y, [at[1] - wide, at[1] + wide]))
        here = elevation[rs, cs]
        if here.size == 0 or not math.isfinite(over):
            continue
        depth = up[k] - here
        low = depth - settings.tolerances.height_share * over
        c, s = math.cos(heading), math.sin(heading)
        dx, dy = x[cs][None, :] - at[0], y[rs][:, None] - at[1]
        across, along = dx * c - dy * s, dx * s + dy * c
        seen = np.isfinite(here) & (low > 0)
        for (nx, ny), d in zip(normals, unit, strict=True):
            seen &= nx * across + ny * along + cross <= d * low + 1e-6
        if seen.any():
            nearest[rs, cs][seen] = np.minimum(nearest[rs, cs][seen], depth[seen])
            least = float(depth[seen].min())
            if least < closest:
                closest, place = least, k
    on_progress("proof over the terrain", len(shots), len(shots))
    covered = np.isfinite(nearest)
    left = without_slivers(_polygons(inside & ~covered, x, y, cell).intersection(survey.area.target))
    share = float((inside & covered).sum() / inside.sum())
    heights = nearest[covered]
    ratio = settings.height_m / closest
    spacing = survey.spacing
    lat, lon = frame.to_lat_lon(shots[place])[0] if len(shots) else (math.nan, math.nan)
    proof = GroundProof(
        cell,
        (float(heights.min()), float(heights.max())) if heights.size else (settings.height_m, settings.height_m),
        max(0.0, 1.0 - (1.0 - spacing.front_overlap) * ratio),
        max(0.0, 1.0 - (1.0 - spacing.side_overlap) * ratio),
        closest if math.isfinite(closest) else settings.height_m,
        (round(float(lat), 7), round(float(lon), 7)),
    )
    warnings = [w for w in plan.warnings if UNSEEN not in w]
    if share < 1.0:
        unknown = inside & ~np.isfinite(elevation)
        words = f", {unknown.sum() * cell**2:.0f} m² of it outside of the elevation model" if unknown.any() else ""
        warnings.append(f"{left.area:.1f} m² {UNSEEN} over the terrain (see uncovered){words}")
    if proof.front_overlap < settings.front_overlap - 0.005 or proof.side_overlap < settings.side_overlap - 0.005:
        warnings.append(
            f"over the highest ground overlaps sink to {100 * proof.front_overlap:.0f} / "
            f"{100 * proof.side_overlap:.0f} % where {100 * settings.front_overlap:.0f} / "
            f"{100 * settings.side_overlap:.0f} % were asked for, the lowest at {lat:.6f}, {lon:.6f}: fly higher, or "
            "ask for more (--front-overlap, --side-overlap)"
        )
    told = replace(plan, covered_share=share, uncovered=geo_polygons(survey.area.frame, left), warnings=tuple(warnings))
    return replace(survey, plan=told, left=left), proof


def _raster(survey: Survey, ground: Ground, shots: int) -> tuple[FloatArray, FloatArray, NDArray[np.bool_], float]:
    """Cell centres ``x`` and ``y``, which of them lie in the area, and the cell's side."""
    target = survey.area.target
    west, south, east, north = target.bounds
    wide, high = east - west, north - south
    fine = min(ground.cell_m, survey.sure.half_width_m / 12.0, math.sqrt(target.area) / _FEWEST_A_SIDE)
    print_m2 = (2.0 * survey.sure.half_width_m) ** 2
    cell = max(fine, math.sqrt(wide * high / _MOST_CELLS), math.sqrt(shots * print_m2 / _MOST_LOOKS))
    while True:
        x = np.arange(west + cell / 2.0, east + cell / 2.0, cell)
        y = np.arange(south + cell / 2.0, north + cell / 2.0, cell)
        # rows go north here: only the sign of the raster's step says so
        inside = features.rasterize(
            [target], out_shape=(len(y), len(x)), transform=Affine(cell, 0.0, west, 0.0, cell, south), dtype="uint8"
        ).astype(bool)
        if inside.sum() >= 100 or len(x) * len(y) > _MOST_CELLS:
            break
        cell /= 2.0
    if not inside.any():  # thinner than can be counted
        inside = features.rasterize(
            [target], out_shape=(len(y), len(x)), transform=Affine(cell, 0.0, west, 0.0, cell, south),
            dtype="uint8", all_touched=True,
        ).astype(bool)  # fmt: skip
    return x, y, inside, cell


def _directions(
    sure: SureFootprint, settings: SurveySettings, planned_share: float | None
) -> tuple[FloatArray, FloatArray, float]:
    """The sure footprint as half planes ``n . q + cross <= d * depth``, ``depth`` the camera's least above a place."""
    share = settings.tolerances.height_share if planned_share is None else planned_share
    cross = settings.tolerances.cross_track_m
    ring = sure.ring if shapely.is_ccw(shapely.linearrings(sure.ring)) else sure.ring[::-1]
    edge = np.roll(ring, -1, axis=0) - ring
    length = np.hypot(*edge.T)
    keep = length > 1e-6
    normals = np.column_stack([edge[:, 1], -edge[:, 0]])[keep] / length[keep, None]
    reach = np.einsum("ij,ij->i", normals, ring[keep])
    return normals, (reach + cross) / (settings.height_m * (1.0 - share)), cross


def _altitudes(plan: SurveyPlan, frame: LocalFrame, ground: Ground, shots: FloatArray) -> FloatArray:
    """The camera's height above the model's zero at each shot: of all camera legs that run there the lowest."""
    legs: list[tuple[FloatArray, FloatArray, float, float]] = []
    for sortie in plan.sorties:
        xy = frame.to_xy([(w.lat_deg, w.lon_deg) for w in sortie.waypoints])
        for i, w in enumerate(sortie.waypoints):
            if w.role is WaypointRole.SURVEY:
                legs.append((xy[i], xy[i], w.alt_m, w.alt_m))
            if w.trigger is not None and not w.trigger.hover and i + 1 < len(xy):
                legs.append((xy[i], xy[i + 1], w.alt_m, sortie.waypoints[i + 1].alt_m))
    found = _lowest_leg(legs, shots)
    if plan.frame is AltitudeFrame.TERRAIN:
        return found + ground.elevation_m(frame.to_lat_lon(shots))
    home_m = float(ground.elevation_m([plan.home])[0]) if plan.home is not None else math.nan
    if plan.frame is AltitudeFrame.RELATIVE:
        return found + home_m
    return found - (float(plan.home_alt_amsl_m or 0.0) - home_m)


def _lowest_leg(legs: Sequence[tuple[FloatArray, FloatArray, float, float]], shots: FloatArray) -> FloatArray:
    a, b = np.array([g[0] for g in legs]), np.array([g[1] for g in legs])
    high = np.array([[g[2], g[3]] for g in legs])
    lines = np.where(np.hypot(*(b - a).T) > 1e-6, shapely.linestrings(np.stack([a, b], axis=1)), shapely.points(a))
    tree, points = shapely.STRtree(lines), shapely.points(shots)
    near = tree.query(points, predicate="dwithin", distance=_NEAR_M)
    lone = np.setdiff1d(np.arange(len(shots)), near[0])
    if len(lone):
        extra = tree.query_nearest(points[lone])
        near = np.hstack([near, np.vstack([lone[extra[0]], extra[1]])])
    shot, leg = near
    way = b[leg] - a[leg]
    t = np.einsum("ij,ij->i", shots[shot] - a[leg], way) / np.maximum(np.einsum("ij,ij->i", way, way), 1e-9)
    t = np.clip(t, 0.0, 1.0)
    found = np.full(len(shots), np.inf)
    np.minimum.at(found, shot, (1.0 - t) * high[leg, 0] + t * high[leg, 1])
    return found


def _polygons(mask: NDArray[np.bool_], x: FloatArray, y: FloatArray, cell: float) -> BaseGeometry:
    if not mask.any():
        return shapely.Polygon()
    place = Affine(cell, 0.0, float(x[0]) - cell / 2.0, 0.0, cell, float(y[0]) - cell / 2.0)
    shapes = features.shapes(mask.astype(np.uint8), mask=mask, transform=place)
    return shapely.make_valid(shapely.union_all([shapely.geometry.shape(g) for g, _ in shapes]))
