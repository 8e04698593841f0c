"""Attitudes as unit quaternions, so that they can be chained and interpolated through nadir, where Euler angles lock.

A quaternion is ``(w, x, y, z)`` and takes *gimbal* axes (x optical axis, y image right, z image down: the axes in which
``Attitude`` counts yaw, pitch, roll) or *body* axes (nose, right wing, belly) into north, east, down. Arrays are
``(N, 4)``; the convention is Rz(yaw) Ry(pitch) Rx(roll), as in MAVLink and MISB ST 0601.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import Attitude

FloatArray = npt.NDArray[np.float64]

GIMBAL_SIGMA_TILT_RAD = math.radians(1.0)
BODY_SIGMA_TILT_RAD = math.radians(1.5)
SIGMA_YAW_RAD = math.radians(8.0)

_BODY_FROM_NADIR_GIMBAL = np.array([math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0])
"""A camera under the belly, image top to the nose: Ry(-90 deg)."""


def quaternions_of_euler(yaw_rad: npt.ArrayLike, pitch_rad: npt.ArrayLike, roll_rad: npt.ArrayLike) -> FloatArray:
    """``(N, 4)`` quaternions of Rz(yaw) Ry(pitch) Rx(roll)."""
    y, p, r = (np.atleast_1d(np.asarray(v, dtype=np.float64)) / 2.0 for v in (yaw_rad, pitch_rad, roll_rad))
    cy, sy, cp, sp, cr, sr = np.cos(y), np.sin(y), np.cos(p), np.sin(p), np.cos(r), np.sin(r)
    return np.stack(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ],
        axis=-1,
    )


def multiply(a: FloatArray, b: FloatArray) -> FloatArray:
    """``(N, 4)`` products: first b, then a."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def normalise(q: FloatArray) -> FloatArray:
    """``(N, 4)`` unit quaternions; NaN where the input is no rotation (a log can hold zeros)."""
    norm = np.linalg.norm(q, axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = q / norm
    return np.where((norm > 0.5) & (norm < 2.0), unit, np.nan)


def belly_camera(q_ned_body: FloatArray) -> FloatArray:
    """``(N, 4)`` gimbal quaternions of a camera fixed under the vehicle, image top to the nose."""
    return multiply(q_ned_body, np.broadcast_to(_BODY_FROM_NADIR_GIMBAL, q_ned_body.shape))


def interpolate_quaternions(a: FloatArray, b: FloatArray, t: FloatArray) -> FloatArray:
    """``(N, 4)`` spherical interpolation from a (``t`` = 0) to b (``t`` = 1) on the shorter way."""
    dot = np.sum(a * b, axis=-1)
    b = np.where(dot[..., None] < 0, -b, b)
    angle = np.arccos(np.clip(np.abs(dot), -1.0, 1.0))
    sine = np.where(angle < 1e-6, 1.0, np.sin(angle))
    wa = np.where(angle < 1e-6, 1.0 - t, np.sin((1.0 - t) * angle) / sine)
    wb = np.where(angle < 1e-6, t, np.sin(t * angle) / sine)
    return normalise(wa[..., None] * a + wb[..., None] * b)


def sample_quaternions(times_s: FloatArray, q: FloatArray, at_s: FloatArray, *, max_gap_s: float) -> FloatArray:
    """``(N, 4)`` quaternions at ``at_s``; NaN where the samples around are further apart than ``max_gap_s``.

    ``times_s`` is ``(M,)`` and increasing. Up to half a gap beyond the ends, and beside a single sample, the nearest
    is held.
    """
    out = np.full((len(at_s), 4), np.nan)
    if len(times_s) == 0:
        return out
    right = np.clip(np.searchsorted(times_s, at_s, side="right"), 1, max(len(times_s) - 1, 1))
    left = right - 1
    right = np.minimum(right, len(times_s) - 1)
    span = times_s[right] - times_s[left]
    t = np.clip(np.divide(at_s - times_s[left], span, out=np.zeros(len(at_s)), where=span > 0), 0.0, 1.0)
    inside = (at_s >= times_s[0] - max_gap_s / 2) & (at_s <= times_s[-1] + max_gap_s / 2) & (span <= max_gap_s)
    near_left = (at_s - times_s[left] >= 0) & (at_s - times_s[left] <= max_gap_s / 2)
    near_right = (times_s[right] - at_s >= 0) & (times_s[right] - at_s <= max_gap_s / 2)
    t = np.where(inside, t, np.where(near_left, 0.0, 1.0))
    valid = inside | near_left | near_right
    out[valid] = interpolate_quaternions(q[left][valid], q[right][valid], t[valid])
    return out


def attitudes_of_quaternions(
    q: FloatArray, *, sigma_yaw_rad: float = SIGMA_YAW_RAD, sigma_tilt_rad: float = GIMBAL_SIGMA_TILT_RAD
) -> list[Attitude | None]:
    """Read ``(N, 4)`` gimbal quaternions as camera attitudes; ``None`` for NaN."""
    w, x, y, z = np.moveaxis(np.asarray(q, dtype=np.float64), -1, 0)
    r00, r01 = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z)
    r10, r11 = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z)
    r20, r21, r22 = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    pitch = np.arcsin(np.clip(-r20, -1.0, 1.0))
    locked = np.hypot(r00, r10) < 1e-7  # straight down: all the turn is yaw
    yaw = np.where(locked, np.arctan2(-r01, r11), np.arctan2(r10, r00))
    roll = np.where(locked, 0.0, np.arctan2(r21, r22))
    return [
        Attitude(yw, pt, rl, sigma_yaw_rad, sigma_tilt_rad) if math.isfinite(yw + pt + rl) else None
        for yw, pt, rl in zip(yaw.tolist(), pitch.tolist(), roll.tolist(), strict=True)
    ]


def quaternions_of_attitudes(attitudes: list[Attitude | None]) -> FloatArray:
    """``(N, 4)`` gimbal quaternions of camera attitudes; NaN for ``None``."""
    angles = np.array(
        [(a.yaw_rad, a.pitch_rad, a.roll_rad) if a is not None else (np.nan,) * 3 for a in attitudes]
    ).reshape(-1, 3)
    return quaternions_of_euler(angles[:, 0], angles[:, 1], angles[:, 2])
