"""Windows: what fades a picture out where its spectrum must not see an edge."""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np

from photomap_gis.ifmi.kernels import Image32, Mask8


@lru_cache(maxsize=256)
def tukey(n: int, taper: float) -> Image32:
    """``(n,)`` flat window whose ends fade over the share ``taper`` of its length (half at each end)."""
    x = (np.arange(n) + 0.5) / n
    ramp = np.clip(np.minimum(x, 1.0 - x) / max(taper / 2.0, 1e-9), 0.0, 1.0)
    window: Image32 = (0.5 - 0.5 * np.cos(math.pi * ramp)).astype(np.float32)
    window.setflags(write=False)
    return window


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
