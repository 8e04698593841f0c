"""Where each photo was taken, and how far to trust it: steps of rounding, and stamps that are older than the photo."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from photomap_gis.core.frame import GpsFix
from photomap_gis.ingest.stills import Still

METRES_PER_DEGREE = 111_320.0
# What a receiver of a drone is good for; only used where something else makes a fix worse than that.
NOMINAL_SIGMA_M = 2.0
_COARSE_STEPS_DEG = (1e-3, 1 / 3600.0, 1e-4, 1 / 36000.0, 1e-5)


def read_fix(still: Still) -> GpsFix | None:
    """Return the photo's fix: XMP's where it is there (it has more digits than EXIF), else EXIF's."""
    if still.xmp.lat_deg is not None and still.xmp.lon_deg is not None:
        lat, lon = still.xmp.lat_deg, still.xmp.lon_deg
    elif still.exif.lat_deg is not None and still.exif.lon_deg is not None:
        lat, lon = still.exif.lat_deg, still.exif.lon_deg
    else:
        return None
    alt = still.xmp.alt_m if still.xmp.alt_m is not None else still.exif.alt_m
    sigma = still.xmp.sigma_m if still.xmp.sigma_m is not None else still.exif.sigma_m
    return GpsFix(lat, lon, alt, sigma)


def judge_fixes(
    fixes: Sequence[GpsFix | None], times_s: Sequence[float | None], steps_deg: Sequence[float]
) -> list[GpsFix | None]:
    """Return the fixes of one flight, in its order, with the sigmas that rounding and age imply.

    ``steps_deg`` is the step in which each position is written, 0 where unknown: the finest is the writer's (it cuts
    "15.000" down to 15/1); what all positions are multiples of counts too. A fix that repeats the one before it while
    the drone flew on is as old as that one.
    """
    written = min((s for s in steps_deg if s > 0.0), default=0.0)
    step = max(written, _common_step_deg([f for f in fixes if f is not None]))
    rounding = step * METRES_PER_DEGREE / math.sqrt(12.0)
    judged: list[GpsFix | None] = []
    for i, fix in enumerate(fixes):
        if fix is None or fix.sigma_m is not None:
            judged.append(fix)
            continue
        extra = math.hypot(rounding, _stale_m(fixes, times_s, i))
        judged.append(replace(fix, sigma_m=math.hypot(NOMINAL_SIGMA_M, extra)) if extra > 0.5 else fix)
    return judged


def says_one_place(fixes: Sequence[GpsFix | None]) -> bool:
    """Whether several photos all carry the very same position: the take-off's, or an album's, but not each its own."""
    places = [(f.lat_deg, f.lon_deg) for f in fixes if f is not None]
    return len(places) >= 4 and len(set(places)) == 1


def _common_step_deg(fixes: Sequence[GpsFix]) -> float:
    """Return the coarsest step of which every latitude and longitude is a multiple, 0 where it is fine."""
    values = {v for f in fixes for v in (f.lat_deg, f.lon_deg)}
    if len(values) < 6:
        return 0.0
    for step in _COARSE_STEPS_DEG:
        if all(abs(v / step - round(v / step)) < 2e-3 for v in values):
            return step
    return 0.0


def _stale_m(fixes: Sequence[GpsFix | None], times_s: Sequence[float | None], i: int) -> float:
    """Return how far the drone flew since the fix at ``i`` was new: its part of the way to the next other fix."""
    here, first = fixes[i], i
    if here is None:
        return 0.0
    while first > 0 and _same_place(fixes[first - 1], here):
        first -= 1
    if first == i:
        return 0.0
    after = next(
        (k for k in range(i + 1, len(fixes)) if fixes[k] is not None and not _same_place(fixes[k], here)), None
    )
    start, now = times_s[first], times_s[i]
    end = times_s[after] if after is not None else None
    if after is None or start is None or now is None or end is None or end <= start:
        return 0.0
    following = fixes[after]
    return 0.0 if following is None else distance_m(here, following) * (now - start) / (end - start)


def _same_place(a: GpsFix | None, b: GpsFix) -> bool:
    return a is not None and a.lat_deg == b.lat_deg and a.lon_deg == b.lon_deg


def distance_m(a: GpsFix, b: GpsFix) -> float:
    """Return the distance over ground of two near fixes, good to a percent."""
    east, north = offset_m(a, b)
    return math.hypot(east, north)


def offset_m(a: GpsFix, b: GpsFix) -> tuple[float, float]:
    """Return how far east and north b is of a, in metres, good to a percent; the date line is no obstacle."""
    lon = math.remainder(b.lon_deg - a.lon_deg, 360.0)
    middle = math.radians((a.lat_deg + b.lat_deg) / 2.0)
    return lon * math.cos(middle) * METRES_PER_DEGREE, (b.lat_deg - a.lat_deg) * METRES_PER_DEGREE
