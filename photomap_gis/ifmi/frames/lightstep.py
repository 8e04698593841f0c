"""Light that jumps at a level line: a decoder that lost a step of it goes on with another brightness.

Neither clouds nor an exposure draw such a line, and the detail on both sides of it fits.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

FloatImage = npt.NDArray[np.float32]
Mask8 = npt.NDArray[np.uint8]

STRIPS = 16
LEAST_STRIPS = STRIPS // 2
ROWS, GAP = 7, 2
"""Rows that are averaged above and below a line, and those left out beside it: an edge laid a pixel off is no jump."""
KNOWN = 0.6
OF_STRIPS = 0.35
"""All but this share of the strips must jump so far."""
LEAST_GREY, LEAST_CONTRAST = 14.0, 0.46
MOST_GAIN = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class LightStep:
    """A jump by ``size`` of the limit (1 and more is a fault); ``beyond`` ``(h, w)`` 1 on the side that is off."""

    size: float
    beyond: Mask8


def light_step(under: FloatImage, picture: FloatImage, seen: Mask8) -> LightStep:
    """Find the largest jump of the light between a picture and its predecessor laid ``under`` it, where ``seen``."""
    h, w = picture.shape
    none = LightStep(0.0, np.zeros((h, w), np.uint8))
    weight = (seen > 0).astype(np.float32)
    if h < 4 * ROWS + 2 * GAP or w < STRIPS or float(weight.mean()) < 0.1:
        return none
    difference = _difference(under, picture, weight)
    size = (STRIPS, h)
    known = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    light = cv2.resize(difference, size, interpolation=cv2.INTER_AREA)
    step = _step(light, known)
    told = np.isfinite(step)
    enough = np.flatnonzero(told.sum(axis=1) >= LEAST_STRIPS)
    if not len(enough):
        return none
    low, high = _quantiles(step[enough], (OF_STRIPS, 1.0 - OF_STRIPS))
    jump = np.maximum(low, -high)
    best = int(np.argmax(jump))
    row = int(enough[best])
    limit = max(LEAST_GREY, LEAST_CONTRAST * float(picture.std()))
    return LightStep(float(jump[best]) / limit, _side(light, known, row, (h, w)))


def _quantiles(rows: FloatImage, shares: tuple[float, ...]) -> list[npt.NDArray[np.float64]]:
    """Return quantiles of each row's numbers, NaN left out: ``nanquantile`` takes a row at a time, which is slow."""
    ordered = np.sort(rows, axis=1).astype(np.float64)  # NaN comes last
    count = np.isfinite(rows).sum(axis=1)
    row = np.arange(len(rows))
    found = []
    for share in shares:
        at = share * (count - 1)
        below = np.floor(at).astype(np.intp)
        above = np.minimum(below + 1, count - 1)
        part = at - below
        found.append(ordered[row, below] * (1.0 - part) + ordered[row, above] * part)
    return found


def _difference(under: FloatImage, picture: FloatImage, weight: FloatImage) -> FloatImage:
    n = float(weight.sum())
    a, b = ((p - float((p * weight).sum()) / n) * weight for p in (under, picture))
    gain = float(np.clip(cv2.norm(b) / max(cv2.norm(a), 1.0), 1.0 / MOST_GAIN, MOST_GAIN))
    return np.asarray(b - gain * a, np.float32)


def _step(light: FloatImage, known: FloatImage) -> FloatImage:
    """``(h, 16)`` how the light jumps at each row, its slope above and below taken off; NaN where that is not known."""
    mean = _means(light, known)
    nan = np.full((ROWS + GAP, STRIPS), np.nan, np.float32)

    def from_row(offset: int) -> FloatImage:
        """Return the mean of the rows that begin so far from each row."""
        rolled = np.concatenate([nan, nan, mean, nan, nan])[2 * len(nan) + offset :]
        return np.asarray(rolled[: len(light)], np.float32)

    below, further_below = from_row(GAP), from_row(GAP + ROWS)
    above, further_above = from_row(-GAP - ROWS), from_row(-GAP - 2 * ROWS)
    slope = 0.5 * (further_below - below + above - further_above) / ROWS
    return np.asarray(below - above - slope * (2 * GAP + ROWS), np.float32)


def _means(light: FloatImage, known: FloatImage) -> FloatImage:
    """``(h, 16)`` mean of the light over the rows from each row on, NaN where too few are known."""
    total, count = (cv2.copyMakeBorder(v, 1, 0, 0, 0, cv2.BORDER_CONSTANT).cumsum(axis=0) for v in (light, known))
    number = count[ROWS:] - count[:-ROWS]
    out = np.full(light.shape, np.nan, np.float32)
    enough = number > KNOWN * ROWS
    out[: len(number)][enough] = (total[ROWS:] - total[:-ROWS])[enough] / number[enough]
    return out


def _side(light: FloatImage, known: FloatImage, row: int, shape: tuple[int, int]) -> Mask8:
    """Tell which side of a row is off: the one that strays more from what most of the picture does."""
    usual = float(np.median(light[known > KNOWN]))
    parts = (slice(0, row), slice(row, shape[0]))
    stray = [
        abs(float(np.median(light[p][known[p] > KNOWN])) - usual) if (known[p] > KNOWN).any() else 0.0 for p in parts
    ]
    beyond = np.zeros(shape, np.uint8)
    beyond[parts[0] if stray[0] > stray[1] else parts[1]] = 1
    return beyond
