"""Flights of known truth, as the solver sees them: registrations with honest covariances, fixes, heights, headings.

Nothing here has pixels: a registration is the closest similarity of what two pinhole cameras see of flat ground, plus
noise that its covariance describes. The noise is deliberately not what the solver takes for granted (``GPS``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from photomap_gis.core.camera import Camera
from photomap_gis.core.frame import Attitude, FrameRef, GpsFix
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.measurement import Registration
from photomap_gis.core.posegraph import EdgeKind, PoseGraph
from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity
from photomap_gis.georef import choose_map_frame, grid_convergence_rad, map_to_lonlat, observe
from photomap_gis.slam import GraphBuilder

CAMERA = Camera.of_hfov(512, 384, math.radians(62.0))
PLACE = GpsFix(52.1, 19.3)
"""Where the flights are flown: any place that a UTM zone fits."""
STEP_S = 0.1
OVERLAP_SAMPLES = 9


@dataclass(frozen=True, slots=True)
class GpsNoise:
    """One-sigma per axis of the receiver's parts of error, its correlation time, and how often it fails."""

    white_m: float = 0.7
    drift_m: float = 2.2
    drift_time_s: float = 45.0
    bias_m: float = 0.9
    blunders: float = 0.01
    dropouts: float = 0.05


GPS = GpsNoise()
"""Not the solver's: 0.5 m white, 2 m of drift with 60 s, 1 m of bias, no blunders."""


@dataclass(frozen=True, slots=True)
class EdgeNoise:
    """``sigma_px`` per axis of a registration of full overlap; ``spread`` of its logarithm from pair to pair."""

    sigma_px: float = 0.15
    spread: float = 0.4


@dataclass(frozen=True, slots=True)
class Plan:
    """A lawnmower flight: strips of ``strip_m``, overlaps, speed, what wind and autopilot add."""

    frames: int
    strip_m: float = 240.0
    height_m: float = 60.0
    forward: float = 0.75
    side: float = 0.64
    speed_m_s: float = 8.0
    speed_wander: float = 0.15
    wander_m: float = 0.4
    tilt_sigma_rad: float = 0.0
    heading_jitter_rad: float = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """What was flown: a dense path ``(M,)``, ``(M, 2)`` (map metres, x east, y south), and its N frames.

    ``tilt_rad`` ``(N, 2)`` is how far the optical axis leans along the image's x and y; ``poses`` map the raw planes
    (origin at the image's centre) to the ground.
    """

    plan: Plan
    path_s: FloatArray
    path_m: FloatArray
    time_s: FloatArray
    xy_m: FloatArray
    height_m: FloatArray
    heading_rad: FloatArray
    tilt_rad: FloatArray
    poses: tuple[Similarity2D, ...] = field(repr=False)

    @property
    def centres_m(self) -> FloatArray:
        """``(N, 2)`` the ground at the image centres."""
        return np.array([p.translation for p in self.poses])

    @property
    def length_m(self) -> float:
        """The way from the first image centre to the last."""
        return float(np.linalg.norm(np.diff(self.centres_m, axis=0), axis=1).sum())

    def at(self, when_s: FloatArray) -> FloatArray:
        """``(n, 2)`` where the aircraft was."""
        return np.stack([np.interp(when_s, self.path_s, self.path_m[:, k]) for k in (0, 1)], axis=1)


def fly(rng: np.random.Generator, plan: Plan) -> Flown:
    """Return a flight over strips to and fro, half circles between them."""
    gsd = plan.height_m / focal_px()
    step_s = (1.0 - plan.forward) * CAMERA.height_px * gsd / plan.speed_m_s
    spacing = (1.0 - plan.side) * CAMERA.width_px * gsd
    seconds = plan.frames * step_s
    path_s = np.arange(0.0, seconds + 2 * step_s + 60.0, STEP_S)
    # gusts of some ten seconds on speed and place
    speed = plan.speed_m_s * (1.0 + plan.speed_wander * _smooth(rng, len(path_s), 12.0))
    way = np.concatenate([[0.0], np.cumsum(speed[:-1] * STEP_S)])
    path, course = _serpentine(way, plan.strip_m, spacing)
    path = path + plan.wander_m * np.stack([_smooth(rng, len(path_s), 8.0) for _ in range(2)], axis=1)
    time = 30.0 + step_s * np.arange(plan.frames)
    n = plan.frames
    xy = np.stack([np.interp(time, path_s, path[:, k]) for k in (0, 1)], axis=1)
    heading = np.interp(time, path_s, np.unwrap(course)) + rng.normal(0, plan.heading_jitter_rad, n)
    height = plan.height_m * (1.0 + 0.01 * np.interp(time, path_s, _smooth(rng, len(path_s), 20.0)))
    tilt = rng.normal(0, 1, (n, 2)) * plan.tilt_sigma_rad
    poses = tuple(_raw_pose(xy[k], height[k], heading[k], tilt[k]) for k in range(n))
    return Flown(plan, path_s, path, time, xy, height, heading, tilt, poses)


def focal_px() -> float:
    """Return the camera's focal length."""
    assert CAMERA.focal_px is not None
    return CAMERA.focal_px


def gauss_markov(rng: np.random.Generator, time_s: FloatArray, sigma: float, correlation_s: float) -> FloatArray:
    """``(N, 2)`` first-order Gauss-Markov noise at ``(N,)`` times."""
    out = np.empty((len(time_s), 2))
    out[0] = rng.normal(0, sigma, 2)
    phi = np.exp(-np.diff(time_s) / correlation_s)
    for k, f in enumerate(phi.tolist(), 1):
        out[k] = f * out[k - 1] + rng.normal(0, sigma * math.sqrt(1.0 - f * f), 2)
    return out


def ground_homography(flown: Flown, k: int) -> FloatArray:
    """``(3, 3)`` from raw plane points (about the image centre) of frame k to the ground."""
    return _homography(flown.xy_m[k], flown.height_m[k], flown.heading_rad[k], flown.tilt_rad[k])


def overlaps(flown: Flown, least: float) -> list[tuple[int, int, float]]:
    """Return the pairs (lower index first) and the share of the one frame that the other sees, the best first."""
    reach = 1.2 * float(flown.height_m.max()) * math.hypot(CAMERA.width_px, CAMERA.height_px) / focal_px()
    c = flown.centres_m
    found = []
    for i in range(len(c) - 1):
        near = i + 1 + np.flatnonzero(np.hypot(*(c[i + 1 :] - c[i]).T) < reach)
        found += [(i, int(j), share) for j in near if (share := _shared(flown, i, int(j)).mean()) >= least]
    return sorted(found, key=lambda p: (-p[2], p[0], p[1]))


def registration(
    rng: np.random.Generator, flown: Flown, a: int, b: int, noise: EdgeNoise, *, false: bool = False
) -> Registration:
    """Return what a registration of two frames measures; a ``false`` one claims as much and lies far off."""
    inside = _shared(flown, a, b)
    points = _grid()[inside] if inside.sum() >= 4 else _grid()
    overlap = max(float(inside.mean()), 0.05)
    truth, misfit = flown.poses[a].inverse() @ flown.poses[b], 0.0
    if flown.plan.tilt_sigma_rad > 0.0:
        H = np.linalg.inv(ground_homography(flown, a)) @ ground_homography(flown, b)
        in_a = _project(H, points)
        truth = fit_similarity(in_a, points)
        misfit = float(np.sqrt(np.mean((truth.apply(points) - in_a) ** 2))) / truth.scale
    sigma = noise.sigma_px * math.exp(rng.normal(0, noise.spread)) / math.sqrt(overlap)
    radius = float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))
    # a registration is surest at the middle of what both see: angle and scale move the image centre with it
    to_centre = Similarity2D.translation_of(*points.mean(axis=0)).adjoint()
    covariance = to_centre @ np.diag([sigma, sigma, sigma / radius, sigma / radius]) ** 2 @ to_centre.T
    # drawn always: the other registrations of a flight are the same whether this one is false or not
    error = rng.multivariate_normal(np.zeros(4), covariance)
    astray = Similarity2D(*rng.normal(0, 0.3 * CAMERA.width_px, 2), rng.normal(0, 0.3), rng.normal(0, 0.1))
    about_centre = (truth @ astray if false else truth) @ Similarity2D.exp(error)
    centre = Similarity2D.translation_of(*CAMERA.principal_xy_px)
    return Registration(
        centre @ about_centre @ centre.inverse(), covariance, 0.97, (CAMERA.width_px, CAMERA.height_px),
        model_sigma_px=misfit, accepted=True, overlap=overlap, a=a, b=b,
    )  # fmt: skip


def add_registrations(
    rng: np.random.Generator, builder: GraphBuilder, flown: Flown, *,
    noise: EdgeNoise | None = None, loops: int | None = None, least: float = 0.3, false: float = 0.0,
) -> None:  # fmt: skip
    """Register every frame to the next and ``loops`` other pairs (``None``: all that overlap by ``least``)."""
    noise = noise or EdgeNoise()
    to_plane = Similarity2D.translation_of(*-CAMERA.principal_xy_px)
    n = len(flown.poses)
    pairs = [(a, b) for a, b, _ in overlaps(flown, least) if b - a > 1][:loops]
    planted = np.zeros(len(pairs), bool)
    planted[rng.permutation(len(pairs))[: round(false * len(pairs))]] = True
    for k in range(n - 1):
        builder.add_registration(registration(rng, flown, k, k + 1, noise), to_plane, to_plane)
    for (a, b), wrong in zip(pairs, planted.tolist(), strict=True):
        measured = registration(rng, flown, a, b, noise, false=wrong)
        builder.add_registration(measured, to_plane, to_plane, EdgeKind.LOOP)


def frame_refs(
    rng: np.random.Generator, flown: Flown, map_frame: MapFrame, noise: GpsNoise = GPS, *, late_s: float = 0.0
) -> tuple[FrameRef, ...]:
    """Return the frames with their fixes (those of ``late_s`` seconds ago) and heights; all are said to be level."""
    n = len(flown.poses)
    error = gauss_markov(rng, flown.time_s, noise.drift_m, noise.drift_time_s)
    error = error + rng.normal(0, noise.white_m, (n, 2)) + rng.normal(0, noise.bias_m, 2)
    wild = rng.random(n) < noise.blunders
    error[wild] += rng.normal(0, 40.0, (int(wild.sum()), 2))
    silent = rng.random(n) < noise.dropouts
    lonlat = map_to_lonlat(map_frame, flown.at(flown.time_s - late_s) + error)
    turn = grid_convergence_rad(map_frame, PLACE.lat_deg, PLACE.lon_deg)
    yaw_error, height_error = rng.normal(0, math.radians(5.0)), math.exp(rng.normal(0, 0.06))
    refs = []
    for k in range(n):
        level = Attitude(flown.heading_rad[k] - turn + yaw_error, -math.pi / 2.0)
        refs.append(
            FrameRef(
                k, f"{k:04d}", "simulated", CAMERA.width_px, CAMERA.height_px, time_s=float(flown.time_s[k]),
                fix=None if silent[k] else GpsFix(float(lonlat[k, 1]), float(lonlat[k, 0])),
                attitude=level,
                height_m=float(flown.height_m[k] * height_error), camera=CAMERA,
            )
        )  # fmt: skip
    return tuple(refs)


def map_frame_here() -> MapFrame:
    """Return the map frame that all flights share; they begin at its origin, give or take."""
    return choose_map_frame([PLACE])


def graph_of(
    rng: np.random.Generator, flown: Flown, *, gps: GpsNoise | None = GPS, noise: EdgeNoise | None = None,
    loops: int | None = None, least: float = 0.3, false: float = 0.0, late_s: float = 0.0,
) -> PoseGraph:  # fmt: skip
    """Return the flight's graph, with fixes, heights and headings as the product takes them, or without any."""
    builder = GraphBuilder()
    for k in range(len(flown.poses)):
        builder.add_frame(k)
    add_registrations(rng, builder, flown, noise=noise, loops=loops, least=least, false=false)
    if gps is not None:
        map_frame = map_frame_here()
        seen = observe(frame_refs(rng, flown, map_frame, gps, late_s=late_s), map_frame)
        builder.observe(seen.positions, seen.scales, seen.headings)
    return builder.snapshot()


def _serpentine(way_m: FloatArray, strip_m: float, spacing_m: float) -> tuple[FloatArray, FloatArray]:
    """``(M, 2)`` places and ``(M,)`` courses (clockwise from north) after so many metres of strips and half circles."""
    arc = math.pi * spacing_m / 2.0
    lap, into = np.divmod(way_m, strip_m + arc)
    north = np.where(lap % 2 == 0, 1.0, -1.0)
    along = np.minimum(into, strip_m)
    angle = np.clip((into - strip_m) / arc, 0.0, 1.0) * math.pi
    y_start = np.where(north > 0, 0.0, -strip_m)
    x = lap * spacing_m + spacing_m / 2.0 * (1.0 - np.cos(angle))
    y = y_start - north * (along + spacing_m / 2.0 * np.sin(angle))
    # every half circle turns to the east: clockwise at the north end, back at the south end
    course = np.where(north > 0, angle, math.pi - angle)
    return np.stack([x, y], axis=1), course


def _smooth(rng: np.random.Generator, n: int, correlation_s: float) -> FloatArray:
    """``(n,)`` smooth noise of unit sigma, ``STEP_S`` apart."""
    width = correlation_s / STEP_S
    kernel = np.exp(-0.5 * (np.arange(-int(3 * width), int(3 * width) + 1) / width) ** 2)
    noise = np.convolve(rng.normal(size=n + len(kernel) - 1), kernel, mode="valid")
    return np.asarray(noise / math.sqrt(float(np.sum(kernel**2))))


def _homography(xy: FloatArray, height: float, heading: float, tilt: FloatArray) -> FloatArray:
    f = focal_px()
    # small leans along the image's x and y: a ray (x, y, f) of the plane in axes that look straight down
    cx, sx, cy, sy = math.cos(tilt[0]), math.sin(tilt[0]), math.cos(tilt[1]), math.sin(tilt[1])
    lean = np.array([[cx, 0.0, sx], [0.0, 1.0, 0.0], [-sx, 0.0, cx]]) @ np.array(
        [[1.0, 0.0, 0.0], [0.0, cy, sy], [0.0, -sy, cy]]
    )
    c, s = math.cos(heading), math.sin(heading)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    place = np.array([[height, 0.0, xy[0]], [0.0, height, xy[1]], [0.0, 0.0, 1.0]])
    return np.asarray(place @ turn @ lean @ np.diag([1.0, 1.0, f]))


def _raw_pose(xy: FloatArray, height: float, heading: float, tilt: FloatArray) -> Similarity2D:
    """The similarity closest to a frame's homography near its centre, exact at the centre."""
    H = _homography(xy, height, heading, tilt)
    if not tilt.any():
        return Similarity2D(float(xy[0]), float(xy[1]), float(heading), math.log(height / focal_px()))
    T = fit_similarity(_project(H, _grid()), _grid())
    centre = _project(H, np.zeros((1, 2)))[0]
    return Similarity2D(float(centre[0]), float(centre[1]), T.angle_rad, T.log_scale)


def _project(H: npt.NDArray[np.float64], points: FloatArray) -> FloatArray:
    p = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ H.T
    return np.asarray(p[:, :2] / p[:, 2:])


def _grid() -> FloatArray:
    """``(n, 2)`` points evenly over a frame, about its centre."""
    w, h = (CAMERA.width_px - 1) / 2.0, (CAMERA.height_px - 1) / 2.0
    x, y = np.meshgrid(np.linspace(-w, w, OVERLAP_SAMPLES), np.linspace(-h, h, OVERLAP_SAMPLES))
    return np.stack([x.ravel(), y.ravel()], axis=1)


def _shared(flown: Flown, a: int, b: int) -> npt.NDArray[np.bool_]:
    """``(n,)`` which points of b's grid frame a sees."""
    in_a = (flown.poses[a].inverse() @ flown.poses[b]).apply(_grid())
    half = (np.array([CAMERA.width_px, CAMERA.height_px]) - 1) / 2.0
    return np.asarray((np.abs(in_a) <= half).all(axis=1))
