"""Whether a registration is to be trusted: a calibrated probability from independent witnesses."""

from __future__ import annotations

import math
from dataclasses import dataclass

ACCEPT = 0.9


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the witnesses said.

    ``correlation`` over the ``overlap``; ``snr`` of the translation pulse; the tiles' ``summed_snr``, the highest
    ``rival`` of their sum as a share of it, how many of the ``tiles`` were ``near``; how many of the ``blocks``
    were ``agreeing``; ``contender`` is the strength of the best other motion over the winner's.
    """

    correlation: float
    overlap: float
    snr: float
    summed_snr: float
    rival: float
    near: int
    tiles: int
    agreeing: int
    blocks: int
    contender: float


def probability_of(e: Evidence) -> float:
    """Return the probability that the registration is right."""
    if e.tiles == 0:
        return 0.0
    score = 0.35 * (e.summed_snr - 13.0) - 6.0 * max(e.rival - 0.5, 0.0) + 4.0 * (e.near / e.tiles - 0.3)
    return 1.0 / (1.0 + math.exp(-max(-30.0, min(30.0, score))))
