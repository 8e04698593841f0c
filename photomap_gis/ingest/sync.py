"""Bring a track's clock and a camera's together, and give every frame its place. Pure: values in, values out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import Attitude, GpsFix
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.resample import interpolate, reach_s
from photomap_gis.ingest.shots import match_shots
from photomap_gis.ingest.telemetry.track import Clock, Track, TrackPoint, Trigger

__all__ = ["Placed", "interpolate", "place_frames", "place_photos"]

_QUARTER_HOUR_S = 900.0
_MAX_QUARTERS = 14 * 4
_ENOUGH = 0.5
"""Share of frames inside the track above which the clocks are believed as they are."""

_SAME_DURATION_REL, _SAME_DURATION_S = 0.05, 5.0


@dataclass(frozen=True, slots=True)
class Placed:
    """What a track says of each frame, in the frames' order; ``None`` where it is silent.

    ``offset_s`` is what was added to the track's clock to reach the camera's. The points' own ``time_s`` are on
    ``clock``: where that is UTC they are a receiver's time, better than any camera's.
    """

    points: tuple[TrackPoint | None, ...]
    offset_s: float
    clock: Clock
    warnings: tuple[str, ...] = ()

    @property
    def fixes(self) -> tuple[GpsFix | None, ...]:
        """The positions."""
        return tuple(None if p is None else GpsFix(p.lat_deg, p.lon_deg, p.alt_m, p.sigma_m) for p in self.points)

    @property
    def attitudes(self) -> tuple[Attitude | None, ...]:
        """The camera's attitudes."""
        return tuple(p.attitude if p else None for p in self.points)

    @property
    def heights_m(self) -> tuple[float | None, ...]:
        """The heights above take-off or ground."""
        return tuple(p.height_m if p else None for p in self.points)


def place_frames(
    times_s: Sequence[float | None],
    track: Track,
    *,
    start_utc_s: float | None,
    options: IngestOptions,
    length_s: float | None = None,
) -> Placed:
    """Give frames their places on a track.

    ``times_s`` are seconds since the video's first frame, which was at ``start_utc_s`` by the camera's clock (``None``:
    unknown). For photos they are Unix seconds and ``start_utc_s`` is 0. Clocks of cameras stand in other time zones, so
    whole quarter hours are tried; ``options.track_offset_s`` overrides all search. For a camera whose start is unknown
    that offset counts from the video's start to the track's, and so does the one that is returned. ``length_s`` is how
    long the whole recording lasts where the frames are only a part of it. ``DataError`` where nothing overlaps.
    """
    if not track.points:
        return Placed((None,) * len(times_s), 0.0, track.clock, (f"{track.source}: holds no positions",))
    frames_s = np.array([math.nan if t is None else t for t in times_s], dtype=np.float64)
    forced = options.track_offset_s
    warnings: list[str] = []
    if track.clock is Clock.VIDEO and start_utc_s != 0.0:
        on_video = 0.0 if forced is None else forced
        return _placed(frames_s, track, on_video, on_video, warnings)
    if track.clock is Clock.VIDEO:
        track = _on_wall_clock(track)
    if start_utc_s is None or track.clock is Clock.BOOT:
        _check_lengths(frames_s, track, length_s, forced, warnings)
        # Photos tell Unix seconds; a video's seconds count from its beginning, also in a later piece of it.
        first_s = float(np.nanmin(frames_s)) if start_utc_s == 0.0 and np.isfinite(frames_s).any() else 0.0
        offset = forced or 0.0
        return _placed(frames_s, track, first_s - track.points[0].time_s + offset, offset, warnings)
    camera_s = frames_s + start_utc_s
    if forced is not None:
        return _placed(camera_s, track, forced, forced, warnings)
    zone_s = _quarter_hours(camera_s, track)
    if zone_s is None:
        if start_utc_s == 0.0 or not _same_length(frames_s, track, length_s):
            raise DataError(_no_overlap(camera_s, track))
        _check_lengths(frames_s, track, length_s, forced, warnings)
        zone_s = start_utc_s - track.points[0].time_s
    elif zone_s:
        warnings.append(
            f"{track.source}: the camera's clock is taken to be {zone_s / 3600.0:+g} h from the track's; "
            "--track-offset SECONDS sets it"
        )
    return _placed(camera_s, track, zone_s, zone_s, warnings)


def place_photos(times_s: Sequence[float | None], track: Track, *, options: IngestOptions) -> Placed:
    """Give photos (Unix seconds, in the order in which they were taken) their places.

    Where the log holds the camera's shots they are matched to the photos first: a shot's moment is known to
    milliseconds, a photo's often to a second.
    """
    if track.triggers and options.track_offset_s is None:
        matched = match_shots(times_s, [t.time_s for t in track.triggers])
        if matched is not None:
            return _placed_by_shots(times_s, track, matched)
    if all(t is None for t in times_s):
        raise DataError(
            f"{track.source}: the photos tell no time and the log holds no equal number of shots; "
            "give photos with EXIF times"
        )
    placed = place_frames(times_s, track, start_utc_s=0.0, options=options)
    if track.triggers and options.track_offset_s is None:
        said = f"{track.source}: the photos' intervals do not clearly fit the log's shots, so the clocks are believed"
        placed = replace(placed, warnings=(*placed.warnings, said))
    return placed


def _placed_by_shots(times_s: Sequence[float | None], track: Track, matched: list[int | None]) -> Placed:
    shots = [None if m is None else track.triggers[m] for m in matched]
    moments = [s.time_s for s in shots if s is not None]
    by_track = iter(interpolate(track, moments))
    points = [None if s is None else _point_of_shot(s, next(by_track)) for s in shots]
    differences = [t - s.time_s for t, s in zip(times_s, shots, strict=True) if t is not None and s is not None]
    offset = float(np.median(differences)) if differences else 0.0
    warnings = []
    missing = sum(s is None for s in shots)
    if missing:
        warnings.append(f"{track.source}: {missing} of {len(shots)} photos meet no shot of the log")
    if not differences:
        warnings.append(f"{track.source}: the photos tell no time; shots are given to them by their order")
    return Placed(tuple(points), offset, track.clock, tuple(warnings))


def _point_of_shot(shot: Trigger, here: TrackPoint | None) -> TrackPoint | None:
    """Join what the shot's own record tells with the track at its moment."""
    if shot.lat_deg is None or shot.lon_deg is None:
        return here
    own = TrackPoint(shot.time_s, shot.lat_deg, shot.lon_deg, shot.alt_m, shot.height_m, shot.attitude)
    if here is None:
        return own
    # A gimbal's attitude, which only the track knows, is better than the vehicle's in the shot.
    attitude = shot.attitude
    if here.attitude is not None and (attitude is None or here.attitude.sigma_tilt_rad < attitude.sigma_tilt_rad):
        attitude = here.attitude
    return replace(
        own,
        alt_m=own.alt_m if own.alt_m is not None else here.alt_m,
        height_m=own.height_m if own.height_m is not None else here.height_m,
        attitude=attitude,
        sigma_m=here.sigma_m,
        hfov_rad=here.hfov_rad,
        focal_35mm=here.focal_35mm,
    )


def _on_wall_clock(track: Track) -> Track:
    """Return a video's track on the wall clock that it tells, for photos that were taken meanwhile."""
    epoch = track.epoch_utc_s if track.epoch_utc_s is not None else track.epoch_local_s
    if epoch is None:
        return replace(track, clock=Clock.BOOT)
    return replace(
        track,
        points=tuple(replace(p, time_s=p.time_s + epoch) for p in track.points),
        triggers=tuple(replace(t, time_s=t.time_s + epoch) for t in track.triggers),
        clock=Clock.UTC if track.epoch_utc_s is not None else Clock.LOCAL,
    )


def _check_lengths(
    frames_s: np.ndarray, track: Track, length_s: float | None, forced: float | None, warnings: list[str]
) -> None:
    """Let track and recording begin together where they last equally long, the last resort, and say so."""
    if forced is not None:
        return
    if not _same_length(frames_s, track, length_s):
        raise DataError(
            f"{track.source}: its clock and the camera's have nothing in common, and the track lasts "
            f"{_length_s(track):.0f} s but the frames {_frames_length_s(frames_s, length_s):.0f} s; tell how many "
            "seconds after the first frame the track begins (negative: before it) by --track-offset SECONDS"
        )
    warnings.append(
        f"{track.source}: its clock and the camera's have nothing in common; both are taken to begin together "
        "(they last equally long); --track-offset SECONDS moves the track"
    )


def _placed(camera_s: np.ndarray, track: Track, offset: float, reported: float, warnings: list[str]) -> Placed:
    """Look the frames up in the track under an offset; count those without a place."""
    at_s = camera_s - offset
    timed = np.flatnonzero(np.isfinite(at_s))
    points: list[TrackPoint | None] = [None] * len(at_s)
    for i, p in zip(timed.tolist(), interpolate(track, at_s[timed].tolist()), strict=True):
        points[i] = p
    found = sum(p is not None for p in points)
    if found == 0 and len(points):
        raise DataError(_no_overlap(camera_s, track))
    if found < len(points):
        warnings.append(f"{track.source}: {len(points) - found} of {len(points)} frames lie outside the track")
    return Placed(tuple(points), reported, track.clock, tuple(warnings))


def _quarter_hours(camera_s: np.ndarray, track: Track) -> float | None:
    """Return the whole quarter hours that bring the camera's clock over the track's; ``None`` where none do."""
    at = _share_inside(camera_s, track, 0.0)
    shares = {
        k * _QUARTER_HOUR_S: _share_inside(camera_s, track, k * _QUARTER_HOUR_S)
        for k in range(-_MAX_QUARTERS, _MAX_QUARTERS + 1)
    }
    best = max(shares.values())
    if best == 0.0:
        return None
    if at >= _ENOUGH or best < 2.0 * at:
        return 0.0
    # Whole hours are likelier than quarters, near ones likelier than far ones.
    good = [offset for offset, share in shares.items() if share >= 0.95 * best]
    return min(good, key=lambda offset: (abs(offset) * (1.0 if offset % 3600.0 == 0.0 else 4.0), -offset))


def _share_inside(camera_s: np.ndarray, track: Track, offset: float) -> float:
    finite = camera_s[np.isfinite(camera_s)]
    if not len(finite):
        return 0.0
    reach = reach_s(np.array([p.time_s for p in track.points[:1000]]))
    low, high = track.points[0].time_s - reach + offset, track.points[-1].time_s + reach + offset
    return float(np.mean((finite >= low) & (finite <= high)))


def _length_s(track: Track) -> float:
    return track.points[-1].time_s - track.points[0].time_s


def _frames_length_s(frames_s: np.ndarray, length_s: float | None) -> float:
    if length_s is not None:
        return length_s
    return float(np.nanmax(frames_s) - np.nanmin(frames_s)) if np.isfinite(frames_s).any() else 0.0


def _same_length(frames_s: np.ndarray, track: Track, length_s: float | None) -> bool:
    frames = _frames_length_s(frames_s, length_s)
    return abs(frames - _length_s(track)) <= max(_SAME_DURATION_S, _SAME_DURATION_REL * frames)


def _no_overlap(camera_s: np.ndarray, track: Track) -> str:
    finite = camera_s[np.isfinite(camera_s)]
    away = track.points[0].time_s - float(finite.min()) if len(finite) else 0.0
    return (
        f"{track.source}: the track and the frames have no moment in common (the track begins {away:+.0f} s from the "
        "first frame); give the seconds to add to the track's clock: --track-offset SECONDS"
    )
