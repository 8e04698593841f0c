"""How well two frames agree where they overlap: the test that decides between wraps, twins and rival peaks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import Similarity2D
from photomap_gis.ifmi.kernels import warp_similarity
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


NOTHING = Agreement(0.0, 0.0)


def agreement(a: Floor, b: Floor, T_a_b: Similarity2D) -> Agreement:
    """Return how floors a and b of equal factor agree under ``T_a_b``, given in the frames' own pixels."""
    T = on_floor(T_a_b, a.factor)
    warped = warp_similarity(b.values, T, a.shape)
    inside = warp_similarity(full_mask(b), T, a.shape) > 250
    if a.mask is not None:
        inside &= a.mask > 0
    n = int(np.count_nonzero(inside))
    smaller = min(a.values.size, b.values.size * T.scale**2)
    if n < 64:
        return Agreement(0.0, n / smaller)
    va, vb = a.values[inside], warped[inside]
    va = va - va.mean()
    vb = vb - vb.mean()
    power = float(va @ va) * float(vb @ vb)
    return Agreement(float(va @ vb) / math.sqrt(power) if power > 0.0 else 0.0, n / smaller)


def full_mask(floor: Floor) -> np.ndarray:
    """Return the floor's mask, made where there is none."""
    return np.full(floor.shape, 255, np.uint8) if floor.mask is None else floor.mask


def on_floor(T_a_b: Similarity2D, factor: int) -> Similarity2D:
    """Return a motion given in frame pixels in the pixels of both frames' floors of a factor."""
    return Similarity2D(T_a_b.tx / factor, T_a_b.ty / factor, T_a_b.angle_rad, T_a_b.log_scale)
