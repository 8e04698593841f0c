"""The covariance that a registration carries: what may have moved it away from the closest similarity, summed up.

Pixel noise is what the blocks' own residuals say, and more of it where frames share little: a frame's rim looks unlike
the same ground in another's middle. The *scatter* of blocks about the field moves the motion as a whole, since what
makes blocks scatter (relief) is seldom smaller than a block. The *pull* is where blocks that the fit discounts would
take it: of things that stand high, which belong to the closest similarity, or of things that moved, which do not.
No more of it is believed than the share of points that no smooth motion explains can move, as far as the camera went.
Such points also tell of ground that is *raised* where no block is discounted: however the fit has spread it, it shifts
the motion by a share of that distance. The *bend* stands for a form that is not exactly a homography's, and nothing is
surer than interpolation between pixels is (``least_px``).

The weights are those under which pairs of known truth are held best, class by class
(``python -m benchmarks.registration.calibrate --fit``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import FloatArray


@dataclass(frozen=True, slots=True)
class Weights:
    """How much of what was seen counts. Variances are multiplied by ``noise``, ``scatter`` and the pulls.

    ``narrow`` adds to ``noise`` where little overlaps. From the share ``usual`` on, outliers can pull by ``outlying``
    times their share of the distance that the camera went: ``pull_along`` weighs the pull in its direction,
    ``pull_any`` in every one. ``raised`` times their share of that distance is a sigma of its own, the less the
    narrower the overlap, whose rim has outliers anyway. ``bend`` multiplies a sigma, ``least_px`` is one.
    """

    noise: float = 0.539
    narrow: float = 1.8
    scatter: float = 14.6
    usual: float = 0.00328
    outlying: float = 1.95
    pull_along: float = 2.02
    pull_any: float = 0.407
    raised: float = 0.0665
    bend: float = 0.00495
    least_px: float = 0.00247


WEIGHTS = Weights()


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

    def covariance(self, weights: Weights = WEIGHTS) -> FloatArray:
        """``(4, 4)`` covariance of xi about b's centre, in b's pixels; positive definite."""
        w = weights
        common = max(self.blocks, 1) * self.shape  # of what moves all blocks together
        pull2_px2 = float(self.pull @ np.linalg.solve(common, self.pull)) / 4.0
        far_px = max(self.outliers - w.usual, 0.0) * self.baseline_px
        believed = min(1.0, (w.outlying * far_px) ** 2 / max(pull2_px2, 1e-12))
        raised_px = w.raised * far_px * self.overlap**2
        together_px2 = believed * w.pull_any * pull2_px2 + raised_px**2 + w.bend**2 * self.bend2_px2 + w.least_px**2
        total = (
            w.noise * (1.0 + w.narrow * (1.0 - self.overlap)) * self.noise
            + w.scatter * self.scatter2_px2 * self.shape
            + believed * w.pull_along * np.outer(self.pull, self.pull)
            + together_px2 * common
        )
        return np.asarray(0.5 * (total + total.T), np.float64)
