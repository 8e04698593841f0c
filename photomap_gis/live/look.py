"""Looks: between two key frames the newest sharp frame is pasted too, so that what moves is seen to move.

A look is no key frame: the graph does not hear of it, its pixels are not kept, and a map that is drawn anew shows key
frames and the newest look. It hangs on the key frame to which it was registered.
"""

from __future__ import annotations

from dataclasses import dataclass

from photomap_gis.core.live import Picture
from photomap_gis.core.measurement import Registration
from photomap_gis.core.placement import FramePlacement
from photomap_gis.ifmi import Fault, FrameLook, judge_registered

PASTED_EVERY_S = 0.25
"""So long at most passes, while frames come, from one frame that is pasted to the next."""
_TOLERANCE_S = 1e-3
SPOILT_PHOTO = (Fault.TORN, Fault.STALE, Fault.BLOCKS)


@dataclass(frozen=True, slots=True, eq=False)
class Witness:
    """What tells whether a frame shows what it cannot have seen: its look, the key frame's, and their registration."""

    frame: FrameLook
    key: FrameLook
    found: Registration
    doubt: float
    is_video: bool
    is_suspect: bool

    def is_spoilt(self) -> bool:
        """Whether a frame that is to be pasted is spoilt in part (a few milliseconds)."""
        told = judge_registered(self.frame, self.key, self.found, doubt=self.doubt, suspect=self.is_suspect)
        return (not told.ok or told.fault is not None) and (
            self.is_video or (not told.ok and told.fault in SPOILT_PHOTO)
        )


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Paste a frame that is no key frame (a command); ``key`` is the one on which it hangs."""

    key: int
    picture: Picture
    placement: FramePlacement
    time_s: float
    witness: Witness


class LookClock:
    """Says when a look is due, by the stream's time alone; one owner."""

    def __init__(self) -> None:
        self._pasted_s = self._last_s = float("-inf")

    def pasted(self, time_s: float) -> None:
        """Take in that a frame is pasted."""
        self._pasted_s = time_s

    def is_due(self, time_s: float) -> bool:
        """Take in the time of a frame; return whether waiting for the next one would be too late."""
        gap_s = min(max(time_s - self._last_s, 0.0), PASTED_EVERY_S)
        self._last_s = time_s
        return time_s + gap_s > self._pasted_s + PASTED_EVERY_S + _TOLERANCE_S
