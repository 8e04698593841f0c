"""A take that was coded, damaged on its way and decoded again: which of its frames are damaged, which are sound."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from benchmarks.registration.faults.camera import Look, Matrix, Motion, draw_picture, expose, fly_placed
from benchmarks.registration.faults.cases import Grey, Mask, strong_difference, working
from benchmarks.registration.faults.screen import draw_telemetry
from benchmarks.registration.faults.streams import Codec, Coding, damage, decode, decode_telling, encode
from benchmarks.registration.pictures import Part

TAKE = 12
FIRST = 3
"""The damage begins no sooner."""
SOUND_SHARE = 0.002
"""Up to this share of damage a frame is sound."""
LAGGING = 3
"""A frame is compared with what the camera saw up to so many frames before, too: a lost motion is no lost picture."""


@dataclass(slots=True, eq=False)
class SpoiltStream:
    """What a decoder shows of a damaged take, by frame number, at working size: ``small``, and undamaged ``whole``.

    ``suspect`` are those of which the decoder told that data was missing; ``places`` ``(3, 3)`` carry pixels of whole
    frames (of ``shape``) to the ground's. How much is damaged is looked at only where it is asked for: most of the time
    goes there.
    """

    codec: Codec
    shape: tuple[int, int]
    places: list[Matrix]
    small: dict[int, Grey]
    whole: dict[int, Grey]
    suspect: set[int]
    _damaged: dict[int, Mask] = field(default_factory=dict)

    @classmethod
    def draw(cls, rng: np.random.Generator, part: Part) -> SpoiltStream:
        """Return a take through a bad link."""
        motion = Motion.HOVER if rng.uniform() < 0.05 else Motion.VIDEO
        light, places = fly_placed(rng, draw_picture(rng, part), motion, TAKE)
        frames = expose(rng, light, Look.draw(rng))
        if rng.uniform() < 0.25:
            frames = draw_telemetry(rng, frames)
        coding = Coding.draw(rng)
        packets = encode(frames, coding)
        clean = decode(packets, coding.codec)
        spoilt = damage(rng, packets, first=FIRST, strokes=int(rng.integers(1, 5)))
        shown, suspect = decode_telling(spoilt, coding.codec)
        size = 256 if max(frames[0].shape) <= 320 or rng.uniform() < 0.5 else 512
        small = {k: working(g, size) for k, g in shown.items() if k in clean and g.shape == clean[k].shape}
        whole = {k: working(clean[k], size) for k in small}
        h, w = frames[0].shape
        return cls(coding.codec, (h, w), places, small, whole, suspect)

    @property
    def numbers(self) -> list[int]:
        """The frames that are shown."""
        return sorted(self.small)

    def damaged(self, k: int) -> Mask:
        """``(h, w)`` True where a frame is damaged."""
        if k not in self._damaged:
            S = np.diag([self.small[k].shape[1] / self.shape[1]] * 2 + [1.0])
            motions = [
                S @ np.linalg.inv(self.places[k]) @ self.places[k - lag] @ np.linalg.inv(S)
                for lag in range(1, min(LAGGING, k) + 1)
            ]
            self._damaged[k] = strong_difference(self.whole[k], self.small[k], drifted=True, motions=motions)
        return self._damaged[k]

    def is_sound(self, k: int) -> bool:
        """Whether hardly anything of a frame is damaged."""
        return float(self.damaged(k).mean()) < SOUND_SHARE

    def last_sound(self, k: int) -> int | None:
        """Return the last sound frame before one, ``None`` where there is none."""
        return next((j for j in reversed(self.numbers) if j < k and self.is_sound(j)), None)
