"""The log-polar spectrum: where a turn and a change of scale of the picture become shifts.

The magnitude of a picture's spectrum knows nothing of translation, and turns and shrinks as the picture turns and
grows. Resampled over angle and logarithmic radius it shifts; radii are in cycles a pixel, so that frames of any shape
and padding share one grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from photomap_gis.ifmi.kernels import Image32, Spectrum64, forward_fft, sample
from photomap_gis.ifmi.pomf import half_whiten
from photomap_gis.ifmi.window import tukey

ANGLES = 256
RADII = 192
LOWEST_CYCLES_PER_PX = 0.02
HIGHEST_CYCLES_PER_PX = 0.47
ANGLE_STEP_RAD = math.pi / ANGLES
LOG_RADIUS_STEP = math.log(HIGHEST_CYCLES_PER_PX / LOWEST_CYCLES_PER_PX) / RADII
NOISE_FLOOR = 1.0
"""Added to the magnitude before the logarithm, as a share of its median: below it there is only noise to see."""
TAPER = 0.15
"""The window's fade for the log-polar spectrum: much narrower than for the shift, since what the rim of a frame shows
is all that two frames of little overlap have in common."""
PADDING = 2
"""The picture is padded to so many times its size: magnitudes are read between the spectrum's samples."""
RADIUS_EXPONENT = 0.4
"""Radii are weighted by this power: fine detail tells a turn better than coarse."""


@dataclass(frozen=True, slots=True, eq=False)
class LogPolarGrid:
    """Where to read a half spectrum (rows shifted so that zero frequency is in the middle)."""

    x: Image32
    y: Image32
    window: Image32


@lru_cache(maxsize=8)
def log_polar_grid(shape: tuple[int, int]) -> LogPolarGrid:
    """Return the reading grid for the half spectrum of a ``shape`` (h, w) picture, ``(ANGLES, RADII)``."""
    h, w = shape
    angle = (np.arange(ANGLES) / ANGLES - 0.5)[:, None] * math.pi
    radius = LOWEST_CYCLES_PER_PX * np.exp(np.arange(RADII) * LOG_RADIUS_STEP)[None, :]
    x = (np.cos(angle) * radius * w).astype(np.float32)
    y = (np.sin(angle) * radius * h + h // 2).astype(np.float32)
    # Angles are periodic, radii are not: the ends of the radius are faded out.
    weight = tukey(RADII, 0.3) * np.exp(RADIUS_EXPONENT * LOG_RADIUS_STEP * np.arange(RADII))
    window = np.broadcast_to((weight / weight.max())[None, :], x.shape).astype(np.float32)
    for a in (x, y, window):
        a.setflags(write=False)
    return LogPolarGrid(x, y, window)


def log_polar(S: Spectrum64) -> Image32:
    """``(ANGLES, RADII)`` logarithm of the magnitude of a half spectrum over angle (from -90 deg) and log radius.

    The logarithm keeps the strong low frequencies from drowning all others (the paper's second improvement); each
    radius loses its mean over the angles, which says nothing about a turn and would only tie scale to blur.
    """
    h, half = S.shape
    grid = log_polar_grid((h, 2 * (half - 1)))
    magnitude = np.abs(S)
    floor = np.float32(NOISE_FLOOR * float(np.median(magnitude[::4, ::4])) + 1e-9)
    magnitude += floor
    log_magnitude = cv2.log(magnitude)
    # Rows in the order of the frequency, without a copy of the whole: the reading grid takes two halves.
    P = sample(np.concatenate([log_magnitude[h // 2 :], log_magnitude[: h // 2]]), grid.x, grid.y)
    P -= P.mean(axis=0, keepdims=True)
    return P * grid.window


def log_polar_spectrum(S: Spectrum64) -> Spectrum64:
    """Return the partly whitened half spectrum of the log-polar picture, ready for the matched filter."""
    return half_whiten(forward_fft(log_polar(S)))
