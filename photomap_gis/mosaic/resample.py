"""The pixels of several frames in one go: what is needed of each lies in an *atlas*, and one map reads from all of it.

Resampling is what a tile costs most. Frame by frame, each over the box about the pixels that it gives, boxes overlap
and most of what they hold is thrown away; out of an atlas every pixel is resampled once, whoever gives it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.similarity import FloatArray
from photomap_gis.mosaic.lattice import FloatImage

# Measured on aerial imagery: bilinear keeps 0.76 of the ground's gradient energy, cubic 1.01, Lanczos 1.00; the cost of
# the whole tile is the same within 10 %.
_INTERPOLATION = cv2.INTER_CUBIC
_BORDER_PX = 3
"""What a cubic kernel may touch beyond a frame's edge: repeated there, for in an atlas somebody else lies beyond."""

ATLAS_PX = 8192
"""An atlas has no more rows (OpenCV takes 32767): float coordinates in it are exact to a thousandth of a pixel."""


class Patch(NamedTuple):
    """A part of a frame's raster: what to add to coordinates in the raster to have them in the patch's own pixels."""

    pixels: ImageArray
    shift_x: float
    shift_y: float


def patch_of(image: ImageArray, xy_px: FloatArray) -> Patch:
    """Return the part of a raster that interpolation between ``(..., 2)`` coordinates may touch, its edge repeated."""
    (x0, x1), (y0, y1) = _span(xy_px[..., 0], image.shape[1]), _span(xy_px[..., 1], image.shape[0])
    part = image[max(y0, 0) : y1, max(x0, 0) : x1]
    beyond = max(-y0, 0), max(y1 - image.shape[0], 0), max(-x0, 0), max(x1 - image.shape[1], 0)
    if any(beyond):
        part = cv2.copyMakeBorder(part, *beyond, cv2.BORDER_REPLICATE)
    return Patch(part, float(-x0), float(-y0))


class Atlas:
    """Patches below each other in one picture, BGR where any of them is; ``shifts`` tells where each of them lies."""

    def __init__(self, patches: Sequence[Patch]) -> None:
        colour = any(p.pixels.ndim == 3 for p in patches)
        heights = [p.pixels.shape[0] for p in patches]
        tops = [sum(heights[:k]) for k in range(len(patches))]
        self.origins = [(0.0, float(top)) for top in tops]
        self.shifts = [(p.shift_x, p.shift_y + top) for p, top in zip(patches, tops, strict=True)]
        if len(patches) == 1:
            self.pixels = patches[0].pixels
            return
        size = (sum(heights), max(p.pixels.shape[1] for p in patches), *((3,) if colour else ()))
        self.pixels = np.empty(size, dtype=np.uint8)
        for p, top in zip(patches, tops, strict=True):
            pixels = cv2.cvtColor(p.pixels, cv2.COLOR_GRAY2BGR) if colour and p.pixels.ndim == 2 else p.pixels
            self.pixels[top : top + pixels.shape[0], : pixels.shape[1]] = pixels

    def read(self, xy_px: FloatImage) -> ImageArray:
        """Return ``(height, width, 3)`` BGR at ``(height, width, 2)`` coordinates in the atlas."""
        read = cv2.remap(self.pixels, xy_px, None, _INTERPOLATION, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(cv2.cvtColor(read, cv2.COLOR_GRAY2BGR) if read.ndim == 2 else read)


def in_groups(heights: Sequence[int], limit: int = ATLAS_PX) -> Iterator[slice]:
    """Yield runs of patches of these heights that fit into one atlas; one that does not has an atlas of its own."""
    first = total = 0
    for k, height in enumerate(heights):
        if total and total + height > limit:
            yield slice(first, k)
            first, total = k, 0
        total += height
    if heights:
        yield slice(first, len(heights))


def _span(values: FloatArray, size: int) -> tuple[int, int]:
    """Return the pixels (first, one past the last) that interpolation at these coordinates may touch, edge and all."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    first = int(np.clip(np.floor(low) - 2, -_BORDER_PX, size - 1))
    return first, int(np.clip(np.ceil(high) + 3, max(first, 0) + 1, size + _BORDER_PX))
