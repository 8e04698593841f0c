"""Reading a matched filter's result: peaks, their sub-pixel place, how clear they are, and Algorithm 3."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.kernels import Image32


@dataclass(frozen=True, slots=True)
class Peak:
    """A peak at fractional ``row`` and ``column``; ``height`` is its value, ``snr`` its height over the scatter."""

    row: float
    column: float
    height: float
    snr: float


def find_peaks(
    delta: Image32, count: int, *, radius: int = 3, allowed: npt.NDArray[np.bool_] | None = None
) -> list[Peak]:
    """Return the ``count`` highest peaks at least ``radius`` cells apart, highest first; both axes are periodic.

    Where ``allowed`` is given, cells that are False are no candidates (the search is restricted, the scatter is not).
    """
    h, w = delta.shape
    mean, deviation = (float(v[0, 0]) for v in cv2.meanStdDev(delta))
    work = delta.copy() if allowed is None else np.where(allowed, delta, np.float32(-np.inf))
    peaks = []
    for _ in range(count):
        flat = int(np.argmax(work))
        r, c = divmod(flat, w)
        if not np.isfinite(work[r, c]):
            break
        rows, columns = np.arange(r - 1, r + 2) % h, np.arange(c - 1, c + 2) % w
        dr, dc = _vertex(delta[rows, c]), _vertex(delta[r, columns])
        height = float(delta[r, c])
        peaks.append(Peak(r + dr, c + dc, height, (height - mean) / max(deviation, 1e-12)))
        rr, cc = np.arange(r - radius, r + radius + 1) % h, np.arange(c - radius, c + radius + 1) % w
        work[np.ix_(rr, cc)] = -np.inf
    return peaks


def _vertex(three: Image32) -> float:
    """Return where the parabola through three values has its top, within ±0.5 of the middle."""
    a, b, c = (float(v) for v in three)
    curvature = a - 2.0 * b + c
    return 0.0 if curvature >= 0.0 else max(-0.5, min(0.5, 0.5 * (a - c) / curvature))


def pulse_covariance(delta: Image32, row: float, column: float, neighbourhood: int) -> FloatArray:
    """``(2, 2)`` covariance (row, column) of a pulse read as a probability mass (Algorithm 3, to the letter).

    Kept for reference. It is not what registrations carry: the pulse's width tells of the filter rather than of the
    error, the matched filter's values can be negative (so the result need not be positive definite), and nothing in it
    knows of tilt. See ``refine`` and ``blocks`` for the covariance in use.
    """
    h, w = delta.shape
    mass = delta / delta.sum()
    i = np.arange(round(row) - neighbourhood, round(row) + neighbourhood + 1)
    j = np.arange(round(column) - neighbourhood, round(column) + neighbourhood + 1)
    patch = mass[np.ix_(i % h, j % w)].astype(np.float64)
    di, dj = i - row, j - column
    cross = float(di @ patch @ dj)
    return np.array([[float(di**2 @ patch.sum(axis=1)), cross], [cross, float(patch.sum(axis=0) @ dj**2)]])
