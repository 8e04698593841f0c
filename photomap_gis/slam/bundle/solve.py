"""The full solution: Gauss-Newton over all views, the lens and the spots, the ground renewed in between."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from photomap_gis.core.camera import Camera
from photomap_gis.core.ground import HeightField
from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.bundle.certainty import Surface, certainty
from photomap_gis.slam.bundle.equations import (
    Reduced,
    SpotPrior,
    prior_cost,
    reduced_equations,
    runs_of,
    spots_settled,
)
from photomap_gis.slam.bundle.ground import fit_ground
from photomap_gis.slam.bundle.layout import Layout
from photomap_gis.slam.bundle.marks import MarkTerms, mark_terms
from photomap_gis.slam.bundle.model import Linearised, cameras_of, linearise, residuals, sight
from photomap_gis.slam.bundle.normal import Normal
from photomap_gis.slam.bundle.problem import BundleProblem, BundleState, exp_rotation, log_rotation

FIRST_RELIEF = 0.03
"""Before looking, the ground may lie off its middle level by this share of the flying height."""
LEAST_RELIEF = 0.001
ROUNDS, LEVEL_ROUNDS = 9, 2
"""In the first rounds the ground counts as level, roughly: a lens that is off bends it like a bowl, and the bowl would
be believed."""
FIRST_STEPS, STEPS, LAST_STEPS = 4, 1, 2
"""Steps of the first round, of those in between, where the ground is renewed after every one, and of the last."""
LIMIT = 2.0
"""Ties this many sigmas off count a quarter."""
SETTLED = 0.3
"""A step is small that gains less than this of the weighted squares: nothing that any sigma would show."""
LENGTHS = (1.0, 0.5, 0.25)
"""Of a step these shares are tried."""
SETTLED_ROUND = 0.2
"""Another round is of no use where the last moved no camera by more than this share of a pixel against the others."""
OBSERVABLE = 0.5
"""A lens number is released where the flight makes it so much surer than it was."""
TOLD_APART = 2.0
"""It is taken where it came out by so many of its sigmas off what was known."""
HELD_ROUNDS = 3
"""Rounds after lens numbers were put back."""
CELLS_A_FOOTPRINT = 4.0
RELIEF_TAIL = 4.0
LEVEL_SIGMA, SLOPE_SIGMA = 1e-3, 0.1
INDEPENDENT, CAUTIOUS = 32.0, 8.0
"""Ties of one pair that count as independent: in what is claimed of cameras and ground (fitted to rendered flights),
and where it is decided whether the lens is another than was known."""
MOUNT_SPREAD = 3.0
"""A mount may lean by so many times what a frame leans besides."""
LEVEL_BOWL, FREE_BOWL = 0.002, 0.05
"""How far the ground's surface may bow, as a share of its reach, before and after the lens is known."""
KNOWN_SHAPE = 5e-4
"""How far a ground of known heights may slope or bow besides."""
LARGE = 500
"""Views from which on threads of BLAS are worth their waiting."""
MOST_BYTES = 3 << 30
"""Equations that need more memory are not put up."""
DAMPINGS = (0.0, 1e-4, 1e-2, 1.0, 100.0)


@dataclass(frozen=True, slots=True)
class LensFound:
    """What the flight says of a lens: prior and posterior sigmas of log focal length and k1, and what was released."""

    camera: Camera
    focal_sigma_log: float
    k1_sigma: float
    focal_observed: bool
    k1_observed: bool


@dataclass(frozen=True, slots=True, eq=False)
class Bundle:
    """The full solution: ``centre`` ``(N, 3)`` (z down), ``R_map_camera`` ``(N, 3, 3)``, ``(N, 6, 6)`` covariances.

    ``ground`` is the surface; ``rms_before_px`` and ``rms_px`` are robust means of what ties were off under the start
    and are now, in raster pixels. ``kept`` is the share of ties that count. ``over_ground`` ``(N, 6, 6)`` is what the
    map's pixels have of the covariance: where cameras and the ground under them err together no pixel moves. ``joint``
    and ``joint_over_ground`` ``(6 N, 6 N)`` are those of all cameras together, where they were asked for.
    """

    centre: FloatArray
    R_map_camera: FloatArray
    covariance: FloatArray
    over_ground: FloatArray
    lenses: tuple[LensFound, ...]
    ground: HeightField
    rms_before_px: float
    rms_px: float
    kept: float
    joint: FloatArray | None = None
    joint_over_ground: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _At:
    """The ties at a state, the information that each is granted, and its weight (0..1) in that."""

    found: Linearised
    information: FloatArray
    weight: FloatArray


def bundle_adjust(problem: BundleProblem, *, joint: bool = False) -> Bundle:
    """Return the full solution of a problem whose views are near the truth already.

    ``joint`` asks for the covariance of all cameras together too. Raises ``numpy.linalg.LinAlgError`` where the problem
    has no single answer, or is too large to look for it.
    """
    # threads of BLAS spin while they wait for each other: on small systems that is most of the time
    with threadpool_limits(1 if len(problem.views) < LARGE else None, user_api="blas"):
        return _adjusted(problem, joint)


@dataclass(frozen=True, slots=True, eq=False)
class _Stage:
    """Where the solution is: the problem with its mounts, the state, the ground under it, and what was last solved."""

    layout: Layout
    problem: BundleProblem
    state: BundleState
    ground: HeightField
    at: _At
    prior: SpotPrior


def _adjusted(asked: BundleProblem, joint: bool) -> Bundle:
    start = BundleState.start(asked)
    problem = _with_mounts(asked, start)
    height = float(np.median(-start.centre[:, 2]))
    ground = replace(_on_level(problem, start), sigma=FIRST_RELIEF * height)
    before = _rms(*residuals(problem, start))
    level = _spot_prior(problem, start, ground, bowl=LEVEL_BOWL)
    none = np.zeros((len(problem.lenses), 2), bool)
    layout = Layout.of(problem, level.bends.shape[1])
    if layout.bytes > MOST_BYTES:
        raise np.linalg.LinAlgError(f"too many frames show the same ground: it would take {layout.bytes / 1e9:.1f} GB")
    state, at, _ = _descend(layout, problem, start, level, none, ground, FIRST_STEPS)
    free = _observable(layout, problem, state, at, level)
    stage = _Stage(layout, _with_mounts(asked, state), _levelled_off(problem, state), ground, at, level)
    stage = _rounds(asked, stage, free, ROUNDS, level=LEVEL_ROUNDS)
    taken = free & _told_apart(stage, free)
    if (taken != free).any():
        stage = _rounds(asked, replace(stage, state=_lenses_held(stage, taken)), taken, HELD_ROUNDS, level=0)
    problem = stage.problem
    surface = Surface.over(_spots_xy(problem, stage.state))
    prior = _spot_prior(problem, stage.state, stage.ground, bowl=FREE_BOWL)
    state, at, _ = _descend(layout, problem, stage.state, prior, taken, stage.ground, LAST_STEPS)
    state, ground = _sized(problem, state, stage.ground)
    # what a lens may still be off is part of every sigma, whether its number was taken or not
    believed = _believed(layout, problem, state, at, prior, free, ground, independent=INDEPENDENT)
    cameras, left_px = cameras_of(problem, state), _rms(at.found.residual, at.found.valid)
    gsd = float(np.median(-state.centre[:, 2] / np.exp(state.log_focal)[problem.lens_of]))
    sure = certainty(
        believed, state, cameras, problem.lens_of, ground, surface, free, misfit=left_px * gsd, joint=joint
    )
    return Bundle(
        state.centre,
        state.R,
        sure.poses,
        sure.over_ground,
        tuple(_lens_found(problem, state, free, sure.lens)),
        ground,
        before,
        left_px,
        float(np.mean(at.weight > 0.5)),
        sure.joint,
        sure.joint_over_ground,
    )


def _rounds(asked: BundleProblem, stage: _Stage, free: np.ndarray, count: int, *, level: int) -> _Stage:
    """Solve, and renew mounts and ground, ``count`` times or until nothing moves; the first ``level`` keep the ground.

    ``free`` ``(L, 2)`` are the lens numbers that may change.
    """
    problem, state, ground, at, prior = stage.problem, stage.state, stage.ground, stage.at, stage.prior
    height = float(np.median(-state.centre[:, 2]))
    gsd = height / float(np.median([lens.focal_px for lens in problem.lenses]))
    for round_ in range(1, count):
        came_from = state.centre
        prior = _spot_prior(problem, state, ground, bowl=LEVEL_BOWL if round_ <= level else FREE_BOWL)
        state, at, equations = _descend(stage.layout, problem, state, prior, free, ground, STEPS)
        problem = _with_mounts(asked, state)
        state = _levelled_off(problem, state)
        if round_ < level:
            continue
        spot_sigma = 1.0 / np.sqrt(np.maximum(equations.spot_information - prior.information, 1e-12))
        ground = _ground_of(problem, state, spot_sigma, height, gsd)
        ground = replace(ground, sigma=max(ground.sigma, LEAST_RELIEF * height))
        moved = (state.centre - came_from)[:, :2]
        if np.abs(moved - np.median(moved, axis=0)).max() < SETTLED_ROUND * gsd:
            break
    return _Stage(stage.layout, problem, state, ground, at, prior)


def _told_apart(stage: _Stage, free: np.ndarray) -> np.ndarray:
    """Return ``(L, 2)`` which lens numbers came out further from what was known than chance explains.

    The others are left as they were: a distortion of half its sigma bows the ground for nothing.
    """
    problem, state = stage.problem, stage.state
    try:
        sigma = _lens_sigmas(_believed(stage.layout, problem, state, stage.at, stage.prior, free, stage.ground))
    except np.linalg.LinAlgError:
        return np.zeros_like(free)
    focal = np.log([lens.focal_px for lens in problem.lenses])
    k1 = np.array([lens.camera.k1 for lens in problem.lenses])
    off = np.stack([state.log_focal - focal, state.k1 - k1], axis=1)
    return np.asarray(np.abs(off) > TOLD_APART * sigma)


def _lenses_held(stage: _Stage, taken: np.ndarray) -> BundleState:
    """Return the state, lens numbers that are not ``taken`` as they were known."""
    problem, state = stage.problem, stage.state
    focal = np.log([lens.focal_px for lens in problem.lenses])
    k1 = np.array([lens.camera.k1 for lens in problem.lenses])
    return replace(
        state,
        log_focal=np.where(taken[:, 0], state.log_focal, focal),
        k1=np.where(taken[:, 1], state.k1, k1),
    )


def _descend(
    layout: Layout,
    problem: BundleProblem,
    state: BundleState,
    prior: SpotPrior,
    free: np.ndarray,
    ground: HeightField,
    steps: int,
) -> tuple[BundleState, _At, Reduced]:
    def equations_at(state: BundleState, at: _At) -> Reduced:
        marked = _marked(problem, state, ground)
        return reduced_equations(layout, problem, state, at.found, at.information, prior, free, marked)

    def cost_at(state: BundleState, at: _At) -> float:
        marked = _marked(problem, state, ground)
        return _cost(problem, state, at, prior) + (0.0 if marked is None else marked.cost)

    at = _look(problem, state)
    equations = equations_at(state, at)
    for _ in range(steps):
        value = cost_at(state, at)
        solved, best, least = False, state, value
        for damping in DAMPINGS:
            try:
                step = equations.normal.step(damping)
            except np.linalg.LinAlgError:
                continue
            solved, spots = True, equations.spots_for(problem, step)
            for length in LENGTHS:
                moved = spots_settled(problem, state.moved(length * step, length * spots), at.information, prior)
                if (cost := cost_at(moved, at)) < value:
                    best, least = moved, cost
                    break
            if least < value:
                break
        if not solved:
            raise np.linalg.LinAlgError("the full solution has no single answer")
        if value - least < SETTLED:
            break  # it gets no better
        state, at = best, _look(problem, best)
        equations = equations_at(state, at)
    return state, at, equations


def _marked(problem: BundleProblem, state: BundleState, ground: HeightField) -> MarkTerms | None:
    if not len(problem.marks):
        return None
    return mark_terms(problem.marks, state, cameras_of(problem, state), problem.lens_of, ground)


def _look(problem: BundleProblem, state: BundleState) -> _At:
    """Linearise, and weigh the ties by how far they are off: their common scale is taken from the flight."""
    found = linearise(problem, state)
    plain = problem.ties.information
    squared = np.einsum("mi,mij,mj->m", found.residual, plain, found.residual)
    scale2 = max(float(np.median(squared[found.valid])) / 1.386, 1.0) if found.valid.any() else 1.0
    weight = np.where(found.valid, 1.0 / (1.0 + squared / scale2 / LIMIT**2) ** 2, 0.0)
    return _At(found, plain * (weight / scale2)[:, None, None], weight)


def _cost(problem: BundleProblem, state: BundleState, at: _At, prior: SpotPrior) -> float:
    """Return the weighted squares at a state, by the weights of another nearby."""
    residual, valid = residuals(problem, state)
    r = np.where(valid[:, None], residual, 1e3)
    return float(np.einsum("mi,mij,mj->", r, at.information, r)) + prior_cost(problem, state, prior)


def _spot_prior(problem: BundleProblem, state: BundleState, ground: HeightField, *, bowl: float) -> SpotPrior:
    """Return the ground as a prior of the spots; one far off (a roof, a crown) is held by little.

    The whole surface may rise, slope and bow (by ``bowl`` times its reach) besides.
    """
    xy, relief = _spots_xy(problem, state), ground.sigma
    z = -ground.at(xy)
    off2 = ((state.z - z) / relief) ** 2
    lens = np.zeros(problem.ties.spots, np.intp)
    lens[problem.ties.spot] = problem.lens_of[problem.ties.b]
    if not len(xy):
        return SpotPrior(z, z, np.zeros((0, 0)), np.zeros(0), lens, state.log_focal)
    surface = Surface.over(xy)
    slope, bowl = (SLOPE_SIGMA, bowl) if problem.terrain is None else (KNOWN_SHAPE, KNOWN_SHAPE)
    sigma = surface.reach * np.array([LEVEL_SIGMA, slope, slope, bowl, bowl, bowl])
    return SpotPrior(z, relief**-2.0 / (1.0 + off2 / RELIEF_TAIL) ** 2, surface.bends(xy), sigma, lens, state.log_focal)


def _with_mounts(problem: BundleProblem, state: BundleState) -> BundleProblem:
    """Return the problem with its cameras expected to lean as those of their lens do on the whole.

    A mount that looks ahead does so in every frame: strips flown to and fro tell it from sloping ground.
    """
    views = list(problem.views)
    for lens in range(len(problem.lenses)):
        of = [k for k, v in enumerate(views) if v.lens == lens]
        expected = np.array([views[k].R_prior for k in of])
        lean = np.mean(log_rotation(expected.transpose(0, 2, 1) @ state.R[of])[:, :2], axis=0)
        spread = float(np.median([views[k].tilt_sigma_rad for k in of]))
        mount = MOUNT_SPREAD * spread
        lean = lean * mount**2 / (mount**2 + spread**2 / len(of))
        turn = exp_rotation(np.array([[lean[0], lean[1], 0.0]]))[0]
        for k in of:
            views[k] = replace(views[k], R_prior=views[k].R_prior @ turn)
    return replace(problem, views=tuple(views))


def _sized(problem: BundleProblem, state: BundleState, ground: HeightField) -> tuple[BundleState, HeightField]:
    """Return world and ground as large as fixes and known points say, and where.

    That the ground is taken to be smooth favours a smaller world, in which all heights are smaller: a pull that only
    the world's size is loose enough to give way to, and that only this takes back.
    """
    marked = _marked(problem, state, ground)
    seen = np.zeros((0, 2)) if marked is None else problem.marks.xy_map + marked.residual
    here, there = state.centre[problem.fix_of, :2], problem.fix_xy
    known = np.concatenate([there, problem.marks.xy_map])
    if len(np.unique(known, axis=0)) < 2:
        return state, ground
    middle = np.concatenate([here, seen]).mean(axis=0)
    A, b = np.zeros((3, 3)), np.zeros(3)
    for axis in (0, 1):
        by = np.stack([np.full(len(here), axis == 0.0), np.full(len(here), axis == 1.0), here[:, axis] - middle[axis]])
        weighed = by @ problem.fix_noise.information
        A += weighed @ by.T
        b += weighed @ (there - here)[:, axis]
    if marked is not None:
        by_mark = np.concatenate([np.broadcast_to(np.eye(2), (len(seen), 2, 2)), (seen - middle)[:, :, None]], axis=2)
        weighed = marked.weigh(by_mark)
        A += np.einsum("kij,kil->jl", by_mark, weighed)
        b -= np.einsum("kij,ki->j", weighed, marked.residual)
    *shift, growth = np.linalg.solve(A, b)
    size = 1.0 + float(growth)
    centre = state.centre * size
    centre[:, :2] += middle * (1.0 - size) + shift
    x, y = np.asarray(ground.origin_xy) * size + middle * (1.0 - size) + shift
    grown = HeightField((float(x), float(y)), ground.cell * size, ground.up * size, ground.sigma * size)
    return replace(state, centre=centre, z=state.z * size), grown


def _spots_xy(problem: BundleProblem, state: BundleState) -> FloatArray:
    """``(P, 2)`` where the spots lie on the map."""
    out = np.zeros((problem.ties.spots, 2))
    out[problem.ties.spot] = sight(problem, state, cameras_of(problem, state)).spot[:, :2]
    return out


def _levelled_off(problem: BundleProblem, state: BundleState) -> BundleState:
    """Move the world so that the ground's middle level is 0: nothing else tells where heights begin."""
    middle = float(np.median(state.z)) if len(state.z) else 0.0
    return replace(state, z=state.z - middle, centre=state.centre - [0.0, 0.0, middle])


def _on_level(problem: BundleProblem, state: BundleState) -> HeightField:
    """Return the ground as far as it is known beforehand, raised so that the spots lie on it on the whole."""
    if problem.terrain is None or not len(state.z):
        return HeightField.level()
    off = -state.z - problem.terrain.at(_spots_xy(problem, state))
    return replace(problem.terrain, up=problem.terrain.up + float(np.median(off)))


def _ground_of(
    problem: BundleProblem, state: BundleState, spot_sigma: FloatArray, height: float, gsd: float
) -> HeightField:
    if problem.terrain is not None:
        return _on_terrain(problem, state, spot_sigma, height)
    camera = problem.lenses[0].camera
    cell = gsd * max(camera.width_px, camera.height_px) / CELLS_A_FOOTPRINT
    known = spot_sigma < 0.1 * height
    xy = _spots_xy(problem, state)
    return fit_ground(xy[known], -state.z[known], spot_sigma[known], cell)


def _on_terrain(problem: BundleProblem, state: BundleState, spot_sigma: FloatArray, height: float) -> HeightField:
    """Return the known ground at the level of the spots, and how far they lie off it, robustly."""
    ground = _on_level(problem, state)
    known = spot_sigma < 0.1 * height
    off = -state.z[known] - ground.at(_spots_xy(problem, state)[known])
    return replace(ground, sigma=1.4826 * float(np.median(np.abs(off))) if known.any() else height * FIRST_RELIEF)


def _believed(
    layout: Layout,
    problem: BundleProblem,
    state: BundleState,
    at: _At,
    prior: SpotPrior,
    free: np.ndarray,
    ground: HeightField,
    *,
    independent: float = CAUTIOUS,
) -> Normal:
    """Return the normal equations as far as they are to be believed.

    The ties of a pair share what is wrong with it (a lens's higher terms, a rolling shutter, leaves in the wind): they
    are as good as a few that share nothing.
    """
    pairs = len(runs_of(problem.ties.a, problem.ties.b))
    share = min(1.0, independent * pairs / max(len(problem.ties), 1))
    marked = _marked(problem, state, ground)
    return reduced_equations(layout, problem, state, at.found, share * at.information, prior, free, marked).normal


def _observable(layout: Layout, problem: BundleProblem, state: BundleState, at: _At, prior: SpotPrior) -> np.ndarray:
    """Return ``(L, 2)`` which lens numbers the flight tells better than was known."""
    free = np.ones((len(problem.lenses), 2), bool)
    try:
        sigma = _lens_sigmas(_believed(layout, problem, state, at, prior, free, HeightField.level()))
    except np.linalg.LinAlgError:
        return np.zeros_like(free)
    before = np.array([(lens.focal_sigma_log, lens.k1_sigma) for lens in problem.lenses])
    return np.asarray(sigma < OBSERVABLE * before)


def _lens_sigmas(normal: Normal) -> FloatArray:
    """Return ``(L, 2)`` posterior sigmas of the lens numbers; ``numpy.linalg.LinAlgError`` as ``Normal.step``."""
    shared, _ = normal.shared_covariance()
    return np.sqrt(np.diag(shared)[: 2 * normal.layout.border.lenses]).reshape(-1, 2)


def _lens_found(problem: BundleProblem, state: BundleState, free: np.ndarray, sigma: FloatArray) -> list[LensFound]:
    out = []
    for k, (lens, camera) in enumerate(zip(problem.lenses, cameras_of(problem, state), strict=True)):
        f = float(sigma[k, 0]) if free[k, 0] else lens.focal_sigma_log
        k1 = float(sigma[k, 1]) if free[k, 1] else lens.k1_sigma
        out.append(LensFound(camera, f, k1, bool(free[k, 0]), bool(free[k, 1])))
    return out


def _rms(residual: FloatArray, valid: np.ndarray) -> float:
    """Return a robust root mean square of the ties' residuals, per axis, in raster pixels."""
    return float(np.sqrt(np.median(np.sum(residual[valid] ** 2, axis=1)) / 1.386)) if valid.any() else float("nan")
