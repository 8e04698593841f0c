"""The canvas's inner loop: what becomes of each pixel of a tile when a frame is pasted on it, in one pass."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled

FEATHER = 0.08
"""Difference of worth over which one frame passes into another."""
LAID, DRAWN = 1, 2
"""What pasting says: the frame has ground there; it has changed what is shown."""

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int32]

_BLEND = "i8(u1[:,:,:], f4[:,:], i4[:,:], f4[:,:], f4[:,:], u1[:,:,:], u1[:,:], f4[:,:], i4, f4, f4, f4)"


@compiled(_BLEND)
def blend_pixels(
    rgb: Bytes, worth: Floats, shown: Ints, seen_s: Floats, gsd: Floats, new_rgb: Bytes, inside: Bytes,
    new_worth: Floats, key: int, new_s: float, new_gsd: float, lead: float,
) -> int:  # fmt: skip
    """Paste a frame's ``(h, w)`` pixels on a tile's planes, in place; return ``LAID`` and ``DRAWN`` as bits.

    A frame is shown whole where it is worth more by half of ``FEATHER``, mixed where it is worth about as much;
    ``lead`` is added to its worth for that, but not kept. A spot that shows nothing has a worth of minus infinity.
    """
    said = 0
    for y in range(inside.shape[0]):
        for x in range(inside.shape[1]):
            if inside[y, x] == 0:
                continue
            said |= 1
            gain = new_worth[y, x] - worth[y, x]
            share = (gain + lead) * np.float32(1.0 / FEATHER) + np.float32(0.5)
            if share >= np.float32(1.0):
                said |= 2
                for c in range(3):
                    rgb[y, x, c] = new_rgb[y, x, c]
            elif share > np.float32(0.0):
                said |= 2
                for c in range(3):
                    old = np.float32(rgb[y, x, c])
                    rgb[y, x, c] = np.uint8(old + share * (np.float32(new_rgb[y, x, c]) - old) + np.float32(0.5))
            if gain > np.float32(0.0):
                worth[y, x] = new_worth[y, x]
                shown[y, x] = key
            if new_s > seen_s[y, x]:
                seen_s[y, x] = new_s
            if new_gsd < gsd[y, x]:
                gsd[y, x] = new_gsd
    return said
