"""Whether a picture repeats the one before: told by motion, not by difference.

A hovering camera's picture differs from its predecessor by its noise, and so does a frozen picture that was coded
anew. But no camera stands still to a hundredth of a pixel, and what a codec makes of one picture twice moves nowhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.frames.look import FrameLook
from photomap_gis.ifmi.frames.traits import CELL_PX

FROZEN_PX = 0.03
"""Common motion (pixels of a picture 256 wide) up to which nothing moved."""
DOUBTFUL_PX = 0.08
RANDOM_SHARE = 0.18
"""Up to this share of it in common, motion is the codec's."""
SAME_SHARE = 0.6
SAME_PX = 0.2
STOPPED_PX = 0.35
EXPECTED_PX = 3.0
MOST_PX = 1.0
LEAST_TEXTURE = 8.0


@dataclass(frozen=True, slots=True)
class Stillness:
    """How places moved between two pictures at the same pixels, root mean square in pixels of one 256 wide.

    ``common_px`` is what a similarity explains of ``motion_px``; ``same_share`` of the pixels are equal to the bit;
    ``texture`` counts the cells that could tell.
    """

    motion_px: float
    common_px: float
    same_share: float
    texture: float


def stillness(look: FrameLook, before: FrameLook) -> Stillness:
    """Measure motion from a predecessor as if it were far below a pixel: one step of Lucas-Kanade, cell by cell."""
    same = float(np.count_nonzero(cv2.compare(look.fine, before.fine, cv2.CMP_EQ))) / look.fine.size
    a, b = before.coarse.astype(np.float32), look.coarse.astype(np.float32)
    r, s = b - a, a + b
    r -= cv2.blur(r, (17, 17))
    gx, gy = cv2.Sobel(s, cv2.CV_32F, 1, 0, scale=1 / 16), cv2.Sobel(s, cv2.CV_32F, 0, 1, scale=1 / 16)
    cells = max(1, a.shape[1] // CELL_PX), max(1, a.shape[0] // CELL_PX)
    xx, xy, yy, xr, yr = (
        cv2.resize(v, cells, interpolation=cv2.INTER_AREA) for v in (gx * gx, gx * gy, gy * gy, gx * r, gy * r)
    )
    det = (xx + 0.5) * (yy + 0.5) - xy * xy
    d = np.concatenate([(((yy + 0.5) * xr - xy * yr) / det).ravel(), (((xx + 0.5) * yr - xy * xr) / det).ravel()])
    weight = np.minimum(xx, yy).ravel()
    weight = np.tile(weight / (weight + 2.0), 2)
    J = _similarity_basis(cells)
    weighted = J * weight[:, None]
    explained = J @ np.linalg.solve(weighted.T @ J + 1e-6 * np.eye(4), weighted.T @ d)
    total = float(weight.sum()) / 2.0 + 1e-6
    scale = 256.0 / max(a.shape)  # coarse pixels to those of a picture 256 wide
    motion = scale * float(np.sqrt((weight * d * d).sum() / total))
    common = scale * float(np.sqrt((weight * explained * explained).sum() / total))
    return Stillness(motion, common, same, total)


def is_frozen(s: Stillness, expected_px: float | None) -> bool:
    """Tell whether a picture repeats its predecessor; ``expected_px`` is how far it should have moved, if known."""
    if s.motion_px > MOST_PX:
        return False
    if s.same_share > 0.98:
        return True
    if s.texture < LEAST_TEXTURE:
        return False
    if expected_px is not None and expected_px > EXPECTED_PX and s.common_px < STOPPED_PX:
        return True
    return (
        s.common_px < FROZEN_PX
        or (s.common_px < DOUBTFUL_PX and s.common_px < RANDOM_SHARE * s.motion_px)
        or (s.same_share > SAME_SHARE and s.common_px < SAME_PX)
    )


@lru_cache(maxsize=8)
def _similarity_basis(cells_wh: tuple[int, int]) -> FloatArray:
    """``(2 n, 4)``: the motion of n cells, x then y, by shift, turn and growth."""
    w, h = cells_wh
    x = np.tile((np.arange(w) + 0.5) / w * 2.0 - 1.0, h)
    y = np.repeat(((np.arange(h) + 0.5) / h * 2.0 - 1.0) * h / w, w)
    one, zero = np.ones(w * h), np.zeros(w * h)
    J = np.concatenate([np.stack([one, zero, -y, x], 1), np.stack([zero, one, x, y], 1)])
    J.setflags(write=False)
    return J
