"""The time between fixes and pictures, found from the motion itself, with its uncertainty.

Cameras write the last fix they had, loggers and cameras disagree by a second: at 5 m/s on strips flown to and fro,
that is 5 m ahead on one strip and 5 m behind on the next, which would pull neighbouring strips apart. A solved path
shows it: at each trial lag, the path as it was so much earlier is laid on the fixes by a similarity, by the same error
model that the solver has (white noise and slow drift), and the misfit's least tells the lag, its curvature how well.
Drift is slow and a turn is quick: a dozen turns tell the lag to some hundredths of a second through metres of drift.
A straight and steady flight shows none: the lag then is a shift of the whole map, which nothing here can see, and its
sigma says so.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_triangular

from photomap_gis.core.posegraph import FixLag, PositionObservation, Solution
from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.problem import MIN_WHITE_SIGMA_M, ComplexArray

MAX_LAG_S = 6.0
STEP_S = 0.1
MIN_FIXES = 12
MAX_FIXES = 600
"""More are thinned: the whitening is dense."""
MAX_SIGMA_S = 0.5
"""A lag that is known less well is not told from none."""
DISTINCT = 20.0
"""By how much chi squared of other lags must exceed the least: strips flown alike look alike a lap later."""
SEPARATE_S = 1.0
OUTLIER = 5.0
"""Fixes that miss by so many times the median miss have no say."""
SHIFT_FIXES = 200
SHIFT_COVERED = 0.6
"""Share of a path's frames for which a shifted track must tell a place."""
SHIFT_MISFIT = 25.0
"""Mean squared misfit in sigmas up to which a track may belong to a path: a chain of registrations drifts."""
SHIFT_DISTINCT = 2.0
"""By what factor all other shifts must fit worse."""
SHIFT_SEPARATE_S = 4.0
LONG_GAP = 4.0
"""Between frames further apart than so many usual intervals the path is unknown."""


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """One-sigma per axis of the fixes: white, and drifting with a correlation time."""

    white_m: float
    drift_m: float
    drift_time_s: float


def lags_by_flight(solution: Solution, positions: Sequence[PositionObservation]) -> dict[int, FixLag]:
    """Return the lag of each flight whose motion tells it to ``MAX_SIGMA_S``, be it believed or as good as none."""
    pose_of = {p.frame: p for p in solution.poses}
    out: dict[int, FixLag] = {}
    for flight, fixes in _by_flight([p for p in positions if p.frame in pose_of]).items():
        segments = Counter(pose_of[p.frame].segment for p in fixes)
        main = min(segments, key=lambda s: (-segments[s], s))
        fixes = [p for p in fixes if pose_of[p.frame].segment == main]
        if len(fixes) < MIN_FIXES:
            continue
        time_s = np.array([p.time_s for p in fixes], np.float64)
        path = np.array([pose_of[p.frame].T_map_plane.translation for p in fixes]) @ (1, 1j)
        fix = np.array([p.xy_map_m for p in fixes]) @ (1, 1j)
        reach = min(MAX_LAG_S, float(time_s[-1] - time_s[0]) / 4.0)
        lag = estimate_lag(time_s, path, fix, _error_model(fixes), reach_s=reach)
        if lag is not None:
            out[flight] = lag
    return out


def estimate_lag(
    time_s: FloatArray, path: ComplexArray, fix_m: ComplexArray, model: ErrorModel, *, reach_s: float
) -> FixLag | None:
    """Return by how much ``(N,)`` fixes (x + iy) are older than the ``(N,)`` places of a path at the same times.

    The path may lie in any frame: a similarity lays it on the fixes at every lag up to ``reach_s`` either way. ``None``
    where the motion does not tell the lag: no clear least within reach, or a sigma above ``MAX_SIGMA_S``.
    """
    thin = np.unique(np.linspace(0, len(time_s) - 1, min(len(time_s), MAX_FIXES)).astype(np.intp))
    lags = np.arange(-int(reach_s / STEP_S), int(reach_s / STEP_S) + 1) * STEP_S
    # every trial looks at the same fixes: those whose time is within the path at all lags
    inside = thin[(time_s[thin] - reach_s >= time_s[0]) & (time_s[thin] + reach_s <= time_s[-1])]
    earlier = _Path(time_s, path)
    known = np.ones(len(inside), bool)
    for lag in (-reach_s, 0.0, reach_s):
        known &= ~earlier.in_gap(time_s[inside] - lag)
    rows = inside[known]
    if len(rows) < MIN_FIXES or len(lags) < 5:
        return None
    shifted = [earlier.at(time_s[rows] - lag) for lag in lags]
    good = _without_outliers(shifted, fix_m[rows])
    rows = rows[good]
    if len(rows) < MIN_FIXES:
        return None
    whiten = _whitener(time_s[rows], model)
    one, measured = whiten(np.ones(len(rows), complex)), whiten(fix_m[rows])
    chi2 = np.array([_misfit(whiten(p[good]), one, measured) for p in shifted])
    best = int(np.argmin(chi2))
    if not 1 <= best < len(lags) - 1:
        return None
    beyond2 = max(1.0, float(chi2[best]) / (2 * len(rows) - 5))
    low, least, high = chi2[best - 1 : best + 2].tolist()
    curvature = (low - 2.0 * least + high) / STEP_S**2
    if curvature <= 0.0:
        return None
    lag = float(lags[best]) + STEP_S * 0.5 * (low - high) / (low - 2.0 * least + high)
    sigma = math.sqrt(2.0 * beyond2 / curvature)
    elsewhere = np.abs(lags - lag) > max(SEPARATE_S, 5.0 * sigma)
    rivals = chi2[elsewhere & _is_least(chi2)]
    ambiguous = len(rivals) > 0 and float(rivals.min()) - least < DISTINCT * beyond2
    return None if sigma > MAX_SIGMA_S or ambiguous else FixLag(lag, sigma)


def find_shift(
    time_s: FloatArray,
    path: ComplexArray,
    place: Callable[[FloatArray], ComplexArray],
    model: ErrorModel,
    shifts_s: FloatArray,
) -> float | None:
    """Return by which of ``shifts_s`` a whole track is older than the ``(N,)`` places of a path; ``None`` if unclear.

    ``place`` gives the track's places (x + iy metres, NaN where it is silent) at any times. The path may lie in any
    frame, and drift as a chain of registrations does. Believed is a shift that fits as well as such tracks do, and
    clearly better than none and than any that lies elsewhere.
    """
    rows = np.unique(np.linspace(0, len(time_s) - 1, min(len(time_s), SHIFT_FIXES)).astype(np.intp))
    if len(rows) < MIN_FIXES:
        return None
    time_s, path = time_s[rows], path[rows]
    whiten = _whitener(time_s, model)
    whole = (whiten(path), whiten(np.ones(len(rows), complex)))
    misfit = np.full(len(shifts_s), np.inf)
    for k, shift in enumerate(shifts_s.tolist()):
        there = place(time_s + shift)
        known = np.isfinite(there)
        if known.sum() < max(MIN_FIXES, SHIFT_COVERED * len(rows)):
            continue
        if known.all():
            misfit[k] = _misfit(*whole, whiten(there)) / (2 * len(rows) - 5)
        else:
            part = _whitener(time_s[known], model)
            one = part(np.ones(int(known.sum()), complex))
            misfit[k] = _misfit(part(path[known]), one, part(there[known])) / (2 * int(known.sum()) - 5)
    best = int(np.argmin(misfit))
    if not np.isfinite(misfit[best]) or misfit[best] > SHIFT_MISFIT:
        return None
    # a misfit is a mean over hundreds of fixes: what is not better by a good part is chance, drift, or another lap
    elsewhere = np.abs(shifts_s - shifts_s[best]) > SHIFT_SEPARATE_S
    if elsewhere.any() and misfit[elsewhere].min() < SHIFT_DISTINCT * max(1.0, misfit[best]):
        return None
    return float(shifts_s[best])


def without_lag(
    solution: Solution, positions: Sequence[PositionObservation], lags_s: Mapping[int, float]
) -> tuple[PositionObservation, ...]:
    """Return the fixes moved along the path to where their pictures were taken.

    The path is the solved one where frames hang together, the fixes' own elsewhere; before its first and after its
    last frame it goes on as it went.
    """
    place_of = {p.frame: p.T_map_plane.translation for p in solution.poses if p.segment == 0}
    moved: dict[int, PositionObservation] = {}
    for flight, fixes in _by_flight(positions).items():
        if flight not in lags_s or len(fixes) < 2:
            continue
        time_s = np.array([p.time_s for p in fixes], np.float64)
        path = np.array([place_of.get(p.frame, p.xy_map_m) for p in fixes]) @ (1, 1j)
        then_s = time_s - lags_s[flight]
        along = _Path(time_s, path)
        shift = path - along.at(np.clip(then_s, time_s[0], time_s[-1]))
        for end, inner in ((0, 1), (-1, -2)):
            velocity = (path[end] - path[inner]) / (time_s[end] - time_s[inner])
            beyond = then_s < time_s[0] if end == 0 else then_s > time_s[-1]
            shift[beyond] -= (then_s[beyond] - time_s[end]) * velocity
        moved.update(
            {
                p.frame: replace(p, xy_map_m=p.xy_map_m + np.array([s.real, s.imag]))
                for p, s in zip(fixes, shift, strict=True)
            }
        )
    return tuple(moved.get(p.frame, p) for p in positions)


class _Path:
    """A plan: a path between its ``(N,)`` times (strictly increasing), smooth, straight over long gaps."""

    def __init__(self, time_s: FloatArray, path: ComplexArray) -> None:
        self._time_s, self._path = time_s, path
        step = np.diff(time_s)
        self._long = step > LONG_GAP * float(np.median(step))
        # an arc between two frames is no chord: at a turn they are metres apart
        self._spline = CubicSpline(time_s, np.stack([path.real, path.imag], axis=1)) if len(time_s) >= 4 else None

    def at(self, when_s: FloatArray) -> ComplexArray:
        """``(n,)`` the places at some times within the path."""
        straight = np.interp(when_s, self._time_s, self._path)
        if self._spline is None:
            return straight
        return np.where(self.in_gap(when_s), straight, self._spline(when_s) @ (1, 1j))

    def in_gap(self, when_s: FloatArray) -> npt.NDArray[np.bool_]:
        """Which times lie in a long gap."""
        before = np.clip(np.searchsorted(self._time_s, when_s, side="right") - 1, 0, len(self._long) - 1)
        return np.asarray(self._long[before] & ~np.isin(when_s, self._time_s))


def _error_model(fixes: Sequence[PositionObservation]) -> ErrorModel:
    """Return what the fixes of a flight say of their errors."""
    whole2 = float(np.median([np.trace(p.covariance_m2) / 2.0 for p in fixes]))
    drift = float(np.median([p.correlated_sigma_m for p in fixes]))
    white = math.sqrt(max(whole2 - drift**2, MIN_WHITE_SIGMA_M**2))
    return ErrorModel(white, drift, float(np.median([p.correlation_time_s for p in fixes])))


class _whitener:
    """A plan: takes the correlation out of ``(N,)`` complex values."""

    def __init__(self, time_s: FloatArray, model: ErrorModel) -> None:
        alike = np.exp(-np.abs(time_s[:, None] - time_s[None]) / max(model.drift_time_s, 1e-3))
        covariance = model.drift_m**2 * alike + model.white_m**2 * np.eye(len(time_s))
        self._root = np.linalg.cholesky(covariance)

    def __call__(self, z: ComplexArray) -> ComplexArray:
        both = solve_triangular(self._root, np.stack([z.real, z.imag], axis=1), lower=True, check_finite=False)
        return np.asarray(both @ (1, 1j))


def _misfit(path: ComplexArray, one: ComplexArray, fix: ComplexArray) -> float:
    """Chi squared of the closest similarity from a whitened path to whitened fixes."""
    design = np.stack([path, one], axis=1)
    normal = design.conj().T @ design
    rhs = design.conj().T @ fix
    found = np.linalg.lstsq(normal, rhs, rcond=None)[0]
    return float(np.sum(np.abs(fix - design @ found) ** 2))


def _without_outliers(shifted: Sequence[ComplexArray], fix: ComplexArray) -> npt.NDArray[np.bool_]:
    """``(n,)`` which fixes are no blunders, by the lag at which most of them agree best."""
    best = np.inf
    kept = np.ones(len(fix), bool)
    for path in shifted:
        good = np.ones(len(fix), bool)
        for _ in range(3):
            p, f = path - path[good].mean(), fix - fix[good].mean()
            z = np.vdot(p[good], f[good]) / max(float(np.vdot(p[good], p[good]).real), 1e-300)
            miss = np.abs(f - z * p)
            middle = float(np.median(miss))
            good = miss <= OUTLIER * middle
        if middle < best:
            best, kept = middle, good
    return kept


def _is_least(values: FloatArray) -> npt.NDArray[np.bool_]:
    """Which values are less than their neighbours (at the ends: than the one)."""
    padded = np.concatenate([[np.inf], values, [np.inf]])
    return np.asarray((padded[1:-1] <= padded[:-2]) & (padded[1:-1] <= padded[2:]))


def _by_flight(positions: Sequence[PositionObservation]) -> dict[int, list[PositionObservation]]:
    """Fixes with a time by flight, in order of time, one an instant (a path has one place at a time)."""
    found: dict[int, dict[float, PositionObservation]] = {}
    for p in positions:
        if p.time_s is not None and np.isfinite(p.xy_map_m).all():
            found.setdefault(p.flight, {}).setdefault(p.time_s, p)
    return {flight: [by_time[t] for t in sorted(by_time)] for flight, by_time in found.items()}
