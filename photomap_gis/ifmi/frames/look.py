"""What judging a frame needs of it, computed once and kept until the next frame has been compared with it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from photomap_gis.core.frame import ImageArray
from photomap_gis.ifmi.frames.traits import Traits, traits_of

FINE_SIDE_PX = 256
COARSE_SIDE_PX = 128
LEAST_SIDE_PX = 16


@dataclass(frozen=True, slots=True, eq=False)
class FrameLook:
    """A frame made small twice: longer side at most 256 (``fine``) and 128 pixels (``coarse``), both uint8.

    ``shape`` is the frame's own ``(h, w)``.
    """

    shape: tuple[int, int]
    fine: ImageArray
    coarse: ImageArray
    traits: Traits


def look_at(grey: ImageArray | FrameLook) -> FrameLook:
    """Return the look of a grey ``(h, w)`` uint8 frame; a look is handed through."""
    if isinstance(grey, FrameLook):
        return grey
    if grey.ndim != 2 or grey.dtype != np.uint8:
        raise ValueError(f"grey must be (h, w) uint8, got {grey.shape} {grey.dtype}")
    fine = shrunk(grey, FINE_SIDE_PX)
    coarse = shrunk(fine, COARSE_SIDE_PX)
    return FrameLook((grey.shape[0], grey.shape[1]), fine, coarse, traits_of(fine, coarse))


def shrunk(grey: ImageArray, side_px: int) -> ImageArray:
    """Return a picture whose longer side is at most ``side_px``; both axes shrink by (nearly) one factor."""
    factor = side_px / max(grey.shape)
    if factor >= 1.0:
        return grey
    size = max(1, round(grey.shape[1] * factor)), max(1, round(grey.shape[0] * factor))
    small: ImageArray = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return small
