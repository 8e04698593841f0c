"""Where the rows of a picture lie in its predecessor, a few at a time: no registration of the whole is needed.

A link that lost its line sync moves rows sideways, by a step or each a little further than the one above; what leaves
on one side comes in on the other. No camera does that. Rows of the ground's own picture stay side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.frames.look import FrameLook
from photomap_gis.ifmi.frames.row_sums import best_lags

FloatImage = npt.NDArray[np.float32]

ROWS, STEP = 12, 6
"""Rows of a window and from one to the next, in coarse pixels."""
DOWN_PX = 16
"""How far up and down the predecessor's rows are looked for."""
SLOPES = np.arange(-9, 10) / 4.0
"""Pixels by which a row may lie further than the one above."""
SLANTED = 0.3
MEAN_SIDE_PX = 17
NOISE_GREY = 1.0
KNOWN_LIKENESS = 0.5
LIKER = 0.2
"""So much better than upright must slanted rows fit, and rows at one lag than at another."""
SAME_ROW_PX = 1
NEAR_PX = 2
LEAST_WINDOWS = 2
LEAST_SLANTED = 3
LEAST_STEP = 0.04
"""Of the width: what tilt and relief may leave between one window and the next is less."""


@dataclass(frozen=True, slots=True)
class RowMotion:
    """What the rows say: ``known_share`` of the windows were found in the predecessor.

    ``slanted_share`` of all lie aslant there, ``step`` is the largest jump (share of the width) between two runs of
    windows that stand upright.
    """

    known_share: float
    slanted_share: float
    step: float
    is_torn: bool


def row_motion(look: FrameLook, before: FrameLook) -> RowMotion:
    """Look for a frame's rows in its predecessor (of the same shape)."""
    a, b = before.coarse, look.coarse
    h, w = b.shape
    count = (h - ROWS) // STEP + 1
    if count < LEAST_SLANTED or w < 2 * MEAN_SIDE_PX:
        return RowMotion(0.0, 0.0, 0.0, False)
    best = np.empty((count, len(SLOPES)), np.float32)
    at = np.zeros((count, len(SLOPES), 2), np.int64)
    likeness_px = _likeness(a, b)
    best_lags(likeness_px, SLOPES, ROWS, STEP, best, at)
    chosen = best.argmax(axis=1)
    down, lag = at[np.arange(count), chosen].T
    likeness, slope = best.max(axis=1), SLOPES[chosen]
    upright = best[:, np.abs(SLOPES) < SLANTED].max(axis=1)
    known = likeness > KNOWN_LIKENESS
    if not known.any():
        return RowMotion(0.0, 0.0, 0.0, False)
    usual = np.bincount(down[known]).argmax()
    known &= np.abs(down - usual) <= SAME_ROW_PX
    slanted = known & (np.abs(slope) >= SLANTED) & (likeness - upright > LIKER)
    level = known & (np.abs(slope) < SLANTED)
    step = _step(likeness_px[usual], lag, level)
    torn = int(np.count_nonzero(slanted)) >= LEAST_SLANTED or step >= LEAST_STEP
    return RowMotion(float(known.mean()), float(slanted.mean()), step, torn)


def _likeness(a: ImageArray, b: ImageArray) -> FloatImage:
    """``(D, h, w)`` correlation of each row of b with the row of a that lies so much further down, by lag around."""
    h, w = b.shape
    A, B = (np.fft.rfft(_rows(p), axis=1) for p in (a, b))
    out = np.zeros((2 * DOWN_PX + 1, h, w), np.float32)
    for d in range(-DOWN_PX, DOWN_PX + 1):
        first, last = max(0, -d), min(h, h - d)
        if first < last:
            product = B[first:last] * np.conj(A[first + d : last + d])
            out[d + DOWN_PX, first:last] = np.fft.irfft(product, n=w, axis=1)
    return out


def _rows(picture: ImageArray) -> FloatArray:
    """Return the rows without what is coarse along them, each of length 1; of what is hardly more than noise, less."""
    p = picture.astype(np.float32)
    p = cv2.GaussianBlur(p - cv2.blur(p, (MEAN_SIDE_PX, 1)), (3, 1), 0.7)
    length = np.sqrt((p * p).sum(axis=1, keepdims=True)) + NOISE_GREY * np.sqrt(p.shape[1])
    return np.asarray(p / length, np.float64)


def _step(likeness: FloatImage, lag: npt.NDArray[np.int64], level: npt.NDArray[np.bool_]) -> float:
    """Return the largest jump of the lag (share of the width, around it) between two runs of windows.

    The windows of a run agree with each other, and those of one do not fit where the other lies: rows of crop would.
    ``likeness`` ``(h, w)`` is that of the row displacement that all have in common.
    """
    w = likeness.shape[1]
    runs: list[list[int]] = []
    for k in np.flatnonzero(level).tolist():
        if runs and k == runs[-1][-1] + 1 and _apart(lag[k], lag[k - 1], w) <= 0.5 * LEAST_STEP:
            runs[-1].append(k)
        else:
            runs.append([k])
    told = [r for r in runs if len(r) >= LEAST_WINDOWS]
    jumps = [0.0]
    for p, q in pairwise(told):
        here, there = ((_at(likeness, r, lag[r[0]]) - _at(likeness, r, lag[s[0]])) for r, s in ((p, q), (q, p)))
        if min(here, there) > LIKER:
            jumps.append(_apart(lag[p[-1]], lag[q[0]], w))
    return max(jumps)


def _at(likeness: FloatImage, run: list[int], lag: int) -> float:
    """Return the mean likeness of a run's rows near a lag."""
    rows = likeness[run[0] * STEP : run[-1] * STEP + ROWS]
    near = np.arange(lag - NEAR_PX, lag + NEAR_PX + 1) % rows.shape[1]
    return float(rows[:, near].mean(axis=0).max())


def _apart(p: int, q: int, w: int) -> float:
    return abs((int(p) - int(q) + w // 2) % w - w // 2) / w
