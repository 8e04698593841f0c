"""When each photo was taken, in UTC: the camera's own clock, set by the GPS receiver's.

The camera's clock runs evenly but shows local time, or whatever its owner set; the receiver's stamp is UTC, but comes
in whole seconds and may be stale, shared by two photos. So the camera's clock gives the intervals and the receiver's
gives the offset, wherever both are there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from photomap_gis.ingest.exif import parse_date_time
from photomap_gis.ingest.stills import Still

QUARTER_HOUR_S = 900.0
_MAX_SCATTER_S = 5.0


@dataclass(frozen=True, slots=True)
class ClockReading:
    """The photos' UTC times in their order, ``None`` where unknown; and what the user should know of the clock."""

    times_s: tuple[float | None, ...]
    warnings: tuple[str, ...] = ()


def read_clock(stills: Sequence[Still]) -> ClockReading:
    """Return the UTC times of the photos of **one** camera body."""
    exposures = [_utc_at_exposure(s) for s in stills]
    if all(t is not None for t in exposures) and len(set(exposures)) == len(exposures):
        return ClockReading(tuple(exposures))
    local = [s.exif.local_s if s.exif.local_s is not None else _created(s) for s in stills]
    gps = [s.exif.gps_s for s in stills]
    if _distinct(local) == 0:
        return ClockReading(_spread(gps))
    if _distinct(gps) > 1.5 * _distinct(local):  # the camera's clock stood still, or software rewrote its dates
        return ClockReading(_spread(gps))
    even = _spread(local, whole_seconds=not all(s.exif.has_subsec for s in stills if s.exif.local_s is not None))
    offset_s, warnings = _utc_offset_s(even, gps, stills)
    return ClockReading(tuple(t - offset_s if t is not None else g for t, g in zip(even, gps, strict=True)), warnings)


def _utc_offset_s(
    local: Sequence[float | None], gps: Sequence[float | None], stills: Sequence[Still]
) -> tuple[float, tuple[str, ...]]:
    """Return what the camera's clock is ahead of UTC."""
    ahead = [a - b for a, b in zip(local, gps, strict=True) if a is not None and b is not None]
    if ahead:
        middle = median(ahead)
        scatter = median(abs(a - middle) for a in ahead)
        if scatter <= _MAX_SCATTER_S:
            return middle, ()
        stated = _stated_offset_s(stills)
        nearest = stated if stated is not None else round(middle / QUARTER_HOUR_S) * QUARTER_HOUR_S
        return nearest, ("camera and GPS clocks disagree by changing amounts: times may be off by minutes",)
    stated = _stated_offset_s(stills)
    if stated is not None:
        return stated, ()
    return 0.0, ("the camera's clock has no time zone: its times are taken as UTC",)


def _stated_offset_s(stills: Sequence[Still]) -> float | None:
    offsets = [s.exif.utc_offset_s for s in stills if s.exif.utc_offset_s is not None]
    return median(offsets) if offsets else None


def _utc_at_exposure(still: Still) -> float | None:
    parsed = parse_date_time(still.xmp.utc_at_exposure)
    return parsed[0] if parsed else None


def _created(still: Still) -> float | None:
    """XMP's own date, without its zone, which makers write wrongly."""
    parsed = parse_date_time(still.xmp.created)
    return parsed[0] if parsed else None


def _distinct(times_s: Sequence[float | None]) -> int:
    return len({t for t in times_s if t is not None})


def _spread(times_s: Sequence[float | None], whole_seconds: bool = True) -> tuple[float | None, ...]:
    """Lay photos that share one whole second evenly into it, in their order (bursts faster than the clock's tick)."""
    if not whole_seconds:
        return tuple(times_s)
    same: dict[float, list[int]] = {}
    for i, t in enumerate(times_s):
        if t is not None:
            same.setdefault(t, []).append(i)
    spread = list(times_s)
    for t, where in same.items():
        if len(where) > 5:  # no camera is that fast: a clock that stands still
            continue
        for n, i in enumerate(where):
            spread[i] = t + n / len(where)
    return tuple(spread)
