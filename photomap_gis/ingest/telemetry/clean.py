"""Keep what can be true of a log's points, say what was dropped."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

from photomap_gis.core.frame import Attitude
from photomap_gis.ingest.telemetry.track import TrackPoint, Trigger

MAX_SPEED_M_PER_S = 350.0
"""Faster than any drone or aeroplane that takes photo maps: a jump beyond it is a glitch of the receiver."""

MAX_ALTITUDE_M = 60_000.0
METRES_PER_DEGREE = 111_195.0


def distance_m(lat_a_deg: float, lon_a_deg: float, lat_b_deg: float, lon_b_deg: float) -> float:
    """Ground distance on the sphere in metres, good to half a percent."""
    a, b = math.radians(lat_a_deg), math.radians(lat_b_deg)
    half = math.sin((b - a) / 2) ** 2
    half += math.cos(a) * math.cos(b) * math.sin(math.radians(lon_b_deg - lon_a_deg) / 2) ** 2
    return 2.0 * math.radians(1.0) ** -1 * METRES_PER_DEGREE * math.asin(math.sqrt(min(1.0, half)))


def is_fix(lat_deg: float, lon_deg: float) -> bool:
    """Whether the numbers can be a position; 0, 0 is what a receiver without a fix writes."""
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):  # False for NaN, too
        return False
    return not (abs(lat_deg) < 1e-6 and abs(lon_deg) < 1e-6)


def clean_points(points: Iterable[TrackPoint]) -> tuple[tuple[TrackPoint, ...], list[str]]:
    """Return the believable points, strictly increasing in time, and a warning per kind of what was dropped."""
    no_fix = bad_time = spikes = 0
    kept: list[TrackPoint] = []
    for p in points:
        if not math.isfinite(p.time_s):
            bad_time += 1
        elif not is_fix(p.lat_deg, p.lon_deg):
            no_fix += 1
        else:
            kept.append(_without_nonsense(p))
    in_order = all(a.time_s < b.time_s for a, b in pairwise(kept))
    if not in_order:
        kept.sort(key=lambda p: p.time_s)
        unique = [b for a, b in zip([None, *kept], kept, strict=False) if a is None or b.time_s > a.time_s]
        kept = unique
    kept, spikes = _without_spikes(kept)
    warnings = []
    if no_fix:
        warnings.append(f"{no_fix} records without a valid position were left out")
    if bad_time:
        warnings.append(f"{bad_time} records without a valid time were left out")
    if spikes:
        warnings.append(f"{spikes} positions jump faster than {MAX_SPEED_M_PER_S:.0f} m/s and were left out")
    return tuple(kept), warnings


def clean_triggers(triggers: Iterable[Trigger]) -> tuple[Trigger, ...]:
    """Return the triggers in order of time; one without a believable position keeps its moment."""
    kept = []
    for t in triggers:
        if not math.isfinite(t.time_s):
            continue
        if t.lat_deg is None or t.lon_deg is None or not is_fix(t.lat_deg, t.lon_deg):
            t = replace(t, lat_deg=None, lon_deg=None)
        kept.append(
            replace(
                t,
                alt_m=bounded(t.alt_m, -MAX_ALTITUDE_M, MAX_ALTITUDE_M),
                height_m=bounded(t.height_m, -MAX_ALTITUDE_M, MAX_ALTITUDE_M),
                attitude=_finite_attitude(t.attitude),
            )
        )
    return tuple(sorted(kept, key=lambda t: t.time_s))


def bounded(value: float | None, low: float, high: float) -> float | None:
    """Return the value where it is a number between the bounds, else ``None``."""
    return value if value is not None and low <= value <= high else None


def _without_nonsense(p: TrackPoint) -> TrackPoint:
    clean = replace(
        p,
        alt_m=bounded(p.alt_m, -MAX_ALTITUDE_M, MAX_ALTITUDE_M),
        height_m=bounded(p.height_m, -MAX_ALTITUDE_M, MAX_ALTITUDE_M),
        attitude=_finite_attitude(p.attitude),
        sigma_m=bounded(p.sigma_m, 1e-3, 1e5),
        focal_35mm=bounded(p.focal_35mm, 1.0, 10_000.0),
        hfov_rad=bounded(p.hfov_rad, math.radians(0.05), math.radians(179.0)),
    )
    return p if clean == p else clean


def _finite_attitude(a: Attitude | None) -> Attitude | None:
    return a if a is not None and math.isfinite(a.yaw_rad + a.pitch_rad + a.roll_rad) else None


def _without_spikes(points: list[TrackPoint]) -> tuple[list[TrackPoint], int]:
    """Drop single points that no speed reaches, and from which none returns."""

    def too_far(a: TrackPoint, b: TrackPoint) -> bool:
        reach = MAX_SPEED_M_PER_S * (b.time_s - a.time_s) + 100.0
        return distance_m(a.lat_deg, a.lon_deg, b.lat_deg, b.lon_deg) > reach

    kept: list[TrackPoint] = []
    dropped = 0
    for i, p in enumerate(points):
        before = kept[-1] if kept else None
        after = points[i + 1] if i + 1 < len(points) else None
        far_before = before is not None and too_far(before, p)
        far_after = after is not None and too_far(p, after)
        alone = (far_before or before is None) and (far_after or after is None) and (far_before or far_after)
        # At the ends one neighbour must speak for two: a first point is a spike only where the rest holds together.
        if alone and before is None and len(points) > 2:
            alone = not too_far(points[1], points[2])
        if alone and len(points) > 2:
            dropped += 1
        else:
            kept.append(p)
    return kept, dropped
