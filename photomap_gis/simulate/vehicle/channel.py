"""A radio link that loses, doubles, reorders and delays packets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Weather:
    """Shares between 0 and 1, times in seconds, for one direction."""

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    delay_s: float = 0.02
    jitter_s: float = 0.0


_LATE_S = 0.4


def arrivals(weather: Weather, sent_s: float, rng: np.random.Generator) -> tuple[float, ...]:
    """Return when a packet arrives: not at all, once or twice. What is reordered comes some tenths of a second late."""
    if rng.random() < weather.loss:
        return ()
    times = []
    for _ in range(2 if rng.random() < weather.duplicate else 1):
        late_s = rng.uniform(0.0, _LATE_S) if rng.random() < weather.reorder else 0.0
        times.append(sent_s + weather.delay_s + rng.uniform(0.0, weather.jitter_s) + late_s)
    return tuple(times)
