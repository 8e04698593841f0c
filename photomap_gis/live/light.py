"""Evening the light of the live map: a frame gets one gain when it is first pasted, and keeps it.

A camera that exposes by itself makes patches that look like shadows of clouds. The gain of a frame makes it as bright
as what the map shows already, measured where both are equally far from the middle of their frames: there the frames
meet, and there their vignetting is the same, so that it does not add up along a flight. A little of the gain is given
back each time: whatever errors add up die away, and the map goes back to the brightness that the camera gives.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from photomap_gis.core.frame import ImageArray
from photomap_gis.live.canvas import NOBODY, WORTH_A_SECOND, LiveCanvas, Sheet

STRIDES_PX = ((600_000, 16), (150_000, 8), (0, 4))
"""From so many pixels of a sheet on, one in so many along each side is looked at (windows begin at multiples of 16)."""
ALIKE = 0.12
"""Difference of the distances to the frames' middles, as a share of half a diagonal."""
KEPT = 0.98
FEWEST = 50
DARKEST, BRIGHTEST = 10.0, 240.0
"""Beyond, a pixel tells nothing of a gain."""
MOST = math.log(1.8)
LITTLE = 0.03
"""What moves in the picture changes its brightness by less; still ground must not flicker for that."""


class Light:
    """The gains of the key frames of a flight; one owner. The same frames in the same order have the same gains."""

    def __init__(self) -> None:
        self._gains: dict[int, float] = {}
        self._times_s = np.full(256, math.nan)

    def of(self, key: int) -> float:
        """Return a key frame's gain, 1 where it has none."""
        return self._gains.get(key, 1.0)

    def take(self, key: int, sheet: Sheet, canvas: LiveCanvas) -> float:
        """Return the gain of a key frame, given it now where it is new."""
        if key not in self._gains:
            gain = self._ratio(sheet, canvas)
            if gain is not None:  # what is too unlike is left as it is, and nothing is measured against it
                self._room_for(key)
                self._times_s[key] = sheet.time_s
            self._gains[key] = 1.0 if gain is None else gain**KEPT
        return self._gains[key]

    def of_look(self, key: int, sheet: Sheet, canvas: LiveCanvas) -> float:
        """Return the gain of a frame that hangs on a key frame: that one's, unless the exposure has changed since."""
        usual, now = self.of(key), self._ratio(sheet, canvas)
        return usual if now in (None, 1.0) or abs(math.log(now / usual)) < LITTLE else now  # 1: nothing to compare

    def _ratio(self, sheet: Sheet, canvas: LiveCanvas) -> float | None:
        """Return how much brighter the canvas is: 1 where little can be compared, ``None`` where it is too unlike."""
        count = 0
        old_sum = new_sum = 0.0
        w = sheet.window
        stride_px = next(s for least, s in STRIDES_PX if w.width * w.height >= least)
        far_new = 1.0 + WORTH_A_SECOND * sheet.time_s
        for planes, there, here in canvas.under(w, stride_px):
            shown = planes.shown[there]
            both = (sheet.inside[here] > 0) & (shown != NOBODY)
            if not both.any():
                continue
            keys = shown[both]
            self._room_for(int(keys.max()))
            times_s = self._times_s[keys]
            old, new = _brightness(planes.rgb[there][both]), _brightness(sheet.rgb[here][both])
            apart = (1.0 + WORTH_A_SECOND * times_s - planes.worth[there][both]) - (far_new - sheet.worth[here][both])
            used = (np.abs(apart) < ALIKE) & _tells(old) & _tells(new)
            count += int(used.sum())
            old_sum += float(old[used].sum(dtype=np.float64))
            new_sum += float(new[used].sum(dtype=np.float64))
        if count < FEWEST or new_sum <= 0.0:
            return 1.0
        ratio = old_sum / new_sum
        return ratio if abs(math.log(max(ratio, 1e-6))) <= MOST else None

    def _room_for(self, key: int) -> None:
        while key >= len(self._times_s):
            self._times_s = np.concatenate([self._times_s, np.full(len(self._times_s), math.nan)])


def brightened(sheet: Sheet, gain: float) -> Sheet:
    """Return a sheet with a gain laid on."""
    if gain == 1.0:
        return sheet
    table = np.clip(np.arange(256) * gain + 0.5, 0, 255).astype(np.uint8)
    return sheet._replace(rgb=np.asarray(cv2.LUT(sheet.rgb, table), np.uint8))


def _brightness(rgb: ImageArray) -> np.ndarray:
    """``(N,)`` of ``(N, 3)``: whole numbers, so that their sums are the same whatever the order."""
    wide = rgb.astype(np.uint16)
    return (wide[:, 0] + 2 * wide[:, 1] + wide[:, 2]) // 4


def _tells(brightness: np.ndarray) -> np.ndarray:
    return (brightness > DARKEST) & (brightness < BRIGHTEST)
