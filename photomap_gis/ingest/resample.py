"""A track between its records: what the camera's place was at any moment, without inventing any.

Positions in logs are steps. Either the receiver's fixes are repeated until the next one comes (a 30 Hz subtitle of a
5 Hz receiver): then a value is true at the moment when it first appears. Or the log has too few decimals (four decimals
of a degree are 11 m): then a step from one value to the next says that the rounding's border, their middle, was
crossed between the two records. Each axis is read by its own steps, and lines are drawn between such knots.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import Attitude
from photomap_gis.ingest.telemetry.clean import METRES_PER_DEGREE
from photomap_gis.ingest.telemetry.rotations import (
    attitudes_of_quaternions,
    quaternions_of_attitudes,
    sample_quaternions,
)
from photomap_gis.ingest.telemetry.track import Track, TrackPoint

FloatArray = npt.NDArray[np.float64]

_MIN_GAP_S, _MAX_GAP_S = 5.0, 15.0
_MIN_REACH_S, _MAX_REACH_S = 0.5, 2.0
_MAX_DECIMALS = 8
_QUANTISED_STEP = 1.6
"""Steps up to this many units of the last decimal are made by rounding, longer ones by the receiver."""

_TELLING_SIGMA_M = 1.0
"""A rounding below this is finer than any receiver without corrections: it says nothing of the fix."""


def gap_s(times_s: FloatArray) -> float:
    """Return how long a hole between records may be before positions in it are unknown."""
    return min(max(_MIN_GAP_S, 3.0 * _usual_interval_s(times_s)), _MAX_GAP_S)


def reach_s(times_s: FloatArray) -> float:
    """Return how far beyond a track's ends a position is still told by the last motion."""
    return min(max(_MIN_REACH_S, 1.5 * _usual_interval_s(times_s)), _MAX_REACH_S)


def interpolate(track: Track, times_s: Sequence[float]) -> list[TrackPoint | None]:
    """Return the track at the given moments of its own clock; ``None`` in long gaps and beyond its ends."""
    points = track.points
    if not points:
        return [None] * len(times_s)
    at_s = np.asarray(times_s, dtype=np.float64).reshape(-1)
    rows_s = np.array([p.time_s for p in points])
    gap = gap_s(rows_s)
    known = _known(rows_s, at_s, gap)
    lat_rows = np.array([p.lat_deg for p in points])
    lon_rows = np.unwrap([p.lon_deg for p in points], period=360.0)
    quantum = min(_quantum_deg(lat_rows), _quantum_deg(lon_rows))
    lats = _along(rows_s, lat_rows, at_s, quantum)
    lons = np.remainder(_along(rows_s, lon_rows, at_s, quantum) + 180.0, 360.0) - 180.0
    scalars = {name: _scalar(points, at_s, name, gap) for name in ("alt_m", "height_m", "hfov_rad", "sigma_m")}
    implied = quantum * METRES_PER_DEGREE / math.sqrt(12.0)
    attitudes = _attitudes(points, at_s, gap)
    nearest = np.clip(np.searchsorted(rows_s, at_s, side="right") - 1, 0, len(points) - 1).tolist()
    return [
        TrackPoint(
            time_s,
            max(-90.0, min(90.0, float(lats[i]))),
            float(lons[i]),
            scalars["alt_m"][i],
            scalars["height_m"][i],
            attitudes[i],
            _joined_sigma_m(scalars["sigma_m"][i], implied),
            points[nearest[i]].focal_35mm,
            scalars["hfov_rad"][i],
        )
        if known[i]
        else None
        for i, time_s in enumerate(at_s.tolist())
    ]


def _usual_interval_s(times_s: FloatArray) -> float:
    return float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0


def _known(rows_s: FloatArray, at_s: FloatArray, gap: float) -> npt.NDArray[np.bool_]:
    """``(N,)`` whether a moment lies between two records no further apart than a gap, or just beside one."""
    right = np.searchsorted(rows_s, at_s, side="left")
    after = np.where(right < len(rows_s), rows_s[np.minimum(right, len(rows_s) - 1)] - at_s, np.inf)
    before = np.where(right > 0, at_s - rows_s[np.maximum(right - 1, 0)], np.inf)
    with np.errstate(invalid="ignore"):
        return (before + after <= gap) | (np.minimum(before, after) <= reach_s(rows_s))


def _quantum_deg(values: FloatArray) -> float:
    """Return the worth of the last decimal that the values use; 0 where they use more than eight."""
    for decimals in range(_MAX_DECIMALS + 1):
        scaled = values * 10.0**decimals
        if np.all(np.abs(scaled - np.round(scaled)) < 1e-5):
            return 10.0**-decimals
    return 0.0


def _along(rows_s: FloatArray, values: FloatArray, at_s: FloatArray, quantum: float) -> FloatArray:
    """``(N,)`` one coordinate at other moments, through the knots of its steps, a little beyond its ends too."""
    knots_s, knots = _knots(rows_s, values, quantum)
    reach = reach_s(rows_s)
    if len(knots_s) > 1:
        # The last motion, over at least a second of it, goes on for the moment of the reach.
        head = min(int(np.searchsorted(knots_s, knots_s[0] + 1.0)), len(knots_s) - 1)
        tail = max(int(np.searchsorted(knots_s, knots_s[-1] - 1.0, side="right")) - 1, 0)
        first_speed = (knots[head] - knots[0]) / (knots_s[head] - knots_s[0])
        last_speed = (knots[-1] - knots[tail]) / (knots_s[-1] - knots_s[tail])
        knots_s = np.concatenate([[knots_s[0] - reach], knots_s, [knots_s[-1] + reach]])
        knots = np.concatenate([[knots[0] - first_speed * reach], knots, [knots[-1] + last_speed * reach]])
    return np.interp(at_s, knots_s, knots)


def _knots(rows_s: FloatArray, values: FloatArray, quantum: float) -> tuple[FloatArray, FloatArray]:
    """Return the moments and values between which a coordinate is a straight line."""
    changes = np.flatnonzero(np.diff(values) != 0.0) + 1
    if len(changes) < 2 or len(changes) > 0.9 * (len(rows_s) - 1):
        return rows_s, values  # every record is news (or none is)
    steps = np.diff(values)[changes - 1]
    if quantum > 0.0 and float(np.median(np.abs(steps))) <= _QUANTISED_STEP * quantum:
        return _knots_of_rounding(rows_s, values, changes, steps, quantum)
    return _knots_of_updates(rows_s, values, changes)


def _knots_of_rounding(
    rows_s: FloatArray, values: FloatArray, changes: npt.NDArray[np.intp], steps: FloatArray, quantum: float
) -> tuple[FloatArray, FloatArray]:
    """Knots where the rounding's borders were crossed; also in the middle of a stay from which it turned back."""
    times: list[float] = [float(rows_s[0])]
    knots: list[float] = [float(values[0])]
    for k, i in enumerate(changes.tolist()):
        if k > 0 and (steps[k] > 0) != (steps[k - 1] > 0):
            stay = (rows_s[changes[k - 1]] + rows_s[i - 1]) / 2.0
            if stay > times[-1]:
                times.append(float(stay))
                knots.append(float(values[i - 1]))
        if abs(steps[k]) <= _QUANTISED_STEP * quantum:
            times.append(float(rows_s[i - 1] + rows_s[i]) / 2.0)
            knots.append(float(values[i - 1] + values[i]) / 2.0)
        else:  # a jump: both its sides are meant
            if rows_s[i - 1] > times[-1]:
                times.append(float(rows_s[i - 1]))
                knots.append(float(values[i - 1]))
            times.append(float(rows_s[i]))
            knots.append(float(values[i]))
    if rows_s[-1] > times[-1]:
        times.append(float(rows_s[-1]))
        knots.append(float(values[-1]))
    return np.array(times), np.array(knots)


def _knots_of_updates(
    rows_s: FloatArray, values: FloatArray, changes: npt.NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Knots where new values first appear; a long stay holds until shortly before the next."""
    news = np.concatenate([[0], changes])
    times, knots = rows_s[news], values[news]
    intervals = np.diff(times)
    usual = float(np.median(intervals))
    stays = np.flatnonzero(intervals > max(1.0, 3.0 * usual))
    all_times = np.concatenate([times, times[stays + 1] - usual, rows_s[-1:]])
    all_knots = np.concatenate([knots, knots[stays], values[-1:]])
    order = np.unique(all_times, return_index=True)[1]
    return all_times[order], all_knots[order]


def _scalar(points: Sequence[TrackPoint], at_s: FloatArray, name: str, gap: float) -> list[float | None]:
    """Return an optional number of the track at other moments; ``None`` where no record near by tells it."""
    told = [(p.time_s, value) for p in points if (value := getattr(p, name)) is not None]
    if not told:
        return [None] * len(at_s)
    times, values = np.array(told).T
    known = _known(times, at_s, gap)
    return [v if k else None for v, k in zip(np.interp(at_s, times, values).tolist(), known.tolist(), strict=True)]


def _attitudes(points: Sequence[TrackPoint], at_s: FloatArray, gap: float) -> list[Attitude | None]:
    """Return the camera's attitude at other moments, each with the sigmas of the record before it."""
    told = [(p.time_s, p.attitude) for p in points if p.attitude is not None]
    if not told:
        return [None] * len(at_s)
    times = np.array([t for t, _ in told])
    q = sample_quaternions(times, quaternions_of_attitudes([a for _, a in told]), at_s, max_gap_s=gap)
    before = np.clip(np.searchsorted(times, at_s, side="right") - 1, 0, len(told) - 1).tolist()
    return [
        a and replace(a, sigma_yaw_rad=told[k][1].sigma_yaw_rad, sigma_tilt_rad=told[k][1].sigma_tilt_rad)
        for a, k in zip(attitudes_of_quaternions(q), before, strict=True)
    ]


def _joined_sigma_m(reported: float | None, implied: float) -> float | None:
    """Join what the receiver reports with what the log's decimals imply."""
    if reported is not None:
        return math.hypot(reported, implied)
    return implied if implied >= _TELLING_SIGMA_M else None
