"""From the flat solution to the full one: cameras posed in space over the ground, where ties and lenses allow it."""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.frame import FrameRef, level_rotation
from photomap_gis.core.ground import HeightField
from photomap_gis.core.placement import FramePlacement, PlanePlacement, PosedPlacement
from photomap_gis.core.posegraph import PointObservation, PositionObservation, Solution, Trajectory
from photomap_gis.core.similarity import FloatArray
from photomap_gis.georef import HEIGHT_SIGMA_M, HEIGHT_SIGMA_REL, MIN_HEIGHT_M, observe, predicted_ce90_m
from photomap_gis.ifmi.template import GRID
from photomap_gis.pipeline.measure import Measurements
from photomap_gis.pipeline.solve import whole_lags
from photomap_gis.pipeline.solved import Solved
from photomap_gis.slam.bundle import Bundle, BundleProblem, Lens, Marks, TieSet, View, bundle_adjust
from photomap_gis.slam.bundle.fixes import FixNoise, fix_noise
from photomap_gis.slam.lag import lags_by_flight, without_lag
from photomap_gis.slam.optimize import BIAS_LIMIT
from photomap_gis.slam.place import GPS_METHOD
from photomap_gis.store import LensRecord, PreparedFrame, RegistrationRecord

logger = logging.getLogger(__name__)

FEWEST_FRAMES = 3
MOST_FRAMES = 5000
"""The slices of the equations grow with the map's shorter side: beyond this they might no longer fit a laptop."""
TIES, TIES_A_FRAME, MOST_TIES = 30_000, 150, 150_000
"""Ties that are enough, those a frame where there are many frames, and those that are never exceeded."""
UNKNOWN_TILT_RAD = 0.07
"""A camera that does not say how it leans looks down to within some four degrees."""
MIN_TIE_SIGMA_WORK_PX = 0.03
SPOT_STEP = 1 << 20
BLUNDERS_INFORMATION = 1e-3
LEAST_PLACE_SIGMA_M = 1e-4
K1_SIGMA = 0.03
KNOWN_K1_SIGMA = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class _Start:
    """A frame as the flat solution has it."""

    ref: FrameRef
    camera: Camera
    placement: FramePlacement
    view: View


def solve_in_space(
    frames: Sequence[FrameRef],
    views: Mapping[int, PlaneView],
    measurements: Measurements,
    solved: Solved,
    *,
    antenna_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    terrain: HeightField | None = None,
    adjust: Callable[[BundleProblem], Bundle] = bundle_adjust,
) -> Solved:
    """Return the solution with its registered frames posed in space; as it was where that cannot be told.

    ``views`` are those that the frames were registered through, ``antenna_offset_m`` as in ``georef.observe``;
    ``terrain`` is the ground's shape where it is known; ``adjust`` solves the problem that is put up.
    """
    starts = _starts({f.index: f for f in frames}, solved)
    records = [r for r in measurements.accepted if r.ties is not None and r.a in starts and r.b in starts]
    order = sorted({f for r in records for f in (r.a, r.b)})
    if not FEWEST_FRAMES <= len(order) <= MOST_FRAMES:
        return solved
    node = {f: k for k, f in enumerate(order)}
    ties = _tie_set(records, node, views, measurements.prepared)
    fixes: tuple[PositionObservation, ...] = ()
    if solved.georeferenced:
        placed = [starts[f].ref for f in order]
        fixes = observe(placed, solved.map_frame, of_cameras=True, antenna_offset_m=antenna_offset_m).positions
    points = _used_points(solved, node)
    if points:
        fixes = _as_biased_as_shown(fixes, starts)
    problem = replace(_problem([starts[f] for f in order], node, ties, fixes, points), terrain=terrain)
    try:
        bundle = adjust(problem)
        if solved.solution is not None and solved.solution.fix_lags_s:
            # a camera that looks ahead looks like a late fix on the plane; in space they are told apart
            solved, fixes = _in_time(solved, solved.solution, bundle, node, fixes)
            problem = replace(_problem([starts[f] for f in order], node, ties, fixes, points), terrain=terrain)
            bundle = adjust(problem)
    except np.linalg.LinAlgError as error:
        logger.warning("cameras could not be posed in space (%s): the flat solution stands", error)
        return solved
    logger.info("ties off by %.3f px before, %.3f px after", bundle.rms_before_px, bundle.rms_px)
    if not bundle.rms_px < bundle.rms_before_px:
        return solved
    return _posed(solved, bundle, problem, node)


def _in_time(
    solved: Solved,
    solution: Solution,
    bundle: Bundle,
    node: Mapping[int, int],
    fixes: tuple[PositionObservation, ...],
) -> tuple[Solved, tuple[PositionObservation, ...]]:
    """Return the solution with the lags that the cameras' path in space tells, and the fixes freed of them."""
    moved = {f: bundle.centre[k] for f, k in node.items()}
    path = replace(
        solution,
        poses=tuple(
            replace(p, T_map_plane=replace(p.T_map_plane, tx=float(moved[p.frame][0]), ty=float(moved[p.frame][1])))
            for p in solution.poses
            if p.frame in moved
        ),
    )
    lags = lags_by_flight(path, fixes)
    believed = {flight: lag.lag_s for flight, lag in lags.items() if lag.believed}
    return replace(solved, fix_lags=whole_lags(lags, solved.track_shifts_s)), without_lag(path, fixes, believed)


def _starts(refs: Mapping[int, FrameRef], solved: Solved) -> dict[int, _Start]:
    """Return the frames that have a focal length and hang on registrations, as views in space."""
    lenses: dict[Camera, int] = {}
    pressed = [p for p in solved.trajectory.placements if p.method != GPS_METHOD]
    told = Counter(refs[p.frame].flight for p in pressed if refs[p.frame].height_m is not None)
    out = {}
    for p in pressed:
        ref, where = refs[p.frame], p.camera_to_map
        if not isinstance(where, PlanePlacement) or where.view.camera.focal_px is None:
            continue
        camera, T, focal = where.view.camera, where.T_map_plane, where.view.camera.focal_px
        lens = lenses.setdefault(camera, len(lenses))
        heading = _about_down(T.angle_rad)
        prior, tilt = heading, UNKNOWN_TILT_RAD
        if ref.attitude is not None:
            prior, tilt = heading @ level_rotation(ref.attitude.R_ned_camera), ref.attitude.sigma_tilt_rad
        height, sigma = np.nan, np.nan
        if solved.georeferenced and ref.height_m is not None and ref.height_m >= MIN_HEIGHT_M:
            # a flight's heights share one error: take-off is not the ground below
            height = ref.height_m
            sigma = float(np.hypot(HEIGHT_SIGMA_REL * height, HEIGHT_SIGMA_M) * np.sqrt(told[ref.flight]))
        centre = np.array([T.tx, T.ty, -T.scale * focal])
        R = heading @ where.view.R_level_camera
        view = View(ref.index, lens, centre, R, prior, tilt, height=height, height_sigma=sigma)
        out[ref.index] = _Start(ref, camera, p, view)
    return out


def _problem(
    starts: Sequence[_Start],
    node: Mapping[int, int],
    ties: TieSet,
    fixes: Sequence[PositionObservation],
    points: Sequence[PointObservation],
) -> BundleProblem:
    views = tuple(s.view for s in starts)
    lenses: dict[int, Lens] = {}
    for s in starts:
        camera = s.camera
        k1_sigma = KNOWN_K1_SIGMA if camera.is_distorted else K1_SIGMA
        lenses.setdefault(s.view.lens, Lens(camera, max(camera.focal_sigma_rel, 1e-4), k1_sigma))
    number = {lens: k for k, lens in enumerate(sorted(lenses))}
    views = tuple(replace(v, lens=number[v.lens]) for v in views)
    used = [o for o in fixes if o.frame in node]
    fix_of = np.array([node[o.frame] for o in used], np.intp)
    centres = np.array([v.centre[:2] for v in views])
    noise = fix_noise(used, centres[fix_of]) if used else FixNoise.none()
    pieces = {s.placement.segment for s in starts}
    fixed = {starts[k].placement.segment for k in fix_of.tolist()}
    seen: dict[int, set[tuple[float, ...]]] = {}
    for p in points:
        seen.setdefault(starts[node[p.frame]].placement.segment, set()).add(tuple(p.xy_map_m))
    fixed |= {piece for piece, places in seen.items() if len(places) >= 2}
    held = [next(k for k, s in enumerate(starts) if s.placement.segment == piece) for piece in sorted(pieces - fixed)]
    return BundleProblem(
        views,
        tuple(lenses[k] for k in sorted(lenses)),
        ties,
        fix_of,
        np.array([o.xy_map_m for o in used]).reshape(-1, 2),
        noise,
        np.array(held, np.intp),
        _marks(points, node, views, lenses, number),
    )


def _as_biased_as_shown(
    fixes: Sequence[PositionObservation], starts: Mapping[int, _Start]
) -> tuple[PositionObservation, ...]:
    """Return the fixes, those of a flight that known points contradict with as large a bias as the flat solution shows.

    The flat solution has learnt it; a receiver that is metres off must not pull the full one either.
    """
    off: dict[int, list[FloatArray]] = {}
    for o in fixes:
        off.setdefault(o.flight, []).append(o.xy_map_m - starts[o.frame].view.centre[:2])
    shown_m = {flight: float(np.hypot(*np.median(misses, axis=0))) for flight, misses in off.items()}
    out = []
    for o in fixes:
        shown = shown_m[o.flight]
        contradicted = 0.0 < BIAS_LIMIT * o.bias_sigma_m < shown
        out.append(replace(o, bias_sigma_m=shown / math.sqrt(2.0)) if contradicted else o)
    return tuple(out)


def _used_points(solved: Solved, node: Mapping[int, int]) -> list[PointObservation]:
    """Return the known points that the flat solution was held by, in frames that are posed."""
    aside = set() if solved.solution is None else set(solved.solution.rejected_points)
    return [p for k, p in enumerate(solved.points) if not p.check and k not in aside and p.frame in node]


def _marks(
    points: Sequence[PointObservation],
    node: Mapping[int, int],
    views: Sequence[View],
    lenses: Mapping[int, Lens],
    number: Mapping[int, int],
) -> Marks:
    """Return known points as marks: sightings of one point share the error of its place.

    What a plane leaves out of a sighting is no error in space.
    """
    if not points:
        return Marks.none()
    focal = {number[k]: lens.focal_px for k, lens in lenses.items()}
    view = np.array([node[p.frame] for p in points], np.intp)
    seen = Counter((p.kind, p.name) for p in points if p.name)
    shared = {key: g for g, key in enumerate(key for key, count in seen.items() if count > 1)}
    place = np.zeros((len(shared), 2, 2))
    group = np.full(len(points), -1, np.intp)
    covariance = np.zeros((len(points), 2, 2))
    for i, p in enumerate(points):
        pixel = -float(views[view[i]].centre[2]) / focal[views[view[i]].lens]
        click_px2 = max(p.sigma_px**2 - p.bend_px**2, MIN_TIE_SIGMA_WORK_PX**2)
        covariance[i] = click_px2 * pixel**2 * np.eye(2)
        if (g := shared.get((p.kind, p.name), -1)) < 0:
            covariance[i] += p.covariance_m2
        else:
            group[i], place[g] = g, p.covariance_m2 + LEAST_PLACE_SIGMA_M**2 * np.eye(2)
    return Marks(view, np.array([p.xy_px for p in points]), np.array([p.xy_map_m for p in points]), covariance, group,
                 place)  # fmt: skip


def _tie_set(
    records: Sequence[RegistrationRecord],
    node: Mapping[int, int],
    views: Mapping[int, PlaneView],
    prepared: Mapping[int, PreparedFrame],
) -> TieSet:
    """Return all ties in raster pixels, anchor by anchor; of very many, the same part of the places of every frame."""
    total = sum(len(r.registration.ties or ()) for r in records)
    stride = max(1, math.ceil(total / min(max(TIES, TIES_A_FRAME * len(node)), MOST_TIES)))
    parts = []
    for r in sorted(records, key=lambda r: (node[r.b], node[r.a])):
        ties = r.registration.ties
        if ties is None:
            continue
        use = (ties.place // GRID + 2 * (ties.place % GRID)) % stride == 0
        xy_a = views[r.a].to_pixel(prepared[r.a].T_plane_work.apply(ties.xy_a_px[use]))
        xy_b = views[r.b].to_pixel(prepared[r.b].T_plane_work.apply(ties.xy_b_px[use]))
        zoom = prepared[r.a].T_plane_work.scale
        xx, xy, yy = ties.covariance_a_px2[use].T * zoom**2
        covariance = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
        covariance += (MIN_TIE_SIGMA_WORK_PX * zoom) ** 2 * np.eye(2)
        finite = np.isfinite(np.concatenate([xy_a, xy_b, covariance.reshape(-1, 4)], axis=1)).all(axis=1)
        a, b = np.full(finite.sum(), node[r.a]), np.full(finite.sum(), node[r.b])
        parts.append((a, b, xy_a[finite], xy_b[finite], covariance[finite], ties.place[use][finite]))
    a, b, xy_a, xy_b, covariance, place = (np.concatenate(column) for column in zip(*parts, strict=True))
    spot = np.unique(b * SPOT_STEP + place, return_inverse=True)[1]
    return TieSet(a.astype(np.intp), b.astype(np.intp), xy_a, xy_b, covariance, spot.astype(np.intp))


def _posed(solved: Solved, bundle: Bundle, problem: BundleProblem, node: Mapping[int, int]) -> Solved:
    placements = []
    for p in solved.trajectory.placements:
        k = node.get(p.frame)
        if k is None:
            placements.append(p)
            continue
        x, y, z = bundle.centre[k]
        camera = bundle.lenses[problem.views[k].lens].camera
        where = PosedPlacement(camera, np.array([x, y, -z]), bundle.R_map_camera[k], bundle.ground)
        placements.append(replace(p, camera_to_map=where, pose_covariance=bundle.over_ground[k]))
    trajectory = Trajectory(tuple(placements), solved.trajectory.revision)
    predicted = predicted_ce90_m(trajectory) if solved.georeferenced else None
    lenses = tuple(
        LensRecord(
            found.camera.name, found.camera.focal_px or 0.0, lens.focal_px, found.focal_sigma_log, found.focal_observed,
            found.camera.k1, lens.camera.k1, found.k1_sigma, found.k1_observed,
        )
        for found, lens in zip(bundle.lenses, problem.lenses, strict=True)
    )  # fmt: skip
    return replace(
        solved,
        trajectory=trajectory,
        predicted_ce90_m=predicted,
        lenses=lenses,
        fit_to_gps_rms_m=_fit_to_gps(bundle, problem),
    )


def _fit_to_gps(bundle: Bundle, problem: BundleProblem) -> float | None:
    """Horizontal RMS of the cameras against their fixes, blunders left out: a residual, never an accuracy."""
    if not len(problem.fix_of):
        return None
    information = np.diag(problem.fix_noise.information)
    used = information > BLUNDERS_INFORMATION * float(np.median(information))
    off = bundle.centre[problem.fix_of, :2] - problem.fix_xy
    return float(np.sqrt(np.mean(np.sum(off[used] ** 2, axis=1))))


def _about_down(angle_rad: float) -> FloatArray:
    """``(3, 3)`` turn about the vertical, x towards y."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
