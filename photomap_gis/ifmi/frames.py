"""Frames that cannot be used, told from the picture itself and its predecessor.

Conservative on purpose: a good frame that is thrown away leaves a hole in the map, a bad one that slips through still
has to pass the registration's own judgement. What the predecessor shows too (letter boxes, overlays, a soft lens) is
the camera's habit, not this frame's fault.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.similarity import FloatArray

BLUR_SIDE_PX = 512
EMPTY_RANGE = 3.0
"""Grey levels between the 1st and 99th percentile up to which a frame shows nothing."""
FROZEN_DIFFERENCE = 0.15
"""Mean grey difference up to which a frame repeats its predecessor: even a hovering camera's noise is more."""
FLAT_SHARE = 0.15
FLAT_ROW_DEVIATION = 0.6
SMEARED_SHARE = 0.1
SAME_ROW_DIFFERENCE = 0.3
TEAR_RATIO = 2.2
"""How much more two neighbouring rows differ than their surroundings where a frame is torn."""
BLOCK_SHARE = 0.015
SHARPNESS = 0.12
"""Detail of one pixel over detail of eight, below which nothing fine is left."""


@dataclass(frozen=True, slots=True)
class FrameVerdict:
    """Whether a frame can be used; ``reason`` says in a few words why not."""

    ok: bool
    reason: str | None = None


GOOD = FrameVerdict(True)


def judge_frame(grey: ImageArray, previous_grey: ImageArray | None = None) -> FrameVerdict:
    """Return the verdict on a grey ``(h, w)`` uint8 frame, by itself and against its predecessor.

    A predecessor of another size is not compared.
    """
    if grey.ndim != 2 or grey.dtype != np.uint8:
        raise ValueError(f"grey must be (h, w) uint8, got {grey.shape} {grey.dtype}")
    previous = None if previous_grey is None or previous_grey.shape != grey.shape else previous_grey
    if min(grey.shape) < 16:
        return FrameVerdict(False, "too small")
    for look in (_empty, _frozen, _half_empty, _smeared, _in_blocks, _torn):  # the surest and cheapest first
        fault = look(grey, previous)
        if fault is not None:
            return FrameVerdict(False, fault)
    sharp = sharpness(grey)
    if sharp < SHARPNESS and (previous is None or sharpness(previous) > 2.0 * sharp):
        return FrameVerdict(False, "blurred")
    return GOOD


def _empty(grey: ImageArray, previous: ImageArray | None) -> str | None:
    stride = max(1, max(grey.shape) // 512)
    low, high = (float(v) for v in np.percentile(grey[::stride, ::stride], [1, 99]))
    if high - low > EMPTY_RANGE:
        return None
    return "black" if high < 16.0 else "white" if low > 240.0 else "empty: one grey or colour"


def _frozen(grey: ImageArray, previous: ImageArray | None) -> str | None:
    if previous is None or float(cv2.absdiff(grey, previous).mean()) > FROZEN_DIFFERENCE:
        return None
    return "frozen: repeats the frame before"


def _half_empty(grey: ImageArray, previous: ImageArray | None) -> str | None:
    """Find a band of rows of one value: what a decoder leaves where data is missing."""
    flat = _flat_rows(grey)
    if previous is not None:
        flat &= ~_flat_rows(previous)
    # Black bars at top and bottom are a letter box, and white may be glare or snow: neither is a fault.
    level = grey.mean(axis=1)
    flat &= (level > 20.0) & (level < 250.0)
    share = float(flat.mean())
    return f"corrupt: {share:.0%} of the rows are empty" if share > FLAT_SHARE else None


def _smeared(grey: ImageArray, previous: ImageArray | None) -> str | None:
    """Find rows that repeat the row above, one after the other: what a decoder draws where data is missing."""
    same = cv2.absdiff(grey[1:], grey[:-1]).mean(axis=1) < SAME_ROW_DIFFERENCE
    same &= grey[1:].std(axis=1) >= FLAT_ROW_DEVIATION
    ends = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    longest = int((ends[1::2] - ends[::2]).max(initial=0))
    return f"corrupt: {longest / len(grey):.0%} of the rows repeat" if longest > SMEARED_SHARE * len(grey) else None


def _flat_rows(grey: ImageArray) -> npt.NDArray[np.bool_]:
    """``(h,)`` True where a row and its neighbours hold one value."""
    rows = grey.astype(np.float32)
    deviation = rows.std(axis=1)
    step = np.zeros(len(rows))
    step[1:] = np.abs(np.diff(rows.mean(axis=1)))
    return np.asarray((deviation < FLAT_ROW_DEVIATION) & (step < 2.0))


def _in_blocks(grey: ImageArray, previous: ImageArray | None) -> str | None:
    share = block_share(grey)
    if share <= BLOCK_SHARE or (previous is not None and block_share(previous) > 0.5 * share):
        return None
    return "corrupt: blocks that do not fit together"


def _torn(grey: ImageArray, previous: ImageArray | None) -> str | None:
    ratio, row = _tear(grey)
    if ratio < TEAR_RATIO:
        return None
    if previous is not None:
        before, row_before = _tear(previous)
        if before > 0.5 * ratio and abs(row - row_before) <= 1:
            return None  # the same line again: an overlay or a caption's border
    return f"torn at {row / len(grey):.0%} of its height"


def _tear(grey: ImageArray) -> tuple[float, int]:
    """Return how much the most suspicious pair of rows stands out, and the row."""
    difference = grey[1:].astype(np.float32) - grey[:-1].astype(np.float32)
    # A tear runs through the whole width (the median over strips), and what lies on its two sides has nothing to do
    # with each other: the difference scatters, where a road's edge is a step of one height.
    strips = [s.std(axis=1) for s in np.array_split(difference, 16, axis=1)]
    profile: FloatArray = np.median(np.stack(strips), axis=0)
    inner = slice(4, len(profile) - 4)
    padded = np.pad(profile, 8, mode="reflect")
    surroundings = np.median(np.lib.stride_tricks.sliding_window_view(padded, 17), axis=1)
    ratio = (profile / (surroundings + 1.0))[inner]
    row = int(np.argmax(ratio))
    return float(ratio[row]), row + 4


def block_share(grey: ImageArray) -> float:
    """Return the share of the picture's area whose blocks are cut off from their neighbours by straight, level steps.

    A lost macro block leaves steps that are one pixel wide, exactly level or plumb, and many pixels long, between
    surroundings that are smooth: neither optics nor nature draws those.
    """
    picture = grey.astype(np.int16)
    # Blocks have sides of both kinds; furrows and eaves along the frame's axes have one.
    return 2.0 * min(_straight_steps(picture), _straight_steps(picture.T))


def _straight_steps(picture: npt.NDArray[np.int16]) -> float:
    step = np.abs(np.diff(picture, axis=1))
    beside = np.maximum(step[:, :-2], step[:, 2:])
    lone = ((step[:, 1:-1] > 8) & (step[:, 1:-1] > 4 * beside)).astype(np.uint8)
    run = cv2.erode(lone, np.ones((7, 1), np.uint8))
    long = cv2.dilate(run, np.ones((7, 1), np.uint8))
    return 16.0 * float(long.mean())  # every step of a block's side stands for a block's width


def sharpness(grey: ImageArray) -> float:
    """Return the strength of detail of about a pixel over that of about eight, at a longer side of 512 pixels."""
    scale = BLUR_SIDE_PX / max(grey.shape)
    small = grey if scale >= 1.0 else cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    picture = small.astype(np.float32)
    # Not the finest detail of all, or noise and rounding would pass for sharpness.
    fine = cv2.GaussianBlur(picture, (0, 0), 1.0) - cv2.GaussianBlur(picture, (0, 0), 2.0)
    half = cv2.GaussianBlur(cv2.pyrDown(picture), (0, 0), 3.0)
    coarse = half - cv2.GaussianBlur(half, (0, 0), 6.0)
    return float(fine.std()) / max(float(coarse.std()), 1e-3)
