"""How well two frames agree where they overlap: the test that decides between wraps, twins and rival peaks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.ifmi.field_sums import inverse
from photomap_gis.ifmi.passes import compare
from photomap_gis.ifmi.spectrum import Floor

FEWEST_PIXELS = 64


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
    H = np.array(H_a_b, np.float64, order="C")  # in the floor's pixels
    H[:2, 2] /= a.factor
    H[2, :2] *= a.factor
    sums = np.empty(5)
    n = compare(a.seen, b.seen, inverse(H), sums)
    growth = abs(float(H[0, 0] * H[1, 1] - H[0, 1] * H[1, 0])) / H[2, 2] ** 2
    overlap = n / max(min(float(a.values.size), b.values.size * growth), 1.0)
    if n < FEWEST_PIXELS:
        return Agreement(0.0, overlap)
    sum_a, sum_b, aa, ab, bb = sums.tolist()
    cross = ab - sum_a * sum_b / n
    power = (aa - sum_a**2 / n) * (bb - sum_b**2 / n)
    return Agreement(cross / math.sqrt(power) if power > 0.0 else 0.0, overlap)


def on_floor(T_a_b: Similarity2D, factor: int) -> Similarity2D:
    """Return a motion given in frame pixels in the pixels of both frames' floors of a factor."""
    return Similarity2D(T_a_b.tx / factor, T_a_b.ty / factor, T_a_b.angle_rad, T_a_b.log_scale)
