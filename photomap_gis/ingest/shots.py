"""Which photo is which shot of the autopilot's log: by the pattern of the intervals between them.

Clocks of cameras and autopilots disagree by anything from fractions of a second to hours, photos get lost, shots fail.
But both lists tell the same story of intervals: shift one over the other until most photos meet a shot.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_TOLERANCE_S = 1.2
"""Photo times have whole seconds in many cameras, and shutters lag."""

_LEAST_MATCHED = 0.8
_CLEARLY = 0.9
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
    # Every pair votes for the offset that would join it.
    votes = np.sort((photos[:, None] - shots[None, :]).ravel())
    in_reach = np.searchsorted(votes, votes + 2 * _TOLERANCE_S, side="right") - np.arange(len(votes))
    best_at = int(np.argmax(in_reach))
    offset = float(np.median(votes[best_at : best_at + int(in_reach[best_at])]))
    away = np.abs(votes - offset) > 3 * _TOLERANCE_S
    best = _assign(photos, shots, offset)
    count = sum(m is not None for m in best)
    if count < _LEAST_MATCHED * min(len(photos), len(shots)) or count < 3:
        return None
    if away.any():
        rival_at = int(np.argmax(np.where(away, in_reach, 0)))
        rival = _assign(photos, shots, float(votes[rival_at]) + _TOLERANCE_S)
        if sum(m is not None for m in rival) > _CLEARLY * count:
            return None  # evenly spaced shots fit at every shift: the clocks must tell
    return best


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
