"""The covariance that a registration carries: what may have moved it away from the closest similarity, summed up.

Pixel noise is what the blocks' own residuals say, and more of it where frames share little: a frame's rim looks unlike
the same ground in another's middle. The *scatter* of blocks about the field moves the motion as a whole, since what
makes blocks scatter (relief) is seldom smaller than a block. The *pull* is where blocks that the fit discounts would
take it: of things that stand high, which belong to the closest similarity, or of things that moved, which do not.
No more of it is believed than the share of points that no smooth motion explains can move, as far as the camera went.
The *bend* stands for a form that is not exactly a homography's.

The numbers are those under which pairs of known truth of every class are held best
(``python -m benchmarks.registration.calibrate``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import FloatArray

NOISE, NARROW = 0.306, 3.1
"""Variances of noise are so many times the blocks' (which are wide already), and more by the second number times the
share of the frames that does not overlap."""
SCATTER = 594.0
USUAL_OUTLIERS, OUTLYING = 0.0015, 2.5
"""From the first share on, outliers can pull by so many times their share of the distance that the camera went."""
PULL_ALONG, PULL_ANY = 5.0, 1.3
"""Variances along the pull, and in any direction."""
BEND = 0.0042
LEAST_SIGMA_PX = 0.0005


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """What was seen of a registration that tells how far it may be off, lengths in b's pixels.

    ``noise`` and ``shape`` are ``(4, 4)`` covariances about b's centre: of the blocks' noise, and of blocks that each
    scatter by one pixel an axis. ``scatter2_px2`` and ``bend2_px2`` are variances an axis, ``pull`` ``(4,)`` the xi of
    the discounted blocks, ``outliers`` a share of the points, ``baseline_px`` how far b's centre lies from a's.
    """

    noise: FloatArray
    shape: FloatArray
    scatter2_px2: float
    pull: FloatArray
    outliers: float
    baseline_px: float
    bend2_px2: float
    blocks: int
    overlap: float

    def covariance(self) -> FloatArray:
        """``(4, 4)`` covariance of xi about b's centre, in b's pixels; positive definite."""
        common = max(self.blocks, 1) * self.shape  # of what moves all blocks together
        pull2_px2 = float(self.pull @ np.linalg.solve(common, self.pull)) / 4.0
        most_px = OUTLYING * max(self.outliers - USUAL_OUTLIERS, 0.0) * self.baseline_px
        believed = min(1.0, most_px**2 / max(pull2_px2, 1e-12))
        together_px2 = believed * PULL_ANY * pull2_px2 + BEND**2 * self.bend2_px2 + LEAST_SIGMA_PX**2
        total = (
            NOISE * (1.0 + NARROW * (1.0 - self.overlap)) * self.noise
            + SCATTER * self.scatter2_px2 * self.shape
            + believed * PULL_ALONG * np.outer(self.pull, self.pull)
            + together_px2 * common
        )
        return np.asarray(0.5 * (total + total.T), np.float64)
