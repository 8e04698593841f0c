"""What the fixes say together: neighbours in time share their error, a flight shares a constant one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from photomap_gis.core.posegraph import PositionObservation
from photomap_gis.core.similarity import FloatArray

IntArray = npt.NDArray[np.intp]

MIN_SIGMA_M = 0.01
BLUNDER = 4.0
"""A fix so many sigmas from what all others say of its place is put aside."""
BLUNDER_VARIANCE = 1e6
ROUNDS = 20
CLOSEST = 1e-9
"""Fixes of one moment share their drift but for this much: a drift that is told twice must not contradict itself."""


@dataclass(frozen=True, eq=False)
class FixNoise:
    """The errors of F fixes along either axis: white noise of ``white_variance`` ``(F,)``, a drift, a flight's bias.

    Drift and bias are of unit variance, a flight's own, and come in ``drift_sigma`` and ``bias_sigma`` ``(F,)`` times.
    The drift is a first-order Gauss-Markov process in ``phase`` ``(F,)``, time in units of its correlation time.
    """

    flight: IntArray
    phase: FloatArray
    white_variance: FloatArray
    drift_sigma: FloatArray
    bias_sigma: FloatArray

    @classmethod
    def none(cls) -> FixNoise:
        """Return the noise of no fixes."""
        return cls.white(np.zeros(0))

    @classmethod
    def white(cls, variance: FloatArray) -> FixNoise:
        """Return the noise of fixes that share nothing."""
        nothing = np.zeros(len(variance))
        return cls(np.zeros(len(variance), np.intp), nothing, np.asarray(variance, np.float64), nothing, nothing)

    @classmethod
    def of(cls, fixes: Sequence[PositionObservation]) -> FixNoise:
        """Return what fixes say of their errors; one without a time shares no drift."""
        flight = np.array([o.flight for o in fixes], np.intp)
        time = np.array([np.nan if o.time_s is None else o.time_s for o in fixes], np.float64)
        timed = np.isfinite(time)
        drift = np.where(timed, [o.correlated_sigma_m for o in fixes], 0.0)
        whole = np.array([float(np.trace(o.covariance_m2)) / 2.0 for o in fixes])
        tau = np.array([o.correlation_time_s for o in fixes], np.float64)
        phase = np.zeros(len(fixes))
        for one in np.unique(flight):
            order = np.flatnonzero((flight == one) & timed)
            order = order[np.argsort(time[order], kind="stable")]
            step = np.diff(time[order]) / np.maximum(np.minimum(tau[order][1:], tau[order][:-1]), 1e-3)
            phase[order[1:]] = np.cumsum(step)
        white = np.maximum(whole - drift**2, MIN_SIGMA_M**2)
        return cls(flight, phase, white, drift, np.array([o.bias_sigma_m for o in fixes], np.float64))

    def __len__(self) -> int:
        return len(self.white_variance)

    @property
    def covariance(self) -> FloatArray:
        """``(F, F)`` covariance of the errors along one axis."""
        near = np.exp(-np.abs(self.phase[:, None] - self.phase[None, :]))
        shared = np.outer(self.drift_sigma, self.drift_sigma) * near + np.outer(self.bias_sigma, self.bias_sigma)
        out = np.where(self.flight[:, None] == self.flight[None, :], shared, 0.0)
        out[np.diag_indices(len(self))] += self.white_variance
        return np.asarray(out, np.float64)

    @cached_property
    def information(self) -> FloatArray:
        """``(F, F)`` inverse of the covariance."""
        return np.asarray(np.linalg.inv(self.covariance), np.float64) if len(self) else np.zeros((0, 0))

    @property
    def steps(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Return fixes that follow each other in one drift, ``(C,)`` earlier and later, and how much of it stays."""
        drifts = np.flatnonzero(self.drift_sigma > 0.0)
        order = drifts[np.lexsort((self.phase[drifts], self.flight[drifts]))]
        early, late = order[:-1], order[1:]
        same = self.flight[early] == self.flight[late]
        early, late = early[same], late[same]
        stays = np.exp(-(self.phase[late] - self.phase[early]))
        return early, late, np.minimum(stays, 1.0 - CLOSEST)

    def times(self, factor: float) -> FixNoise:
        """Return errors of so many times the variance."""
        root = np.sqrt(factor)
        return FixNoise(
            self.flight, self.phase, self.white_variance * factor, self.drift_sigma * root, self.bias_sigma * root
        )


def fix_noise(fixes: Sequence[PositionObservation], xy: FloatArray) -> FixNoise:
    """Return the noise of fixes, as seen from where their cameras are taken to be ``(F, 2)``.

    Blunders are put aside, and where the rest miss their places by more than they should, all are trusted less.
    """
    if not len(fixes):
        return FixNoise.none()
    noise = FixNoise.of(fixes)
    whole = np.diag(noise.covariance)
    miss = xy - np.array([o.xy_map_m for o in fixes])
    for _ in range(min(ROUNDS, len(fixes) // 4)):
        information = noise.information
        # of each fix against all others: its residual in their light, and that residual's variance
        off = (information @ miss) / np.diag(information)[:, None]
        score = np.sum(off**2, axis=1) * np.diag(information) / 2.0
        worst = int(np.argmax(score))
        if score[worst] < BLUNDER**2:
            break
        white = noise.white_variance.copy()
        white[worst] += BLUNDER_VARIANCE * whole[worst]
        noise = replace(noise, white_variance=white)
    excess = float(np.einsum("ik,ij,jk->", miss, noise.information, miss)) / (2.0 * len(fixes))
    return noise if excess <= 1.0 else noise.times(excess)
