"""What the fixes say together: neighbours in time share their error, a flight shares a constant one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from photomap_gis.core.posegraph import PositionObservation
from photomap_gis.core.similarity import FloatArray

MIN_SIGMA_M = 0.01
BLUNDER = 4.0
"""A fix so many sigmas from what all others say of its place is put aside."""
ROUNDS = 20


def fix_covariance(fixes: Sequence[PositionObservation]) -> FloatArray:
    """``(F, F)`` covariance along one axis of the errors of fixes: white, Gauss-Markov, and a flight's bias."""
    time = np.array([np.nan if o.time_s is None else o.time_s for o in fixes])
    flight = np.array([o.flight for o in fixes])
    shared = np.array([o.correlated_sigma_m for o in fixes])
    tau = np.array([o.correlation_time_s for o in fixes])
    bias = np.array([o.bias_sigma_m for o in fixes])
    whole = np.array([float(np.trace(o.covariance_m2)) / 2.0 for o in fixes])
    same = flight[:, None] == flight[None, :]
    apart = np.abs(time[:, None] - time[None, :])
    near = np.where(np.isfinite(apart), np.exp(-np.nan_to_num(apart) / np.maximum(np.minimum.outer(tau, tau), 1e-3)), 0)
    np.fill_diagonal(near, 1.0)
    out = np.where(same, np.outer(shared, shared) * near + np.outer(bias, bias), 0.0)
    out[np.diag_indices(len(fixes))] += np.maximum(whole - shared**2, MIN_SIGMA_M**2)
    return out


def fix_information(fixes: Sequence[PositionObservation], xy: FloatArray) -> FloatArray:
    """``(F, F)`` information along one axis of the fixes, as seen from where their cameras are taken to be ``(F, 2)``.

    Blunders are put aside, and where the rest miss their places by more than they should, all are trusted less.
    """
    if not len(fixes):
        return np.zeros((0, 0))
    covariance = fix_covariance(fixes)
    miss = xy - np.array([o.xy_map_m for o in fixes])
    for _ in range(min(ROUNDS, len(fixes) // 4)):
        information = np.linalg.inv(covariance)
        # of each fix against all others: its residual in their light, and that residual's variance
        off = (information @ miss) / np.diag(information)[:, None]
        score = np.sum(off**2, axis=1) * np.diag(information) / 2.0
        worst = int(np.argmax(score))
        if score[worst] < BLUNDER**2:
            break
        covariance[worst, worst] += 1e6 * covariance[worst, worst]
    information = np.linalg.inv(covariance)
    excess = float(np.einsum("ik,ij,jk->", miss, information, miss)) / (2.0 * len(fixes))
    return np.asarray(information / max(excess, 1.0), np.float64)
