"""A track that comes after the pictures: given to the flights of a mission that have no positions, by their motion.

A stream that was recorded on the ground and the log of the drone's card begin at different moments, and clocks are
off. So the path of the pictures, which needs no positions, is laid on the track at every time at which they can have
been flown together; where it fits clearly better than anywhere else, the frames get their places. Nothing that was
registered hangs on positions.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.frame import Flight, FlightTrack, FrameRef, GpsFix, TrackFix
from photomap_gis.core.grid import MapFrame
from photomap_gis.georef import choose_map_frame
from photomap_gis.ingest.kept_track import frame_time_s, placed_anew
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.sync import place_frames
from photomap_gis.ingest.telemetry import TRACK_SUFFIXES, Clock, Track, TrackPoint, read_track
from photomap_gis.pipeline.align import sequential_paths, shift_of
from photomap_gis.pipeline.measure import Measurements
from photomap_gis.pipeline.prepare import SpectrumShelf
from photomap_gis.pipeline.settings import MapSettings, Progress
from photomap_gis.store import Mission

logger = logging.getLogger(__name__)

STEP_S = 0.5
MOST_TRIALS = 40_000
MIN_STEP_S = 0.1
MOST_POINTS = 50_000
MIN_FRAMES = 12
NO_PLACE = ("no telemetry was found", "no positions: the map is relative")
"""How warnings begin (behind a file's name) that a track makes void."""


@dataclass(frozen=True, slots=True)
class _Laid:
    """A track on a flight's clock: ``to_frames_s`` was added to its own. ``is_sure``: the clocks say so themselves."""

    track: FlightTrack
    to_frames_s: float
    is_sure: bool


def split_tracks(sources: Sequence[str | Path]) -> tuple[list[str | Path], list[Path]]:
    """Return the sources that hold pictures, and those that are tracks."""
    tracks = [Path(s) for s in sources if Path(s).suffix.lower() in TRACK_SUFFIXES and Path(s).is_file()]
    return [s for s in sources if Path(s) not in tracks], tracks


def add_track(mission: Mission, path: Path, settings: MapSettings, on_progress: Progress) -> tuple[str, ...]:
    """Give a mission's flights without positions their places by a track, and return what the user should know.

    Where all flights have positions, a track takes their place in the one flight, or in the one of its name. Raises
    ``DataError`` where the track is none, ``UsageError`` where it cannot be told which flight it is of.
    """
    track = read_track(path, srt_order=settings.ingest.srt_order)
    if not track.points:
        raise DataError(f"{path}: holds no positions; give another log")
    targets = _targets(list(mission.frames), list(mission.flights), path)
    lent = _lend(mission, track, targets, settings, on_progress, may_guess=True)
    if not lent:
        raise DataError(
            f"{path}: fits no flight of this mission: neither clocks nor motion tell when it was flown; "
            "--track-offset SECONDS (from the first frame to the track's beginning) sets it"
        )
    return (*track.warnings, *lent)


def lend_positions(
    mission: Mission, donors: Sequence[Flight], settings: MapSettings, on_progress: Progress
) -> tuple[str, ...]:
    """Give flights without positions those of flights that were added, where clocks or motion say that they are one.

    So the card's file gives the stream that was recorded on the ground its place. What does not clearly fit stays as
    it was.
    """
    said: list[str] = []
    for donor in donors:
        frames = list(mission.frames)
        targets = [
            f for f in mission.flights
            if f.id not in {d.id for d in donors} and not any(r.fix is not None for r in frames if r.flight == f.id)
        ]  # fmt: skip
        track = _track_of(donor, [f for f in frames if f.flight == donor.id])
        if targets and track is not None:
            said += _lend(mission, track, targets, settings, on_progress, may_guess=False)
    return tuple(said)


def _track_of(flight: Flight, frames: Sequence[FrameRef]) -> Track | None:
    """Return where a flight's frames were as a track of its own."""
    rows = sorted(
        (when, f.fix, f.height_m) for f in frames if f.fix is not None and (when := frame_time_s(f)) is not None
    ) if len({frame_time_s(f) for f in frames}) == len(frames) else []  # fmt: skip
    if len(rows) < MIN_FRAMES:
        return None
    has_utc = all(f.time_s is not None for f in frames)
    points = tuple(
        TrackPoint(when, fix.lat_deg, fix.lon_deg, fix.alt_m, height_m, sigma_m=fix.sigma_m)
        for when, fix, height_m in rows
    )
    return Track(points, Clock.UTC if has_utc else Clock.BOOT, flight.name)


def _lend(
    mission: Mission,
    track: Track,
    targets: Sequence[Flight],
    settings: MapSettings,
    on_progress: Progress,
    *,
    may_guess: bool,
) -> tuple[str, ...]:
    """Give flights their places by a track and keep that; return what is to be told, nothing where it fits none.

    ``may_guess``: a lone flight of which neither clocks nor motion tell begins with the track.
    """
    name = Path(track.source).name
    frames, flights = list(mission.frames), list(mission.flights)
    map_frame = mission.header.map_frame
    if map_frame.crs_wkt is None:
        map_frame = choose_map_frame([GpsFix(p.lat_deg, p.lon_deg) for p in track.points], settings.crs)
    fitting = []
    for flight in targets:
        laid = _lay(track, [f for f in frames if f.flight == flight.id], flight.id, settings.ingest)
        if laid is not None:
            fitting.append((flight, laid))
    kept = {t.flight: t for t in mission.tracks}
    places = _search(mission, [laid for _, laid in fitting], map_frame, settings, on_progress)
    told: dict[int, str] = {}
    guesses = []
    for flight, laid in fitting:
        shift_s = places.get(flight.id, 0.0)
        if flight.id not in places and not laid.is_sure:
            if not may_guess or len(fitting) > 1:
                continue  # of several flights it is that of which the motion speaks
            guesses.append(
                f"{name}: the motion of {flight.name} does not tell when this track was flown: both are taken to "
                "begin together; check the map, --track-offset SECONDS sets it"
            )
        moved = replace(laid.track, points=tuple(replace(p, time_s=p.time_s - shift_s) for p in laid.track.points))
        placed = placed_anew(frames, moved, 0.0)
        count = sum(p.fix is not None for p in placed if p.flight == flight.id)
        if not count:
            continue
        # How a picture was levelled is what its registrations were made with: that stays.
        frames = [
            replace(p, attitude=f.attitude) if p.flight == flight.id else f for f, p in zip(frames, placed, strict=True)
        ]
        kept[flight.id] = moved
        total = sum(f.flight == flight.id for f in frames)
        times_s = [t for f in frames if f.flight == flight.id and (t := frame_time_s(f)) is not None]
        begins_s = moved.points[0].time_s - min(times_s)
        told[flight.id] = (
            f"{name}: gives {count} of the {total} frames of {flight.name} their places; the track begins "
            f"{abs(begins_s):.1f} s {'after' if begins_s >= 0 else 'before'} the first of them"
        )
    if not told:
        return ()
    source = track.source if Path(track.source).name == track.source else str(Path(track.source).absolute())
    mission.flights.replace(replace(f, track_source=source) if f.id in told else f for f in flights)
    mission.tracks.replace(kept[k] for k in sorted(kept))
    mission.frames.replace(frames)
    names = {f.name for f in flights if f.id in told}
    before = [w for w in mission.header.warnings if not _is_void(w, names)]
    said = (*guesses, *told.values())
    warnings = tuple(dict.fromkeys([*before, *track.warnings, *said]))
    mission.save_header(replace(mission.header, map_frame=map_frame, warnings=warnings))
    return said


def _targets(frames: Sequence[FrameRef], flights: Sequence[Flight], path: Path) -> list[Flight]:
    """Return the flights that the track can be of."""
    named = [f for f in flights if f.name.lower() == path.stem.lower()]
    without = [f for f in flights if not any(r.fix is not None for r in frames if r.flight == f.id)]
    chosen = [f for f in named if f in without] or without or named or (list(flights) if len(flights) == 1 else [])
    if not chosen:
        raise UsageError(
            f"{path}: all flights of this mission have positions ({', '.join(f.name for f in flights[:5])}); "
            "a track of one of their names would take the place of that flight's"
        )
    return chosen


def _lay(track: Track, frames: Sequence[FrameRef], flight: int, options: IngestOptions) -> _Laid | None:
    """Lay a track on a flight's clock: by the clocks where these meet, else so that both begin together."""
    times_s = [t for f in frames if (t := frame_time_s(f)) is not None]
    if not times_s:
        return None
    has_utc = all(f.time_s is not None for f in frames)
    start_s = min(times_s)
    forced_s = options.track_offset_s
    if forced_s is None and has_utc and track.clock in (Clock.UTC, Clock.LOCAL):
        try:
            placed = place_frames(times_s, track, start_utc_s=0.0, options=options)
            apart = [t - p.time_s for t, p in zip(times_s, placed.points, strict=True) if p is not None]
            if len(apart) > len(times_s) / 2:
                return _Laid(_kept(track, flight, median(apart)), median(apart), is_sure=True)
        except DataError as error:
            logger.info("%s", error)
    to_frames_s = start_s - track.points[0].time_s + (forced_s or 0.0)
    return _Laid(_kept(track, flight, to_frames_s), to_frames_s, is_sure=forced_s is not None)


def _kept(track: Track, flight: int, to_frames_s: float) -> FlightTrack:
    """Return a track as a mission keeps it, on its frames' clock."""
    points = track.points
    step_s = max(MIN_STEP_S, (points[-1].time_s - points[0].time_s) / MOST_POINTS)
    rows: list[TrackFix] = []
    for p in points:
        if not rows or p.time_s + to_frames_s - rows[-1].time_s >= step_s - 1e-6:
            fix = GpsFix(p.lat_deg, p.lon_deg, p.alt_m, p.sigma_m)
            rows.append(TrackFix(p.time_s + to_frames_s, fix, p.height_m, p.attitude))
    return FlightTrack(flight, tuple(rows))


def _search(
    mission: Mission, laid: Sequence[_Laid], map_frame: MapFrame, settings: MapSettings, on_progress: Progress
) -> dict[int, float]:
    """Return by flight by how much its track must be moved, where the clocks do not tell and the motion does."""
    unsure = [k for k in laid if not k.is_sure]
    prepared = {p.frame: p for p in mission.prepared}
    wanted = {k.track.flight for k in unsure}
    frames = [f for f in mission.frames if f.flight in wanted]
    if not unsure or any(f.index not in prepared for f in frames):
        return {}
    measurements = Measurements(mission, SpectrumShelf(mission), prepared, settings, on_progress)
    measurements.take_kept()
    indices = {f.index for f in frames}
    chain = [r for r in measurements.accepted if r.a in indices and r.b in indices]
    paths = sequential_paths(frames, chain, prepared)
    found = {}
    for one in unsure:
        flight = one.track.flight
        if flight not in paths:
            continue
        times_s, points = paths[flight][0], one.track.points
        first_s, last_s = points[0].time_s - float(times_s[-1]), points[-1].time_s - float(times_s[0])
        step_s = max(STEP_S, (last_s - first_s) / MOST_TRIALS)
        shift_s = shift_of(one.track, paths, map_frame, np.arange(first_s, last_s + step_s, step_s))
        if shift_s is not None:
            found[flight] = shift_s
    return found


def _is_void(warning: str, names: set[str]) -> bool:
    """Whether a warning told of the lack that the track mends."""
    if warning.startswith(NO_PLACE[1]):
        return True
    file, _, words = warning.partition(": ")
    return words.startswith(NO_PLACE[0]) and Path(file).stem in names
