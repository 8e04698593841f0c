"""Pictures in which two seasons look alike: how steep the ground's brightness is, whichever way it goes."""

from __future__ import annotations

from enum import StrEnum

import cv2
import numpy as np

from photomap_gis.core.frame import ImageArray
from photomap_gis.reference.imagery import Patch

SOFTENING_PX = 1.0
BRIGHTEST_PERCENT = 99.5


class Look(StrEnum):
    """How two pictures are compared."""

    GRADIENT = "gradient"
    GREY = "grey"


def seen_as(patch: Patch, look: Look) -> Patch:
    """Return a patch as it is compared."""
    return patch if look is Look.GREY else gradient_picture(patch)


def gradient_picture(patch: Patch) -> Patch:
    """Return the root of the gradient's size, stretched to 8 bits: a contrast that turns leaves it as it is.

    The root keeps a few roof edges from outshining everything. A border of the mask is lost with what lies beyond it.
    """
    mask = patch.mask
    grey = patch.grey.astype(np.float32)
    if not mask.all():
        # What is not seen is black: brought to the mean it makes no edge that reaches far inside.
        grey[~mask] = float(grey[mask].mean()) if mask.any() else 0.0
        mask = cv2.erode(mask.astype(np.uint8), np.ones((7, 7), np.uint8), borderValue=1) > 0
    soft = cv2.GaussianBlur(grey, (0, 0), SOFTENING_PX)
    size = np.sqrt(cv2.magnitude(cv2.Sobel(soft, cv2.CV_32F, 1, 0), cv2.Sobel(soft, cv2.CV_32F, 0, 1)))
    top = float(np.percentile(size[mask], BRIGHTEST_PERCENT)) if mask.any() else 0.0
    stretched = np.where(mask, size * np.float32(255.0 / max(top, 1e-6)), np.float32(0.0))
    picture: ImageArray = cv2.add(stretched.astype(np.float32), 0.0, dtype=cv2.CV_8U)
    return Patch(picture, mask)
