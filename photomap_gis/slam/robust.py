"""How much to trust a residual: weights for re-weighted least squares, and the spread they are judged by."""

from __future__ import annotations

import numpy as np

from photomap_gis.core.similarity import FloatArray

MEDIAN_CHI2 = {1: 0.4549, 2: 1.3863, 4: 3.3567}
"""Median of chi squared by degrees of freedom."""
REJECTED_BELOW = 0.1
"""A term whose weight ends below this was put aside."""


def geman_mcclure(squared: FloatArray, limit: float) -> FloatArray:
    """Weights ``(c^2 / (c^2 + d^2))^2``: smooth, for the rounds in which the limit c still narrows."""
    return (limit * limit / (limit * limit + squared)) ** 2


def redescending(squared: FloatArray, limit: float) -> FloatArray:
    """Weights 1 within ``limit`` sigma, ``(limit / d)^4`` beyond: the pull of a far term goes to nothing.

    Good terms keep their whole weight (unlike Tukey's or Geman-McClure's), so covariances stay honest.
    """
    return np.clip(limit * limit / np.maximum(squared, 1e-300), 1e-6, 1.0) ** 2


def spread(squared: FloatArray, dof: int, redundancy: float = 1.0, *, least: float = 1.0) -> float:
    """Return by what factor residuals exceed their claimed sigmas (never below ``least``), from their median.

    ``redundancy`` is the share of the measurements that the fit has not used up: residuals shrink by its root.
    """
    if not len(squared):
        return 1.0
    return float(max(least, np.sqrt(np.median(squared) / (MEDIAN_CHI2[dof] * max(redundancy, 0.1)))))
