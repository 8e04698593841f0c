"""Join the separate streams of an autopilot's log (positions, attitudes, gimbal) into points of one track."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photomap_gis.ingest.telemetry.clean import clean_points
from photomap_gis.ingest.telemetry.rotations import (
    BODY_SIGMA_TILT_RAD,
    GIMBAL_SIGMA_TILT_RAD,
    FloatArray,
    attitudes_of_quaternions,
    belly_camera,
    normalise,
    quaternions_of_euler,
    sample_quaternions,
)
from photomap_gis.ingest.telemetry.track import TrackPoint

_MAX_ATTITUDE_GAP_S = 2.0
_MAX_GIMBAL_GAP_S = 4.0
_MAX_RATE_HZ = 25.0


@dataclass(frozen=True, slots=True, eq=False)
class Positions:
    """``(N,)`` arrays of one receiver or estimator; NaN where a value is unknown."""

    times_s: FloatArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    alt_m: FloatArray
    height_m: FloatArray
    sigma_m: FloatArray
    without_fix: int = 0

    @classmethod
    def of(
        cls,
        times_s: FloatArray,
        lat_deg: FloatArray,
        lon_deg: FloatArray,
        *,
        alt_m: FloatArray | None = None,
        height_m: FloatArray | None = None,
        sigma_m: FloatArray | None = None,
    ) -> Positions:
        """Return the valid positions in order of time, without repeated moments.

        What is no fix goes before anything is interpolated: between 0, 0 and a place lies no place.
        """
        unknown = np.full(len(times_s), np.nan)
        columns = (lat_deg, lon_deg, *(unknown if v is None else v for v in (alt_m, height_m, sigma_m)))
        there = (np.abs(lat_deg) <= 90.0) & (np.abs(lon_deg) <= 180.0)
        there &= (np.abs(lat_deg) > 1e-6) | (np.abs(lon_deg) > 1e-6)
        good = np.flatnonzero(np.isfinite(times_s) & there)
        _, first = np.unique(times_s[good], return_index=True)
        keep = good[first]
        lat, lon, alt, height, sigma = (np.asarray(c, dtype=np.float64)[keep] for c in columns)
        return cls(times_s[keep], lat, lon, alt, height, sigma, len(times_s) - len(good))


@dataclass(frozen=True, slots=True, eq=False)
class Turns:
    """``(N,)`` times and ``(N, 4)`` quaternions of body or gimbal axes into north, east, down."""

    times_s: FloatArray
    q: FloatArray

    @classmethod
    def of(cls, times_s: FloatArray, q: FloatArray) -> Turns:
        """Return the turns in order of time, without repeated moments and without nonsense."""
        q = normalise(np.asarray(q, dtype=np.float64).reshape(-1, 4))
        good = np.flatnonzero(np.isfinite(times_s) & np.isfinite(q).all(axis=1))
        _, first = np.unique(times_s[good], return_index=True)
        keep = good[first]
        return cls(times_s[keep], q[keep])

    @classmethod
    def of_euler(
        cls, times_s: FloatArray, *, roll_rad: FloatArray, pitch_rad: FloatArray, yaw_rad: FloatArray
    ) -> Turns:
        """Return the turns of roll, pitch and yaw."""
        if len(times_s) == 0:
            return cls(np.empty(0), np.empty((0, 4)))
        return cls.of(times_s, quaternions_of_euler(yaw_rad, pitch_rad, roll_rad))

    def yaw_rad(self, at_s: FloatArray) -> FloatArray:
        """``(N,)`` yaw at other moments; NaN where unknown."""
        w, x, y, z = np.moveaxis(sample_quaternions(self.times_s, self.q, at_s, max_gap_s=_MAX_ATTITUDE_GAP_S), -1, 0)
        yaw: FloatArray = np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))
        return yaw


def points_of(positions: Positions, body: Turns, gimbal: Turns | None) -> tuple[tuple[TrackPoint, ...], list[str]]:
    """Return the camera's track and warnings.

    A gimbal's own attitude wins over the vehicle's where it is known within a few seconds. Points lie at the moments of
    whichever stream is denser, up to 25 a second, since a vehicle tilts faster than it moves.
    """
    times_s = _moments(positions.times_s, body.times_s if gimbal is None else gimbal.times_s)
    if len(times_s) == 0:
        return (), []
    attitudes = attitudes_of_quaternions(
        belly_camera(sample_quaternions(body.times_s, body.q, times_s, max_gap_s=_MAX_ATTITUDE_GAP_S)),
        sigma_tilt_rad=BODY_SIGMA_TILT_RAD,
    )
    if gimbal is not None:
        by_gimbal = attitudes_of_quaternions(
            sample_quaternions(gimbal.times_s, gimbal.q, times_s, max_gap_s=_MAX_GIMBAL_GAP_S),
            sigma_tilt_rad=GIMBAL_SIGMA_TILT_RAD,
        )
        attitudes = [g or b for g, b in zip(by_gimbal, attitudes, strict=True)]
    columns = [
        np.interp(times_s, positions.times_s, c).tolist()
        for c in (
            positions.lat_deg,
            np.unwrap(positions.lon_deg, period=360.0),  # a flight may cross the date line
            positions.alt_m,
            positions.height_m,
            positions.sigma_m,
        )
    ]
    points, warnings = clean_points(
        TrackPoint(t, lat, math.remainder(lon, 360.0), _known(alt), _known(height), attitude, _known(sigma))
        for t, attitude, lat, lon, alt, height, sigma in zip(times_s.tolist(), attitudes, *columns, strict=True)
    )
    if positions.without_fix:
        warnings.insert(0, f"{positions.without_fix} positions without a fix were left out")
    return points, warnings


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _moments(positions_s: FloatArray, turns_s: FloatArray) -> FloatArray:
    """Return the denser of two streams' moments, inside the positions' span and away from their gaps."""
    if len(positions_s) < 2 or len(turns_s) <= 1.5 * len(positions_s):
        return positions_s
    inside = turns_s[(turns_s >= positions_s[0]) & (turns_s <= positions_s[-1])]
    slots = np.floor(inside * _MAX_RATE_HZ)
    inside = inside[np.append(True, np.diff(slots) > 0)] if len(inside) else inside
    span = np.diff(positions_s)
    left = np.clip(np.searchsorted(positions_s, inside, side="right") - 1, 0, len(span) - 1)
    usual = float(np.median(span))
    return np.unique(np.concatenate([positions_s, inside[span[left] <= max(1.0, 3.0 * usual)]]))
