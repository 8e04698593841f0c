"""The hot doors: Fourier transforms and resampling, by OpenCV, in single precision.

OpenCV's packed real transform is the fastest on the sizes that occur here (see docs), but its packed layout is
awkward: spectra leave this file as ordinary half spectra, as ``numpy.fft.rfft2`` lays them out (``packed``).
"""

from __future__ import annotations

from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt
import scipy.fft

from photomap_gis.core.similarity import Similarity2D
from photomap_gis.ifmi.packed import pack, unpack

Image32 = npt.NDArray[np.float32]
Spectrum64 = npt.NDArray[np.complex64]
Mask8 = npt.NDArray[np.uint8]
Picture = TypeVar("Picture", Image32, Mask8)

FAR, UNSEEN = 1e4, 30.0
"""What a picture holds where nothing can be seen, and the least that is a mixture with it: no picture comes near."""
LARGEST_PACKED = 320
"""Wider pictures go through SciPy: unpacking OpenCV's layout costs them more than its transform saves."""


def fft_size(size: int) -> int:
    """Return the smallest even length >= ``size`` that transforms fast."""
    n = max(size, 2)
    while True:
        n = int(cv2.getOptimalDFTSize(n))
        if n % 2 == 0:
            return n
        n += 1


def forward_fft(image: Image32) -> Spectrum64:
    """``(h, w // 2 + 1)`` half spectrum of a real ``(h, w)`` image; h and w must be even."""
    h, w = image.shape
    if w > LARGEST_PACKED:
        return np.asarray(scipy.fft.rfft2(image), np.complex64)
    half = np.empty((h, w // 2 + 1), np.complex64)
    unpack(cv2.dft(image), half)
    return half


def inverse_fft(half: Spectrum64) -> Image32:
    """Real ``(h, w)`` image of an ``(h, w // 2 + 1)`` half spectrum; w is taken to be even."""
    h, w = half.shape[0], 2 * (half.shape[1] - 1)
    if w > LARGEST_PACKED:
        return np.asarray(scipy.fft.irfft2(half), np.float32)
    packed = np.empty((h, w), np.float32)
    pack(half, packed)
    inverse: Image32 = cv2.dft(packed, flags=cv2.DFT_INVERSE | cv2.DFT_SCALE)
    return inverse


def forward_fft_stack(images: Image32) -> Spectrum64:
    """``(n, h, w // 2 + 1)`` half spectra of ``(n, h, w)`` small images at once."""
    return np.asarray(scipy.fft.rfft2(images, axes=(1, 2)), np.complex64)


def inverse_fft_stack(halves: Spectrum64) -> Image32:
    """Real ``(n, h, w)`` images of ``(n, h, w // 2 + 1)`` half spectra; w is taken to be even."""
    return np.asarray(scipy.fft.irfft2(halves, axes=(1, 2)), np.float32)


def warp_similarity(image: Picture, T_out_in: Similarity2D, shape: tuple[int, int]) -> Picture:
    """Resample an image by ``T_out_in`` onto ``shape`` (h, w), bilinearly; 0 outside."""
    T_in_out = T_out_in.inverse().matrix[:2]
    warped: Picture = cv2.warpAffine(
        image, T_in_out, (shape[1], shape[0]), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )
    return warped


def sample(image: Picture, x: Image32, y: Image32, outside: float = 0.0) -> Picture:
    """Bilinear values at float maps of equal shape; beyond the border the picture holds ``outside``."""
    values: Picture = cv2.remap(
        image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(outside,) * 4
    )
    return values


def halve(image: Image32) -> Image32:
    """Return the next floor of the pyramid: pixel (x, y) there lies at (2 x, 2 y) here."""
    smaller: Image32 = cv2.pyrDown(image)
    return smaller
