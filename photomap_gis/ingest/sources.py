"""Sources: what the user names (folders, globs, photos, videos) becomes footage, and its frames become pixels."""

from __future__ import annotations

import glob
import logging
import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np

from photomap_gis.core.errors import DataError, FrameReadError
from photomap_gis.core.frame import Flight, FlightTrack, Footage, Frame, FrameRef
from photomap_gis.ingest.box_files import is_recording
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.photo_flights import natural_key
from photomap_gis.ingest.photos import photo_footage
from photomap_gis.ingest.recording_footage import recording_footage
from photomap_gis.ingest.stills import PHOTO_SUFFIXES, RAW_SUFFIXES, read_photo

logger = logging.getLogger(__name__)

VIDEO_SUFFIXES = frozenset({".mp4", ".mov", ".m4v", ".avi", ".mkv", ".ts", ".mts", ".m2ts", ".mpg", ".mpeg", ".webm"})
MISSION_MARK = "mission.json"  # a mission's own tiles and maps are no photos
_LOG_SUFFIXES = frozenset({".gpx", ".csv", ".tlog", ".bin", ".ulg", ".klv", ".srt"})
_FEW_PHOTOS = 3


@dataclass(frozen=True, slots=True)
class FoundFiles:
    """The files that the sources hold, in order, each once; and what the user should know."""

    photos: tuple[Path, ...]
    videos: tuple[Path, ...]
    warnings: tuple[str, ...] = ()
    recordings: tuple[Path, ...] = ()


def open_sources(
    sources: Sequence[Path | str],
    options: IngestOptions | None = None,
    *,
    first_index: int = 0,
    first_flight: int = 0,
    on_progress: Callable[[int, int], None] | None = None,
) -> Footage:
    """Return the footage of all sources: frames numbered from ``first_index`` in order of flight and time.

    A source is a folder (with its subfolders), a glob, a photo or a video. Flights are numbered from ``first_flight``
    in order of time. Raises ``DataError`` where a source is missing or nothing can be used, ``UsageError`` where an
    option makes no sense.
    """
    options = options or IngestOptions()
    found = find_files(sources)
    parts: list[Footage] = []
    if found.photos:
        part = photo_footage(found.photos, options, on_progress=on_progress)
        if options.track is not None:
            from photomap_gis.ingest.photo_track import place_by_track

            part = place_by_track(part, options)
        parts.append(_hint_at_logs(part))
    if found.videos:
        from photomap_gis.ingest.video import video_footage  # PyAV loads slowly, and photos do not need it

        parts.append(video_footage(found.videos, options, on_progress=on_progress))
    parts += [recording_footage(r, options, on_progress=on_progress) for r in found.recordings]
    return _renumber(parts, found.warnings, first_index, first_flight)


def _renumber(parts: Sequence[Footage], warnings: Sequence[str], first_index: int, first_flight: int) -> Footage:
    """Join the parts: flights in order of time (unknown ones last), each with its frames in their order."""
    flown: list[tuple[float, Flight, list[FrameRef], list[FlightTrack]]] = []
    for part in parts:
        for flight in part.flights:
            members = [f for f in part.frames if f.flight == flight.id]
            start = min((f.time_s for f in members if f.time_s is not None), default=math.inf)
            flown.append((start, flight, members, [t for t in part.tracks if t.flight == flight.id]))
    frames: list[FrameRef] = []
    flights: list[Flight] = []
    tracks: list[FlightTrack] = []
    for _, flight, members, kept in sorted(flown, key=lambda f: f[0]):
        flights.append(replace(flight, id=first_flight + len(flights)))
        tracks += [replace(t, flight=flights[-1].id) for t in kept]
        frames += [
            replace(frame, index=first_index + len(frames) + i, flight=flights[-1].id)
            for i, frame in enumerate(members)
        ]
    said = (*warnings, *(w for part in parts for w in part.warnings))
    return Footage(tuple(frames), tuple(flights), tuple(dict.fromkeys(said)), tuple(tracks))


def _hint_at_logs(part: Footage) -> Footage:
    """Tell of telemetry that lies beside photos without positions: photos do not name their log, so the user must."""
    if any(f.fix is not None for f in part.frames):
        return part
    folders = {Path(f.source).parent for f in part.frames}
    logs = [p for folder in folders for p in folder.iterdir() if p.suffix.lower() in _LOG_SUFFIXES]
    if not logs:
        return part
    hint = f"the photos have no positions, but {min(logs).name} lies beside them: --track {min(logs)} uses it"
    return replace(part, warnings=(*part.warnings, hint))


def find_files(sources: Sequence[Path | str]) -> FoundFiles:
    """Return the photo and video files of the sources.

    In a folder, photos are what is wanted where there are several, and videos where there are none: the others are
    named in a warning. What is named itself (a file, a glob) is used. Raises ``DataError`` naming what to do.
    """
    if not sources:
        raise DataError("no source given: name a folder of photos, photos or a video")
    photos: dict[Path, Path] = {}
    videos: dict[Path, Path] = {}
    warnings: list[str] = []
    recordings: list[Path] = []
    repeated = 0
    for source in sources:
        here = _expand(str(source))
        recordings += [r for r in here.recordings if r not in recordings]
        named_photos, named_videos = here.photos, here.videos
        warnings += here.warnings
        for path, into in [(p, photos) for p in named_photos] + [(p, videos) for p in named_videos]:
            key = path.resolve()
            repeated += key in into
            # absolute, as a mission is resumed from anywhere; a link keeps its own name
            into.setdefault(key, path.parent.resolve() / path.name)
    if repeated:
        many = "s were" if repeated > 1 else " was"
        warnings.append(f"{repeated} file{many} named more than once: each is used once")
    return FoundFiles(tuple(photos.values()), tuple(videos.values()), tuple(warnings), tuple(recordings))


def _expand(source: str) -> FoundFiles:
    path = Path(source).expanduser()
    if path.is_dir() and is_recording(path):
        return FoundFiles((), (), recordings=(path.resolve(),))
    if path.is_dir():
        return _search_folder(path)
    if path.is_file():
        return _sort_out([path], source, is_named=True)
    if glob.has_magic(source):
        matches = [Path(m) for m in glob.iglob(str(path), recursive=True)]  # noqa: PTH207 - patterns may be absolute
        files = [m for m in matches if m.is_file()]
        folders = [_search_folder(m) for m in sorted(matches, key=natural_key) if m.is_dir()] if not files else []
        if folders:
            return FoundFiles(
                tuple(p for f in folders for p in f.photos),
                tuple(v for f in folders for v in f.videos),
                tuple(w for f in folders for w in f.warnings),
            )
        if not files:
            raise DataError(f"nothing matches {source}: check the pattern and the folder")
        return _sort_out(files, source, is_named=False)
    raise DataError(f"no such file or folder: {source}: check the name")


def _sort_out(files: Sequence[Path], source: str, *, is_named: bool) -> FoundFiles:
    ordered = sorted(files, key=natural_key)
    photos = tuple(f for f in ordered if f.suffix.lower() in PHOTO_SUFFIXES)
    videos = tuple(f for f in ordered if f.suffix.lower() in VIDEO_SUFFIXES)
    if photos or videos:
        return FoundFiles(photos, videos)
    if any(f.suffix.lower() in RAW_SUFFIXES for f in files):
        raise DataError(f"{source}: raw photos are not read: export them as JPEG or TIFF")
    if is_named:
        raise DataError(f"{source} is no photo or video that can be read: name photos (JPEG, TIFF, PNG) or a video")
    raise DataError(f"{source} matches no photo or video: check the pattern")


def _search_folder(folder: Path) -> FoundFiles:
    files = [f for f in _walk(folder) if not f.name.startswith(".")]
    photos = [f for f in files if f.suffix.lower() in PHOTO_SUFFIXES]
    videos = [f for f in files if f.suffix.lower() in VIDEO_SUFFIXES]
    warnings = []
    if not photos and not videos:
        if any(f.suffix.lower() in RAW_SUFFIXES for f in files):
            raise DataError(f"{folder} holds raw photos only, which are not read: export them as JPEG or TIFF")
        if (folder / MISSION_MARK).is_file() and is_recording(folder / "recording"):
            raise DataError(f"{folder} is a live mission: name what it recorded, {folder / 'recording'}")
        if (folder / MISSION_MARK).is_file():
            raise DataError(f"{folder} is a mission, not a source: name the folder of the photos")
        raise DataError(f"{folder} holds no photos or videos: name a folder that does")
    if photos and videos:
        used, left = (photos, videos) if len(photos) >= _FEW_PHOTOS else (videos, photos)
        kind = "video" if left is videos else "photo"
        names = ", ".join(f.name for f in left[:3]) + (", ..." if len(left) > 3 else "")
        many = "s" if len(left) != 1 else ""
        warnings.append(f"not used: {len(left)} {kind}{many} in {folder} ({names}): name them to use them, too")
        photos, videos = (used, []) if used is photos else ([], used)
    return FoundFiles(tuple(sorted(photos, key=natural_key)), tuple(sorted(videos, key=natural_key)), tuple(warnings))


def _walk(folder: Path) -> Iterator[Path]:
    """Yield the pictures below a folder; hidden folders and missions are passed over, and links do not go round."""
    seen: set[Path] = set()
    wanted = PHOTO_SUFFIXES | VIDEO_SUFFIXES | RAW_SUFFIXES
    for where, below, names in os.walk(folder, followlinks=True):
        here = Path(where)
        real = here.resolve()
        if real in seen or MISSION_MARK in names:
            below[:] = []
            continue
        seen.add(real)
        below[:] = sorted(d for d in below if not d.startswith(".") and d != "@eaDir")
        for name in names:
            path = here / name
            if path.suffix.lower() in wanted and path.is_file():  # a pipe of that name would never end
                yield path


def read_frame(ref: FrameRef) -> Frame:
    """Return one frame with its pixels. Raises ``FrameReadError``; for many frames of a video use ``read_frames``."""
    if ref.frame_number is None:
        return read_photo(ref)
    _, frame = next(read_frames([ref]))
    if isinstance(frame, FrameReadError):
        raise frame
    return frame


def read_frames(refs: Sequence[FrameRef]) -> Iterator[tuple[FrameRef, Frame | FrameReadError]]:
    """Yield every frame with its pixels, in the order given; a frame that cannot be read comes as its error.

    Neighbours of one video are decoded in one pass: give a video's frames together and in ascending order.
    """
    for (source, is_video), run in groupby(refs, key=lambda r: (r.source, r.frame_number is not None)):
        if is_video:
            yield from _read_video(source, list(run))
            continue
        for ref in run:
            try:
                yield ref, read_photo(ref)
            except FrameReadError as error:
                yield ref, error


def _read_video(source: str, refs: list[FrameRef]) -> Iterator[tuple[FrameRef, Frame | FrameReadError]]:
    for run in _ascending(refs):
        yield from _read_ascending(source, run)


def _ascending(refs: Sequence[FrameRef]) -> Iterator[list[FrameRef]]:
    """Cut where a video's frame numbers do not rise."""
    run: list[FrameRef] = []
    for ref in refs:
        if run and (ref.frame_number or 0) <= (run[-1].frame_number or 0):
            yield run
            run = []
        run.append(ref)
    if run:
        yield run


def _read_ascending(source: str, refs: list[FrameRef]) -> Iterator[tuple[FrameRef, Frame | FrameReadError]]:
    from photomap_gis.ingest.video import video_frames  # PyAV loads slowly, and photos do not need it

    waiting = {ref.frame_number: ref for ref in refs if ref.frame_number is not None}
    why = "the video ends before it"
    try:
        for found in video_frames(Path(source), sorted(waiting)):
            ref = waiting.pop(found.number, None)
            if ref is not None:
                yield ref, _video_frame(ref, found.image, found.is_suspect)
    except DataError as error:
        why = str(error)
    for ref in waiting.values():
        yield ref, FrameReadError(f"{ref.name}: {why}")


def _video_frame(ref: FrameRef, image: np.ndarray | None, is_suspect: bool) -> Frame | FrameReadError:
    if image is None:
        return FrameReadError(f"{ref.name}: this frame of the video is damaged")
    if ref.width_px and image.shape[:2] != (ref.height_px, ref.width_px):
        return FrameReadError(f"{ref.name}: its size changes within the video")
    return Frame(ref, image, is_suspect)
