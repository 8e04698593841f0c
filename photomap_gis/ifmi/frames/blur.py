"""Whether a picture is blurred so heavily that nothing fine is left, against what its predecessor showed.

The weights are those of a logistic regression on tuned pictures: blurs of a standard deviation from 2.5 % of the width
and smears from 12 % against sound frames, among them blurs up to 1.2 % and smears up to 6 %.
"""

from __future__ import annotations

import numpy as np

from photomap_gis.ifmi.frames.traits import Traits

CONSTANT = -20.9
OF_SHARPNESS, OF_LOSS, OF_DETAIL = -5.1, -3.5, -3.3
SURE = 7.0
LIKELY, DOUBTFUL = 1.0, 2.3


def blur_score(traits: Traits, before: Traits) -> float:
    """Return the logarithm of the odds that a picture is blurred heavily while its predecessor was not.

    Looked at is the direction that lost most: a smear leaves the detail across it.
    """
    sharp, sharp_before = (np.log((t.near + 0.2) / (t.far + 0.6)) for t in (traits, before))
    detail = np.log((traits.near + 0.5) / (before.near + 0.5))
    loss = float((sharp - sharp_before).min())
    return CONSTANT + OF_SHARPNESS * float(sharp.min()) + OF_LOSS * loss + OF_DETAIL * float(detail.min())
