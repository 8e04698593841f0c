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
from photomap_gis.ifmi.template import Template, derivative

CAUCHY = 2.0
"""Residuals beyond this many robust sigmas lose weight: shadows, cars, people, relief."""
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


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """A refined motion ``G``, and what the last step saw.

    ``correlation`` is that of the compared points, ``support`` the share of b's points that lie in a: 0 where the fit
    has failed. ``attenuation`` (0..1) is how much of b's slopes is found in a: noise and blur are not.
    """

    G: FloatArray
    correlation: float
    support: float
    attenuation: float


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

    Steps shorter than ``enough_px`` of the floor at ``reach_px`` end it. ``stiffness`` holds parameters from the fifth
    on: the share of the similarity's mean information that is added to theirs. ``near`` says that ``G`` is right to
    about a pixel already: then, and only then, the slopes of both frames tell how far a step has to go.
    """
    t = b.template
    J = t.J[:freedom]
    value = t.value.ravel()
    textured = t.J[0] != 0
    textured |= t.J[1] != 0
    reach_px = max(b.shape) / 2.0
    correlation, support = 0.0, 0.0
    slopes_a, attenuation = None, 1.0
    for _ in range(steps):
        seen, valid = look_up(a, G, t.qx, t.qy)
        seen, valid = seen.ravel(), valid.ravel()
        valid &= textured
        n = int(np.count_nonzero(valid))
        if n < FEWEST_POINTS:
            return Alignment(G, 0.0, 0.0, 1.0)
        weight = valid.astype(np.float32)
        gain = float(weight * seen @ value) / max(float(weight * value @ value), 1e-9)
        residual = seen - np.float32(max(gain, 0.05)) * value
        weight /= np.float32(1.0) + np.square(residual * np.float32(1.0 / (CAUCHY * typical(residual, valid))))
        weighted = weight * value
        power_b, cross = float(weighted @ value), float(weighted @ seen)
        power_a = float(weight * seen @ seen)
        correlation, support = cross / math.sqrt(max(power_a * power_b, 1e-12)), n / len(value)
        gain = cross / max(power_b, 1e-9)
        if gain <= LEAST_GAIN:
            return Alignment(G, correlation, 0.0, 1.0)
        residual = seen - np.float32(gain) * value
        WJ = J * weight
        H = (WJ @ J.T).astype(np.float64)
        curvature = H * gain
        if near and correlation < CLEAN:
            if slopes_a is None:
                slopes_a = _slopes_of_a(a, G, t, freedom)
            curvature, attenuation = _curvature(WJ, slopes_a, curvature)
        damped = curvature.copy()
        damped.flat[:: freedom + 1] += _damping(curvature, freedom, stiffness)
        step = np.asarray(-np.linalg.solve(damped, (WJ @ residual).astype(np.float64)), np.float64)
        length_px = reach_px * math.sqrt(float(step @ step))
        if length_px > LONGEST_STEP_PX:
            step *= LONGEST_STEP_PX / length_px
        G = G @ field_matrix(step)
        if length_px < enough_px:
            break
    return Alignment(G / G[2, 2], correlation, support, attenuation)


def _slopes_of_a(a: Floor, G: FloatArray, t: Template, freedom: int) -> Image32:
    """``(freedom, N)`` derivative of a's values at b's points by the motion's parameters."""
    x, y = _places(a, G, t.qx, t.qy)
    half = np.float32(0.5)
    sx = half * (sample(a.values, x + 1, y) - sample(a.values, x - 1, y))
    sy = half * (sample(a.values, x, y + 1) - sample(a.values, x, y - 1))
    # The chain rule, with the motion's linear part in the frame's middle: a good curvature is enough.
    m = ((G[:2, :2] - np.outer(G[:2, 2], G[2, :2]) / G[2, 2]) / (G[2, 2] * a.factor)).astype(np.float32)
    return derivative(t.qx, t.qy, m[0, 0] * sx + m[1, 0] * sy, m[0, 1] * sx + m[1, 1] * sy)[:freedom]


def _curvature(WJ: Image32, J_a: Image32, alone: FloatArray) -> tuple[FloatArray, float]:
    """Return the curvature of the correlation of both frames, and its size as a share of what b ``alone`` promises.

    Slopes of noise, and of detail that the other frame has lost to blur, are in b's own curvature but do not pull:
    by it alone every step falls short, and the fit ends before it is there.
    """
    both = (WJ @ J_a.T).astype(np.float64)
    both = 0.5 * (both + both.T)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(alone), 1e-12))
    share, axes = np.linalg.eigh(both * np.outer(scale, scale))
    of_alone = np.einsum("ij,ik,kj->j", axes, alone * np.outer(scale, scale), axes)
    share = np.clip(share, LEAST_ATTENUATION * of_alone, of_alone)
    mended = (axes * share) @ axes.T / np.outer(scale, scale)
    attenuation = float(np.trace(both[:2, :2]) / max(np.trace(alone[:2, :2]), 1e-12))
    return mended, min(max(attenuation, LEAST_ATTENUATION), 1.0)


def outlying(a: Floor, b: Floor, G: FloatArray) -> float:
    """Return the share of b's points that the motion does not explain, were it a little off and noise as it is.

    Only points in company count: raised and moved things are patches, heavy tails of noise are not.
    """
    t = b.template
    seen, valid = look_up(a, G, t.qx, t.qy)
    valid &= (t.gx != 0) | (t.gy != 0)
    n = int(np.count_nonzero(valid))
    if n < FEWEST_POINTS:
        return 1.0
    value = t.value * valid
    gain = max(float(np.vdot(value, seen)) / max(float(np.vdot(value, value)), 1e-9), LEAST_GAIN)
    residual = np.abs(seen - np.float32(gain) * t.value)
    slope = np.hypot(t.gx, t.gy) * np.float32(gain * SLACK_PX * 2.0 / max(b.shape))
    beyond = valid & (residual > slope + np.float32(3.0 * typical(residual, valid)))
    in_block = np.count_nonzero(beyond, axis=1)
    return float(in_block[in_block > COMPANY * np.count_nonzero(valid, axis=1)].sum()) / n


def _damping(H: FloatArray, freedom: int, stiffness: float) -> FloatArray:
    level = float(np.trace(H[:4, :4])) / 4.0
    damping = np.full(freedom, 1e-6 * level)
    damping[4:] += stiffness * level
    return damping


def typical(residual: Image32, valid: npt.NDArray[np.bool_]) -> float:
    """Return the robust sigma of residuals; some hundreds are enough to tell it."""
    stride = max(1, residual.size // 600)
    some = np.abs(residual.ravel()[::stride][valid.ravel()[::stride]])
    if some.size == 0:
        return 1.0
    middle = some.size // 2
    return 1.4826 * float(np.partition(some, middle)[middle]) + 1e-6


def look_up(a: Floor, G: FloatArray, qx: Image32, qy: Image32) -> tuple[Image32, npt.NDArray[np.bool_]]:
    """Return the values of a at ``G`` of b's field coordinates, and whether they can be seen there; else 0."""
    x, y = _places(a, G, qx, qy)
    seen = sample(a.seen, x, y, outside=FAR)
    valid = seen < np.float32(30.0)
    seen *= valid
    return seen, valid


def _places(a: Floor, G: FloatArray, qx: Image32, qy: Image32) -> tuple[Image32, Image32]:
    """Return where b's field coordinates lie on a floor of a, in its pixels."""
    g = G.astype(np.float32)
    g[:2] /= np.float32(a.factor)
    x = g[0, 0] * qx + g[0, 1] * qy + g[0, 2]
    y = g[1, 0] * qx + g[1, 1] * qy + g[1, 2]
    if g[2, 0] != 0.0 or g[2, 1] != 0.0:
        depth = g[2, 0] * qx + g[2, 1] * qy + g[2, 2]
        x /= depth
        y /= depth
    return x, y
