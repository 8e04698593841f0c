"""What is kept of a track beside the frames, and frames placed by it anew when their clocks prove apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from photomap_gis.core.frame import FlightTrack, FrameRef, GpsFix, TrackFix
from photomap_gis.ingest.resample import interpolate
from photomap_gis.ingest.telemetry.track import Clock, Track, TrackPoint

MIN_STEP_S = 0.1
"""Records nearer in time than this add nothing: the path between them is straight."""
MAX_POINTS = 50_000
ONE_CLOCK_S = 0.5
"""Frames that differ by more from their track's clock do not share one (their shots were matched one by one)."""


def kept_track(
    track: Track, flight: int, frames: Sequence[FrameRef], points: Sequence[TrackPoint | None]
) -> FlightTrack | None:
    """Return what to keep of the track that gave ``frames`` the places ``points``; ``None`` without a common clock."""
    apart = [
        when - p.time_s
        for f, p in zip(frames, points, strict=True)
        if p is not None and (when := frame_time_s(f)) is not None
    ]
    if not apart or max(apart) - min(apart) > ONE_CLOCK_S or not track.points:
        return None
    to_frames_s = float(np.median(apart))
    step = max(MIN_STEP_S, (track.points[-1].time_s - track.points[0].time_s) / MAX_POINTS)
    rows: list[TrackFix] = []
    for p in track.points:
        if not rows or p.time_s + to_frames_s - rows[-1].time_s >= step - 1e-6:
            fix = GpsFix(p.lat_deg, p.lon_deg, p.alt_m, p.sigma_m)
            rows.append(TrackFix(p.time_s + to_frames_s, fix, p.height_m, p.attitude))
    return FlightTrack(flight, tuple(rows))


def placed_anew(frames: Sequence[FrameRef], kept: FlightTrack, lag_s: float) -> tuple[FrameRef, ...]:
    """Return the frames with the places that the track has ``lag_s`` later than their own times.

    Frames of other flights stay as they are. A video's attitudes come from its track and move along; a photo has its
    own. Where the track is silent at the new moment, a frame has no fix.
    """
    track = Track(
        tuple(
            TrackPoint(
                p.time_s, p.fix.lat_deg, p.fix.lon_deg, p.fix.alt_m, p.height_m, p.attitude, p.fix.sigma_m
            )
            for p in kept.points
        ),
        Clock.UTC,
        "kept track",
    )  # fmt: skip
    timed = [
        (k, when) for k, f in enumerate(frames) if f.flight == kept.flight and (when := frame_time_s(f)) is not None
    ]
    out = list(frames)
    for (k, _), point in zip(timed, interpolate(track, [when + lag_s for _, when in timed]), strict=True):
        out[k] = _moved(out[k], point)
    return tuple(out)


def frame_time_s(frame: FrameRef) -> float | None:
    """Return a frame's moment on its flight's clock."""
    return frame.time_s if frame.time_s is not None else frame.pts_s


def _moved(frame: FrameRef, point: TrackPoint | None) -> FrameRef:
    if point is None:
        return replace(frame, fix=None)
    is_video = frame.frame_number is not None
    return replace(
        frame,
        fix=GpsFix(point.lat_deg, point.lon_deg, point.alt_m, point.sigma_m),
        height_m=point.height_m if point.height_m is not None and point.height_m > 0.0 else frame.height_m,
        attitude=point.attitude if is_video and point.attitude is not None else frame.attitude,
    )
