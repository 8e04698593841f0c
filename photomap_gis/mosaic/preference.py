"""What a user wants to see where several frames show a spot: the steepest look, the sharpest one, or the newest.

Each wish is a cost per frame that is added to the cost of choosing it (``choice``), where 1 is what the corner of a
frame costs against its middle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum

import numpy as np

from photomap_gis.core.layer import BLUR_TO_WIDTH


class Prefer(StrEnum):
    """Which of several frames the map shows."""

    NADIR = "nadir"
    SHARP = "sharp"
    NEWEST = "newest"


SHARP_PER_OCTAVE2 = 6.0
"""What twice as coarse a detail costs under ``SHARP``; a half of it costs a quarter of that."""

MINUTE_COST = 2.0
"""What a minute of age costs under ``NEWEST``: a frame half a minute newer is shown but at its rim's expense."""

PAUSE_COST = 10.0
"""The most that a pause between two frames adds: flights of another day are no farther away than that."""

MAX_COST = 900.0
"""Less than a tier (``choice.TIER_COST``): an old registered frame is still better than one placed by GPS alone."""


def detail_m(gsd_m_per_px: float, blur_px: float) -> float:
    """Return the smallest detail on the ground that a frame can show; an unknown blur is taken for none."""
    return gsd_m_per_px * max(1.0, BLUR_TO_WIDTH * blur_px if math.isfinite(blur_px) else 1.0)


def costs_of_detail(detail_m_by_frame: Mapping[int, float]) -> dict[int, float]:
    """Return by frame what its detail adds to its cost under ``SHARP``."""
    if not detail_m_by_frame:
        return {}
    middle = float(np.median(list(detail_m_by_frame.values())))
    octaves = {frame: math.log2(detail / middle) for frame, detail in detail_m_by_frame.items()}
    return {
        f: float(np.clip(math.copysign(SHARP_PER_OCTAVE2 * o * o, o), -MAX_COST, MAX_COST)) for f, o in octaves.items()
    }


def costs_of_age(time_s_by_frame: Mapping[int, float | None]) -> dict[int, float]:
    """Return by frame what its age adds to its cost under ``NEWEST``; frames without a time are older than all others.

    Minutes count in full while frames follow each other; a pause counts for no more than ``PAUSE_COST``.
    """
    known = sorted(((t, f) for f, t in time_s_by_frame.items() if t is not None), reverse=True)
    costs: dict[int, float] = {}
    total, newer = 0.0, known[0][0] if known else 0.0
    for time_s, frame in known:
        total += min(MINUTE_COST * (newer - time_s) / 60.0, PAUSE_COST)
        costs[frame], newer = total, time_s
    oldest = total + PAUSE_COST if known else 0.0
    costs |= {f: oldest for f, t in time_s_by_frame.items() if t is None}
    most = max(costs.values(), default=0.0)
    return {f: c * min(1.0, MAX_COST / most) if most > 0.0 else 0.0 for f, c in costs.items()}
