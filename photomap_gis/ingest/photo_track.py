"""Photos and a telemetry log that the user names: the log's places are laid on the photos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from photomap_gis.core.camera import Camera
from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import Attitude, Flight, FlightTrack, Footage, FrameRef, GpsFix
from photomap_gis.ingest.kept_track import kept_track
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.sync import Placed, place_photos
from photomap_gis.ingest.telemetry.read import read_track
from photomap_gis.ingest.telemetry.track import Track, TrackPoint


def place_by_track(footage: Footage, options: IngestOptions) -> Footage:
    """Return the footage with the places that ``options.track`` gives; where it is silent a photo keeps its own.

    All photos share one clock at first; where that fails each flight is tried alone. Raises ``DataError`` where no
    flight overlaps the track.
    """
    if options.track is None:
        return footage
    track = read_track(options.track, srt_order=options.srt_order)
    by_flight: dict[int, list[int]] = {flight.id: [] for flight in footage.flights}
    for position, frame in enumerate(footage.frames):
        by_flight[frame.flight].append(position)
    placed, warnings = _place(footage, list(by_flight.values()), track, options)
    frames = list(footage.frames)
    flights = list(footage.flights)
    for positions, part in placed:
        for position, point in zip(positions, part.points, strict=True):
            frames[position] = _with_point(frames[position], point)
        reached = {frames[p].flight for p, point in zip(positions, part.points, strict=True) if point is not None}
        flights = [_with_track(f, track, part.offset_s) if f.id in reached else f for f in flights]
    tracks = [
        kept
        for positions, part in placed
        for flight in dict.fromkeys(footage.frames[p].flight for p in positions)
        if (kept := _kept(track, flight, positions, part, footage)) is not None
    ]
    said = (*footage.warnings, *dict.fromkeys(warnings))
    return Footage(tuple(frames), tuple(flights), said, (*footage.tracks, *tracks))


def _kept(track: Track, flight: int, positions: Sequence[int], part: Placed, footage: Footage) -> FlightTrack | None:
    """Return what is kept of the track for one flight."""
    frames = [footage.frames[p] for p in positions]
    own = [(f, q) for f, q in zip(frames, part.points, strict=True) if f.flight == flight]
    return kept_track(track, flight, [f for f, _ in own], [q for _, q in own])


def _place(
    footage: Footage, flights: Sequence[list[int]], track: Track, options: IngestOptions
) -> tuple[list[tuple[list[int], Placed]], list[str]]:
    times = [f.time_s for f in footage.frames]
    everything = [p for positions in flights for p in positions]
    warnings = list(track.warnings)
    try:
        whole = place_photos([times[p] for p in everything], track, options=options)
    except DataError as error:
        if len(flights) < 2:
            raise
        why = error
    else:
        return [(everything, whole)], [*warnings, *whole.warnings]
    placed = []
    for positions in flights:
        try:
            part = place_photos([times[p] for p in positions], track, options=options)
        except DataError as error:
            warnings.append(str(error))
        else:
            placed.append((positions, part))
            warnings += part.warnings
    if not placed:
        raise why
    return placed, warnings


def _with_track(flight: Flight, track: Track, offset_s: float) -> Flight:
    return replace(flight, track_source=track.source, track_offset_s=offset_s)


def _with_point(frame: FrameRef, point: TrackPoint | None) -> FrameRef:
    if point is None:
        return frame
    return replace(
        frame,
        fix=GpsFix(point.lat_deg, point.lon_deg, point.alt_m, point.sigma_m),
        attitude=_better(frame.attitude, point.attitude),
        height_m=point.height_m if point.height_m is not None and point.height_m > 0.0 else frame.height_m,
        camera=_lens(frame.camera, point),
    )


def _better(own: Attitude | None, logged: Attitude | None) -> Attitude | None:
    """A gimbal's angles in the photo are better than the body's in the log."""
    if own is None or logged is None:
        return logged or own
    return own if own.sigma_tilt_rad <= logged.sigma_tilt_rad else logged


def _lens(camera: Camera | None, point: TrackPoint) -> Camera | None:
    """A lens of which the photo says nothing may be known to the log."""
    if camera is None or camera.focal_px is not None or point.hfov_rad is None:
        return camera
    return Camera.of_hfov(camera.width_px, camera.height_px, point.hfov_rad, name=camera.name, origin="track")
