"""From video files to footage: recordings, their telemetry, and which of their frames enter the map."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from statistics import median

import numpy as np

from photomap_gis.core.camera import Camera
from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import Flight, FlightTrack, Footage, FrameRef
from photomap_gis.ingest.decode import (
    FrameIndex,
    VideoInfo,
    frame_index,
    probe,
    read_video_frame,
    read_video_frames,
    video_frames,
)
from photomap_gis.ingest.kept_track import kept_track
from photomap_gis.ingest.lenses import LensFacts, camera_for
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.sampling import DEFAULT_RATE_HZ, choose_frames, sampling_rates
from photomap_gis.ingest.splits import group_splits
from photomap_gis.ingest.sync import Placed, place_frames
from photomap_gis.ingest.telemetry import TRACK_SUFFIXES, Clock, Track, TrackPoint, read_track
from photomap_gis.ingest.telemetry.media import find_embedded
from photomap_gis.ingest.video_lenses import choose_videos

__all__ = [
    "LaidFile",
    "VideoInfo",
    "frame_index",
    "laid_footage",
    "probe",
    "read_video_frame",
    "read_video_frames",
    "video_footage",
    "video_frames",
]

logger = logging.getLogger(__name__)

_PLAN_STEP_S = 0.5
"""How finely the track is looked at to choose the frames."""

_HFOV_STEP_RAD = math.radians(0.02)
_HFOV_SIGMA_REL = 0.03


@dataclass(frozen=True, slots=True)
class _Piece:
    """One file of a recording: ``base_s`` is its first frame's second of the whole recording."""

    info: VideoInfo
    index: FrameIndex
    base_s: float
    track: Track | None


@dataclass(frozen=True, slots=True)
class LaidFile:
    """A file of a recording that tells itself when its first frame was: seconds since the first file's, and Unix."""

    path: Path
    base_s: float
    start_utc_s: float | None


@dataclass(frozen=True, slots=True)
class _Clocks:
    """How one file's frames meet a track: what to add to their seconds, and when the camera says that zero was.

    ``length_s`` is how long lasts what the track accompanied, the file or the whole recording.
    """

    track: Track | None
    base_s: float
    start_utc_s: float | None
    length_s: float

    def place(self, times_s: Sequence[float], options: IngestOptions) -> Placed | None:
        """Place moments given in seconds since the file's first frame."""
        if self.track is None or not self.track.points:
            return None
        return place_frames(
            [self.base_s + t for t in times_s],
            self.track,
            start_utc_s=self.start_utc_s,
            options=options,
            length_s=self.length_s,
        )


@dataclass(slots=True)
class _Ledger:
    """What is collected while the recordings are gone through."""

    frames: list[FrameRef] = field(default_factory=list)
    flights: list[Flight] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    tracks: list[FlightTrack] = field(default_factory=list)


def video_footage(
    paths: Sequence[Path],
    options: IngestOptions | None = None,
    *,
    on_progress: Callable[[int, int], None] | None = None,
) -> Footage:
    """Return the footage of video files: split files joined to flights, telemetry found, frames chosen.

    Frames and flights are numbered from 0. A file that cannot be read is named in a warning and left out; ``DataError``
    where none is left. A video without telemetry gives frames without a fix, and a warning.
    """
    options = options or IngestOptions()
    ledger = _Ledger()
    infos = _probe_all(paths, ledger.warnings)
    forced = None if options.track is None else read_track(options.track, srt_order=options.srt_order)
    if forced is not None:
        ledger.warnings += forced.warnings
    done = 0
    infos, unused = choose_videos(infos, options.lens)
    ledger.warnings += unused
    recordings = group_splits(infos)
    if forced is not None and forced.clock is Clock.VIDEO and len(recordings) > 1:
        ledger.warnings.append(
            f"{forced.source}: counts the seconds of one video, but there are {len(recordings)}; it is laid on each"
        )
    unplaced: list[DataError] = []
    for recording in recordings:
        pieces = _pieces(recording, forced, options, ledger.warnings)
        if pieces:
            try:
                _add_flight(pieces, forced, options, ledger)
            except DataError as error:  # its log and its clock do not meet: the other recordings' may
                unplaced.append(error)
                ledger.warnings.append(f"left out: {error}")
        done += len(recording)
        if on_progress is not None:
            on_progress(done, len(infos))
    if not ledger.frames:
        raise unplaced[0] if unplaced else DataError(_nothing_usable(ledger.warnings))
    return Footage(
        tuple(ledger.frames), tuple(ledger.flights), tuple(dict.fromkeys(ledger.warnings)), tuple(ledger.tracks)
    )


def laid_footage(
    files: Sequence[LaidFile],
    options: IngestOptions,
    *,
    track: Track | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> Footage:
    """Return the footage of files that are one recording, whatever their names: their places in time are told.

    ``track`` is where no other is given. A file that cannot be read is named in a warning and left out; ``DataError``
    where none is left.
    """
    ledger = _Ledger()
    forced = track if options.track is None else read_track(options.track, srt_order=options.srt_order)
    if forced is not None:
        ledger.warnings += forced.warnings
    pieces: list[_Piece] = []
    for done, file in enumerate(files):
        try:
            info = replace(probe(file.path), start_utc_s=file.start_utc_s)
            index = frame_index(file.path)
        except DataError as error:
            ledger.warnings.append(f"left out: {error}")
            continue
        track = None if forced is not None else find_track(info, options, ledger.warnings)
        pieces.append(_Piece(info, index, file.base_s, track))
        if on_progress is not None:
            on_progress(done + 1, len(files))
    if not pieces:
        raise DataError(_nothing_usable(ledger.warnings))
    _add_flight(pieces, forced, options, ledger)
    return Footage(
        tuple(ledger.frames), tuple(ledger.flights), tuple(dict.fromkeys(ledger.warnings)), tuple(ledger.tracks)
    )


def _nothing_usable(warnings: Sequence[str]) -> str:
    reasons = [w.removeprefix("left out: ") for w in warnings if w.startswith("left out: ")]
    return reasons[0] if reasons else "no video holds a frame that can be used; give other files"


def find_track(info: VideoInfo, options: IngestOptions, warnings: list[str]) -> Track | None:
    """Return the telemetry beside a video (same stem, any case) or inside it, ``None`` where there is none."""
    for path in _beside(info.path):
        try:
            track = read_track(path, srt_order=options.srt_order)
        except DataError as error:
            warnings.append(f"{error}")
            continue
        warnings += track.warnings
        if track.points:
            return track
    if info.has_klv or info.has_subtitles or info.has_gopro_metadata:
        embedded = find_embedded(info.path, order=options.srt_order)
        if embedded is not None:
            warnings += embedded.warnings
            return embedded
    return None


def _beside(video: Path) -> list[Path]:
    """Return the possible telemetry files of a video, best first."""
    stems = {video.stem.lower(), video.name.lower()}
    try:
        found = [p for p in video.parent.iterdir() if p.stem.lower() in stems and p.suffix.lower() in TRACK_SUFFIXES]
    except OSError:
        return []
    return sorted((p for p in found if p.is_file()), key=lambda p: (TRACK_SUFFIXES.index(p.suffix.lower()), p.name))


def _probe_all(paths: Sequence[Path], warnings: list[str]) -> list[VideoInfo]:
    infos = []
    errors = []
    for path in paths:
        try:
            infos.append(probe(Path(path)))
        except DataError as error:
            errors.append(str(error))
    if not infos:
        raise DataError(errors[0] if errors else "no video was given; name a video file")
    warnings += [f"left out: {e}" for e in errors]
    return infos


def _pieces(
    recording: Sequence[VideoInfo], forced: Track | None, options: IngestOptions, warnings: list[str]
) -> list[_Piece]:
    """Open each file's index and telemetry; lay the files one behind the other."""
    pieces: list[_Piece] = []
    base_s = 0.0
    for info in recording:
        try:
            index = frame_index(info.path)
        except DataError as error:
            warnings.append(f"left out: {error}")
            continue
        track = None if forced is not None else find_track(info, options, warnings)
        if info.frame_count and len(index.pts) < 0.98 * info.frame_count:
            warnings.append(
                f"{info.path.name}: {len(index.pts)} of {info.frame_count} announced frames are there; "
                "the file was cut short, copy it again from the card"
            )
        pieces.append(_Piece(info, index, base_s, track))
        spacing_s = float(np.median(np.diff(index.times_s))) if len(index.pts) > 1 else 0.0
        base_s += float(index.times_s[-1]) + spacing_s
    return pieces


def _add_flight(pieces: Sequence[_Piece], forced: Track | None, options: IngestOptions, ledger: _Ledger) -> None:
    flight = len(ledger.flights)
    first = pieces[0].info
    shared = forced if forced is not None else pieces[0].track
    failures: list[DataError] = []
    placements: list[tuple[_Piece, list[int], Placed | None, float | None]] = []
    length_s = max(p.base_s + float(p.index.times_s[-1]) for p in pieces)
    for piece in pieces:
        # A file's own log counts from its first frame, one for the whole recording from the first file's.
        own = forced is None and piece.track is not None
        if own:
            clocks = _Clocks(piece.track, 0.0, piece.info.start_utc_s, float(piece.index.times_s[-1]))
        else:
            clocks = _Clocks(shared, piece.base_s, first.start_utc_s, length_s)
        try:
            numbers, placed = _sample(piece, clocks, options)
        except DataError as error:  # one piece may lie beyond the log; the others tell where the flight was
            failures.append(error)
            numbers, placed = _sample(piece, replace(clocks, track=None), options)
        if placed is not None:
            ledger.warnings += placed.warnings
        began_s = _began_utc_s(piece, numbers, placed, clocks, ledger.warnings)
        placements.append((piece, numbers, placed, began_s))
    if failures and all(placed is None for _, _, placed, _ in placements):
        raise failures[0]
    ledger.warnings += [str(f) for f in failures]
    if shared is None and all(p.track is None for p in pieces):
        ledger.warnings.append(
            f"{first.path.name}: no telemetry was found beside or inside this video, so its map has no place on Earth; "
            "give a log by --track FILE"
        )
    cameras: list[str] = []
    for piece, numbers, placed, began_s in placements:
        frames = _frames(piece, numbers, placed, began_s, flight, len(ledger.frames), options)
        ledger.frames += frames
        cameras += [f.camera.name for f in frames[:1] if f.camera is not None]
    _keep_track(ledger, flight, placements, shared)
    offsets = [placed.offset_s for _, _, placed, _ in placements if placed is not None]
    used = shared or next((p.track for p in pieces if p.track is not None), None)
    more = f" and {len(pieces) - 1} more" if len(pieces) > 1 else ""
    ledger.flights.append(
        Flight(
            flight,
            f"{first.path.stem}{more}",
            next((c for c in cameras if c), f"{first.make} {first.model}".strip()),
            kind="video",
            track_source=None if used is None else used.source,
            track_offset_s=offsets[0] if offsets else 0.0,
        )
    )


def _keep_track(
    ledger: _Ledger,
    flight: int,
    placements: Sequence[tuple[_Piece, list[int], Placed | None, float | None]],
    shared: Track | None,
) -> None:
    """Keep the track of a recording where all of its files share one, or where it is one file."""
    track = shared or (placements[0][0].track if len(placements) == 1 else None)
    if track is None or track.clock is Clock.VIDEO:  # the recording's own subtitles are on its own clock
        return
    frames = ledger.frames[len(ledger.frames) - sum(len(numbers) for _, numbers, _, _ in placements) :]
    points = [p for _, numbers, placed, _ in placements for p in (placed.points if placed else (None,) * len(numbers))]
    if len(placements) > 1 and any(f.time_s is None for f in frames):
        return  # each file counts from its own beginning
    kept = kept_track(track, flight, frames, points)
    if kept is not None:
        ledger.tracks.append(kept)


def _sample(piece: _Piece, clocks: _Clocks, options: IngestOptions) -> tuple[list[int], Placed | None]:
    """Choose the frames of one file and place them."""
    times_s = piece.index.times_s
    if options.frame_rate_hz is not None:
        numbers = choose_frames(times_s, options.frame_rate_hz)
    else:
        numbers = choose_frames(times_s, _rates_hz(piece, clocks, options))
    return numbers, clocks.place(times_s[numbers].tolist(), options)


def _rates_hz(piece: _Piece, clocks: _Clocks, options: IngestOptions) -> np.ndarray | float:
    """``(N,)`` sampling rate at every frame of a file."""
    times_s = piece.index.times_s
    plan_s = np.arange(0.0, float(times_s[-1]) + _PLAN_STEP_S, _PLAN_STEP_S)
    plan = clocks.place(plan_s.tolist(), options)
    if plan is None:
        return DEFAULT_RATE_HZ
    camera = _camera_of(piece.info, _median_focal_35mm(plan.points), options)
    aspect = piece.info.width_px / piece.info.height_px
    rates = sampling_rates(plan.points, plan_s, hfov_rad=camera.hfov_rad, aspect=aspect)
    return np.interp(times_s, plan_s, rates)


def _began_utc_s(
    piece: _Piece, numbers: Sequence[int], placed: Placed | None, clocks: _Clocks, warnings: list[str]
) -> float | None:
    """Return the Unix time of a file's first frame, as well as it is known: by a receiver's clock before a camera's."""
    track = clocks.track
    if placed is not None and placed.clock is Clock.UTC:
        times_s = piece.index.times_s
        began = [p.time_s - float(times_s[n]) for n, p in zip(numbers, placed.points, strict=True) if p is not None]
        if began:
            return median(began)
    if track is not None and track.clock is Clock.VIDEO and track.epoch_utc_s is not None:
        return track.epoch_utc_s + clocks.base_s
    if clocks.start_utc_s is not None:
        return clocks.start_utc_s + clocks.base_s
    if track is not None and track.clock is Clock.VIDEO and track.epoch_local_s is not None:
        warnings.append(f"{piece.info.path.name}: its times are local without a zone; they are taken for UTC")
        return track.epoch_local_s + clocks.base_s
    return None


def _frames(
    piece: _Piece,
    numbers: Sequence[int],
    placed: Placed | None,
    began_s: float | None,
    flight: int,
    first_index: int,
    options: IngestOptions,
) -> list[FrameRef]:
    info, times_s = piece.info, piece.index.times_s
    points = placed.points if placed is not None else (None,) * len(numbers)
    fixes = placed.fixes if placed is not None else (None,) * len(numbers)
    typical_focal = _median_focal_35mm(points)
    frames = []
    for i, (number, point, fix) in enumerate(zip(numbers, points, fixes, strict=True)):
        pts_s = float(times_s[number])
        time_s = None if began_s is None else began_s + pts_s
        frames.append(
            FrameRef(
                index=first_index + i,
                name=f"{info.path.stem}#{number:06d}",
                source=str(info.path),
                width_px=info.width_px,
                height_px=info.height_px,
                flight=flight,
                frame_number=number,
                pts_s=pts_s,
                time_s=time_s,
                fix=fix,
                attitude=point.attitude if point else None,
                height_m=point.height_m if point else None,
                camera=_camera_at(info, point, typical_focal, options),
            )
        )
    return frames


def _median_focal_35mm(points: Sequence[TrackPoint | None]) -> float | None:
    told = [p.focal_35mm for p in points if p is not None and p.focal_35mm is not None]
    return median(told) if told else None


def _camera_at(
    info: VideoInfo, point: TrackPoint | None, typical_focal_35mm: float | None, options: IngestOptions
) -> Camera:
    """Return the camera of one frame: a log may follow its zoom."""
    told = options.hfov_deg is not None or options.focal_35mm is not None
    if not told and point is not None and point.hfov_rad is not None:
        return _camera_of_hfov(info, round(point.hfov_rad / _HFOV_STEP_RAD) * _HFOV_STEP_RAD)
    focal = point.focal_35mm if point is not None and point.focal_35mm is not None else typical_focal_35mm
    return _camera_of(info, focal, options)


@lru_cache(maxsize=256)
def _camera_of_hfov(info: VideoInfo, hfov_rad: float) -> Camera:
    name = f"{info.make} {info.model}".strip()
    camera = Camera.of_hfov(info.width_px, info.height_px, hfov_rad, name=name, origin="telemetry")
    return replace(camera, focal_sigma_rel=_HFOV_SIGMA_REL)


@lru_cache(maxsize=256)
def _camera_of(info: VideoInfo, focal_35mm: float | None, options: IngestOptions) -> Camera:
    """Return the camera by the user's word, the log's equivalent focal length or the profile, in this order."""
    camera = camera_for(
        info.width_px,
        info.height_px,
        LensFacts(make=info.make, model=info.model, focal_35mm=focal_35mm),
        hfov_deg=options.hfov_deg,
        focal_35mm=options.focal_35mm,
        is_video=True,
    )
    if focal_35mm is not None and camera.origin == "exif 35 mm equivalent":
        return replace(camera, origin="telemetry 35 mm equivalent")
    return camera
