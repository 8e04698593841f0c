"""The score of a whole map, window by window."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.compare.align import LaidPair
from photomap_gis.compare.evidence import REACH_PX, STRIDE_PX, Pair, evidence, lean_px
from photomap_gis.compare.score import score_of
from photomap_gis.core.grid import MapGrid, Window

FloatImage = npt.NDArray[np.float32]

NODATA = -1.0
"""The score where either shows no ground."""
WINDOW_PX = 1024
SAMPLE_PX = 320
MOST_SAMPLES = 16
STEPS = 250.0
"""Scores are rounded to so many steps: finer ones say nothing and do not compress."""


def score_windows(grid: MapGrid) -> list[Window]:
    """Return the windows that cover a grid once, row by row."""
    return [
        Window(x, y, min(WINDOW_PX, grid.width - x), min(WINDOW_PX, grid.height - y))
        for y in range(0, grid.height, WINDOW_PX)
        for x in range(0, grid.width, WINDOW_PX)
    ]


def sample_windows(grid: MapGrid) -> list[Window]:
    """Return some windows spread over a grid."""
    width, height = min(SAMPLE_PX, grid.width), min(SAMPLE_PX, grid.height)
    a_side = int(math.sqrt(MOST_SAMPLES))
    cols, rows = min(a_side, -(-grid.width // width)), min(a_side, -(-grid.height // height))
    lefts = [round((grid.width - width) * c / max(1, cols - 1)) for c in range(cols)]
    tops = [round((grid.height - height) * r / max(1, rows - 1)) for r in range(rows)]
    return [Window(left, top, width, height) for top in tops for left in lefts]


def score_window(laid: LaidPair, pair: Pair, window: Window) -> FloatImage:
    """``(h, w)`` float32: the probability that each pixel of a window has changed, ``NODATA`` where nothing is known.

    The same pixel gets the same score whichever window it is asked for in, if windows begin at even pixels.
    """
    around = Window(
        window.col_off - REACH_PX, window.row_off - REACH_PX,
        window.width + 2 * REACH_PX, window.height + 2 * REACH_PX,
    )  # fmt: skip
    out = np.full((window.height, window.width), NODATA, np.float32)
    old, new, mask = laid.read(around)
    inner = np.s_[REACH_PX : REACH_PX + window.height, REACH_PX : REACH_PX + window.width]
    if not mask[inner].any():
        return out
    score = score_of(evidence(old, new, mask, pair, most_lean_px=lean_px(laid.grid.pixel_size)))
    # Every second pixel was scored: those between are the mean of their neighbours, at the pixels' own places.
    x, y = np.meshgrid(np.arange(around.width) / STRIDE_PX, np.arange(around.height) / STRIDE_PX)
    full = cv2.remap(
        score, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    rounded = np.round(full * np.float32(STEPS)) / np.float32(STEPS)
    out[mask[inner]] = rounded[inner][mask[inner]]
    return out
