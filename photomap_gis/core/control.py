"""Ground control: points whose place on Earth is known, where pictures show them, and how a map is moved by hand."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from photomap_gis.core.errors import UsageError

CONTROL_SIGMA_M = 0.05
"""One sigma per axis of a surveyed point of which the file says nothing."""
CLICK_SIGMA_PX = 1.0
"""One sigma per axis of a point marked in a picture."""

_ORDINALS = {"second": 2, "third": 3, "fourth": 4, "fifth": 5}


@dataclass(frozen=True, slots=True)
class Sighting:
    """A control point in one picture: ``image`` is its file name or path, ``xy_px`` are pixels of the stored raster."""

    image: str
    xy_px: tuple[float, float]
    sigma_px: float = CLICK_SIGMA_PX


@dataclass(frozen=True, slots=True)
class ControlPoint:
    """A point of the ground: ``x`` east and ``y`` north (longitude, latitude in degrees for a geographic ``crs``).

    ``crs`` is as it was written; ``sigma_m`` is the survey's one sigma per axis. Heights are not used by the map.
    """

    name: str
    crs: str
    x: float
    y: float
    z_m: float | None = None
    sigma_m: float = CONTROL_SIGMA_M
    sightings: tuple[Sighting, ...] = ()


@dataclass(frozen=True, slots=True)
class Nudge:
    """A correction of the whole map by hand: metres east and north, degrees clockwise about a place on Earth."""

    east_m: float
    north_m: float
    clockwise_deg: float = 0.0
    pivot_lat_deg: float = 0.0
    pivot_lon_deg: float = 0.0


def check_names(names: Sequence[str], check: Sequence[str]) -> frozenset[str]:
    """Return which of the control points are kept for the check.

    ``check`` holds names, or ``every-third`` and the like (``every-N``: the N-th, the 2N-th, ... in the file's order).
    ``UsageError`` for names that there are none of, and where nothing would be left to fit.

    >>> sorted(check_names(["a", "b", "c", "d"], ["every-second"]))
    ['b', 'd']
    """
    found: set[str] = set()
    for word in check:
        every = re.fullmatch(r"every-(\w+)", word)
        if every and word not in names:
            step = _ORDINALS.get(every[1]) or (int(every[1]) if every[1].isdecimal() else 0)
            if step < 2:
                raise UsageError(f"--check {word}: write every-second, every-third or every-N with N of 2 or more")
            if len(names) < step:
                raise UsageError(f"--check {word}: there are only {len(names)} control points")
            found.update(names[step - 1 :: step])
        elif word in names:
            found.add(word)
        else:
            known = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
            raise UsageError(f"--check {word}: there is no such control point; there are {known or 'none'}")
    return frozenset(found)


def is_coordinate(value: float) -> bool:
    """Whether a number can be a coordinate at all."""
    return math.isfinite(value) and abs(value) < 1e9
