"""By how much pictures come later than positions while a flight lasts, found from its own motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from photomap_gis.core.frame import TrackFix
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.posegraph import FixLag
from photomap_gis.core.similarity import FloatArray
from photomap_gis.georef import DRIFT_SIGMA_M, DRIFT_TIME_S, WHITE_SIGMA_M, fix_to_map
from photomap_gis.slam import ErrorModel, estimate_lag

MODEL = ErrorModel(WHITE_SIGMA_M, DRIFT_SIGMA_M, DRIFT_TIME_S)
REACH_S = 6.0
SHARE = 0.25
"""Of the flight so far: a lag of more cannot be told from another piece of it."""


def picture_lag(
    stream_times_s: FloatArray, path_xy: FloatArray, placed: Sequence[TrackFix | None], map_frame: MapFrame
) -> FixLag | None:
    """Return by how much pictures come later than the positions they were given, ``None`` where motion does not tell.

    ``(N,)`` stream times of frames of one connected piece, strictly increasing; ``(N, 2)`` where they lie by image
    motion, in any frame; and where ``LiveTelemetry.place`` put them. Key frames are enough. The result is for
    ``LiveTelemetry.set_lag``; a straight and steady flight shows no lag.
    """
    rows = [k for k, p in enumerate(placed) if p is not None]
    if len(rows) < 2:
        return None
    fixes = [p.fix for p in placed if p is not None]
    time_s = np.asarray(stream_times_s, np.float64)[rows]
    path = np.asarray(np.asarray(path_xy, np.float64)[rows] @ (1, 1j), np.complex128)
    there = fix_to_map(map_frame, [f.lat_deg for f in fixes], [f.lon_deg for f in fixes])
    fix = np.asarray(there @ (1, 1j), np.complex128)
    reach_s = min(REACH_S, SHARE * float(time_s[-1] - time_s[0]))
    found = estimate_lag(time_s, path, fix, MODEL, reach_s=reach_s)
    # A fix that is older than its picture's place was taken before it: the picture is early.
    return None if found is None else FixLag(-found.lag_s, found.sigma_s)
