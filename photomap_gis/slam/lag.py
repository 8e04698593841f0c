"""Fixes that are late: the time between a fix and the picture it was written into, found from the motion itself.

Cameras write the last fix they had, loggers and cameras disagree by a second: at 5 m/s on strips flown to and fro,
that is 5 m ahead on one strip and 5 m behind on the next, which would pull neighbouring strips apart. A solved path
shows it: shifted in time by the lag, the fixes fit better than where they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from photomap_gis.core.posegraph import PositionObservation, Solution
from photomap_gis.core.similarity import FloatArray

MIN_LAG_S = 0.5
"""A shorter lag moves fixes by less than they are off anyhow."""
MAX_LAG_S = 6.0
STEP_S = 0.1
MIN_FIXES = 12
MIN_GAIN = 0.2
"""A lag is believed where it takes away this share of the spread of fixes about the path: a straight and steady flight
shows none (the lag is then a shift of the whole map, which nothing here can see)."""


def lags_by_flight(solution: Solution, positions: Sequence[PositionObservation]) -> dict[int, float]:
    """Return the believed lag of each flight in seconds; positive where fixes are older than the pictures."""
    place_of = {p.frame: p.T_map_plane.translation for p in solution.poses if p.segment == 0}
    out: dict[int, float] = {}
    for flight, fixes in _by_flight([p for p in positions if p.frame in place_of]).items():
        if len(fixes) < MIN_FIXES:
            continue
        time_s = np.array([p.time_s for p in fixes], np.float64)
        path = np.array([place_of[p.frame] for p in fixes])
        fix = np.array([p.xy_map_m for p in fixes])
        reach = min(MAX_LAG_S, float(time_s[-1] - time_s[0]) / 4.0)
        lags = np.arange(-int(reach / STEP_S), int(reach / STEP_S) + 1) * STEP_S
        spread = np.array([_spread(fix - _at(time_s, path, time_s - lag)) for lag in lags])
        best = int(np.argmin(spread))
        gained = spread[best] < (1.0 - MIN_GAIN) * spread[len(lags) // 2]
        if gained and abs(lags[best]) >= MIN_LAG_S and 0 < best < len(lags) - 1:
            out[flight] = float(lags[best])
    return out


def without_lag(
    solution: Solution, positions: Sequence[PositionObservation], lags: dict[int, float]
) -> tuple[PositionObservation, ...]:
    """Return the fixes moved along the path to where their pictures were taken.

    The path is the solved one where frames hang together, the fixes' own elsewhere; before its first and after its
    last frame it goes on as it went.
    """
    place_of = {p.frame: p.T_map_plane.translation for p in solution.poses if p.segment == 0}
    moved: dict[int, PositionObservation] = {}
    for flight, fixes in _by_flight(positions).items():
        if flight not in lags or len(fixes) < 2:
            continue
        time_s = np.array([p.time_s for p in fixes], np.float64)
        path = np.array([place_of.get(p.frame, p.xy_map_m) for p in fixes])
        then_s = time_s - lags[flight]
        shift = path - _at(time_s, path, then_s)
        for end, inner in ((0, 1), (-1, -2)):
            velocity = (path[end] - path[inner]) / (time_s[end] - time_s[inner])
            beyond = ~np.isfinite(shift[:, 0]) & (np.abs(then_s - time_s[end]) < np.abs(then_s - time_s[inner]))
            shift[beyond] = path[beyond] - path[end] - (then_s[beyond, None] - time_s[end]) * velocity
        moved.update({p.frame: replace(p, xy_map_m=p.xy_map_m + s) for p, s in zip(fixes, shift, strict=True)})
    return tuple(moved.get(p.frame, p) for p in positions)


def _by_flight(positions: Sequence[PositionObservation]) -> dict[int, list[PositionObservation]]:
    """Fixes with a time by flight, in order of time, one an instant (a path has one place at a time)."""
    found: dict[int, dict[float, PositionObservation]] = {}
    for p in positions:
        if p.time_s is not None and np.isfinite(p.xy_map_m).all():
            found.setdefault(p.flight, {}).setdefault(p.time_s, p)
    return {flight: [by_time[t] for t in sorted(by_time)] for flight, by_time in found.items()}


def _at(time_s: FloatArray, path: FloatArray, when_s: FloatArray) -> FloatArray:
    """``(N, 2)`` the path at other times, by linear interpolation; NaN beyond its ends."""
    columns = [np.interp(when_s, time_s, path[:, k], left=np.nan, right=np.nan) for k in (0, 1)]
    return np.stack(columns, axis=1)


def _spread(miss: FloatArray) -> float:
    """Median distance of residuals from their median: blunders and a common shift do not count."""
    kept = miss[np.isfinite(miss).all(axis=1)]
    return float(np.median(np.linalg.norm(kept - np.median(kept, axis=0), axis=1))) if len(kept) else np.inf
