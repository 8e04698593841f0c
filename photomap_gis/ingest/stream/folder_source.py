"""A folder of photos as a live source: those that are there, then those that come, each once it is whole."""

from __future__ import annotations

import hashlib
import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from photomap_gis.core.errors import DataError, FrameReadError
from photomap_gis.core.frame import FrameRef
from photomap_gis.core.live import (
    EndReason,
    GapKind,
    LiveClock,
    LiveFrame,
    StreamEnd,
    StreamEvent,
    StreamGap,
    StreamRenamed,
)
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.photo_flights import natural_key
from photomap_gis.ingest.photos import photo_footage
from photomap_gis.ingest.stills import PHOTO_SUFFIXES, read_photo
from photomap_gis.ingest.stream.picture import ArrayPicture
from photomap_gis.ingest.stream.timeline import Timeline

_POLL_S = 0.5
_PATIENCE_S = 30.0
"""For so long a file may be unreadable: a card reader or a radio link may still be writing it."""
_MAX_FILES = 200_000
_TAIL_BYTES = 1 << 16
"""Cameras append previews and notes behind a picture's end."""
_LONGEST_NAP_S = 0.2


@dataclass(slots=True)
class _Seen:
    """A file that is not taken yet: its size and time of change, and since when they are so."""

    size: int
    mtime_ns: int
    since_s: float
    first_s: float


class FolderSource:
    """A ``FrameSource`` of a folder: ``watch`` waits for more photos until it is closed, without it it ends.

    A file is read when two looks found it unchanged and it decodes whole; the same picture under a second name is left
    out. What comes together is put in order of EXIF
    time, then of name; the stream time is the EXIF time since the first photo where it rises, else that of arrival.
    """

    def __init__(self, folder: Path, options: IngestOptions, clock: LiveClock, *, watch: bool) -> None:
        self._folder, self._options, self._clock = folder, options, clock
        self.is_live = watch
        self._done: set[Path] = set()
        self._prints: dict[bytes, Path] = {}
        self._waiting: dict[Path, _Seen] = {}
        self._closed = threading.Event()
        self._started_utc_s: float | None = None
        if not watch and not self._files():
            raise DataError(f"{folder} holds no photos: name a folder that does, or one that is being filled")

    @property
    def name(self) -> str:
        """The folder's name."""
        return self._folder.name

    @property
    def started_utc_s(self) -> float | None:
        """Unix seconds of the first photo."""
        return self._started_utc_s

    def close(self) -> None:
        """End the source soon."""
        self._closed.set()

    def __iter__(self) -> Iterator[StreamEvent]:
        """Yield the photos as they come."""
        timeline = Timeline(by_arrival=True)
        index = 0
        if self.is_live and not self._files():
            yield StreamGap(GapKind.WAITING, 0.0, self._clock.now_s(), f"waiting for photos in {self._folder}")
        while not self._closed.is_set():
            ready, left_out = self._look()
            for path, why in left_out:
                yield StreamGap(
                    GapKind.FILE_LEFT_OUT, timeline.stream_time_s, self._clock.now_s(), f"{path.name}: {why}",
                    frames_lost=1,
                )  # fmt: skip
            for ref in ready:
                if self._closed.is_set():
                    break
                try:
                    frame = read_photo(ref)
                except FrameReadError:
                    continue  # still being written: it stays among those that are waited for
                path = Path(ref.source)
                self._taken(path)
                arrival_s = self._clock.now_s()
                twin = self._twin(path)
                if twin is not None:
                    if not twin.exists():
                        yield StreamRenamed(str(twin), str(path))
                    else:
                        yield StreamGap(
                            GapKind.FILE_LEFT_OUT, timeline.stream_time_s, arrival_s,
                            f"{path.name}: the same picture as {twin.name}, left out", frames_lost=0,
                        )  # fmt: skip
                    continue
                if self._started_utc_s is None:
                    self._started_utc_s = ref.time_s if ref.time_s is not None else self._clock.utc_s()
                moment = timeline.place(ref.time_s, arrival_s)
                placed = replace(ref, index=index, pts_s=moment.stream_time_s)
                index += 1
                yield LiveFrame(placed, ArrayPicture(frame.image), arrival_s)
            if not self.is_live and not self._waiting:
                break
            self._nap(_POLL_S)
        closed = self._closed.is_set()
        yield StreamEnd(
            EndReason.CLOSED if closed else EndReason.END_OF_FILE, timeline.stream_time_s, self._clock.now_s(),
            "" if closed else f"all photos in {self._folder} were read",
        )  # fmt: skip

    def _look(self) -> tuple[list[FrameRef], list[tuple[Path, str]]]:
        """Return the photos that seem whole, in order, and the files that are given up."""
        now_s = self._clock.now_s()
        stable: list[Path] = []
        for path in self._files():
            try:
                state = path.stat()
            except OSError:
                self._waiting.pop(path, None)  # gone again: a temporary name
                continue
            seen = self._waiting.get(path)
            if seen is None or (seen.size, seen.mtime_ns) != (state.st_size, state.st_mtime_ns):
                first_s = now_s if seen is None else seen.first_s
                self._waiting[path] = _Seen(state.st_size, state.st_mtime_ns, now_s, first_s)
                if self.is_live:
                    continue  # a first look: whether it grows only a second one tells
            if state.st_size and _has_end(path):
                stable.append(path)
        refs = []
        for path in stable:
            ref = self._ref(path)
            if ref is not None:
                refs.append(ref)
        refs.sort(key=lambda r: (math.inf if r.time_s is None else r.time_s, natural_key(Path(r.source))))
        left_out = []
        ready = {Path(r.source) for r in refs}
        for path, seen in list(self._waiting.items()):
            # an unreadable file that no longer changes is not waited for without end
            if now_s - seen.since_s > (_PATIENCE_S if self.is_live else -1.0) and path not in ready:
                self._taken(path)
                left_out.append((path, "cannot be read as a photo; copy it again"))
        return refs, left_out

    def _ref(self, path: Path) -> FrameRef | None:
        try:
            footage = photo_footage([path], self._options)
        except DataError:
            return None
        ref = footage.frames[0]
        return None if ref.problem is not None else ref

    def _twin(self, path: Path) -> Path | None:
        """Return the photo that was read with the very same bytes before, ``None`` where there is none."""
        with path.open("rb") as file:
            print_ = hashlib.file_digest(file, "blake2b").digest()
        twin = self._prints.get(print_)
        self._prints[print_] = path
        return twin

    def _taken(self, path: Path) -> None:
        self._done.add(path)
        self._waiting.pop(path, None)

    def _files(self) -> list[Path]:
        """Return the photos of the folder and those below it that were not taken yet."""
        found: list[Path] = []
        for path in self._folder.rglob("*"):
            if len(found) >= _MAX_FILES:
                break
            hidden = any(part.startswith(".") for part in path.relative_to(self._folder).parts)
            if path.suffix.lower() in PHOTO_SUFFIXES and not hidden and path not in self._done and path.is_file():
                found.append(path)
        return found

    def _nap(self, seconds: float) -> None:
        until_s = self._clock.now_s() + seconds
        while not self._closed.is_set() and (left_s := until_s - self._clock.now_s()) > 0.0:
            self._clock.sleep(min(left_s, _LONGEST_NAP_S))


def _has_end(path: Path) -> bool:
    """Whether a JPEG's end is there: a decoder takes half a picture for a whole one with a grey foot."""
    if path.suffix.lower() not in (".jpg", ".jpeg"):
        return True
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - _TAIL_BYTES))
            return b"\xff\xd9" in file.read(_TAIL_BYTES)
    except OSError:
        return False
