"""Which photo is which shot of the autopilot's log: by the pattern of the intervals between them.

Clocks of cameras and autopilots disagree by anything from fractions of a second to hours, photos get lost, shots fail.
But both lists tell the same story of intervals: shift one over the other until most photos meet a shot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_TOLERANCE_S = 1.2
"""Further apart, a photo and a shot do not belong together: shutters lag, and clocks drift a little."""

_SIGMA_S = 0.4
"""Photo times have whole seconds in many cameras: that is 0.29 s of rounding, and a little more for the shutter."""

_COST_OF_NO_SHOT = 4.0
_CLOCK_SLACK_S = 1.5
_LEAST_MATCHED = 0.8
_CLEAR_COST, _CLEAR_COST_PER_PHOTO = 12.0, 0.05
"""How much dearer the next best offset must be: three shots that fit nothing, and what chance makes of many."""

_CANDIDATES = 60
_MAX_PAIRS = 4_000_000


def match_shots(photo_s: Sequence[float | None], shot_s: Sequence[float]) -> list[int | None] | None:
    """Return for each photo the position of its shot, ``None`` in it for a photo without one.

    ``photo_s`` are in the photos' order; all ``None`` where the photos tell no time: then equal counts are believed.
    Returns ``None`` where the two lists do not clearly belong together.
    """
    shots = np.asarray(shot_s, dtype=np.float64)
    if len(shots) == 0 or len(photo_s) == 0:
        return None
    timed = [i for i, t in enumerate(photo_s) if t is not None]
    if not timed:
        return list(range(len(shots))) if len(shots) == len(photo_s) else None
    photos = np.array([photo_s[i] for i in timed], dtype=np.float64)
    if len(timed) < 3 or len(shots) < 3 or len(photos) * len(shots) > _MAX_PAIRS:
        return None
    if len(photos) == len(shots):
        offset = float(np.median(photos - shots))
        if np.quantile(np.abs(photos - shots - offset), 0.9) <= _TOLERANCE_S:
            return _spread(timed, list(range(len(shots))), len(photo_s))
    matched = _by_offset(photos, shots)
    return None if matched is None else _spread(timed, matched, len(photo_s))


def _spread(timed: list[int], matched: Sequence[int | None], count: int) -> list[int | None]:
    out: list[int | None] = [None] * count
    for i, shot in zip(timed, matched, strict=True):
        out[i] = shot
    return out


def _by_offset(photos: FloatArray, shots: FloatArray) -> list[int | None] | None:
    """Return the shot of each photo under the one offset that explains most; ``None`` where two do equally well."""
    tried = [_settled(photos, shots, offset) for offset in _candidates_s(photos, shots)]
    (cost, offset, best), *others = sorted(tried, key=lambda t: t[0])
    count = sum(m is not None for m in best)
    if count < 3 or count < _LEAST_MATCHED * min(len(photos), len(shots)):
        return None
    dear = cost + _CLEAR_COST + _CLEAR_COST_PER_PHOTO * len(photos)
    rivals = [(o, matched) for c, o, matched in others if abs(o - offset) > 1.0 and c < dear]
    if not rivals:
        return best
    # Evenly spaced shots fit at many shifts: then the clocks must tell, up to a time zone.
    by_clock = [matched for o, matched in [(offset, best), *rivals] if abs(math.remainder(o, 900.0)) <= _CLOCK_SLACK_S]
    return by_clock[0] if len(by_clock) == 1 else None


def _candidates_s(photos: FloatArray, shots: FloatArray) -> list[float]:
    """Return offsets that join many pairs, the best first, no two of them close."""
    votes = np.sort((photos[:, None] - shots[None, :]).ravel())  # every pair votes for what would join it
    width = 2.0 * _SIGMA_S
    inside = np.searchsorted(votes, votes + width, side="right") - np.arange(len(votes))
    found: list[float] = []
    for i in np.argsort(-inside, kind="stable").tolist():
        if all(abs(votes[i] + width / 2.0 - o) > width / 2.0 for o in found):
            found.append(float(votes[i]) + width / 2.0)
            if len(found) == _CANDIDATES:
                break
    return found


def _settled(photos: FloatArray, shots: FloatArray, offset: float) -> tuple[float, float, list[int | None]]:
    """Return (cost, offset, assignment) after moving an offset to the middle of what it joins."""
    for _ in range(2):
        joined = _assign(photos, shots, offset)
        apart = np.array([p - shots[m] for p, m in zip(photos, joined, strict=True) if m is not None])
        if len(apart):
            offset = float(np.median(apart))
    joined = _assign(photos, shots, offset)
    apart = np.array([p - shots[m] - offset for p, m in zip(photos, joined, strict=True) if m is not None])
    cost = float(np.minimum((apart / _SIGMA_S) ** 2, _COST_OF_NO_SHOT).sum())
    return cost + _COST_OF_NO_SHOT * (len(photos) - len(apart)), offset, joined


def _assign(photos: FloatArray, shots: FloatArray, offset: float) -> list[int | None]:
    """Give each photo the nearest shot that is still free and not before the last one given."""
    out: list[int | None] = []
    last = -1
    for photo in photos - offset:
        low = int(np.searchsorted(shots, photo - _TOLERANCE_S))
        high = int(np.searchsorted(shots, photo + _TOLERANCE_S, side="right"))
        free = range(max(low, last + 1), high)
        choice = min(free, key=lambda k: abs(shots[k] - photo), default=None)
        out.append(choice)
        last = last if choice is None else choice
    return out
