"""Ground that repeats itself: rows of crops, roof tiles, parked cars.

Repeating texture fits at every period, and a window favours the smallest shift: neither correlation nor peaks say that
it is chance. So where a frame looks like itself moved, the motions that lie whole periods beside a lead are put up
against it, and all are judged by what does not repeat: how much of both frames is left unlike, over all of the
overlap, without forgiving outliers. Weeds among the rows, or one car more, then decide; where nothing does, the motion
is one of several and says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.field import project
from photomap_gis.ifmi.overlap import Agreement, agreement_under
from photomap_gis.ifmi.periods import Period
from photomap_gis.ifmi.spectrum import Spectrum

FURTHEST_MULTIPLE = 4
LEAST_OVERLAP = 0.2
RIVAL = 0.5
"""A motion is worth following up when the frames agree under it at least this well, as a share of how they do here."""
INDEPENDENT = 0.3
"""Two periods span a lattice when the sine of the angle between them is at least this."""


def likeness(a: Spectrum, b: Spectrum, H_a_b: FloatArray) -> Agreement:
    """Return how like both frames are over their overlap under a homography (frame pixels), nothing forgiven."""
    return agreement_under(a.floors[a.spectral], b.floors[b.spectral], H_a_b)


def repeated(
    a: Spectrum, b: Spectrum, H_a_b: FloatArray, count: int, *, centre_within: tuple[FloatArray, float] | None
) -> list[FloatArray]:
    """Return the ``count`` likeliest homographies that lie whole periods of a beside ``H_a_b``, the likeliest first.

    ``centre_within`` is where in a, and how near, b's centre has to come to lie.
    """
    factor = a.floors[a.spectral].factor
    coarse = min(a.spectral + 1, len(a.floors) - 1)
    here = agreement_under(a.floors[coarse], b.floors[coarse], H_a_b).correlation
    found: list[tuple[float, FloatArray]] = []
    for dx, dy in _lattice(a.periods, min(a.shape) / factor):
        shift = np.array([[1.0, 0.0, dx * factor], [0.0, 1.0, dy * factor], [0.0, 0.0, 1.0]])
        H = shift @ H_a_b
        if centre_within is not None:
            gap = project(H, np.array([[(b.shape[1] - 1) / 2.0, (b.shape[0] - 1) / 2.0]]))[0] - centre_within[0]
            if math.hypot(*gap) > centre_within[1]:
                continue
        seen = agreement_under(a.floors[coarse], b.floors[coarse], H)
        if seen.overlap >= LEAST_OVERLAP and seen.correlation >= RIVAL * here:
            found.append((seen.correlation, H))
    found.sort(key=lambda f: -f[0])
    least = RIVAL * likeness(a, b, H_a_b).correlation
    return [H for _, H in found[:count] if likeness(a, b, H).correlation >= least]


def _lattice(periods: Sequence[Period], side_px: float) -> list[tuple[float, float]]:
    """Return the shifts, in pixels of the spectral floor, that the periods span, zero left out."""
    first = periods[0]
    second = next((p for p in periods[1:] if _sine(first, p) >= INDEPENDENT), None)
    reach = range(-FURTHEST_MULTIPLE, FURTHEST_MULTIPLE + 1)
    shifts = []
    for i in reach:
        for j in reach if second is not None else (0,):
            dx = i * first.dx_px + (0.0 if second is None else j * second.dx_px)
            dy = i * first.dy_px + (0.0 if second is None else j * second.dy_px)
            if (i or j) and math.hypot(dx, dy) < 0.8 * side_px:
                shifts.append((dx, dy))
    return shifts


def _sine(p: Period, q: Period) -> float:
    lengths = math.hypot(p.dx_px, p.dy_px) * math.hypot(q.dx_px, q.dy_px)
    return abs(p.dx_px * q.dy_px - p.dy_px * q.dx_px) / max(lengths, 1e-9)
