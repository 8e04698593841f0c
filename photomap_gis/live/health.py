"""How a session does, in numbers and in words that a person in a hurry reads at a glance."""

from __future__ import annotations

from collections import deque

from photomap_gis.core.live import GapKind, StreamGap
from photomap_gis.live.locate import Locator
from photomap_gis.live.loop import Tally
from photomap_gis.live.steps import FrameState, Step
from photomap_gis.server.live_view import GpsState, LinkState, LiveHealth

EVERY_S = 1.0
GPS_LOST_S = 3.0
_RECENT = 90


class HealthWatch:
    """Follows the loop by the stream's time; owned by the loop."""

    def __init__(self, tally: Tally, locator: Locator) -> None:
        self._tally, self._locator = tally, locator
        self._times: deque[float] = deque(maxlen=_RECENT)
        self._latencies: deque[float] = deque(maxlen=_RECENT)
        self._link = LinkState.OK
        self._fix_at_s: float | None = None
        self._told_at_s = -1e9
        self._now_s = 0.0
        self._words: list[str] = []
        self._lost = ""
        self._pieces = self._keys = 0
        self.snapped = False

    def say(self, words: str) -> None:
        """Keep a sentence for people; each once."""
        if words not in self._words:
            self._words = [*self._words[-4:], words]

    def hear(self, gap: StreamGap) -> None:
        """Take in what the source tells of its link."""
        if gap.kind in (GapKind.LINK_LOST, GapKind.WAITING, GapKind.NO_KEY_FRAME, GapKind.UNUSABLE):
            self._link, self._lost = LinkState.LOST, gap.message
        elif gap.kind is GapKind.RECONNECTED:
            self._link = LinkState.OK
        elif gap.kind is GapKind.RECORDING_STOPPED:
            self.say(gap.message)

    def step(self, step: Step, time_s: float, latency_ms: float, pieces: int, keys: int) -> bool:
        """Take in a step of the loop; return whether it is time to tell."""
        self._now_s, self._pieces, self._keys = time_s, pieces, keys
        self._latencies.append(latency_ms)
        if step.belief is not None:
            self._times.append(time_s)
        waits = step.state in (FrameState.ERROR, FrameState.WAITING)
        self._link = LinkState.WAITING if waits else LinkState.OK
        if step.ref.fix is not None:
            self._fix_at_s = time_s
        if time_s - self._told_at_s < EVERY_S:
            return False
        self._told_at_s = time_s
        return True

    def now(self) -> LiveHealth:
        """Return the health at this moment."""
        t, times = self._tally, self._times
        recent = [s for s in times if s > self._now_s - 2.0]
        fps = (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 1 and recent[-1] > recent[0] else 0.0
        latency = max(self._latencies, default=0.0)
        return LiveHealth(
            t.frames, fps, latency, t.dropped, t.error_frames, self._keys, self._pieces, self._link, self._gps(),
            tuple(self._spoken()),
        )  # fmt: skip

    def _gps(self) -> GpsState:
        if self._fix_at_s is None:
            return GpsState.SEARCHING if self._locator.has_positions else GpsState.NONE
        return GpsState.OK if self._now_s - self._fix_at_s < GPS_LOST_S else GpsState.LOST

    def _spoken(self) -> list[str]:
        words = []
        if self._link is LinkState.LOST:
            words.append(self._lost or "link lost: waiting for pictures")
        elif self._link is LinkState.WAITING:
            words.append("the map waits: pictures cannot be placed just now")
        if self._gps() is GpsState.LOST:
            words.append("no position from the drone: the map goes on by its pictures")
        if self._pieces > 1:
            words.append(f"{self._pieces} pieces are not tied to each other yet")
        return [*words, *self._words]
