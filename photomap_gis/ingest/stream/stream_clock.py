"""How a stream's time stands to the clock of arrival: by the quickest frames, the others were held up. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from photomap_gis.core.live import FrameMoment

_BUCKET_S = 10.0
_REACH = 6
"""Buckets on either side that have a say: clocks drift apart by milliseconds in a minute, links stutter by seconds."""


class StreamClock:
    """A builder: told of frames, it takes stream times to the clock of arrival (less the link's least delay)."""

    def __init__(self) -> None:
        self._least_s: dict[int, float] = {}

    def hear(self, moments: Sequence[FrameMoment]) -> None:
        """Take note of when frames came."""
        for stream_time_s, arrival_s in moments:
            bucket = int(stream_time_s // _BUCKET_S)
            ahead_s = arrival_s - stream_time_s
            self._least_s[bucket] = min(self._least_s.get(bucket, ahead_s), ahead_s)

    def arrival_s(self, stream_time_s: float) -> float:
        """Return when a frame of this stream time would have come over a quick link."""
        bucket = int(stream_time_s // _BUCKET_S)
        near = [a for b in range(bucket - _REACH, bucket + _REACH + 1) if (a := self._least_s.get(b)) is not None]
        if not near:
            raise ValueError("no frame near this time was heard of")
        return stream_time_s + min(near)
