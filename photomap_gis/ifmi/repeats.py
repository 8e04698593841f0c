"""Whether the ground repeats itself under a motion: rows of crops, roof tiles, parked cars.

Repeating texture fits at every period, and a window favours the smallest shift: neither correlation nor peaks say that
it is chance. So the periods are taken from the frame's own correlation with itself, and the tiles are asked about the
motion moved by each of them. Where they speak for it as clearly as for the motion itself, which is right is not known;
where something does not repeat (weeds among the rows, cars among the lots) they do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.kernels import forward_fft, inverse_fft
from photomap_gis.ifmi.pulse import find_peaks
from photomap_gis.ifmi.spectrum import Floor, apodisation, windowed
from photomap_gis.ifmi.tiles import tile_pulses

TAPER = 0.5
LEAST_REPEAT = 0.3
"""A frame's correlation with itself, away from zero shift, from which on a period is worth asking."""
NEAREST_PX = 4.0
MOST_PERIODS = 3
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


def closest_repeat(a: Floor, b: Floor, H_a_b: FloatArray) -> Repeat | None:
    """Return the period that rivals the motion most, ``None`` where the ground does not repeat itself.

    ``H_a_b`` is the motion with its bend, ``(3, 3)``, frame pixels.
    """
    periods = _periods(a)
    if not periods:
        return None
    here = tile_pulses(a, b, H_a_b)
    if here is None:
        return None
    rivals = []
    for dx, dy, likeness in periods:
        for sign in (1.0, -1.0):
            shift = np.array([[1.0, 0.0, sign * dx * a.factor], [0.0, 1.0, sign * dy * a.factor], [0.0, 0.0, 1.0]])
            there = tile_pulses(a, b, shift @ H_a_b)
            if there is not None and len(there.near) >= 0.5 * len(here.near):
                strength = there.summed_snr / max(here.summed_snr, 1e-6)
                rivals.append(Repeat(float(shift[0, 2]), float(shift[1, 2]), strength, likeness))
                break
    return max(rivals, key=lambda r: (r.ambiguous, r.strength), default=None)


def _periods(floor: Floor) -> list[tuple[float, float, float]]:
    """Return the shifts (x, y), in pixels of the floor, by which a picture looks like itself, and how much so."""
    faded = windowed(floor.values, floor.mask, TAPER)
    own = inverse_fft((np.abs(forward_fft(faded)) ** 2).astype(np.complex64))
    if not own[0, 0] > 0.0:
        return []
    # A picture loses its rim when it is moved: divide by what the window alone would lose.
    h, w = faded.shape
    canvas = np.zeros((h, w), np.float32)
    canvas[: floor.shape[0], : floor.shape[1]] = apodisation(floor.shape, TAPER) ** 2
    window = inverse_fft((np.abs(forward_fft(canvas)) ** 2).astype(np.complex64))
    likeness = (own / own[0, 0]) / np.maximum(window / window[0, 0], np.float32(0.1))
    y, x = np.fft.fftfreq(h, 1.0 / h)[:, None], np.fft.fftfreq(w, 1.0 / w)[None, :]
    allowed = (np.hypot(x, y) > NEAREST_PX) & (np.abs(x) < floor.shape[1] / 3) & (np.abs(y) < floor.shape[0] / 3)
    allowed &= likeness >= LEAST_REPEAT
    # The hill about zero shift is no period: only what rises again counts.
    neighbours = [np.roll(likeness, s, axis) for axis in (0, 1) for s in (1, -1)]
    allowed &= likeness >= np.maximum.reduce(neighbours)
    found = []
    for p in find_peaks(own, MOST_PERIODS, radius=2, allowed=allowed & (y >= 0)):  # short periods lose least: first
        dx = p.column if p.column <= w / 2 else p.column - w
        dy = p.row if p.row <= h / 2 else p.row - h
        found.append((dx, dy, float(likeness[round(p.row) % h, round(p.column) % w])))
    return found
