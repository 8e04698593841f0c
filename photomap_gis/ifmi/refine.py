"""Refinement: from a coarse motion to a photometric fit of a fraction of a pixel, by robust Gauss-Newton steps.

Inverse compositional Lucas-Kanade with the four degrees of freedom of a similarity and a gain, on the evenly spread
points of b's ``Template``, from the coarsest floor to the finest. Floors are normalised for local brightness and
contrast already, so no bias is needed. The step acts on the right of ``T_a_b``, about b's centre: the result's
information matrix is in the axes that ``Registration.covariance`` speaks of.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.ifmi.kernels import Image32, sample
from photomap_gis.ifmi.overlap import on_floor
from photomap_gis.ifmi.spectrum import Floor

CAUCHY = 2.0
"""Residuals beyond this many robust sigmas lose weight: shadows, cars, people, relief."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A refined motion in frame pixels, and what the last step saw.

    ``information`` is ``(4, 4)``, of xi about b's centre in b's frame pixels, under the fiction that all residuals are
    independent; ``correlation`` that of the compared points; ``support`` the share of b's points that lie in a.
    """

    T_a_b: Similarity2D
    information: FloatArray
    correlation: float
    support: float


def refine(floors_a: tuple[Floor, ...], floors_b: tuple[Floor, ...], T_a_b: Similarity2D, *, steps: int = 12) -> Fit:
    """Refine ``T_a_b`` (frame pixels) over the given floors, which are passed coarsest first, equal factors paired."""
    fit = Fit(T_a_b, np.zeros((4, 4)), 0.0, 0.0)
    for a, b in zip(floors_a, floors_b, strict=True):
        fit = _refine_floor(a, b, fit.T_a_b, steps)
        if fit.support == 0.0:
            break
    return fit


def _refine_floor(a: Floor, b: Floor, T_a_b: Similarity2D, steps: int) -> Fit:
    t = b.template
    h, w = b.shape
    cx, cy = (w - 1) / 2.0, (h - 1) / 2.0
    x, y = t.x - np.float32(cx), t.y - np.float32(cy)
    # Angle and scale are solved in pixels of movement at the half diagonal, so that the system is well conditioned.
    reach = math.hypot(cx, cy)
    J = np.stack([t.gx, t.gy, (t.gy * x - t.gx * y) / reach, (t.gx * x + t.gy * y) / reach]).reshape(4, -1)
    value = t.value.ravel()
    textured = (t.gx != 0).ravel() | (t.gy != 0).ravel()
    unit = np.array([1.0, 1.0, 1.0 / reach, 1.0 / reach])
    T = on_floor(T_a_b, b.factor)
    information, correlation, support = np.zeros((4, 4)), 0.0, 0.0
    for _ in range(steps):
        seen, valid = (v.ravel() for v in look_up(a, T, t.x, t.y))
        valid &= textured
        n = int(np.count_nonzero(valid))
        support = n / len(value)
        if n < 50:
            return Fit(T_a_b, np.zeros((4, 4)), 0.0, 0.0)
        weight = valid.astype(np.float32)
        gain = float(weight * seen @ value) / max(float(weight * value @ value), 1e-9)
        residual = seen - np.float32(max(gain, 0.05)) * value
        weight /= 1.0 + (residual / np.float32(CAUCHY * typical(residual, valid))) ** 2
        power_b, power_a = float(weight * value @ value), float(weight * seen @ seen)
        cross = float(weight * seen @ value)
        correlation = cross / math.sqrt(max(power_a * power_b, 1e-12))
        gain = cross / max(power_b, 1e-9)
        if gain <= 0.02:
            return Fit(T_a_b, np.zeros((4, 4)), correlation, 0.0)
        residual = seen - np.float32(gain) * value
        WJ = J * weight
        H = (WJ @ J.T).astype(np.float64)
        step = np.linalg.solve(H + 1e-6 * np.trace(H) * np.eye(4) / 4.0, -(WJ @ residual).astype(np.float64) / gain)
        length = float(np.abs(step[:2]).sum() + np.hypot(step[2], step[3]))
        if length > 4.0:
            step *= 4.0 / length
        xi = step * unit
        sigma2 = float(weight * residual @ residual) / max(float(weight.sum()), 1.0)
        to_frame = 1.0 / (unit * np.array([b.factor, b.factor, 1.0, 1.0]))
        information = H * gain**2 / max(sigma2, 1e-12) * np.outer(to_frame, to_frame)
        centre = Similarity2D.translation_of(cx, cy)
        T = T @ centre @ Similarity2D.exp(xi) @ centre.inverse()
        if length < 0.004:
            break
    f = b.factor
    return Fit(Similarity2D(T.tx * f, T.ty * f, T.angle_rad, T.log_scale), information, correlation, support)


def typical(residual: Image32, valid: npt.NDArray[np.bool_]) -> float:
    """Return the robust sigma of residuals; every fifth is enough to tell it."""
    some = np.abs(residual.ravel()[::5][valid.ravel()[::5]])
    return 1.4826 * float(np.median(some)) + 1e-6 if some.size else 1.0


def look_up(a: Floor, T: Similarity2D, x: Image32, y: Image32) -> tuple[Image32, npt.NDArray[np.bool_]]:
    """Return the values of a at ``T`` of b's points, and whether they lie on it; ``T`` in the floors' pixels."""
    m = T.matrix
    xa = np.float32(m[0, 0]) * x + np.float32(m[0, 1]) * y + np.float32(m[0, 2])
    ya = np.float32(m[1, 0]) * x + np.float32(m[1, 1]) * y + np.float32(m[1, 2])
    return look_up_at(a, xa, ya)


def look_up_at(a: Floor, xa: Image32, ya: Image32) -> tuple[Image32, npt.NDArray[np.bool_]]:
    """Return the values of a at float maps of pixels, and whether they lie on it."""
    h, w = a.shape
    valid = (xa >= 1) & (xa <= w - 2) & (ya >= 1) & (ya <= h - 2)
    if a.mask is not None:
        valid &= sample(a.mask, xa, ya) > 250
    return sample(a.values, xa, ya), valid
