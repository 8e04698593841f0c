"""The covariance that a registration carries: what may have moved it away from the closest similarity, summed up.

Pixel noise is what the blocks' own residuals say. Everything else moves blocks as if each drew its own displacement,
and reaches the motion through the geometry of the overlap (``shape``): the *scatter* of blocks about the field, the
*outliers* (points that no smooth motion explains: raised things and movers; their pull grows with the distance that
the camera went), the *bend* (its form is not exactly a homography's), and a floor.

The numbers are the most likely ones for pairs of known truth (``python -m benchmarks.registration.calibrate``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import FloatArray

NOISE, NOISE_DECORRELATED = 3.0, 2.0
"""Variances of blocks, which take residuals for independent and slopes for exact, grow so many times, and by the second
number times what the block's correlation lacks to 1."""
SCATTER = 4.0
OUTLIER = 0.26
USUAL_OUTLIERS = 0.006
BEND = 0.005
LEAST_SIGMA_PX = 0.001


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """What was seen of a registration that tells how far it may be off, lengths in b's pixels.

    ``noise`` and ``shape`` are ``(4, 4)`` covariances about b's centre: of the blocks' noise, and of blocks that each
    scatter by one pixel an axis. ``scatter2_px2`` and ``bend2_px2`` are variances an axis, ``outliers`` a
    share of the points, ``baseline_px`` how far b's centre lies from a's.
    """

    noise: FloatArray
    shape: FloatArray
    scatter2_px2: float
    outliers: float
    baseline_px: float
    bend2_px2: float
    blocks: int

    def parts(self) -> list[FloatArray]:
        """Return the covariances whose weighted sum is the registration's, in the order of ``WEIGHTS``."""
        pull2 = (max(self.outliers - USUAL_OUTLIERS, 0.0) * self.baseline_px) ** 2
        common = max(self.blocks, 1) * self.shape  # of what moves all blocks together
        return [self.noise, self.scatter2_px2 * self.shape, pull2 * common, self.bend2_px2 * common, common]

    def covariance(self) -> FloatArray:
        """``(4, 4)`` covariance of xi about b's centre, in b's pixels; positive definite."""
        total = np.zeros((4, 4))
        for weight, part in zip(WEIGHTS, self.parts(), strict=True):
            total += weight * part
        return 0.5 * (total + total.T)


WEIGHTS = (1.0, SCATTER, OUTLIER**2, BEND**2, LEAST_SIGMA_PX**2)
