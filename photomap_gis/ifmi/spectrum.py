"""All that is computed once a frame and reused for every pair: pyramid, spectrum, log-polar spectrum.

The log-polar spectrum is made when it is first asked for: a frame that is only ever tracked never needs it.

The *spectral* floor of the pyramid (longer side at most ``SPECTRAL_SIDE_PX``) feeds the matched filters, the floors
from it upwards feed the refinement, one below it the test of overlaps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.ifmi.kernels import FAR, Image32, Mask8, Spectrum64, fft_size, forward_fft, halve
from photomap_gis.ifmi.logpolar import PADDING as ROTATION_PADDING
from photomap_gis.ifmi.logpolar import TAPER as ROTATION_TAPER
from photomap_gis.ifmi.logpolar import log_polar_spectrum
from photomap_gis.ifmi.periods import Period, find_periods
from photomap_gis.ifmi.pomf import whiten
from photomap_gis.ifmi.template import Template, make_template, steepest_pixels
from photomap_gis.ifmi.window import apodisation, soft_mask

SPECTRAL_SIDE_PX = 160
FINEST_SIDE_PX = 720
COARSEST_SIDE_PX = 40
SHIFT_TAPER = 0.2
MEAN_RADIUS = 0.055
"""Half side of the neighbourhood of the local mean, as a share of a floor's longer side."""
GREY_FLOOR = 2.0
"""Local contrast below this many grey levels is not amplified: it is noise."""
POINTS = 2700
FEW_POINTS = 1100
"""Points of a template, and of those of floors below the spectral one: they only help to find it."""


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """One floor of a frame's pyramid: ``factor`` frame pixels to a pixel, pixel (x, y) at (factor x, factor y).

    ``values`` is the grey picture freed of its local mean and divided by its local contrast: what light and lens did
    is gone, about one unit of scatter is left. ``mask`` is 255 where the picture is to be used, ``None`` everywhere;
    ``seen`` is ``values`` with ``FAR`` where the mask is 0.
    """

    factor: int
    values: Image32
    mask: Mask8 | None
    seen: Image32
    template: Template

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.values.shape[0], self.values.shape[1]


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A frame, ready to be registered to any other.

    ``floors`` lie finest first. ``spectral`` indexes the floor of the whitened half spectrum ``phases``; ``periods``
    are the shifts by which the frame looks like itself.
    """

    index: int
    shape: tuple[int, int]
    grey: ImageArray
    mask: npt.NDArray[np.bool_] | None
    floors: tuple[Floor, ...]
    spectral: int
    phases: Spectrum64
    periods: tuple[Period, ...]

    @cached_property
    def log_polar_phases(self) -> Spectrum64:
        """The partly whitened half spectrum of the log-polar picture of the spectral floor's spectrum."""
        floor = self.floors[self.spectral]
        return log_polar_spectrum(
            forward_fft(windowed(floor.values, floor.mask, ROTATION_TAPER, padding=ROTATION_PADDING))
        )

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.shape[1], self.shape[0]


def make_spectrum(
    grey_u8: ImageArray, *, mask: npt.NDArray[np.bool_] | None = None, index: int = -1, factor: int | None = None
) -> Spectrum:
    """Return what registration needs of a grey ``(h, w)`` uint8 frame; ``mask`` is True where it may be used.

    ``factor`` chooses the spectral floor (the nearest there is), which is else the first that is small enough.
    """
    if grey_u8.ndim != 2 or grey_u8.dtype != np.uint8:
        raise ValueError(f"grey_u8 must be (h, w) uint8, got {grey_u8.shape} {grey_u8.dtype}")
    if min(grey_u8.shape) < 16:
        raise ValueError(f"grey_u8 must be at least 16 pixels high and wide, got {grey_u8.shape}")
    if mask is not None and mask.shape != grey_u8.shape:
        raise ValueError(f"mask must have the frame's shape {grey_u8.shape}, got {mask.shape}")
    floors, spectral = _pyramid(grey_u8, mask, factor)
    floor = floors[spectral]
    F = forward_fft(windowed(floor.values, floor.mask, SHIFT_TAPER))
    return Spectrum(
        index,
        grey_u8.shape,
        grey_u8,
        mask,
        floors,
        spectral,
        whiten(F),
        find_periods(F, floor.shape),
    )


def of_one_scale(a: Spectrum, b: Spectrum) -> tuple[Spectrum, Spectrum]:
    """Return both spectra, made anew where they are of frames so different in size that their floors do not pair."""
    factors = [[f.factor for f in s.floors] for s in (a, b)]
    if factors[0] == factors[1] and a.spectral == b.spectral:
        return a, b
    common = sorted(set(factors[0]) & set(factors[1]))
    if not common:
        raise ValueError(f"frames of {a.size_px} and {b.size_px} pixels are too different in size to be registered")
    wanted = max(a.floors[a.spectral].factor, b.floors[b.spectral].factor)
    factor = min(common, key=lambda f: abs(f - wanted))
    both = []
    for s in (a, b):
        made = make_spectrum(s.grey, mask=s.mask, index=s.index, factor=factor)
        floors = tuple(f for f in made.floors if f.factor in common)
        both.append(replace(made, floors=floors, spectral=common.index(factor)))
    return both[0], both[1]


def windowed(values: Image32, mask: Mask8 | None, taper: float, *, padding: int = 1) -> Image32:
    """Fade a picture out towards its borders and masked parts, on a canvas of even, fast size."""
    h, w = values.shape
    faded = values * apodisation((h, w), taper)
    if mask is not None:
        faded *= soft_mask(mask)
    return on_canvas(faded, (fft_size(h * padding), fft_size(w * padding)))


def on_canvas(image: Image32, canvas: tuple[int, int]) -> Image32:
    """Return the picture in the upper left corner of a canvas of zeros."""
    h, w = image.shape
    if (h, w) == canvas:
        return image
    padded = np.zeros(canvas, np.float32)
    padded[:h, :w] = image
    return padded


def _pyramid(grey: ImageArray, mask: npt.NDArray[np.bool_] | None, wanted: int | None) -> tuple[tuple[Floor, ...], int]:
    """Return the floors, finest first, and which of them is the spectral one."""
    picture = grey.astype(np.float32)
    weights = None if mask is None else mask.astype(np.float32)
    if weights is not None:
        picture = _filled(picture, weights)
    pictures, factor = [(1, picture, weights)], 1
    while max(picture.shape) > COARSEST_SIDE_PX * 2 and min(picture.shape) >= 48:
        picture, factor = halve(picture), factor * 2
        weights = None if weights is None else halve(weights)
        pictures.append((factor, picture, weights))
    kept = [p for p in pictures if max(p[1].shape) <= FINEST_SIDE_PX] or pictures[-1:]
    spectral = next((k for k, p in enumerate(kept) if max(p[1].shape) <= SPECTRAL_SIDE_PX), len(kept) - 1)
    if wanted is not None:
        spectral = min(range(len(kept)), key=lambda k: abs(math.log2(kept[k][0] / wanted)))
    light = _light(kept[spectral][1])
    floors: list[Floor] = []
    for factor, picture, weights in kept:
        values, m, seen = _floor_of(picture, weights, light)
        flat = steepest_pixels(values, m, POINTS if len(floors) <= spectral else FEW_POINTS)
        template = make_template(values, m, flat, factor=factor, size_px=(grey.shape[1], grey.shape[0]))
        floors.append(Floor(factor, values, m, seen, template))
    return tuple(floors), spectral


def _floor_of(
    picture: Image32, weights: Image32 | None, light: tuple[Image32, Image32]
) -> tuple[Image32, Mask8 | None, Image32]:
    """Return ``values``, ``mask`` and ``seen`` of a floor."""
    values = _normalised(picture, light)
    if weights is None:
        return values, None, values
    mask = np.where(weights > 0.99, 255, 0).astype(np.uint8)
    values[mask == 0] = 0.0
    return values, mask, np.where(mask == 0, np.float32(FAR), values)


def _filled(picture: Image32, weights: Image32) -> Image32:
    """Replace masked pixels by the mean of their unmasked surroundings, so that no edge leaks out of the mask."""
    k = (max(3, round(2 * MEAN_RADIUS * max(picture.shape)) | 1),) * 2
    total = cv2.blur(picture * weights, k, borderType=cv2.BORDER_REFLECT)
    share = cv2.blur(weights, k, borderType=cv2.BORDER_REFLECT)
    overall = float((picture * weights).sum() / max(float(weights.sum()), 1.0))
    surroundings = np.where(share > 0.02, total / np.maximum(share, np.float32(0.02)), np.float32(overall))
    filled: Image32 = np.where(weights > 0.5, picture, surroundings).astype(np.float32)
    return filled


def _light(picture: Image32) -> tuple[Image32, Image32]:
    """Return the local mean and one over the local contrast of a picture: what light and lens did to it."""
    side = max(3, round(2 * MEAN_RADIUS * max(picture.shape)) | 1)
    mean = cv2.blur(picture, (side, side), borderType=cv2.BORDER_REFLECT)
    detail = picture - mean
    power = cv2.blur(detail * detail, (2 * side + 1, 2 * side + 1), borderType=cv2.BORDER_REFLECT)
    return mean, np.float32(1.0) / cv2.sqrt(power + np.float32(GREY_FLOOR**2))


def _normalised(picture: Image32, light: tuple[Image32, Image32]) -> Image32:
    """Free a floor of its light, which is smooth enough to be taken from another floor."""
    h, w = picture.shape
    mean, gain = light if light[0].shape == (h, w) else (cv2.resize(v, (w, h)) for v in light)
    values: Image32 = cv2.GaussianBlur(picture, (5, 5), 0.8)
    values -= mean
    values *= gain
    return values
