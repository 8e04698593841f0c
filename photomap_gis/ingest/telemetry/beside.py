"""When untimed metadata of a transport stream was: by the pictures between which it lies in the stream of bytes.

Asynchronous metadata (MISB ST 0604) bears no time stamp. The demuxer hands a picture out only when the next one begins
or its parser has seen enough, so the order in which packets come out says little: it is up to three pictures late.
Their places in the bytes do not lie.
"""

from __future__ import annotations

from collections import deque
from typing import Generic, NamedTuple, TypeVar

T = TypeVar("T")

_MOST_WAITING = 500


class Timed(NamedTuple, Generic[T]):
    """What waited, and its second; ``None`` where no picture came before or behind it."""

    what: T
    second: float | None


class BesidePictures(Generic[T]):
    """Holds untimed packets until the picture behind them has come; one owner.

    Places are bytes since the beginning (``None`` or negative: not known, as little as the time then).
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[int, T]] = deque()
        self._before: deque[tuple[int, float]] = deque(maxlen=16)

    def untimed(self, place: int | None, what: T) -> list[Timed[T]]:
        """Take a packet; return what need not wait any longer."""
        if place is None or place < 0:
            return [Timed(what, self._before[-1][1] if self._before else None)]
        self._waiting.append((place, what))
        return [self._timed(*self._waiting.popleft(), None)] if len(self._waiting) > _MOST_WAITING else []

    def picture(self, place: int | None, second: float | None) -> list[Timed[T]]:
        """Take a picture; return what lay before it: half way between the pictures around it."""
        if place is None or place < 0 or second is None:
            return []
        found = []
        while self._waiting and self._waiting[0][0] < place:
            found.append(self._timed(*self._waiting.popleft(), second))
        self._before.append((place, second))
        return found

    def rest(self) -> list[Timed[T]]:
        """Return what still waits at the end."""
        return [self._timed(*self._waiting.popleft(), None) for _ in range(len(self._waiting))]

    def _timed(self, place: int, what: T, behind_s: float | None) -> Timed[T]:
        before_s = next((s for p, s in reversed(self._before) if p < place), None)
        if before_s is None or behind_s is None:
            return Timed(what, behind_s if before_s is None else before_s)
        return Timed(what, (before_s + behind_s) / 2.0)
