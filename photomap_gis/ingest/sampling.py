"""Which frames of a video enter the map: enough that neighbours overlap well, no more. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from photomap_gis.ingest.telemetry.clean import METRES_PER_DEGREE
from photomap_gis.ingest.telemetry.track import TrackPoint

FloatArray = npt.NDArray[np.float64]

DEFAULT_RATE_HZ = 2.5
MIN_RATE_HZ, MAX_RATE_HZ = 1.0, 5.0
WANTED_OVERLAP = 0.85
_TYPICAL_HFOV_RAD = math.radians(70.0)
"""Where the lens is unknown: most drones' video lies between 60 and 80 degrees."""
FEW_FRAMES, MOST_OFTEN = 700, 2.0
"""A recording that asks for fewer frames than this is sampled up to twice as often: frames between reach further at the
rim of a shaky flight, and a short flight's cost little."""

_LOWEST_HEIGHT_M = 5.0
_SPEED_WINDOW_S = 4.0


def sampling_rates(
    points: Sequence[TrackPoint | None], times_s: FloatArray, *, hfov_rad: float | None, aspect: float
) -> FloatArray:
    """``(N,)`` frames a second wanted at each moment, from speed and height there.

    ``aspect`` is width over height: the frame's shorter side may lie along the flight. Where speed or height is unknown
    the default rate is wanted. Short recordings are sampled more often.
    """
    rates = np.full(len(times_s), DEFAULT_RATE_HZ)
    speeds = _speeds_m_per_s(points, times_s)
    for i, p in enumerate(points):
        if p is None or p.height_m is None or not math.isfinite(speeds[i]):
            continue
        hfov = p.hfov_rad or hfov_rad or _TYPICAL_HFOV_RAD
        width_m = 2.0 * max(p.height_m, _LOWEST_HEIGHT_M) * math.tan(hfov / 2.0)
        step_m = (1.0 - WANTED_OVERLAP) * min(width_m, width_m / max(aspect, 1e-3))
        rates[i] = min(max(speeds[i] / step_m, MIN_RATE_HZ), MAX_RATE_HZ)
    return np.minimum(rates * _room_for_more(rates, times_s), MAX_RATE_HZ)


def _room_for_more(rates: FloatArray, times_s: FloatArray) -> float:
    """Return by how much more often a short recording is sampled."""
    asked = float(np.sum(np.diff(times_s) * (rates[1:] + rates[:-1]) / 2.0))
    return float(np.clip(FEW_FRAMES / max(asked, 1.0), 1.0, MOST_OFTEN))


def choose_frames(times_s: FloatArray, rates_hz: FloatArray | float) -> list[int]:
    """Return the numbers of the frames to use: the first, then one whenever the integral of the rate is a whole number.

    ``times_s`` ``(N,)`` are the moments of all frames, increasing; a hole in the recording counts as one step.
    """
    if len(times_s) == 0:
        return []
    rates = np.broadcast_to(np.asarray(rates_hz, dtype=np.float64), times_s.shape)
    steps = np.diff(times_s) * (rates[1:] + rates[:-1]) / 2.0
    phase = np.concatenate([[0.0], np.cumsum(np.minimum(steps, 1.0))])
    # The frame nearest to each whole number: rounding spreads frames evenly where the rates do not divide.
    wanted = np.arange(0.0, math.floor(phase[-1] + 1e-6) + 1.0)
    right = np.clip(np.searchsorted(phase, wanted - 1e-9), 0, len(phase) - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(wanted - phase[left] < phase[right] - wanted, left, right)
    return [int(i) for i in np.unique(nearest)]


def _speeds_m_per_s(points: Sequence[TrackPoint | None], times_s: FloatArray) -> FloatArray:
    """``(N,)`` ground speed over a few seconds around each moment, NaN where unknown: single steps are mostly noise."""
    speeds = np.full(len(times_s), np.nan)
    known = [i for i, p in enumerate(points) if p is not None]
    if len(known) < 2:
        return speeds
    at = times_s[known]
    lat = np.array([points[i].lat_deg for i in known])  # type: ignore[union-attr]
    lon = np.unwrap([points[i].lon_deg for i in known], period=360.0)  # type: ignore[union-attr]
    north = lat * METRES_PER_DEGREE
    east = lon * METRES_PER_DEGREE * math.cos(math.radians(float(np.median(lat))))
    left = np.searchsorted(at, at - _SPEED_WINDOW_S / 2.0)
    right = np.searchsorted(at, at + _SPEED_WINDOW_S / 2.0, side="right") - 1
    span = at[right] - at[left]
    way = np.hypot(north[right] - north[left], east[right] - east[left])
    speeds[known] = np.where(span > 0.2, way / np.maximum(span, 1e-6), np.nan)
    return speeds
