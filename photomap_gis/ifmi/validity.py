"""Whether a registration is to be trusted: a calibrated probability from independent witnesses.

A logistic regression on what the witnesses say, fitted to pairs of known truth, right, wrong and on repeating ground
(``python -m benchmarks.registration.calibrate``; pictures of the ``tuning`` part only).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

ACCEPT = 0.9
"""The probability from which on a registration is accepted: beyond it, wrong ones are rarer than one in 5,000."""

MOST_REPEATING, UNDECIDED = 0.9, 0.5
"""From the first on a motion on repeating ground is one of several that fit: no more than the second is believed."""

WEIGHTS = {
    "one": -1.41,
    "tiles_snr": 2.12,
    "tiles_rival": -3.51,
    "tiles_near": 0.14,
    "blocks_agreeing": 1.12,
    "correlation": 1.59,
    "contender": -6.93,
    "log_overlap": 2.32,
    "repeats": -3.5,
}


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the witnesses said.

    ``correlation`` over the ``overlap``; ``snr`` of the translation pulse; the tiles' ``summed_snr``, the highest
    ``rival`` of their sum as a share of it, how many of the ``tiles`` were ``near``; how many of the ``blocks``
    could be ``solved`` and were ``agreeing``; ``contender`` is the strength of the best other motion over the
    winner's; ``repeats`` how unlike the motion leaves both frames as a share of the best rival on ground that repeats
    itself (near 1: which is right cannot be told; 0: there is no such rival); ``bend`` what no similarity can express,
    as a share of half the frame.
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

    def features(self) -> dict[str, float]:
        """Return what the regression weighs, by the names of ``WEIGHTS``."""
        return {
            "one": 1.0,
            "tiles_snr": min(self.summed_snr, 40.0) / 10.0,
            "tiles_rival": min(self.rival, 1.0),
            "tiles_near": self.near / max(self.tiles, 1),
            "blocks_agreeing": self.agreeing / max(self.blocks, 1),
            "correlation": max(self.correlation, 0.0),
            "contender": min(self.contender, 1.5),
            "log_overlap": math.log(max(self.overlap, 0.02)),
            "repeats": min(self.repeats, 1.0),
        }


def probability_of(e: Evidence) -> float:
    """Return the probability that the registration is right."""
    if e.tiles == 0:
        return 0.0
    score = sum(WEIGHTS[name] * value for name, value in e.features().items())
    probability = 1.0 / (1.0 + math.exp(-max(-30.0, min(30.0, score))))
    return min(probability, UNDECIDED) if e.repeats > MOST_REPEATING else probability
