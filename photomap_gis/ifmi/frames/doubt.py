"""How faulty a frame looks that none of the sure tests rejected: by itself, against what its predecessor shows.

What the camera always shows (a letter box, furrows, a soft lens) is taken off by the predecessor, if that shows the
same ground. Where it does not, a road or an eave is new too: then only what no ground looks like is believed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from photomap_gis.ifmi.frames import blur
from photomap_gis.ifmi.frames.traits import Traits

FLAT_SHARE = 0.33
SMEARED_SHARE, BLOCKY_SHARE, CORNERED_SHARE = 0.0125, 0.06, 0.003
"""Shares that are as good as certain; half of them is an even bet."""
TORN_RATIO = 1.6
"""Two rows that differ so much more than those around them are an even bet."""
LIKELY = 0.95
STRANGE_SMEAR, STRANGE_BLOCKS, STRANGE_CORNERS, STRANGE_TEAR = 1.5, 1.0, 3.0, 2.2
"""So many times what is as good as certain is asked for where the predecessor may show other ground."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """What raises doubt, each as a multiple of what is as good as certain (an even bet at 0.5)."""

    smeared: float
    blocky: float
    cornered: float
    torn: float
    flat: float
    blurred: float

    @property
    def of_kin(self) -> float:
        """How faulty the frame looks, 0..1, if its predecessor shows the same ground."""
        most = max(
            0.0,
            self.smeared,
            min(LIKELY, self.blocky),
            min(LIKELY, self.cornered),
            min(LIKELY, self.torn),
            self.flat,
            self.blurred,
        )
        return min(1.0, most)

    @property
    def of_strangers(self) -> float:
        """How faulty it looks whatever its predecessor shows; at most ``of_kin``."""
        most = max(
            0.0,
            0.5 * self.smeared / STRANGE_SMEAR,
            0.5 * self.blocky / STRANGE_BLOCKS,
            0.5 * self.cornered / STRANGE_CORNERS,
            0.5 * self.torn / STRANGE_TEAR,
        )
        return min(self.of_kin, most)


def doubt_of(t: Traits, before: Traits) -> Doubt:
    """Return what a picture's traits raise doubt by, against its predecessor's."""
    return Doubt(
        smeared=(t.smeared - 1.5 * before.smeared) / SMEARED_SHARE,
        blocky=(t.blocky - 2.0 * before.blocky) / BLOCKY_SHARE,
        cornered=(t.cornered - 2.0 * before.cornered) / CORNERED_SHARE,
        torn=0.5 * (t.tear / max(before.tear, 1.0) - 1.0) / (TORN_RATIO - 1.0),
        flat=0.75 * (t.flat_share - before.flat_share) / FLAT_SHARE,
        blurred=1.0 / (1.0 + math.exp(min(-(blur.blur_score(t, before) - blur.DOUBTFUL), 50.0))),
    )
