"""Reading a matched filter's result: peaks, their sub-pixel place, and how clear they are."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

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
    peaks: list[Peak] = []
    while len(peaks) < count:
        r, c = divmod(int(np.argmax(work)), w)
        if not np.isfinite(work[r, c]):
            break
        height = float(delta[r, c])
        dr = _vertex(float(delta[r - 1, c]), height, float(delta[(r + 1) % h, c]))
        dc = _vertex(float(delta[r, c - 1]), height, float(delta[r, (c + 1) % w]))
        peaks.append(Peak(r + dr, c + dc, height, (height - mean) / max(deviation, 1e-12)))
        if len(peaks) < count:
            rows, columns = np.arange(r - radius, r + radius + 1) % h, np.arange(c - radius, c + radius + 1) % w
            work[rows[:, None], columns] = -np.inf
    return peaks


def _vertex(a: float, b: float, c: float) -> float:
    """Return where the parabola through three values has its top, within ±0.5 of the middle."""
    curvature = a - 2.0 * b + c
    return 0.0 if curvature >= 0.0 else max(-0.5, min(0.5, 0.5 * (a - c) / curvature))
