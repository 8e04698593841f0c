"""From what a user names as a live source to the source."""

from __future__ import annotations

from pathlib import Path

from photomap_gis.core.errors import DataError
from photomap_gis.core.live import FrameSource, LiveClock
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.stream.clock import SystemClock
from photomap_gis.ingest.stream.file_source import FileSource

_OPTIONS = IngestOptions()


def open_stream(
    source: str | Path,
    *,
    realtime: bool = True,
    options: IngestOptions = _OPTIONS,
    clock: LiveClock | None = None,
) -> FrameSource:
    """Return the live source that ``source`` names; what cannot be used is told before the first frame.

    A file is played at its rate (``realtime``) or as fast as it is read. ``options`` tell the lens. ``DataError`` for
    files that are no video, ``LinkError`` for addresses that nobody answers.
    """
    clock = clock or SystemClock()
    path = Path(source)
    if path.is_file():
        return FileSource(path, options, clock, realtime=realtime)
    raise DataError(f"{source}: no such file; check the path")
