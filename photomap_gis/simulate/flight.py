"""Fly a pattern: when and where each frame is truly taken, and what the drone believes of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from photomap_gis.core.frame import Attitude, GpsFix
from photomap_gis.core.similarity import FloatArray
from photomap_gis.simulate.geodesy import GeoFrame
from photomap_gis.simulate.ground import Ground
from photomap_gis.simulate.noise import gauss_markov, smooth_process
from photomap_gis.simulate.pattern import Pattern, plan_pattern
from photomap_gis.simulate.pose import CameraPose
from photomap_gis.simulate.spec import FlightSpec

PATH_STEP_S = 0.05
TURN_S = 3.0
"""How long the nose takes from one strip's direction to the next."""
CORNER_S = 1.0


class Stream(IntEnum):
    """Each concern draws from its own generator, so that changing one leaves the others as they were."""

    MOTION = 1
    GPS = 2
    IMAGING = 3
    ERRORS = 4
    REPORT = 5

    def rng(self, seed: int) -> np.random.Generator:
        """Return the concern's generator."""
        return np.random.default_rng([seed, int(self)])


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One frame: its true pose (middle row; first and last row too), and what is reported of it (``None``: nothing)."""

    index: int
    time_s: float
    pose: CameraPose
    pose_first_row: CameraPose
    pose_last_row: CameraPose
    speed_en_m_s: tuple[float, float]
    fix: GpsFix | None
    attitude: Attitude | None
    relative_height_m: float | None


@dataclass(frozen=True, slots=True, eq=False)
class FlightPlan:
    """All shots of a flight, in order; ``take_off_height_m`` is the land's level in the ground's heights."""

    shots: tuple[Shot, ...]
    patterns: tuple[Pattern, ...]
    take_off_height_m: float


@dataclass(frozen=True, slots=True, eq=False)
class _Path:
    """The drone's smooth way, sampled every ``PATH_STEP_S``: time, east, north, unwrapped yaw; and when it shoots."""

    time_s: FloatArray
    en_m: FloatArray
    yaw_rad: FloatArray
    shot_times_s: FloatArray


def required_size_m(spec: FlightSpec, *, video: bool) -> tuple[float, float]:
    """Width and height of a ground on which the flight fits at its altitude (100 m where none is given)."""
    boxes = [p.box_m for p in _patterns(spec, None, video=video)]
    return max(b[0] for b in boxes), max(b[1] for b in boxes)


def fly(ground: Ground, spec: FlightSpec, *, video: bool = False) -> FlightPlan:
    """Return the shots of a flight over the middle of a ground; the same spec and ground give the same flight."""
    patterns = _patterns(spec, ground.size_m, video=video)
    path = _joined([_path(p, spec, video=video) for p in patterns])
    centre = np.asarray(ground.centre_en_m)
    rng = Stream.MOTION.rng(spec.seed)
    t, m = path.time_s, spec.motion
    en = path.en_m + np.stack(
        [smooth_process(t, sigma=m.wander_sigma_m, tau_s=m.slow_tau_s, rng=rng) for _ in range(2)], axis=1
    )
    rise = smooth_process(t, sigma=m.height_sigma_m, tau_s=m.slow_tau_s, rng=rng)
    tilt, tau = math.radians(m.tilt_deg), m.tilt_tau_s
    sway = [smooth_process(t, sigma=tilt * math.sqrt(0.7), tau_s=tau, rng=rng) for _ in range(2)]
    yaw = path.yaw_rad + smooth_process(t, sigma=math.radians(m.yaw_deg), tau_s=2 * tau, rng=rng)
    times = path.shot_times_s
    jerk = tilt * math.sqrt(0.3) * rng.standard_normal((len(times), 2))
    half = min(ground.size_m) / 4.0
    around = centre + np.stack(np.meshgrid(np.linspace(-half, half, 15), np.linspace(-half, half, 15)), -1).reshape(
        -1, 2
    )
    take_off = float(np.median(ground.heights_at(around)))
    altitude = patterns[0].altitude_m

    def pose_at(when: float, k: int) -> CameraPose:
        east, north, up, roll, pitch, turn = (
            float(np.interp(when, t, series)) for series in (en[:, 0], en[:, 1], rise, sway[0], sway[1], yaw)
        )
        return CameraPose.of_body(
            (centre[0] + east, centre[1] + north),
            take_off + altitude + up,
            roll_rad=roll + jerk[k, 0],
            pitch_rad=pitch + jerk[k, 1] + math.radians(m.lean_deg),
            yaw_rad=turn,
        )

    readout = spec.imaging.rolling_shutter_ms / 1000.0
    poses = [pose_at(w, k) for k, w in enumerate(times)]
    fixes = _fixes(ground, spec, times, poses, take_off)
    heights, attitudes = _reports(ground, spec, times, poses, take_off)
    shots = []
    for k, when in enumerate(times):
        first, last = (pose_at(when + d * readout, k) if readout else poses[k] for d in (-0.5, 0.5))
        ahead, behind = (np.array([np.interp(when + d, t, en[:, i]) for i in (0, 1)]) for d in (0.2, -0.2))
        speed = (ahead - behind) / 0.4
        shots.append(
            Shot(
                k, spec.start_unix_s + float(when), poses[k], first, last, (float(speed[0]), float(speed[1])),
                fixes[k], attitudes[k], heights[k],
            )
        )  # fmt: skip
    return FlightPlan(tuple(shots), patterns, take_off)


def _patterns(spec: FlightSpec, room_m: tuple[float, float] | None, *, video: bool) -> tuple[Pattern, ...]:
    """One pattern for each heading, the frames shared out; all from the lowest of their altitudes."""
    n = len(spec.headings_deg)
    shares = [spec.frames // n + (k < spec.frames % n) for k in range(n)]
    headings = [math.radians(h) for h in spec.headings_deg]
    jobs = [(s, h) for s, h in zip(shares, headings, strict=True) if s > 0]
    patterns = [plan_pattern(spec, s, h, room_m=room_m, video=video) for s, h in jobs]
    lowest = min(p.altitude_m for p in patterns)
    if any(p.altitude_m > lowest for p in patterns):
        from dataclasses import replace

        level = replace(spec, altitude_m=lowest)
        patterns = [plan_pattern(level, s, h, room_m=room_m, video=video) for s, h in jobs]
    return tuple(patterns)


def _path(pattern: Pattern, spec: FlightSpec, *, video: bool) -> _Path:
    """Fly one pattern at constant speed, corners rounded; photos are taken on the strips only."""
    speed = spec.speed_m_s
    lead = 0.0 if video else speed * max(TURN_S, CORNER_S)
    corners = pattern.turn_points(lead_m=lead)
    if (pattern.stations == 1 and lead == 0.0) or len(corners) < 2:
        corners = np.concatenate([corners, corners[-1:] + 1e-6])
    legs = np.diff(corners, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    count = max(2, int(at[-1] / speed / PATH_STEP_S) + 1)
    t = np.arange(count) * PATH_STEP_S
    en = np.stack([np.interp(t * speed, at, corners[:, i]) for i in (0, 1)], axis=1)
    if spec.nose_follows_track:
        leg = np.clip(np.searchsorted(at, t * speed, side="right") - 1, 0, len(legs) - 1)
        yaw = np.unwrap(np.arctan2(legs[:, 0], legs[:, 1]))[leg]
    else:
        yaw = np.full(count, pattern.heading_rad)
    en = np.stack([_rounded(np.asarray(en[:, i]), CORNER_S) for i in (0, 1)], axis=1)
    yaw = _rounded(np.asarray(yaw, dtype=np.float64), TURN_S)
    if video:
        times = np.arange(pattern.frames) / spec.video_rate_hz
    else:
        station = np.arange(pattern.frames)
        strip, k = station // pattern.stations, station % pattern.stations
        times = (at[2 * strip] + lead + k * pattern.along_step_m) / speed
    return _Path(np.asarray(t, dtype=np.float64), np.asarray(en, dtype=np.float64), yaw, np.asarray(times, float))


def _joined(paths: list[_Path]) -> _Path:
    """Fly one path after the other, the time of a transfer in between."""
    pause, start = 20.0, 0.0
    times, places, yaws, shots = [], [], [], []
    for p in paths:
        times.append(p.time_s + start)
        places.append(p.en_m)
        yaws.append(p.yaw_rad)
        shots.append(p.shot_times_s + start)
        start += float(p.time_s[-1]) + pause
    return _Path(np.concatenate(times), np.concatenate(places), np.concatenate(yaws), np.concatenate(shots))


def _rounded(series: FloatArray, window_s: float) -> FloatArray:
    """Moving average that keeps the ends."""
    n = max(1, int(window_s / PATH_STEP_S)) // 2
    padded = np.concatenate([np.full(n, series[0]), series, np.full(n, series[-1])])
    total = np.concatenate([[0.0], np.cumsum(padded)])
    return np.asarray((total[2 * n + 1 :] - total[: -2 * n - 1]) / (2 * n + 1))


def _fixes(
    ground: Ground, spec: FlightSpec, times: FloatArray, poses: list[CameraPose], take_off_m: float
) -> list[GpsFix | None]:
    """Return what the GPS says at each shot."""
    g, rng = spec.gps, Stream.GPS.rng(spec.seed)
    n = len(times)
    error = np.stack([gauss_markov(times, sigma=g.walk_sigma_m, tau_s=g.walk_tau_s, rng=rng) for _ in range(2)], axis=1)
    error += g.white_sigma_m * rng.standard_normal((n, 2)) + (g.bias_east_m, g.bias_north_m)
    up = gauss_markov(times, sigma=1.8 * g.walk_sigma_m, tau_s=g.walk_tau_s, rng=rng)
    believed = np.array([(p.easting_m, p.northing_m) for p in poses]).reshape(-1, 2) + error
    if g.rate_hz is not None:  # the receiver's last word holds until its next
        newest = np.floor(times * g.rate_hz + 1e-9)
        first = np.concatenate([[True], np.diff(newest) > 0])
        believed = believed[np.maximum.accumulate(np.where(first, np.arange(n), 0))]
    lost = np.zeros(n, dtype=bool)
    while lost.sum() < round(g.dropout_share * n):
        k = int(rng.integers(0, n))
        lost[k : k + min(g.dropout_run, round(g.dropout_share * n) - int(lost.sum()))] = True
    lon_lat = GeoFrame(ground.crs_wkt).to_lon_lat(believed)
    # an ellipsoidal height of the land of 60 m: whoever takes a GPS altitude for a height above ground will notice
    return [
        None if lost[k] else GpsFix(float(lon_lat[k, 1]), float(lon_lat[k, 0]), p.height_m - take_off_m + 60.0 + up[k])
        for k, p in enumerate(poses)
    ]


def _reports(
    ground: Ground, spec: FlightSpec, times: FloatArray, poses: list[CameraPose], take_off_m: float
) -> tuple[list[float | None], list[Attitude | None]]:
    """Return what barometer and gimbal say at each shot."""
    rng = Stream.REPORT.rng(spec.seed)
    drift = gauss_markov(times, sigma=spec.barometer_sigma_m, tau_s=120.0, rng=rng)
    wrong = math.radians(spec.attitude_sigma_deg) * rng.standard_normal((len(times), 3))
    convergence = GeoFrame(ground.crs_wkt).convergence_rad(*ground.centre_en_m)
    heights: list[float | None] = []
    attitudes: list[Attitude | None] = []
    for k, pose in enumerate(poses):
        heights.append(pose.height_m - take_off_m + float(drift[k]) if spec.report_height else None)
        if not spec.report_attitude:
            attitudes.append(None)
            continue
        turn = Attitude.of_body_camera(roll_rad=wrong[k, 0], pitch_rad=wrong[k, 1], yaw_rad=wrong[k, 2]).R_ned_camera
        level = Attitude.of_body_camera(roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0).R_ned_camera
        believed = CameraPose(0.0, 0.0, 0.0, pose.R_grid_camera @ level.T @ turn)
        attitudes.append(believed.attitude(convergence))
    return heights, attitudes
