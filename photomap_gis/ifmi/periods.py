"""The periods of a frame: the shifts by which it looks like itself (rows of crops, roof tiles, parked cars)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from photomap_gis.ifmi.kernels import Image32, Spectrum64, forward_fft, inverse_fft
from photomap_gis.ifmi.passes import powers, reaches
from photomap_gis.ifmi.pulse import find_peaks
from photomap_gis.ifmi.window import apodisation

LEAST_LIKENESS = 0.3
"""A frame's correlation with itself, away from zero shift, from which on a period is worth asking."""
NEAREST_PX = 3.0
MOST_PERIODS = 3
WINDOW_TAPER = 0.2


@dataclass(frozen=True, slots=True)
class Period:
    """A shift in pixels of the spectral floor, and the frame's correlation with itself there."""

    dx_px: float
    dy_px: float
    likeness: float


def find_periods(F: Spectrum64, shape: tuple[int, int]) -> tuple[Period, ...]:
    """Return the shifts by which a picture of a ``shape`` (h, w), whose half spectrum is ``F``, looks like itself."""
    power = np.empty_like(F)
    powers(F, power)
    own = inverse_fft(power)
    if not own[0, 0] > 0.0:
        return ()
    h, w = own.shape
    lost, allowed = _lost_by_window(shape, (h, w))
    if not reaches(own, lost, allowed, LEAST_LIKENESS * float(own[0, 0])):
        return ()
    likeness = own * (lost / own[0, 0])
    candidates = (likeness >= np.float32(LEAST_LIKENESS)) & allowed
    # The hill about zero shift is no period: only what rises again counts.
    candidates &= likeness >= cv2.dilate(likeness, np.ones((3, 3), np.uint8))
    found = []
    for p in find_peaks(own, MOST_PERIODS, radius=2, allowed=candidates):  # short periods lose least: first
        dx = p.column if p.column <= w / 2 else p.column - w
        dy = p.row if p.row <= h / 2 else p.row - h
        found.append(Period(dx, dy, float(likeness[round(p.row) % h, round(p.column) % w])))
    return tuple(found)


@lru_cache(maxsize=8)
def _lost_by_window(shape: tuple[int, int], canvas: tuple[int, int]) -> tuple[Image32, np.ndarray]:
    """Return by how much a moved picture's correlation is to be raised, its rim being lost, and where to look."""
    window = np.zeros(canvas, np.float32)
    window[: shape[0], : shape[1]] = apodisation(shape, WINDOW_TAPER)
    own = inverse_fft((np.abs(forward_fft(window)) ** 2).astype(np.complex64))
    y, x = (np.fft.fftfreq(n, 1.0 / n) for n in canvas)
    y, x = y[:, None], x[None, :]
    allowed = (np.hypot(x, y) > NEAREST_PX) & (np.abs(x) < shape[1] / 3) & (np.abs(y) < shape[0] / 3) & (y >= 0)
    return (own[0, 0] / np.maximum(own, 0.1 * own[0, 0])).astype(np.float32), allowed
