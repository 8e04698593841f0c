"""Refinement: from a coarse motion to a photometric fit of a fraction of a pixel, by robust Gauss-Newton steps.

Inverse compositional Lucas-Kanade with a gain on the evenly spread points of b's ``Template``, from the coarsest floor
to the finest: first a similarity, then the homography of its *field* (see ``field``). Floors are normalised for local
brightness and contrast already, so no bias is needed.

A motion here is ``G``, ``(3, 3)``: field coordinates of b (see ``template``) to frame pixels of a.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.field import field_matrix
from photomap_gis.ifmi.kernels import Image32, sample
from photomap_gis.ifmi.spectrum import FAR, Floor
from photomap_gis.ifmi.template import Template, write_derivative

CAUCHY = 2.0
"""Residuals beyond this many robust sigmas lose weight: shadows, cars, people, relief."""
SCALE_STEPS = 2
"""So many steps measure the robust sigma; later ones take it over."""
YIELDING = 0.25
"""Stiffness falls to so much of itself at every step."""
PATIENCE, RISE = 4, 0.003
"""After so many steps more are taken only while each raises the correlation by this much."""
FEWEST_POINTS = 50
LONGEST_STEP_PX = 4.0
LEAST_GAIN = 0.03
SLACK_PX = 0.4
"""So far may a point lie from where the motion puts it, in pixels of the floor, before it counts as an outlier."""
COMPANY = 0.1
""".. and so large a share of its block's points must be outliers with it."""
CLEAN = 0.97
"""From this correlation on b's own slopes are as good as those of both frames."""
LEAST_ATTENUATION = 0.15
WHOLE = np.eye(2)
"""Nothing of the slopes is lost."""


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """A refined motion ``G``, and what the last step saw.

    ``correlation`` is that of the compared points, ``support`` the share of b's points that lie in a: 0 where the fit
    has failed. ``attenuation`` ``(2, 2)`` is how much of b's slopes is found in a: noise and blur are not.
    ``seen`` ``(N,)`` are a's values at the points of b's template before the last step, ``valid`` where there are any.
    """

    G: FloatArray
    correlation: float
    support: float
    attenuation: FloatArray
    seen: Image32
    valid: npt.NDArray[np.bool_]


def align(
    a: Floor,
    b: Floor,
    G: FloatArray,
    *,
    freedom: int,
    steps: int,
    enough_px: float = 0.02,
    stiffness: float = 0.0,
    near: bool = False,
) -> Alignment:
    """Refine ``G`` on a floor by its first ``freedom`` (4: similarity, 8: homography) parameters.

    It ends where less than ``enough_px`` of the floor at ``reach_px`` are left to go. ``stiffness`` holds parameters
    from the fifth on at first: the share of the similarity's mean information that is added to theirs. ``near`` says
    that ``G`` is right to about a pixel already: then, and only then, the slopes of both frames tell how far a step has
    to go.
    """
    t = b.template
    A = t.A[: 1 + freedom].reshape(1 + freedom, -1)
    value, usable = A[0], t.usable.ravel()
    reach_px = max(b.shape) / 2.0
    correlation, support, attenuation = 0.0, 0.0, WHOLE
    gain, unit, slopes_a, before_px = 0.0, np.float32(1.0), None, math.inf
    seen, valid = value, usable
    for k in range(steps):
        seen, valid = look_up(a, G, t.Q)
        valid &= usable
        n = int(np.count_nonzero(valid))
        if n < FEWEST_POINTS:
            return Alignment(G, 0.0, 0.0, WHOLE, seen, valid)
        weight = valid.astype(np.float32)
        if gain == 0.0:
            gain = max(float((weight * seen) @ value) / max(float((weight * value) @ value), 1e-9), 0.05)
        residual = seen - np.float32(gain) * value
        if k < SCALE_STEPS:
            unit = np.float32(1.0 / (CAUCHY * typical(residual, valid)))
        residual *= unit
        residual *= residual
        residual += np.float32(1.0)
        weight /= residual
        # All the sums of products in one matrix product: b's value and derivatives with themselves and with a's value.
        W = A * weight
        own, pull = (W @ A.T).astype(np.float64), (W @ seen).astype(np.float64)
        power_b, cross, power_a = float(own[0, 0]), float(pull[0]), float((weight * seen) @ seen)
        before = correlation
        correlation, support = cross / math.sqrt(max(power_a * power_b, 1e-12)), n / value.size
        gain = cross / max(power_b, 1e-9)
        if gain <= LEAST_GAIN:
            return Alignment(G, correlation, 0.0, WHOLE, seen, valid)
        curvature = own[1:, 1:] * gain
        if near and correlation < CLEAN:
            if slopes_a is None:
                slopes_a = _slopes_of_a(a, G, t, freedom)
            curvature, attenuation = _curvature(W[1:], slopes_a, curvature)
        step = np.asarray(
            np.linalg.solve(_damped(curvature, stiffness * YIELDING**k), gain * own[1:, 0] - pull[1:]), np.float64
        )
        length_px = reach_px * math.sqrt(float(step @ step))
        if length_px > LONGEST_STEP_PX:
            step *= LONGEST_STEP_PX / length_px
        G = G @ field_matrix(step)
        # Steps shrink by a rate: what is left to go is the rest of the series.
        rate = min(length_px / before_px, 0.9)
        if length_px * max(rate / (1.0 - rate), 0.1) < enough_px or (k >= PATIENCE and correlation < before + RISE):
            break
        before_px = length_px
    return Alignment(G / G[2, 2], correlation, support, attenuation, seen, valid)


def _slopes_of_a(a: Floor, G: FloatArray, t: Template, freedom: int) -> Image32:
    """``(freedom, N)`` derivative of a's values at b's points by the motion's parameters."""
    x, y = _places(a, G, t.Q)
    half = np.float32(0.5)
    sx = half * (sample(a.values, x + 1, y) - sample(a.values, x - 1, y)).ravel()
    sy = half * (sample(a.values, x, y + 1) - sample(a.values, x, y - 1)).ravel()
    # The chain rule, with the motion's linear part in the frame's middle: a good curvature is enough.
    m = ((G[:2, :2] - np.outer(G[:2, 2], G[2, :2]) / G[2, 2]) / (G[2, 2] * a.factor)).astype(np.float32)
    J = np.empty((8, sx.size), np.float32)
    write_derivative(J, t.Q.reshape(3, -1), m[0, 0] * sx + m[1, 0] * sy, m[0, 1] * sx + m[1, 1] * sy)
    return J[:freedom]


def _curvature(WJ: Image32, J_a: Image32, alone: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the curvature of the correlation of both frames, and the share of b's slopes in it, ``(2, 2)``.

    Slopes of noise, and of detail that the other frame has lost to blur, are in what b ``alone`` promises but do not
    pull: by it alone every step falls short, and the fit ends before it is there.
    """
    both = (WJ @ J_a.T).astype(np.float64)
    both = 0.5 * (both + both.T)
    mended = _within(both, alone)
    share = np.linalg.solve(alone[:2, :2] + 1e-12 * np.eye(2), mended[:2, :2])
    return mended, 0.5 * (share + share.T)


def _within(both: FloatArray, alone: FloatArray) -> FloatArray:
    """Return a curvature kept between a small share of another and all of it, direction by direction."""
    scale = 1.0 / np.sqrt(np.maximum(alone.diagonal(), 1e-12))
    unit = np.outer(scale, scale)
    share, axes = np.linalg.eigh(both * unit)
    of_alone = ((alone * unit) @ axes * axes).sum(axis=0)
    np.minimum(np.maximum(share, LEAST_ATTENUATION * of_alone, out=share), of_alone, out=share)
    return np.asarray((axes * share) @ axes.T / unit, np.float64)


def outlying(b: Floor, fit: Alignment) -> float:
    """Return the share of b's points that the fit does not explain, were it a little off and noise as it is.

    Only points in company count: raised and moved things are patches, heavy tails of noise are not.
    """
    t = b.template
    n = int(np.count_nonzero(fit.valid))
    if n < FEWEST_POINTS:
        return 1.0
    value = t.value.ravel()
    usual = value * fit.valid
    gain = max(float(usual @ fit.seen) / max(float(usual @ usual), 1e-9), LEAST_GAIN)
    residual = np.abs(fit.seen - np.float32(gain) * value)
    steepness = np.sqrt(t.gx * t.gx + t.gy * t.gy).ravel()
    steepness *= np.float32(gain * SLACK_PX * 2.0 / max(b.shape))
    steepness += np.float32(3.0 * typical(residual, fit.valid))
    beyond = fit.valid & (residual > steepness)
    in_block = beyond.reshape(t.usable.shape).sum(axis=1)
    return float(in_block[in_block > COMPANY * fit.valid.reshape(t.usable.shape).sum(axis=1)].sum()) / n


def _damped(curvature: FloatArray, stiffness: float) -> FloatArray:
    """Return the curvature with a trace of damping, and with stiffness against the bend."""
    n = len(curvature)
    level = float(curvature.ravel()[: 4 * (n + 1) : n + 1].sum()) / 4.0
    damped = curvature.copy()
    damped.ravel()[:: n + 1] += 1e-6 * level
    if stiffness > 0.0 and n > 4:
        damped.ravel()[4 * (n + 1) :: n + 1] += stiffness * level
    return damped


def typical(residual: Image32, valid: npt.NDArray[np.bool_]) -> float:
    """Return the robust sigma of residuals; some hundreds are enough to tell it."""
    stride = max(1, residual.size // 600)
    some = np.abs(residual.ravel()[::stride][valid.ravel()[::stride]])
    if some.size == 0:
        return 1.0
    middle = some.size // 2
    return 1.4826 * float(np.partition(some, middle)[middle]) + 1e-6


def look_up(a: Floor, G: FloatArray, Q: Image32) -> tuple[Image32, npt.NDArray[np.bool_]]:
    """``(N,)`` values of a at ``G`` of b's ``Q`` (``(3, ...)``), and whether they can be seen there; else 0."""
    x, y = _places(a, G, Q)
    seen = sample(a.seen, x, y, outside=FAR).ravel()
    valid = seen < np.float32(30.0)
    seen *= valid
    return seen, valid


def _places(a: Floor, G: FloatArray, Q: Image32) -> tuple[Image32, Image32]:
    """``(1, N)`` each: where b's field coordinates lie on a floor of a, in its pixels."""
    g = G.astype(np.float32)
    g[:2] /= np.float32(a.factor)
    P = g @ Q.reshape(3, -1)
    if g[2, 0] != 0.0 or g[2, 1] != 0.0:
        P[:2] /= P[2]
    return P[0:1], P[1:2]
