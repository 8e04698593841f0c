"""From the blocks' residual motions to the final motion, its covariance and the model sigma."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import FloatArray, Similarity2D, transform_jacobian
from photomap_gis.ifmi.blocks import BlockMotion
from photomap_gis.ifmi.refine import Fit
from photomap_gis.ifmi.spectrum import Spectrum

CORRELATED_RESIDUALS = 3.0
"""By how much variances grow since neighbouring residuals are not independent (calibrated on known truth)."""
MISFIT_SHARE = 0.5
"""How much of the misfit's scatter enters the motion's covariance as if every block drew it anew (calibrated)."""
FLOOR_PX = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """The final motion with its uncertainty; ``agreeing`` of ``blocks`` visible blocks moved as the motion says."""

    T_a_b: Similarity2D
    covariance: FloatArray
    model_sigma_px: float
    agreeing: int
    blocks: int


def settle(fit: Fit, motion: BlockMotion, b: Spectrum) -> Settled:
    """Return the similarity that fits the overlap evenly.

    The photometric fit listens most to where contrast is; where tilt or relief bend the motion, that is not the
    similarity closest to the whole overlap. The blocks' motions, weighted evenly, correct it.
    """
    centre = np.array([(b.shape[1] - 1) / 2.0, (b.shape[0] - 1) / 2.0])
    scale = max(b.shape) / 2.0
    base = _noise_covariance(fit, scale)
    visible = int(motion.visible.sum())
    use = motion.solved
    if int(use.sum()) < 4:
        return Settled(fit.T_a_b, 4.0 * base, 1.0, 0, visible)
    p, d = motion.centre[use] - centre, motion.displacement[use]
    noise = CORRELATED_RESIDUALS * motion.covariance[use]
    J = transform_jacobian(Similarity2D.identity(), p)  # d xi -> displacement of b's points
    noise2 = 0.5 * np.trace(noise, axis1=1, axis2=2)
    misfit2 = 0.05**2
    weight = np.ones(len(p))
    xi = np.zeros(4)
    for _ in range(6):
        w = weight / (noise2 + misfit2)
        H = np.einsum("nki,n,nkj->ij", J, w, J)
        xi = np.linalg.solve(
            H + 1e-9 * np.diag([1, 1, scale**2, scale**2]) * np.trace(H), np.einsum("nki,n,nk->i", J, w, d)
        )
        r = d - J @ xi
        r2 = np.sum(r * r, axis=1) / 2.0
        misfit2 = max(_robust_power(r2) - float(np.median(noise2)), 1e-4)
        weight = 1.0 / (1.0 + r2 / (4.0 * (misfit2 + noise2)))
    rigid = 3.0 * math.sqrt(misfit2) + 0.006 * max(b.shape)
    agreeing = int(np.count_nonzero(np.sqrt(2.0 * r2) < rigid))
    w = weight / (noise2 + MISFIT_SHARE * misfit2)
    H = np.einsum("nki,n,nkj->ij", J, w, J)
    spread = np.linalg.inv(H + 1e-9 * np.diag([1, 1, scale**2, scale**2]) * np.trace(H))
    shift = Similarity2D.translation_of(*centre)
    T = fit.T_a_b @ shift @ Similarity2D.exp(xi) @ shift.inverse()
    least = np.diag([FLOOR_PX**2, FLOOR_PX**2, (FLOOR_PX / scale) ** 2, (FLOOR_PX / scale) ** 2])
    covariance = spread + least
    return Settled(T, 0.5 * (covariance + covariance.T), math.sqrt(misfit2), agreeing, visible)


def _noise_covariance(fit: Fit, scale: float) -> FloatArray:
    ridge = np.diag([1e-4, 1e-4, 1e-4 * scale**2, 1e-4 * scale**2])
    return np.asarray(np.linalg.inv(fit.information / CORRELATED_RESIDUALS + ridge), np.float64)


def _robust_power(r2: FloatArray) -> float:
    """Return the mean of squares that a 2-D Gaussian of the same median would have, per axis."""
    return float(np.median(r2)) / math.log(2.0)
