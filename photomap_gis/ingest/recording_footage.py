"""A live mission's black box as footage: the pieces of one stream are one flight, as it was flown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import Footage
from photomap_gis.ingest.box_files import TICKS_HZ, BoxContents, piece_path, read_contents, started_utc_s
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.telemetry.track import Track

TELEMETRY = "telemetry.tlog"
"""What the autopilot said while it was recorded; used where no other track is given."""


def recording_footage(
    folder: Path, options: IngestOptions, *, on_progress: Callable[[int, int], None] | None = None
) -> Footage:
    """Return the footage of a recording; ``DataError`` where nothing of it can be read.

    A recording of files or photos (a played video, a watched folder) leads to these, which must still be there.
    """
    contents = read_contents(folder)
    log = folder / TELEMETRY
    has_log = options.track is None and log.is_file() and log.stat().st_size > 0
    files = [Path(str(line.get("path"))) for line in contents.of_kind("file")]
    photos = [Path(str(line.get("path"))) for line in contents.of_kind("photo")]
    lines = contents.of_kind("piece")
    if photos:
        from photomap_gis.ingest.photo_track import place_by_track
        from photomap_gis.ingest.photos import photo_footage

        if has_log:
            options = replace(options, track=log)
        footage = photo_footage(list(dict.fromkeys(photos)), options, on_progress=on_progress)
        return footage if options.track is None else place_by_track(footage, options)
    from photomap_gis.ingest.video import LaidFile, laid_footage, video_footage  # PyAV loads slowly

    if files:
        if has_log:
            options = replace(options, track=log)
        return video_footage(list(dict.fromkeys(files)), options, on_progress=on_progress)
    laid = []
    started_s = started_utc_s(contents)
    first_s: float | None = None
    for line in lines:
        path = piece_path(folder, line)
        begins_s = _begins_s(contents, line)
        if path is None or begins_s is None:
            continue
        first_s = begins_s if first_s is None else first_s
        laid.append(LaidFile(path, begins_s - first_s, None if started_s is None else started_s + begins_s))
    if not laid:
        raise DataError(f"{folder}: nothing was recorded: no frame had come")
    heard: Track | None = None
    said: tuple[str, ...] = ()
    if has_log:
        from photomap_gis.ingest.telemetry.tlog import read_tlog

        try:
            heard = read_tlog(log, by_record_clock=True)  # the clock by which the pieces were recorded
        except DataError as error:
            said = (str(error),)
    footage = laid_footage(laid, options, track=heard, on_progress=on_progress)
    return replace(footage, warnings=(*said, *footage.warnings))


def _begins_s(contents: BoxContents, line: Mapping[str, Any]) -> float | None:
    """Return the stream time of a piece's first frame, ``None`` where no frame of it came."""
    number, first_pts_s = line.get("number"), line.get("first_pts_s")
    for record in contents.frames:
        if record.piece == number:
            if record.pts_ticks is None or not isinstance(first_pts_s, int | float):
                return record.stream_time_s
            since_s = record.pts_ticks / TICKS_HZ - first_pts_s
            return record.stream_time_s - (since_s if 0.0 <= since_s < 5.0 else 0.0)
    return None
