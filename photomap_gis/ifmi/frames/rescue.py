"""A second try for a frame that could not be registered: perhaps a part of it can."""

from __future__ import annotations

import numpy as np

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.measurement import Registration
from photomap_gis.ifmi.prior import Prior
from photomap_gis.ifmi.register import register
from photomap_gis.ifmi.spectrum import Spectrum, make_spectrum

PART = 0.55
"""Share of the height or width that is tried at a time."""


def register_part(before: Spectrum, frame: ImageArray, *, prior: Prior | None = None) -> Registration | None:
    """Return the registration of the first part of a grey frame that can be registered, ``None`` where none can.

    Where a frame is torn, a half of it may be whole: above, below, left and right are tried in turn.
    """
    h, w = frame.shape
    rows, columns = round(PART * h), round(PART * w)
    for part in (np.s_[:rows], np.s_[h - rows :], np.s_[:, :columns], np.s_[:, w - columns :]):
        mask = np.zeros((h, w), np.bool_)
        mask[part] = True
        found = register(before, make_spectrum(frame, mask=mask), prior=prior, fallback=False)
        if found.accepted:
            return found
    return None
