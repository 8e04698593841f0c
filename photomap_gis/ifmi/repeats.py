"""Whether the ground repeats itself under a motion: rows of crops, roof tiles, parked cars.

Repeating texture fits at every period, and a window favours the smallest shift: neither correlation nor peaks say that
it is chance. So the tiles are asked about the motion moved by each of the frame's own periods. Where they speak for it
as clearly as for the motion itself, which is right is not known; where something does not repeat (weeds among the
rows, cars among the lots) they do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.spectrum import Spectrum
from photomap_gis.ifmi.tiles import TilePulses, tile_pulses

RIVAL_STRENGTH = 0.85
WHOLLY_PERIODIC = 0.85


@dataclass(frozen=True, slots=True)
class Repeat:
    """A shift in a's frame pixels by which the ground repeats.

    ``strength`` is the tiles' word for it as a share of the winner's, ``likeness`` the frame's correlation with itself.
    """

    dx_px: float
    dy_px: float
    strength: float
    likeness: float

    @property
    def ambiguous(self) -> bool:
        """Whether the motion moved by the period may as well be right."""
        return self.strength > RIVAL_STRENGTH or self.likeness > WHOLLY_PERIODIC


def closest_repeat(a: Spectrum, b: Spectrum, H_a_b: FloatArray, here: TilePulses) -> Repeat | None:
    """Return the period that rivals the motion most, ``None`` where the ground does not repeat itself.

    ``H_a_b`` is the motion with its bend, ``(3, 3)``, frame pixels, ``here`` what the tiles say of it.
    """
    floor_a, floor_b = a.floors[a.spectral], b.floors[b.spectral]
    rivals = []
    for period in a.periods:
        for sign in (1.0, -1.0):
            dx, dy = (sign * d * floor_a.factor for d in (period.dx_px, period.dy_px))
            shift = np.array([[1.0, 0.0, dx], [0.0, 1.0, dy], [0.0, 0.0, 1.0]])
            there = tile_pulses(floor_a, floor_b, shift @ H_a_b)
            if there is not None and len(there.near) >= 0.5 * len(here.near):
                strength = there.summed_snr / max(here.summed_snr, 1e-6)
                rivals.append(Repeat(dx, dy, strength, period.likeness))
                break
    return max(rivals, key=lambda r: (r.ambiguous, r.strength), default=None)
