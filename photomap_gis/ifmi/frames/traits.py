"""What one picture alone tells about its soundness, as a few numbers; none of them decides by itself.

A camera's habit (a soft lens, a letter box, rows of crop) gives the same numbers in the frame before: what counts is
what is new.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.similarity import FloatArray

FloatImage = npt.NDArray[np.float32]

CELL_PX = 8
FLAT_DEVIATION = 1.2
"""Standard deviation within a cell up to which it is empty."""
SAME_LEVEL = 3.0
DIRECTIONS = 8
NEAR_PX, FAR_PX = 3, 16
"""Distances (coarse pixels) whose differences tell sharpness: a heavy blur takes the near ones away."""
SMEAR_ROWS = 8
STEP_GREY = 14
STRIPS, TEAR_ROWS = 16, 13


@dataclass(frozen=True, slots=True, eq=False)
class Traits:
    """Numbers of one picture.

    ``flat_share`` of it holds the one value ``flat_level``; ``deviation`` is its standard deviation; ``coherence``
    that of its means over 8 x 8 pixels relative to it, ``row_likeness`` the correlation of neighbouring rows: both
    near 0 for noise. ``near`` and ``far``, ``(8,)`` by direction from 0 to 180 degrees: mean squared differences of
    pixels 3 and 16 apart, noise taken off. ``smeared`` of it repeats the row (or the column) beside it; ``blocky`` of
    it is cut off from its neighbours by straight steps, level and plumb; ``tear`` is how much two rows differ across
    the width against the rows around them.
    """

    flat_share: float
    flat_level: float
    deviation: float
    coherence: float
    row_likeness: float
    near: FloatArray
    far: FloatArray
    smeared: float
    blocky: float
    tear: float


def traits_of(fine: ImageArray, coarse: ImageArray) -> Traits:
    """Return the traits of a picture, longer side at most 256 pixels, and of its half."""
    flat_share, flat_level = _flat(coarse)
    deviation, coherence, likeness = _scatter(fine)
    spurious = 2.0 * (0.5 * _noise(fine)) ** 2  # a coarse pixel is the mean of four
    picture = coarse.astype(np.float32)
    near, far = (np.maximum(_differences(picture, d) - spurious, 0.0) for d in (NEAR_PX, FAR_PX))
    return Traits(
        flat_share, flat_level, deviation, coherence, likeness, near, far, _smeared(coarse), _blocky(fine), _tear(fine)
    )


def _flat(coarse: ImageArray) -> tuple[float, float]:
    """Return the largest share of cells that hold one value, and the value."""
    picture = coarse.astype(np.float32)
    cells = max(1, picture.shape[1] // CELL_PX), max(1, picture.shape[0] // CELL_PX)
    mean = cv2.resize(picture, cells, interpolation=cv2.INTER_AREA)
    square = cv2.resize(picture * picture, cells, interpolation=cv2.INTER_AREA)
    levels = np.sort(mean[square - mean * mean < FLAT_DEVIATION**2])
    if not len(levels):
        return 0.0, 0.0
    count = np.searchsorted(levels, levels + SAME_LEVEL, side="right") - np.arange(len(levels))
    best = int(np.argmax(count))
    return float(count[best]) / mean.size, float(levels[best] + SAME_LEVEL / 2.0)


def _scatter(fine: ImageArray) -> tuple[float, float, float]:
    picture = fine.astype(np.float32)
    deviation = float(cv2.meanStdDev(picture)[1][0, 0])
    cells = max(1, picture.shape[1] // CELL_PX), max(1, picture.shape[0] // CELL_PX)
    coarse = float(cv2.resize(picture, cells, interpolation=cv2.INTER_AREA).std())
    step = cv2.norm(fine[1:], fine[:-1], cv2.NORM_L2SQR) / max(fine[1:].size, 1)
    power = max(deviation, 0.5) ** 2
    return deviation, coarse / max(deviation, 0.5), 1.0 - step / (2.0 * power)


def _noise(fine: ImageArray) -> float:
    """Return about the standard deviation of the noise: what is left of the smoothest half of the picture."""
    quarter = fine[: fine.shape[0] // 2 * 2 : 2, : fine.shape[1] // 2 * 2 : 2].astype(np.float32)
    beside = fine[: fine.shape[0] // 2 * 2 : 2, 1 : fine.shape[1] // 2 * 2 : 2].astype(np.float32)
    below = fine[1 : fine.shape[0] // 2 * 2 : 2, : fine.shape[1] // 2 * 2 : 2].astype(np.float32)
    across = fine[1 : fine.shape[0] // 2 * 2 : 2, 1 : fine.shape[1] // 2 * 2 : 2].astype(np.float32)
    twist = np.abs(quarter - beside - below + across)
    return min(4.0, float(np.percentile(twist[::2, ::2], 30)) / (0.385 * 2.0))


def _differences(picture: FloatImage, distance_px: int) -> FloatArray:
    """``(8,)`` mean squared difference of pixels so far apart, by direction; 0 where the picture is too small."""
    h, w = picture.shape
    out = np.zeros(DIRECTIONS)
    for k in range(DIRECTIONS):
        angle = math.pi * k / DIRECTIONS
        dx, dy = round(distance_px * math.cos(angle)), round(distance_px * math.sin(angle))
        if abs(dx) < w and dy < h:
            a = picture[dy:, max(0, dx) : w + min(0, dx)]
            b = picture[: h - dy, max(0, -dx) : w + min(0, -dx)]
            out[k] = float(cv2.norm(a, b, cv2.NORM_L2SQR)) / a.size
    return out


def _smeared(coarse: ImageArray) -> float:
    """Return the share of the picture that changes along one axis only: what a decoder draws where data is missing."""
    h, w = coarse.shape
    if min(h, w) <= SMEAR_ROWS + 1:
        return 0.0
    _, still_down = cv2.threshold(cv2.absdiff(coarse[1:], coarse[:-1]), 1, 1, cv2.THRESH_BINARY_INV)
    _, still_along = cv2.threshold(cv2.absdiff(coarse[:, 1:], coarse[:, :-1]), 1, 1, cv2.THRESH_BINARY_INV)
    down = cv2.morphologyEx(still_down, cv2.MORPH_OPEN, np.ones((SMEAR_ROWS, 1), np.uint8))[:, :-1]
    along = cv2.morphologyEx(still_along, cv2.MORPH_OPEN, np.ones((1, SMEAR_ROWS), np.uint8))[:-1]
    near_down = cv2.blur(down * np.uint8(200), (5, 5))
    near_along = cv2.blur(along * np.uint8(200), (5, 5))
    return max(
        float(np.count_nonzero((near_down > 140) & (near_along < 70))),
        float(np.count_nonzero((near_along > 140) & (near_down < 70))),
    ) / down.size  # fmt: skip


def _blocky(fine: ImageArray) -> float:
    """Return the share of the area whose blocks are cut off by steps one pixel wide, exactly level *and* plumb.

    Neither optics nor nature draws those; furrows and eaves along the frame's axes have one kind of sides.
    """
    if min(fine.shape) < 16:
        return 0.0
    across, down = cv2.absdiff(fine[:, 1:], fine[:, :-1]), cv2.absdiff(fine[1:], fine[:-1])
    plumb = _straight(across[:, 1:-1], cv2.max(across[:, :-2], across[:, 2:]), (6, 1))
    level = _straight(down[1:-1], cv2.max(down[:-2], down[2:]), (1, 6))
    return min(plumb, level)


def _straight(step: ImageArray, beside: ImageArray, run_hw: tuple[int, int]) -> float:
    lone = cv2.addWeighted(step, 1.0, beside, -3.0, 0.0)
    _, lone = cv2.threshold(lone, STEP_GREY, 1, cv2.THRESH_BINARY)
    long = cv2.morphologyEx(lone, cv2.MORPH_OPEN, np.ones(run_hw, np.uint8))
    return 16.0 * float(np.count_nonzero(long)) / long.size  # every step of a side stands for a block's width


def _tear(fine: ImageArray) -> float:
    """Return how much the rows differ where they differ most, in three of four strips, against the rows around."""
    h, w = fine.shape
    if h < 16 or w < STRIPS:
        return 0.0
    step = cv2.resize(
        cv2.absdiff(fine[1:], fine[:-1]).astype(np.float32), (STRIPS, h - 1), interpolation=cv2.INTER_AREA
    )
    around = (TEAR_ROWS * cv2.blur(step, (1, TEAR_ROWS)) - step) / (TEAR_ROWS - 1.0)
    ratio = np.partition(step / (around + 1.0), STRIPS // 4, axis=1)[3:-3, STRIPS // 4]
    return float(ratio.max())
