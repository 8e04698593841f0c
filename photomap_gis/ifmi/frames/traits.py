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
SMEAR_ROWS, SMEAR_SIDE_PX, SMEAR_DETAIL = 16, 9, 1.0
STEP_GREY = 14
CORNER_GREY, CORNER_LONE, CORNER_RUN_PX, CORNER_PX = 12, 1.5, 6, 9
"""A step by so many grey levels more than its factor times those beside it, so long, so near another."""
STRIPS, TEAR_ROWS = 16, 13


@dataclass(frozen=True, slots=True, eq=False)
class Traits:
    """Numbers of one picture.

    ``flat_share`` of it holds the one value ``flat_level``; ``deviation`` is its standard deviation; ``coherence``
    that of its means over 8 x 8 pixels relative to it, ``row_likeness`` the correlation of neighbouring rows: both
    near 0 for noise. ``near`` and ``far``, ``(8,)`` by direction from 0 to 180 degrees: mean squared differences of
    pixels 3 and 16 apart, noise taken off. ``smeared`` of it repeats the row (or the column) beside it; ``blocky`` of
    it is cut off from its neighbours by straight steps, level and plumb; ``cornered`` of it lies where such steps meet;
    ``tear`` is how much two rows differ across
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
    cornered: float
    tear: float


def traits_of(fine: ImageArray, coarse: ImageArray) -> Traits:
    """Return the traits of a picture, longer side at most 256 pixels, and of its half."""
    flat_share, flat_level = _flat(coarse)
    deviation, coherence, likeness = _scatter(fine)
    spurious = 2.0 * (0.5 * _noise(fine)) ** 2  # a coarse pixel is the mean of four
    picture = coarse.astype(np.float32)
    near, far = (np.maximum(_differences(picture, d) - spurious, 0.0) for d in (NEAR_PX, FAR_PX))
    smeared, blocky, cornered, tear = _smeared(fine), _blocky(fine), _cornered(fine), _tear(fine)
    return Traits(flat_share, flat_level, deviation, coherence, likeness, near, far, smeared, blocky, cornered, tear)


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


def _smeared(fine: ImageArray) -> float:
    """Return the share of the picture whose rows (or columns) repeat each other to the bit although they have detail.

    That is what a decoder draws where data is missing; a road or a roof along the axis has noise.
    """
    if min(fine.shape) <= SMEAR_ROWS + 1:
        return 0.0
    return max(_streaks(fine), _streaks(np.ascontiguousarray(fine.T)))


def _streaks(fine: ImageArray) -> float:
    down = cv2.absdiff(fine[1:], fine[:-1])[:, :-1]
    _, same = cv2.threshold(down, 0, 1, cv2.THRESH_BINARY_INV)
    runs = cv2.morphologyEx(same, cv2.MORPH_OPEN, np.ones((SMEAR_ROWS, 1), np.uint8))
    if not runs.any():
        return 0.0
    along = cv2.absdiff(fine[:, 1:], fine[:, :-1])[:-1]
    side = (SMEAR_SIDE_PX, SMEAR_SIDE_PX)
    detail, change = (cv2.blur(v.astype(np.float32), side) for v in (along, down))
    most = cv2.blur(runs * np.uint8(200), (5, 5)) > 120
    return float(np.count_nonzero(most & (detail > SMEAR_DETAIL) & (detail > 4.0 * change))) / down.size


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


def _cornered(fine: ImageArray) -> float:
    """Return the share of the area where such steps meet: the corners of blocks.

    Fainter steps count than in ``_blocky``, if they are of one sign along their run: two edges that meet so are rare.
    """
    if min(fine.shape) < 16:
        return 0.0
    near = np.ones((CORNER_PX, CORNER_PX), np.uint8)
    plumb = cv2.dilate(_runs(fine), near)
    level = cv2.dilate(np.ascontiguousarray(_runs(np.ascontiguousarray(fine.T)).T), near)
    return float(np.count_nonzero(plumb & level)) / fine.size


def _runs(fine: ImageArray) -> npt.NDArray[np.uint8]:
    """``(h, w)`` 1 where plumb steps of one sign run down; the pixel left of each step."""
    left, right = fine[:, :-1], fine[:, 1:]
    size = cv2.absdiff(right, left)
    beside = cv2.max(size[:, :-2], size[:, 2:])
    out = np.zeros(fine.shape, np.uint8)
    run = np.ones((CORNER_RUN_PX, 1), np.uint8)
    for step in (cv2.subtract(right, left), cv2.subtract(left, right)):  # 0 where the sign is the other
        lone = cv2.addWeighted(step[:, 1:-1], 1.0, beside, -CORNER_LONE, 0.0)
        _, lone = cv2.threshold(lone, CORNER_GREY, 1, cv2.THRESH_BINARY)
        out[:, 1:-2] |= np.asarray(cv2.morphologyEx(lone, cv2.MORPH_OPEN, run), np.uint8)
    return out


def _straight(step: ImageArray, beside: ImageArray, run_hw: tuple[int, int]) -> float:
    lone = cv2.addWeighted(step, 1.0, beside, -3.0, 0.0)
    _, lone = cv2.threshold(lone, STEP_GREY, 1, cv2.THRESH_BINARY)
    long = cv2.morphologyEx(lone, cv2.MORPH_OPEN, np.ones(run_hw, np.uint8))
    return 16.0 * float(np.count_nonzero(long)) / long.size  # every step of a side stands for a block's width


def _tear(fine: ImageArray) -> float:
    """Return how much the rows differ where they differ most, in three of four strips, against the rows around."""
    return float(cut_ratio(fine)[3:-3].max(initial=0.0))


def cut_ratio(fine: ImageArray) -> FloatImage:
    """``(h - 1,)`` how much each row differs from the next, in three of four strips, against the rows around.

    Empty where the picture is too small to tell.
    """
    h, w = fine.shape
    if h < 16 or w < STRIPS:
        return np.zeros(0, np.float32)
    step = cv2.resize(
        cv2.absdiff(fine[1:], fine[:-1]).astype(np.float32), (STRIPS, h - 1), interpolation=cv2.INTER_AREA
    )
    around = (TEAR_ROWS * cv2.blur(step, (1, TEAR_ROWS)) - step) / (TEAR_ROWS - 1.0)
    ratio: FloatImage = np.partition(step / (around + 1.0), STRIPS // 4, axis=1)[:, STRIPS // 4]
    return ratio
