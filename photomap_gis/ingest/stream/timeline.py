"""The stream's time: strictly increasing seconds since the first frame, whatever the time stamps do. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

_MAX_STEP_S = 5.0
"""A longer step forward is believed only where as much time went by at the receiver."""
_USUAL_INTERVAL_S = 1.0 / 30.0
_SMALLEST_STEP_S = 1e-6
_SMOOTHING = 0.1


@dataclass(frozen=True, slots=True)
class Moment:
    """A frame's stream time; ``jump_s`` is by how much the time stamps jumped where they were not believed."""

    stream_time_s: float
    jump_s: float | None = None


class Timeline:
    """A plan that follows one source's time stamps.

    ``by_arrival``: what is not believed of the time stamps is told by the clock of arrival (a stream). Without it
    (a file) every step forward is believed, and a step back counts as one usual interval.
    """

    def __init__(self, *, by_arrival: bool, interval_s: float = _USUAL_INTERVAL_S) -> None:
        self._by_arrival = by_arrival
        self._interval_s = interval_s if 0.0 < interval_s < 10.0 else _USUAL_INTERVAL_S
        self._pts_s: float | None = None
        self._stream_s: float | None = None
        self._arrival_s = 0.0
        self._is_fresh = True

    @property
    def stream_time_s(self) -> float:
        """The last frame's stream time, 0 before the first."""
        return self._stream_s or 0.0

    def restart(self) -> None:
        """A new connection: its time stamps have nothing to do with those before."""
        self._is_fresh = True

    def at(self, pts_s: float | None) -> float:
        """Return the stream time of something else that bears a time stamp: metadata between two frames.

        Its decoder holds frames back, so metadata is not of the last frame that came out but of one to come.
        """
        if self._stream_s is None or self._is_fresh or pts_s is None or self._pts_s is None:
            return self.stream_time_s
        ahead_s = pts_s - self._pts_s
        return max(0.0, self._stream_s + ahead_s) if abs(ahead_s) <= _MAX_STEP_S else self._stream_s

    def place(self, pts_s: float | None, arrival_s: float) -> Moment:
        """Return the stream time of the next frame."""
        if self._stream_s is None:
            moment = Moment(0.0)
        else:
            elapsed_s = max(0.0, arrival_s - self._arrival_s)
            step_s, jump_s = self._step(pts_s, elapsed_s)
            moment = Moment(self._stream_s + max(step_s, _SMALLEST_STEP_S), jump_s)
        self._pts_s, self._stream_s, self._arrival_s = pts_s, moment.stream_time_s, arrival_s
        self._is_fresh = False
        return moment

    def _step(self, pts_s: float | None, elapsed_s: float) -> tuple[float, float | None]:
        """Return the step to take, and the jump of the time stamps where it is not theirs."""
        if self._is_fresh:  # a file or recording that is cut shows no time between its pieces
            return (elapsed_s if self._by_arrival else self._interval_s), None
        if pts_s is None or self._pts_s is None or not math.isfinite(pts_s):
            return self._interval_s, None
        told_s = pts_s - self._pts_s
        if told_s > 0.0 and (told_s <= _MAX_STEP_S or not self._by_arrival or abs(told_s - elapsed_s) < told_s / 2.0):
            if told_s < 1.0:
                self._interval_s += _SMOOTHING * (told_s - self._interval_s)
            return told_s, None
        if told_s == 0.0:
            return self._interval_s, None
        return (max(elapsed_s, self._interval_s) if self._by_arrival else self._interval_s), told_s
