"""Height along a path: what the ground asks for, what climb and descent allow, and the fewest points that say it.

Pure: distances along the path and heights, in metres.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def flyable(
    along_m: FloatArray, wanted_m: FloatArray, climb_slope: FloatArray, descent_slope: FloatArray
) -> FloatArray:
    """Return the lowest profile that is nowhere below ``wanted_m`` and keeps to the slopes.

    ``climb_slope`` and ``descent_slope`` are ``(N - 1,)``, each step's steepest metres a metre, above 0. A step of no
    length (a climb on the spot) is not limited.
    """
    steps = np.diff(along_m)
    height = np.array(wanted_m, np.float64)
    free = steps <= 1e-9
    for i in range(len(steps) - 1, -1, -1):  # climb early enough for what is ahead
        if not free[i]:
            height[i] = max(height[i], height[i + 1] - climb_slope[i] * steps[i])
    for i in range(len(steps)):  # descend slowly enough from what is behind
        if not free[i]:
            height[i + 1] = max(height[i + 1], height[i] - descent_slope[i] * steps[i])
    return height


def fewest(along_m: FloatArray, height_m: FloatArray, tolerance_m: float) -> list[int]:
    """Return the indices, ends included, whose straight lines stay within ``tolerance_m`` of the profile.

    Greedy by the cone of slopes that all points so far allow: the furthest point that is still seen through it.
    """
    kept = [0]
    last = len(along_m) - 1
    while kept[-1] < last:
        start = kept[-1]
        low, high, best = -np.inf, np.inf, start + 1
        for i in range(start + 1, last + 1):
            run = along_m[i] - along_m[start]
            if run <= 1e-9:
                best = i
                continue
            slope = (height_m[i] - height_m[start]) / run
            if low <= slope <= high:
                best = i
            low = max(low, (height_m[i] - tolerance_m - height_m[start]) / run)
            high = min(high, (height_m[i] + tolerance_m - height_m[start]) / run)
            if low > high:
                break
        kept.append(best)
    return kept
