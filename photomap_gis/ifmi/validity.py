"""Whether a registration is to be trusted: a calibrated probability from independent witnesses."""

from __future__ import annotations

import math
from dataclasses import dataclass

ACCEPT = 0.9
MOST_REPEATING = 0.4


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the witnesses said.

    ``correlation`` over the ``overlap``; ``snr`` of the translation pulse; the tiles' ``summed_snr``, the highest
    ``rival`` of their sum as a share of it, how many of the ``tiles`` were ``near``; how many of the ``blocks``
    were ``agreeing``; ``contender`` is the strength of the best other motion over the winner's; ``repeats`` whether the
    ground looks the same a period away.
    """

    correlation: float
    overlap: float
    snr: float
    summed_snr: float
    rival: float
    near: int
    tiles: int
    agreeing: int
    solved: int
    blocks: int
    contender: float
    repeats: float = 0.0
    bend: float = 0.0


def probability_of(e: Evidence) -> float:
    """Return the probability that the registration is right."""
    if e.tiles == 0:
        return 0.0
    score = (
        0.3 * (min(e.summed_snr, 40.0) - 14.0)
        - 6.0 * max(e.rival - 0.4, 0.0)
        + 4.0 * (e.near / e.tiles - 0.5)
        + 1.0 * (math.log1p(e.agreeing) - 1.8)
        + 4.0 * (e.correlation - 0.3)
        - 3.0 * max(e.contender - 0.5, 0.0)
    )
    probability = 1.0 / (1.0 + math.exp(-max(-30.0, min(30.0, score))))
    return min(probability, 0.5) if e.repeats > MOST_REPEATING else probability
