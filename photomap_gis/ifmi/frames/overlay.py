"""What is drawn over every picture of a camera: logos, telemetry text, letter boxes, propellers."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.ifmi.frames.fit import Mask8
from photomap_gis.ifmi.frames.look import FINE_SIDE_PX, shrunk

FEWEST_FRAMES = 4
QUIET_SHARE = 0.35
"""A pixel that changes by less than this share of what is usual in its picture stands still."""
EDGE_SHARE = 0.6
"""An edge that is there in the middle of all frames, at this share of its usual strength, is drawn."""
EDGE_GREY = 8.0
LEAST_CHANGE = 4.0
MOST_SHARE = 0.5
SPECK_SHARE = 2e-4


def fixed_overlay_mask(frames: Sequence[ImageArray]) -> npt.NDArray[np.bool_]:
    """``(h, w)`` True where frames of one camera show the ground: give it to ``make_spectrum(mask=...)``.

    ``frames`` are four or more grey ``(h, w)`` uint8 frames between which the camera moved. Where they hardly differ at
    all (nothing moved, or the ground is bare) nothing can be told, and all of it is True.
    """
    if len(frames) < FEWEST_FRAMES:
        raise ValueError(f"frames must be at least {FEWEST_FRAMES}, got {len(frames)}")
    shapes = {f.shape for f in frames}
    if len(shapes) > 1:
        raise ValueError(f"frames must be of one size, got {sorted(shapes)}")
    h, w = frames[0].shape
    stack = np.stack([shrunk(f, FINE_SIDE_PX) for f in frames]).astype(np.float32)
    change = stack.std(axis=0)
    usual = float(np.median(change))
    if usual < LEAST_CHANGE:
        return np.ones((h, w), np.bool_)
    quiet = cv2.blur(change, (3, 3)) < QUIET_SHARE * usual
    fixed = (quiet | _standing_edges(stack)).astype(np.uint8)
    fixed = _without_specks(cv2.morphologyEx(fixed, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)))
    if float(fixed.mean()) > MOST_SHARE:
        return np.ones((h, w), np.bool_)
    # what changes within a line of text (its digits) lies between what does not
    fixed = cv2.morphologyEx(fixed, cv2.MORPH_CLOSE, np.ones((3, 11), np.uint8))
    fixed = cv2.dilate(fixed, np.ones((5, 5), np.uint8))
    whole = cv2.resize(fixed * np.uint8(255), (w, h), interpolation=cv2.INTER_LINEAR)
    return np.asarray(whole < 64)


def _standing_edges(stack: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """``(h, w)`` True at edges that every picture has: those of ground that moves cancel out in the median."""
    along = np.stack([cv2.Sobel(p, cv2.CV_32F, 1, 0, scale=1 / 4) for p in stack])
    down = np.stack([cv2.Sobel(p, cv2.CV_32F, 0, 1, scale=1 / 4) for p in stack])
    standing = np.hypot(np.median(along, axis=0), np.median(down, axis=0))
    usual = np.median(np.hypot(along, down), axis=0)
    return np.asarray((standing > EDGE_SHARE * usual) & (standing > max(EDGE_GREY, 2.0 * float(np.median(usual)))))


def _without_specks(fixed: Mask8) -> Mask8:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(fixed, connectivity=8)
    kept = stats[:count, cv2.CC_STAT_AREA] >= max(4.0, SPECK_SHARE * fixed.size)
    kept[0] = False
    return np.asarray(kept[labels], np.uint8)
