"""Judge estimates against the truth, and say how sure the figures are."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray, Similarity2D, wrap_angle

from .pairs import Pair

SUCCESS_SHARE = 0.016
"""A registration is right where its error is below this share of the frame's width."""
CHI2_95 = {2: 5.991464547107979, 4: 9.487729036781154}
Z_95 = 1.959963984540054


@dataclass(frozen=True, slots=True)
class Error:
    """How far an estimate is from the closest similarity: ``rms_px`` over the true overlap, in a's pixels.

    ``centre_px`` is at the image centre of b; ``angle_deg`` and ``scale`` (relative) are of the motion itself.
    """

    rms_px: float
    centre_px: float
    angle_deg: float
    scale: float


def error_of(T: Similarity2D, pair: Pair) -> Error:
    """Return the error of an estimate of a pair that has a truth."""
    truth = truth_of(pair)
    return Error(
        rms_px=rms_px(T, truth, pair.points_b),
        centre_px=float(np.hypot(*(T.apply(centre_of(pair)) - truth.apply(centre_of(pair))))),
        angle_deg=abs(math.degrees(wrap_angle(T.angle_rad - truth.angle_rad))),
        scale=abs(math.expm1(T.log_scale - truth.log_scale)),
    )


def truth_of(pair: Pair) -> Similarity2D:
    """Return a pair's truth; ``ValueError`` where it has none."""
    if pair.T_a_b is None:
        raise ValueError(f"pair of class {pair.cls} ({pair.picture}) shows nothing in common: it has no truth")
    return pair.T_a_b


def rms_px(T: Similarity2D, U: Similarity2D, points: FloatArray) -> float:
    """Root mean square distance of two motions over ``(N, 2)`` points."""
    d = T.apply(points) - U.apply(points)
    return float(np.sqrt(np.mean(np.sum(d * d, axis=1))))


def is_right(rms: float, width_px: int) -> bool:
    """Whether an error keeps the success rule."""
    return rms < SUCCESS_SHARE * width_px


def centre_of(pair: Pair) -> tuple[float, float]:
    """The image centre of b."""
    w, h = pair.size_px
    return (w - 1) / 2.0, (h - 1) / 2.0


def xi_of(T: Similarity2D, pair: Pair) -> FloatArray:
    """``(4,)`` xi in ``T_true = T Exp(xi)`` about b's image centre, order x, y, theta, log s, in b's pixels."""
    centre = Similarity2D.translation_of(*centre_of(pair))
    return (centre.inverse() @ T.inverse() @ truth_of(pair) @ centre).log()


def model_rms_px(pair: Pair) -> float:
    """What ``model_sigma_px`` should be: the unavoidable residual per axis, in b's pixels."""
    return pair.residual_px / (truth_of(pair).scale * math.sqrt(2.0))


def mahalanobis2(xi: FloatArray, covariance: FloatArray) -> float:
    """Squared length of an error in its own sigmas: chi-square of as many degrees of freedom where the claim holds."""
    return float(xi @ np.linalg.solve(covariance, xi))


@dataclass(frozen=True, slots=True)
class Interval:
    """A figure and its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Calibration:
    """Whether covariances hold the truth: shares of errors in the claimed 95 % regions, NEES per degree of freedom."""

    count: int
    held_4dof: Interval
    held_xy: Interval
    nees_per_dof: Interval
    nees_median: float


def calibration(xi: FloatArray, covariance: FloatArray, rng: np.random.Generator) -> Calibration:
    """Judge ``(N, 4)`` errors by their ``(N, 4, 4)`` claimed covariances."""
    d4 = np.einsum("ni,ni->n", xi, np.linalg.solve(covariance, xi[..., None])[..., 0])
    xy = xi[:, :2]
    d2 = np.einsum("ni,ni->n", xy, np.linalg.solve(covariance[:, :2, :2], xy[..., None])[..., 0])
    return Calibration(
        count=len(xi),
        held_4dof=wilson(int(np.sum(d4 <= CHI2_95[4])), len(xi)),
        held_xy=wilson(int(np.sum(d2 <= CHI2_95[2])), len(xi)),
        nees_per_dof=bootstrap(d4 / 4.0, np.mean, rng),
        nees_median=float(np.median(d4) / 4.0),
    )


def wilson(hits: int, count: int) -> Interval:
    """Return a share and Wilson's 95 % interval."""
    if count == 0:
        return Interval(math.nan, 0.0, 1.0)
    p, z2 = hits / count, Z_95**2
    middle = (p + z2 / (2 * count)) / (1 + z2 / count)
    half = Z_95 / (1 + z2 / count) * math.sqrt(p * (1 - p) / count + z2 / (4 * count**2))
    return Interval(p, max(0.0, middle - half), min(1.0, middle + half))


def bootstrap(
    values: npt.ArrayLike, statistic: Callable[[FloatArray], Any], rng: np.random.Generator, rounds: int = 400
) -> Interval:
    """Return a statistic of ``(N,)`` values and its 95 % interval by resampling."""
    v = np.asarray(values, np.float64)
    if len(v) == 0:
        return Interval(math.nan, math.nan, math.nan)
    drawn = np.array([float(statistic(v[rng.integers(len(v), size=len(v))])) for _ in range(rounds)])
    low, high = np.quantile(drawn, (0.025, 0.975))
    return Interval(float(statistic(v)), float(low), float(high))


def median(values: npt.ArrayLike, rng: np.random.Generator) -> Interval:
    """Return the median with its 95 % interval."""
    return bootstrap(values, np.median, rng)


def quantile(values: npt.ArrayLike, q: float, rng: np.random.Generator) -> Interval:
    """Return a quantile with its 95 % interval."""
    return bootstrap(values, lambda v: np.quantile(v, q), rng)
