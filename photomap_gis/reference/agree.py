"""Which ties believe the same: the ground has changed here and there, and repeats itself elsewhere.

Between the map as GPS lays it and the map as the reference shows it lies a small motion of the whole, bent a little by
the drift of the GPS. Wrong ties lie anywhere in their search windows, right ones where that motion takes them.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity

MAX_PAIRS = 600
MIN_AGREEING = 3
MIN_SHARE = 0.5
"""Of the ties that are believed by themselves this share must agree, else none is believed."""
MAX_TURN_RAD = 0.12
MAX_LOG_GROWTH = 0.1


def agreeing(
    predicted_m: npt.ArrayLike, measured_m: npt.ArrayLike, tolerance_m: npt.ArrayLike, weight: npt.ArrayLike
) -> npt.NDArray[np.bool_]:
    """Return which of N ties one similarity near the identity explains: the ones of the greatest total weight.

    ``predicted_m``, ``measured_m`` are ``(N, 2)`` places by the present map and by the reference; ``tolerance_m`` and
    ``weight`` ``(N,)``. Where fewer than three (or all, of fewer) agree, or too small a share of the weight, none does.
    """
    p, m = np.asarray(predicted_m, np.float64), np.asarray(measured_m, np.float64)
    tolerance, w = np.asarray(tolerance_m, np.float64), np.asarray(weight, np.float64)
    n = len(p)
    nobody = np.zeros(n, bool)
    if not n:
        return nobody
    best, best_score = nobody, -1.0
    for T in _motions(p, m):
        inside = np.hypot(*(T.apply(p) - m).T) <= tolerance
        score = float(w[inside].sum())
        if score > best_score:
            best, best_score = inside, score
    for _ in range(3):
        if best.sum() >= MIN_AGREEING:
            T = _restrained(fit_similarity(m[best], p[best], w[best]), p[best], m[best])
            again = np.hypot(*(T.apply(p) - m).T) <= tolerance
            if w[again].sum() < w[best].sum():
                break
            best = again
    if best.sum() < min(MIN_AGREEING, n) or w[best].sum() < MIN_SHARE * w.sum():
        return nobody
    return best


def _motions(p: FloatArray, m: FloatArray) -> list[Similarity2D]:
    """Return the motions to try: the shift of each tie, and the similarity of every pair (of some where many)."""
    out = [Similarity2D.translation_of(*d) for d in m - p]
    # Two ties alone are explained by a similarity of their own, whatever they say: they must share a shift.
    pairs = list(combinations(range(len(p)), 2)) if len(p) >= MIN_AGREEING else []
    if len(pairs) > MAX_PAIRS:
        step = len(pairs) / MAX_PAIRS
        pairs = [pairs[int(k * step)] for k in range(MAX_PAIRS)]
    for i, j in pairs:
        rows = [i, j]
        if np.hypot(*(p[i] - p[j])) < 1e-6 or np.hypot(*(m[i] - m[j])) < 1e-6:
            continue
        T = fit_similarity(m[rows], p[rows])
        if abs(T.angle_rad) <= MAX_TURN_RAD and abs(T.log_scale) <= MAX_LOG_GROWTH:
            out.append(T)
    return out


def _restrained(T: Similarity2D, p: FloatArray, m: FloatArray) -> Similarity2D:
    """Return a motion, as a mere shift where it turns or grows more than a map by GPS may."""
    if abs(T.angle_rad) <= MAX_TURN_RAD and abs(T.log_scale) <= MAX_LOG_GROWTH:
        return T
    return Similarity2D.translation_of(*np.median(m - p, axis=0))
