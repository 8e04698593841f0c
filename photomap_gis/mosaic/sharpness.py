"""How blurred a frame is, from its pixels alone.

An edge that was smeared by a Gaussian of sigma s has a steepness that falls as 1 / sqrt(s^2 + t^2) when it is blurred
further by t. Two such blurs of one picture tell s, whatever the height of the edge [1]. Looked at are the steepest
places along x and along y apart: motion blurs along one axis only, and the worse axis is what counts.

[1] S. Zhuo and T. Sim: Defocus map estimation from a single image. Pattern Recognition 44 (2011).
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from photomap_gis.core.frame import ImageArray

_FINE, _COARSE = 1.0, 2.0  # sigmas of the two further blurs, pixels: the finer one also quiets the sensor's noise
_CROP_PX = 256
_STEEPEST = 0.02  # share of a crop's pixels that are looked at
_LEAST_STEEP = 1.5  # grey levels a pixel, after the finer blur: below it noise is measured
_LEAST_COUNT = 60
BLUR_DIGITS = 3
"""A blur is told to so many digits, so that one that was written down is the same."""

MAX_BLUR_PX = 8.0
"""Beyond it the method only says: at least that."""


def blur_of(image: ImageArray) -> float:
    """Return the blur of a ``(H, W)`` or ``(H, W, 3)`` picture: one sigma in its pixels, of its worse axis.

    NaN where nothing in it is steep enough to tell (water, fog). The camera's own optics count: a crisp frame has about
    half a pixel.
    """
    along = ([], [])  # type: tuple[list[np.ndarray], list[np.ndarray]]
    for y, x in _crops(*image.shape[:2]):
        crop = image[y : y + _CROP_PX, x : x + _CROP_PX]
        grey = (cv2.cvtColor(crop, cv2.COLOR_BGR2GRAY) if crop.ndim == 3 else crop).astype(np.float32)
        fine, coarse = (cv2.GaussianBlur(grey, (0, 0), s, borderType=cv2.BORDER_REPLICATE) for s in (_FINE, _COARSE))
        for axis, ratios in enumerate(along):
            ratios.append(_steepness_ratios(fine, coarse, axis))
    blurs = [_blur_from(np.concatenate(ratios)) for ratios in along]
    known = [b for b in blurs if math.isfinite(b)]
    return round(max(known), BLUR_DIGITS) if known else math.nan


def _crops(height: int, width: int) -> list[tuple[int, int]]:
    """Return the upper left corners of five crops: the middle, and half way to each corner."""
    return [
        (max(0, round(v * height) - _CROP_PX // 2), max(0, round(u * width) - _CROP_PX // 2))
        for v, u in ((0.5, 0.5), (0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75))
    ]


def _steepness_ratios(fine: np.ndarray, coarse: np.ndarray, axis: int) -> np.ndarray:
    """Return fine over coarse steepness along an axis (0: x) at the steepest places."""
    dx, dy = (1, 0) if axis == 0 else (0, 1)
    a, across = (cv2.Sobel(fine, cv2.CV_32F, *d, ksize=1, scale=0.5) for d in ((dx, dy), (dy, dx)))
    b = cv2.Sobel(coarse, cv2.CV_32F, dx, dy, ksize=1, scale=0.5)
    steep, inner = np.abs(a), np.s_[6:-6, 6:-6]
    steep = np.where(steep > np.abs(across), steep, 0.0)[inner]  # edges that run across this axis
    if steep.size == 0:
        return np.empty(0, np.float32)
    least = max(_LEAST_STEEP, float(np.quantile(steep, 1.0 - _STEEPEST)))
    at = steep >= least
    return np.asarray(steep[at] / np.maximum(np.abs(b)[inner][at], 1e-3))


def _blur_from(ratios: np.ndarray) -> float:
    if len(ratios) < _LEAST_COUNT:
        return math.nan
    r2 = float(np.median(ratios)) ** 2
    f2, c2 = _FINE**2, _COARSE**2
    if r2 <= (MAX_BLUR_PX**2 + c2) / (MAX_BLUR_PX**2 + f2):
        return MAX_BLUR_PX
    return math.sqrt(max((c2 - r2 * f2) / (r2 - 1.0), 0.0))
