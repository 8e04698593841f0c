"""All that is computed once a frame and reused for every pair: pyramid, spectrum, log-polar spectrum.

The *spectral* floor of the pyramid (longer side at most 320 pixels) feeds the matched filters, the floors from it
upwards feed the refinement, one below it the test of overlaps.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.ifmi.kernels import Image32, Mask8, Spectrum64, fft_size, forward_fft, halve
from photomap_gis.ifmi.logpolar import PADDING as ROTATION_PADDING
from photomap_gis.ifmi.logpolar import TAPER as ROTATION_TAPER
from photomap_gis.ifmi.logpolar import log_polar_spectrum, tukey
from photomap_gis.ifmi.pomf import whiten
from photomap_gis.ifmi.template import Template, make_template

SPECTRAL_SIDE_PX = 320
FINEST_SIDE_PX = 720
SHIFT_TAPER = 0.2
MEAN_RADIUS = 0.04
"""Half side of the neighbourhood of the local mean, as a share of a floor's longer side."""
GREY_FLOOR = 2.0
"""Local contrast below this many grey levels is not amplified: it is noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """One floor of a frame's pyramid: ``factor`` frame pixels to a pixel, pixel (x, y) at (factor x, factor y).

    ``values`` is the grey picture freed of its local mean and divided by its local contrast: what light and lens did
    is gone, about one unit of scatter is left. ``mask`` is 255 where the picture is to be used, ``None`` everywhere.
    """

    factor: int
    values: Image32
    mask: Mask8 | None
    template: Template

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.values.shape[0], self.values.shape[1]


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Spectrum:
    """A frame, ready to be registered to any other.

    ``floors`` lie finest first. ``spectral`` indexes the floor of the whitened half spectrum ``phases``;
    ``log_polar_phases`` is the whitened spectrum of its log-polar picture.
    """

    index: int
    shape: tuple[int, int]
    grey: ImageArray
    mask: npt.NDArray[np.bool_] | None
    floors: tuple[Floor, ...]
    spectral: int
    phases: Spectrum64
    log_polar_phases: Spectrum64

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.shape[1], self.shape[0]


def make_spectrum(grey_u8: ImageArray, *, mask: npt.NDArray[np.bool_] | None = None, index: int = -1) -> Spectrum:
    """Return what registration needs of a grey ``(h, w)`` uint8 frame; ``mask`` is True where it may be used."""
    if grey_u8.ndim != 2 or grey_u8.dtype != np.uint8:
        raise ValueError(f"grey_u8 must be (h, w) uint8, got {grey_u8.shape} {grey_u8.dtype}")
    if min(grey_u8.shape) < 16:
        raise ValueError(f"grey_u8 must be at least 16 pixels high and wide, got {grey_u8.shape}")
    if mask is not None and mask.shape != grey_u8.shape:
        raise ValueError(f"mask must have the frame's shape {grey_u8.shape}, got {mask.shape}")
    floors = _pyramid(grey_u8, mask)
    spectral = next(k for k, f in enumerate(floors) if max(f.shape) <= SPECTRAL_SIDE_PX)
    floor = floors[spectral]
    F = forward_fft(windowed(floor.values, floor.mask, SHIFT_TAPER))
    S = forward_fft(windowed(floor.values, floor.mask, ROTATION_TAPER, padding=ROTATION_PADDING))
    return Spectrum(index, grey_u8.shape, grey_u8, mask, floors, spectral, whiten(F), log_polar_spectrum(S))


def windowed(values: Image32, mask: Mask8 | None, taper: float, *, padding: int = 1) -> Image32:
    """Fade a picture out towards its borders and masked parts, on a canvas of even, fast size."""
    h, w = values.shape
    faded = values * apodisation((h, w), taper)
    if mask is not None:
        faded *= soft_mask(mask)
    canvas = fft_size(h * padding), fft_size(w * padding)
    if canvas == (h, w):
        return faded
    padded: Image32 = cv2.copyMakeBorder(faded, 0, canvas[0] - h, 0, canvas[1] - w, cv2.BORDER_CONSTANT, value=0)
    return padded


@lru_cache(maxsize=16)
def apodisation(shape: tuple[int, int], taper: float) -> Image32:
    """``(h, w)`` separable Tukey window."""
    window: Image32 = np.outer(tukey(shape[0], taper), tukey(shape[1], taper)).astype(np.float32)
    window.setflags(write=False)
    return window


def soft_mask(mask: Mask8) -> Image32:
    """Return a mask as weights 0..1 that fade inwards, so that its outline writes nothing into the spectrum."""
    k = max(3, round(0.03 * max(mask.shape)) | 1)
    eroded = cv2.erode(mask, np.ones((k, k), np.uint8), borderValue=255)
    soft: Image32 = cv2.blur(eroded, (k, k)).astype(np.float32) / np.float32(255.0)
    return soft


def _pyramid(grey: ImageArray, mask: npt.NDArray[np.bool_] | None) -> tuple[Floor, ...]:
    picture = grey.astype(np.float32)
    weights = None if mask is None else mask.astype(np.float32)
    if weights is not None:
        picture = _filled(picture, weights)
    floors, factor = [], 1
    while True:
        if max(picture.shape) <= FINEST_SIDE_PX:
            m = None if weights is None else np.where(weights > 0.99, 255, 0).astype(np.uint8)
            values = _normalised(picture, m)
            floors.append(Floor(factor, values, m, make_template(values, m)))
        if max(picture.shape) <= SPECTRAL_SIDE_PX / 2 or min(picture.shape) < 24:
            return tuple(floors)
        picture, factor = halve(picture), factor * 2
        weights = None if weights is None else halve(weights)


def _filled(picture: Image32, weights: Image32) -> Image32:
    """Replace masked pixels by the mean of their unmasked surroundings, so that no edge leaks out of the mask."""
    k = (max(3, round(2 * MEAN_RADIUS * max(picture.shape)) | 1),) * 2
    total = cv2.blur(picture * weights, k, borderType=cv2.BORDER_REFLECT)
    share = cv2.blur(weights, k, borderType=cv2.BORDER_REFLECT)
    overall = float((picture * weights).sum() / max(float(weights.sum()), 1.0))
    surroundings = np.where(share > 0.02, total / np.maximum(share, np.float32(0.02)), np.float32(overall))
    filled: Image32 = np.where(weights > 0.5, picture, surroundings).astype(np.float32)
    return filled


def _normalised(picture: Image32, mask: Mask8 | None) -> Image32:
    side = max(3, round(2 * MEAN_RADIUS * max(picture.shape)) | 1)
    smooth = cv2.GaussianBlur(picture, (0, 0), 0.8)
    detail = smooth - cv2.blur(picture, (side, side), borderType=cv2.BORDER_REFLECT)
    power = cv2.blur(detail * detail, (2 * side + 1, 2 * side + 1), borderType=cv2.BORDER_REFLECT)
    values: Image32 = detail / cv2.sqrt(power + np.float32(GREY_FLOOR**2))
    if mask is not None:
        values[mask == 0] = 0.0
    return values
