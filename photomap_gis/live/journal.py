"""What a session decided, line by line: enough to decide the same again.

``live/session.json`` says what was asked for (replaced whole); ``live/journal.jsonl`` holds a line for every frame that
the loop took, for frames dropped, for every solution at the frame at which it was adopted; ``live/render.jsonl`` what
was drawn anew between which commands of the loop. Each line is handed to the operating system at once, so that a killed
session loses at most the line it was writing.
"""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any

from photomap_gis.core.errors import DataError, OutputError
from photomap_gis.publish import write_file

SCHEMA = 1
MOST_LINE = 1 << 22
FOLDER, SESSION, JOURNAL, RENDER = "live", "session.json", "journal.jsonl", "render.jsonl"


class LineLog:
    """A file of JSON objects that is only appended to; safe among threads.

    With ``on_failure`` a disk that takes no more is told to it, once, and later lines are left out: what follows a hole
    could not be replayed.
    """

    def __init__(self, path: Path, on_failure: Callable[[OutputError], None] | None = None) -> None:
        self._path, self._on_failure, self._failed = path, on_failure, False
        self._file: IO[bytes] | None = None
        self._lock = threading.Lock()

    def write(self, what: str, **values: Any) -> None:
        """Append a line; ``OutputError`` where the disk does not take it."""
        if self._failed:
            return
        line = json.dumps({"t": what, **values}, separators=(",", ":")).encode() + b"\n"
        try:
            with self._lock:
                if self._file is None:
                    cut_to_whole_lines(self._path)
                    self._file = self._path.open("ab")
                self._file.write(line)
                self._file.flush()
        except OSError as error:
            failure = OutputError(f"cannot write {self._path}: {error.strerror}; free or choose another disk")
            if self._on_failure is None:
                raise failure from error
            self._failed = True
            self._on_failure(failure)

    def close(self) -> None:
        """Let go of the file."""
        if self._file is not None:
            with contextlib.suppress(OSError):  # what a full disk did not take
                self._file.close()
            self._file = None


def cut_to_whole_lines(path: Path) -> None:
    """Drop the line that a killed session was writing."""
    if not path.is_file():
        return
    with path.open("rb+") as file:
        end = file.seek(0, 2)
        start = max(0, end - MOST_LINE)
        file.seek(start)
        tail = file.read(end - start)
        if tail and not tail.endswith(b"\n"):
            file.truncate(start + tail.rfind(b"\n") + 1)


def read_lines(path: Path) -> Iterator[Mapping[str, Any]]:
    """Yield the whole lines of a log; ``DataError`` where one in the middle is damaged."""
    if not path.is_file():
        return
    with path.open("rb") as file:
        for number, line in enumerate(file, start=1):
            if not line.endswith(b"\n"):
                return
            try:
                value = json.loads(line)
                if not isinstance(value, dict) or not isinstance(value.get("t"), str):
                    raise ValueError
            except ValueError as error:
                raise DataError(f"{path}, line {number}, is damaged: this session cannot be replayed") from error
            yield value


def save_session(folder: Path, document: Mapping[str, Any]) -> None:
    """Replace ``session.json``."""
    (folder / FOLDER).mkdir(parents=True, exist_ok=True)
    write_file(folder / FOLDER / SESSION, json.dumps({"schema": SCHEMA, **document}, indent=1).encode())


def load_session(folder: Path) -> dict[str, Any]:
    """Return what a session was asked for; ``DataError`` where the folder holds none."""
    path = folder / FOLDER / SESSION
    if not path.is_file():
        raise DataError(f"{folder} holds no live session (no {FOLDER}/{SESSION}): name one made by 'photomap live'")
    try:
        document = json.loads(path.read_bytes())
        if document["schema"] != SCHEMA:
            raise DataError(f"{path} comes from another version of photomap")
        return dict(document)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{path} is damaged") from error
