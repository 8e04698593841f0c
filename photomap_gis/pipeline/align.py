"""Tracks whose clock is off by more than seconds: found by the motion of the pictures, and the frames placed anew.

Clocks of loggers are off by a minute, cameras stand in other time zones. Whole quarter hours are chosen by ingest where
track and frames overlap; what that leaves is looked for here against the path of the sequential registrations alone,
which needs no fix. Seconds and their fractions are left to the solver.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from photomap_gis.core.frame import FlightTrack, FrameRef
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.georef import DRIFT_SIGMA_M, DRIFT_TIME_S, WHITE_SIGMA_M, fix_to_map
from photomap_gis.ingest.kept_track import frame_time_s, placed_anew
from photomap_gis.pipeline.solve import graph_builder, leanings_of
from photomap_gis.slam import ErrorModel, find_shift, solve
from photomap_gis.store import Mission, PreparedFrame, RegistrationRecord

REACH_S, STEP_S = 60.0, 0.5
QUARTER_HOUR_S, MAX_QUARTERS = 900.0, 56
MIN_SHIFT_S = 3.0
"""Less is left to the solver, which moves fixes along the solved path."""
MAX_HOLE_S = 15.0
"""Between records further apart a track is silent."""
MODEL = ErrorModel(WHITE_SIGMA_M, DRIFT_SIGMA_M, DRIFT_TIME_S)


def track_shifts(
    mission: Mission,
    frames: Sequence[FrameRef],
    accepted: Sequence[RegistrationRecord],
    prepared: Mapping[int, PreparedFrame],
) -> dict[int, float]:
    """Return by flight by how many seconds its track is older than its pictures, where that is more than a few.

    Flights whose motion does not tell are not in it.
    """
    if not list(mission.tracks) or mission.header.map_frame.crs_wkt is None:
        return {}
    path = sequential_paths(frames, accepted, prepared)
    found = {}
    for track in mission.tracks:
        shift = shift_of(track, path, mission.header.map_frame, _trials_s())
        if shift is not None and abs(shift) > MIN_SHIFT_S:
            found[track.flight] = shift
    return found


def sequential_paths(
    frames: Sequence[FrameRef], accepted: Sequence[RegistrationRecord], prepared: Mapping[int, PreparedFrame]
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Return by flight its longest unbroken path, by the sequential registrations alone: ``(N,)`` times and x + iy."""
    usable = [f for f in frames if prepared[f.index].usable]
    chain = [r for r in accepted if r.kind is EdgeKind.SEQUENTIAL]
    leanings = leanings_of({f.index: f for f in usable}, chain, prepared)
    relative = solve(graph_builder(usable, chain, prepared, MapFrame(None), leanings).snapshot())
    times = {f.index: when for f in usable if (when := frame_time_s(f)) is not None}
    flights = {f.index: f.flight for f in usable}
    pose_of = {p.frame: p.T_map_plane for p in relative.poses}
    segments: dict[tuple[int, int], list[int]] = {}
    for pose in relative.poses:
        if pose.frame in times:
            segments.setdefault((flights[pose.frame], pose.segment), []).append(pose.frame)
    longest: dict[int, list[int]] = {}
    for (flight, _), members in segments.items():
        if len(members) > len(longest.get(flight, ())):
            longest[flight] = members
    out = {}
    for flight, members in longest.items():
        by_time = {times[f]: f for f in members}
        time_s = np.array(sorted(by_time))
        out[flight] = time_s, np.array([complex(*pose_of[by_time[t]].translation) for t in time_s.tolist()])
    return out


def shift_of(
    track: FlightTrack, paths: Mapping[int, tuple[np.ndarray, np.ndarray]], map_frame: MapFrame, trials_s: np.ndarray
) -> float | None:
    """Return by which trial a track is older than its flight's pictures, ``None`` where the motion does not tell."""
    if track.flight not in paths:
        return None
    time_s, path = paths[track.flight]
    return find_shift(time_s, path, _Places(track, map_frame), MODEL, trials_s)


def aligned(mission: Mission, frames: Sequence[FrameRef], shifts_s: Mapping[int, float]) -> tuple[FrameRef, ...]:
    """Return the frames with the places that their tracks have under these shifts."""
    out = tuple(frames)
    if shifts_s:
        for track in mission.tracks:
            if track.flight in shifts_s:
                out = placed_anew(out, track, shifts_s[track.flight])
    return out


def _trials_s() -> np.ndarray:
    """Shifts of up to a minute about every whole quarter hour within 14 h."""
    fine = np.arange(-REACH_S, REACH_S + STEP_S / 2.0, STEP_S)
    quarters = QUARTER_HOUR_S * np.arange(-MAX_QUARTERS, MAX_QUARTERS + 1)
    return (quarters[:, None] + fine).ravel()


class _Places:
    """A plan: the places of a track on the map at any time of its frames' clock."""

    def __init__(self, track: FlightTrack, map_frame: MapFrame) -> None:
        self._time_s = np.array([p.time_s for p in track.points])
        lats, lons = [p.fix.lat_deg for p in track.points], [p.fix.lon_deg for p in track.points]
        self._place = fix_to_map(map_frame, lats, lons) @ (1, 1j)
        self._hole = np.diff(self._time_s) > MAX_HOLE_S

    def __call__(self, when_s: np.ndarray) -> np.ndarray:
        """``(n,)`` x + iy in map metres; NaN where the track is silent."""
        if when_s[-1] < self._time_s[0] or when_s[0] > self._time_s[-1]:
            return np.full(len(when_s), complex(np.nan, np.nan))
        nan = complex(np.nan, np.nan)
        places = np.interp(when_s, self._time_s, self._place, left=nan, right=nan)
        if self._hole.any():
            before = np.clip(np.searchsorted(self._time_s, when_s, side="right") - 1, 0, len(self._hole) - 1)
            places[self._hole[before]] = nan
        return places
