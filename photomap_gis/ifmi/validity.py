"""Whether a registration is to be trusted: a calibrated probability from independent witnesses."""

from __future__ import annotations

import math
from dataclasses import dataclass

ACCEPT = 0.9


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the witnesses said.

    ``low``, ``middle`` and ``fine`` are correlations over the overlap in three bands; ``snr`` that of the translation
    pulse; ``rival`` the evidence of the best other motion over the winner's; ``drift`` how far the refinement moved,
    as a share of the frame.
    """

    low: float
    middle: float
    fine: float
    overlap: float
    snr: float
    rival: float
    agreeing_blocks: int
    blocks: int
    drift: float
    area_px: float


def probability_of(e: Evidence, method: str) -> float:
    """Return the probability that the registration is right."""
    if e.blocks == 0:
        return 0.0
    share = e.agreeing_blocks / e.blocks
    z = math.atanh(max(-0.99, min(0.99, e.middle))) * math.sqrt(e.area_px) / 10.0
    score = 0.35 * (z - 4.0) + 6.0 * (share - 0.5) + 4.0 * (e.low - 0.4) - 6.0 * max(0.0, e.rival - 0.7)
    return 1.0 / (1.0 + math.exp(-max(-30.0, min(30.0, score))))
