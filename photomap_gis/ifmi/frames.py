"""Frames that cannot be used, told from the picture itself and its predecessor.

Conservative on purpose: a good frame that is thrown away leaves a hole in the map, a bad one that slips through still
has to pass the registration's own judgement.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from photomap_gis.core.frame import ImageArray

JUDGED_SIDE_PX = 512


@dataclass(frozen=True, slots=True)
class FrameVerdict:
    """Whether a frame can be used; ``reason`` says in a few words why not."""

    ok: bool
    reason: str | None = None


GOOD = FrameVerdict(True)


def judge_frame(grey: ImageArray, previous_grey: ImageArray | None = None) -> FrameVerdict:
    """Return the verdict on a grey ``(h, w)`` uint8 frame, by itself and against its predecessor of equal size."""
    if grey.ndim != 2 or grey.dtype != np.uint8:
        raise ValueError(f"grey must be (h, w) uint8, got {grey.shape} {grey.dtype}")
    mean, deviation = (float(v[0, 0]) for v in cv2.meanStdDev(grey))
    low, high = (float(v) for v in np.percentile(grey[::4, ::4], [1, 99]))
    if high - low <= 3.0 and deviation < 2.5:
        if mean < 12.0:
            return FrameVerdict(False, "black frame")
        if mean > 243.0:
            return FrameVerdict(False, "white frame")
        return FrameVerdict(False, "empty frame of one grey")
    if previous_grey is not None and previous_grey.shape == grey.shape and np.array_equal(grey, previous_grey):
        return FrameVerdict(False, "frozen: the same picture as before")
    return GOOD
