"""A decoder's own word: whether a frame of a video was made of all the data that belongs to it."""

from __future__ import annotations

from typing import Any

LONGEST = 300
"""Frames after which doubt ends without a key frame, too: pictures that are refreshed piece by piece have none."""


class Trouble:
    """Remembers that something was missing until the next key frame that came whole (a builder, one a decoder).

    What follows a damaged frame is coded as changes to it, so it is as good as the decoder's guess; the flag of the
    frames themselves (``is_corrupt``) only tells of the first.
    """

    def __init__(self) -> None:
        self._left = 0

    def failed(self) -> None:
        """Take note of a packet that came damaged or could not be decoded."""
        self._left = LONGEST

    def of(self, frame: Any) -> bool:
        """Tell whether data was missing for the next frame, a PyAV frame in the decoder's order, or since its key."""
        if frame.is_corrupt:
            self._left = LONGEST
        elif frame.key_frame:
            self._left = 0
        else:
            self._left = max(0, self._left - 1)
        return self._left > 0
