"""How well two frames agree where they overlap: the test that decides between wraps, twins and rival peaks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.ifmi.kernels import FAR, UNSEEN
from photomap_gis.ifmi.spectrum import Floor


@dataclass(frozen=True, slots=True)
class Agreement:
    """``correlation`` (-1..1) of two floors over their overlap; ``overlap`` is its share of the smaller frame."""

    correlation: float
    overlap: float

    @property
    def evidence(self) -> float:
        """Grow with correlation and with the area it was found on: correlations of small areas are cheap."""
        return self.correlation * math.sqrt(max(self.overlap, 0.0))


def agreement(a: Floor, b: Floor, T_a_b: Similarity2D) -> Agreement:
    """Return how floors a and b of equal factor agree under ``T_a_b``, given in the frames' own pixels."""
    return agreement_under(a, b, T_a_b.matrix)


def agreement_under(a: Floor, b: Floor, H_a_b: FloatArray) -> Agreement:
    """Return how floors a and b of equal factor agree under a ``(3, 3)`` homography of the frames' own pixels."""
    h, w = a.shape
    f = np.diag([1.0 / a.factor, 1.0 / a.factor, 1.0])
    H = f @ H_a_b @ np.diag([a.factor, a.factor, 1.0])
    warped = cv2.warpPerspective(
        b.seen, H, (w, h), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(FAR,) * 4
    ).ravel()
    seen = a.seen.ravel()
    inside = (warped < np.float32(UNSEEN)) & (seen < np.float32(UNSEEN))
    n = int(np.count_nonzero(inside))
    growth = abs(float(np.linalg.det(H[:2, :2]))) / H[2, 2] ** 2
    overlap = n / max(min(float(a.values.size), b.values.size * growth), 1.0)
    if n < 64:
        return Agreement(0.0, overlap)
    vb, va = warped * inside, seen * inside
    sum_a, sum_b = float(va.sum()), float(vb.sum())
    cross = float(va @ vb) - sum_a * sum_b / n
    power = (float(va @ va) - sum_a**2 / n) * (float(vb @ vb) - sum_b**2 / n)
    return Agreement(cross / math.sqrt(power) if power > 0.0 else 0.0, overlap)


def on_floor(T_a_b: Similarity2D, factor: int) -> Similarity2D:
    """Return a motion given in frame pixels in the pixels of both frames' floors of a factor."""
    return Similarity2D(T_a_b.tx / factor, T_a_b.ty / factor, T_a_b.angle_rad, T_a_b.log_scale)
