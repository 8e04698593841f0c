"""The files of a black box: what lies in a recording's folder, written so that a cut loses the last second at most.

::

    recording/
      index.jsonl        a line a thing that happened: begin, piece, file, photo, gap, end (only ever appended)
      frames.idx         32 bytes a decoded frame: connection, piece, time stamp, stream time, arrival
      piece-00001.ts     packets as they came (MPEG-TS; Matroska for what it cannot hold), some five minutes each
      telemetry.tlog     what the autopilot said, where one was listened to

A line or record that a cut left half written is passed over.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

from photomap_gis.core.errors import DataError, OutputError

INDEX, FRAMES = "index.jsonl", "frames.idx"
VERSION = 1
_RECORD = struct.Struct("<IIqdd")
_NO_PTS = -(1 << 63)
_MAX_INDEX_BYTES = 1 << 30
TICKS_HZ = 90_000


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """One decoded frame: of which connection and piece, its time stamp in 1/90000 s (``None``: it had none), when."""

    connection: int
    piece: int
    pts_ticks: int | None
    stream_time_s: float
    arrival_s: float


@dataclass(frozen=True, slots=True)
class BoxContents:
    """A recording's index as it could be read: ``lines`` in order, ``frames`` in order of decoding."""

    folder: Path
    lines: tuple[Mapping[str, Any], ...]
    frames: tuple[FrameRecord, ...]

    @property
    def begun(self) -> Mapping[str, Any]:
        """The first line: source and Unix time of stream time 0."""
        return self.lines[0]

    def of_kind(self, kind: str) -> list[Mapping[str, Any]]:
        """Return the lines of a kind."""
        return [line for line in self.lines if line["kind"] == kind]


class BoxIndex:
    """The open index of a recording being made; owned by one thread."""

    def __init__(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._lines: BinaryIO = (folder / INDEX).open("ab")
            self._frames: BinaryIO = (folder / FRAMES).open("ab")
            # a record that a cut left half written would shift all behind it
            self._frames.truncate(self._frames.tell() // _RECORD.size * _RECORD.size)
            if self._lines.tell():
                self._lines.write(b"\n")
        except OSError as error:
            raise OutputError(f"{folder} cannot be written: {error.strerror or error}; choose another place") from error

    def line(self, **what: object) -> None:
        """Append a line."""
        self._lines.write(json.dumps(what, ensure_ascii=False).encode() + b"\n")

    def frame(self, record: FrameRecord) -> None:
        """Append a frame."""
        ticks = _NO_PTS if record.pts_ticks is None else record.pts_ticks
        self._frames.write(_RECORD.pack(record.connection, record.piece, ticks, record.stream_time_s, record.arrival_s))

    def flush(self) -> None:
        """Have it on the disk."""
        for file in (self._lines, self._frames):
            file.flush()
            os.fsync(file.fileno())

    def close(self) -> None:
        """Close the files."""
        self._lines.close()
        self._frames.close()


def is_recording(folder: Path) -> bool:
    """Whether a folder holds a black box."""
    return (folder / INDEX).is_file() and _first_line(folder) is not None


def read_contents(folder: Path) -> BoxContents:
    """Return a recording's index; ``DataError`` where it is none."""
    if _first_line(folder) is None:
        raise DataError(f"{folder} holds no recording: name the folder 'recording' of a live mission")
    try:
        if (folder / INDEX).stat().st_size > _MAX_INDEX_BYTES:
            raise DataError(f"{folder / INDEX} is damaged: it is larger than any flight's")
        lines = [parsed for raw in (folder / INDEX).read_bytes().splitlines() if (parsed := _parsed(raw)) is not None]
        data = (folder / FRAMES).read_bytes() if (folder / FRAMES).is_file() else b""
    except OSError as error:
        raise DataError(f"{folder}: cannot be read ({error.strerror or error}); check its rights") from error
    whole = data[: len(data) // _RECORD.size * _RECORD.size]
    frames = [
        FrameRecord(connection, piece, None if ticks == _NO_PTS else ticks, stream_s, arrival_s)
        for connection, piece, ticks, stream_s, arrival_s in _RECORD.iter_unpack(whole)
    ]
    return BoxContents(folder, tuple(_by_new_names(lines)), _on_one_clock(lines, frames))


def _by_new_names(lines: Sequence[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """Yield the lines with photos under the names that they were given later."""
    names = {str(line.get("path")): str(line.get("to")) for line in lines if line["kind"] == "renamed"}
    for line in lines:
        path, hops = str(line.get("path")), 0
        while line["kind"] == "photo" and path in names and hops < len(names):
            path, hops = names[path], hops + 1
        yield {**line, "path": path, "was": line["path"]} if hops else line


def _on_one_clock(lines: Sequence[Mapping[str, Any]], frames: Sequence[FrameRecord]) -> tuple[FrameRecord, ...]:
    """Return the records of sessions that were cut off and resumed with the stream times of the first one.

    Each session counts from its own beginning; Unix time tells how much later that was.
    """
    sessions: list[Mapping[str, Any]] = []
    session_of: dict[int, Mapping[str, Any]] = {}
    for line in lines:
        if line["kind"] == "recording":
            sessions.append(line)
        elif line["kind"] == "piece" and sessions:
            session_of.setdefault(int(line.get("connection", 0)), sessions[-1])
    if len(sessions) < 2:
        return tuple(frames)
    starts: dict[int, float] = {}
    out: list[FrameRecord] = []
    for record in frames:
        session = session_of.get(record.connection)
        start = None if session is None else _start_utc_s(session, record)
        if session is None or start is None:
            out.append(record)
            continue
        ahead_s = starts.setdefault(id(session), start) - next(iter(starts.values()))
        out.append(replace(record, stream_time_s=record.stream_time_s + max(ahead_s, 0.0)))
    return tuple(out)


def _start_utc_s(session: Mapping[str, Any], record: FrameRecord) -> float | None:
    """Return the Unix seconds of a session's stream time 0, by one of its frames."""
    try:
        began_utc_s, began_arrival_s = float(session["began_utc_s"]), float(session["began_arrival_s"])
    except (KeyError, TypeError, ValueError):
        return None
    return began_utc_s + (record.arrival_s - record.stream_time_s) - began_arrival_s


def piece_path(folder: Path, line: Mapping[str, Any]) -> Path | None:
    """Return where a piece lies, ``None`` where the index names none that can be: it may have been tampered with."""
    name = line.get("file")
    if not isinstance(name, str) or Path(name).name != name or name in ("", ".", ".."):
        return None
    path = folder / name
    return path if path.is_file() else None


def started_utc_s(contents: BoxContents) -> float | None:
    """Return the Unix seconds of a recording's stream time 0."""
    return _start_utc_s(contents.begun, contents.frames[0]) if contents.frames else None


def _first_line(folder: Path) -> Mapping[str, Any] | None:
    try:
        with (folder / INDEX).open("rb") as file:
            line = _parsed(file.readline(65_536))
    except OSError:
        return None
    return line if line is not None and line["kind"] == "recording" else None


def _parsed(raw: bytes) -> Mapping[str, Any] | None:
    try:
        line = json.loads(raw)
    except (ValueError, RecursionError):
        return None
    return line if isinstance(line, dict) and isinstance(line.get("kind"), str) else None
