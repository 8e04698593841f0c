"""Numbers as colours: a ramp that people with any colour vision can read, and its legend."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

STOPS = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))
"""Dark to light at even steps of what the eye takes for brightness (the stops of viridis)."""
_STEPS = 256
_PERCENT = (1.0, 99.0)


@dataclass(frozen=True, slots=True)
class Ramp:
    """The numbers at which the ramp begins and ends; beyond them its ends hold."""

    low: float
    high: float

    @classmethod
    def over(cls, values: npt.NDArray[np.float64]) -> Ramp:
        """Return a ramp over nearly all of some numbers."""
        if values.size == 0:
            return cls(0.0, 1.0)
        low, high = (float(v) for v in np.percentile(values, _PERCENT))
        return cls(low, high if high > low else low + max(1.0, abs(low) * 1e-6))

    def colours(self, values: npt.NDArray[Any], seen: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint8]:
        """``(H, W, 4)`` RGBA of ``(H, W)`` numbers; transparent where not ``seen`` or not finite."""
        v = values.astype(np.float64)
        known = seen & np.isfinite(v)
        share = (np.where(known, v, self.low) - self.low) / (self.high - self.low)
        rgb = _TABLE[np.rint(share.clip(0.0, 1.0) * (_STEPS - 1)).astype(np.intp)]
        return np.dstack([rgb, np.where(known, 255, 0).astype(np.uint8)])


def _table() -> npt.NDArray[np.uint8]:
    at = np.linspace(0.0, 1.0, len(STOPS))
    t = np.linspace(0.0, 1.0, _STEPS)
    return np.stack([np.rint(np.interp(t, at, np.array(STOPS)[:, k])) for k in range(3)], axis=-1).astype(np.uint8)


_TABLE = _table()
