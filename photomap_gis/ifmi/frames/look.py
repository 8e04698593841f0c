"""What judging a frame needs of it, computed once and kept until the next frame has been compared with it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.ifmi.frames.traits import Traits, traits_of

FINE_SIDE_PX = 256
COARSE_SIDE_PX = 128
LEAST_SIDE_PX = 16


@dataclass(frozen=True, slots=True, eq=False)
class FrameLook:
    """A frame made small twice: longer side at most 256 (``fine``) and 128 pixels (``coarse``), both uint8.

    ``shape`` is the frame's own ``(h, w)``. ``usable`` is 255 in the coarse picture where the frame may be compared,
    ``None`` where it may everywhere.
    """

    shape: tuple[int, int]
    fine: ImageArray
    coarse: ImageArray
    traits: Traits
    usable: npt.NDArray[np.uint8] | None = None


def look_at(grey: ImageArray | FrameLook, *, mask: npt.NDArray[np.bool_] | None = None) -> FrameLook:
    """Return the look of a grey ``(h, w)`` uint8 frame, ``mask`` True where it may be used.

    A look is handed through.
    """
    if isinstance(grey, FrameLook):
        return grey
    if grey.ndim != 2 or grey.dtype != np.uint8:
        raise ValueError(f"grey must be (h, w) uint8, got {grey.shape} {grey.dtype}")
    fine = shrunk(grey, FINE_SIDE_PX)
    coarse = shrunk(fine, COARSE_SIDE_PX)
    usable = None
    if mask is not None:
        if mask.shape != grey.shape:
            raise ValueError(f"mask must have the frame's shape {grey.shape}, got {mask.shape}")
        size = coarse.shape[1], coarse.shape[0]
        share = cv2.resize(mask.astype(np.uint8) * np.uint8(255), size, interpolation=cv2.INTER_AREA)
        usable = cv2.threshold(share, 250, 255, cv2.THRESH_BINARY)[1]
    return FrameLook((grey.shape[0], grey.shape[1]), fine, coarse, traits_of(fine, coarse), usable)


def shrunk(grey: ImageArray, side_px: int) -> ImageArray:
    """Return a picture whose longer side is at most ``side_px``; both axes shrink by (nearly) one factor."""
    factor = side_px / max(grey.shape)
    if factor >= 1.0:
        return grey
    size = max(1, round(grey.shape[1] * factor)), max(1, round(grey.shape[0] * factor))
    small: ImageArray = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return small
