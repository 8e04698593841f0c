"""Pictures drawn out along an axis: what a decoder makes of a few last rows (or columns) when the rest is lost.

``Traits.smeared`` tells it where rows repeat to the bit; here they need only be alike, as they are when the frames
after it were coded on top.
"""

from __future__ import annotations

import cv2
import numpy as np

from photomap_gis.core.frame import ImageArray

FAR_ROWS, ROWS = 12, 25
"""How far apart rows are compared, and over how many of them."""
STRIP_PX = 16
FEWEST_STRIPS = 4
MEAN_SIDE_PX = 17


def drawn_out(coarse: ImageArray) -> float:
    """Return how much rows far apart (or columns) are alike where they are most, in three of four strips: -1..1.

    A road or a roof along the axis fills a strip or two; rows of crop fill all, and did so in the frame before.
    """
    return max(_alike(coarse), _alike(np.ascontiguousarray(coarse.T)))


def _alike(coarse: ImageArray) -> float:
    h, w = coarse.shape
    if h < FAR_ROWS + ROWS or w < FEWEST_STRIPS * STRIP_PX:
        return 0.0
    f = coarse.astype(np.float32)
    f -= cv2.blur(f, (MEAN_SIDE_PX, 1))
    a, b = f[:-FAR_ROWS], f[FAR_ROWS:]
    ab, aa, bb = (cv2.blur(v, (STRIP_PX, ROWS)) for v in (a * b, a * a, b * b))
    likeness = ab / (np.sqrt(aa * bb) + 1.0)
    edge = ROWS // 2
    strips = np.sort(likeness[edge : len(likeness) - edge, STRIP_PX // 2 :: STRIP_PX], axis=1)
    return float(strips[:, strips.shape[1] // 4].max())
