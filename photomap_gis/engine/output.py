"""What a job's process says, line by line: progress, words, documents, and why it failed. Pure."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from pydantic import ValidationError

from photomap_gis.engine.documents import JobErrorDocument, ProgressDocument

_LONGEST_LINE = 2000
_NAMES: dict[int, Any] = {1: "fault", 2: "usage", 3: "data", 4: "link", 5: "extra", 130: "stopped"}
_PREFIXES = ("photomap: ", "Error: ")


def progress_of(line: str) -> ProgressDocument | None:
    """Return the progress that a line of stderr tells (``cli/progress.py``), ``None`` where it is words."""
    if not line.startswith('{"progress"'):
        return None
    try:
        said = json.loads(line)
        return ProgressDocument(
            stage=said["progress"], done=said["done"], total=said["total"], rate=said["rate"], eta_s=said["eta_s"]
        )
    except (ValueError, KeyError, TypeError, ValidationError, RecursionError):
        return None


def words_of(line: bytes) -> str:
    """Return a line of stderr as text, without its end and not longer than anyone reads."""
    return line.decode("utf-8", "replace").rstrip()[:_LONGEST_LINE]


class Documents:
    """The JSON documents on a job's stdout: one over many lines, or one a line.

    ``max_bytes`` bounds what is kept; beyond it ``overflowed`` is true and the rest is dropped.
    """

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._pending: list[bytes] = []
        self._last: Any = None
        self.bytes = 0
        self.overflowed = False

    def feed(self, line: bytes) -> dict[str, Any] | None:
        """Take a line; return the document that it is by itself, if it is one."""
        if not self._pending and line.startswith(b"{") and (found := _parsed(line)) is not None:
            self._last, self.bytes = found, len(line)
            return found if isinstance(found, dict) else None
        if self.bytes + len(line) > self._max_bytes:
            self.overflowed = True
        elif self._pending or line.strip():
            self._pending.append(line)
            self.bytes += len(line)
        return None

    def result(self) -> Any:
        """Return the last document, ``None`` where there is none that is whole."""
        if self._pending and not self.overflowed:
            return _parsed(b"".join(self._pending))
        return self._last


def error_of(exit_code: int, log: Sequence[str], result: Any) -> JobErrorDocument:
    """Return why a process ended with a code that is not 0: its own words where it had any."""
    name = _NAMES.get(exit_code, "crashed")
    message = _message(log) or _told(result)
    if name == "crashed":
        how = f"signal {-exit_code}" if exit_code < 0 else f"exit code {exit_code}"
        hint = "; the machine may have run out of memory: close other programs or use a coarser pixel"
        message = f"the process was ended from outside or crashed ({how}){hint if exit_code == -9 else ''}" + (
            f"; last it said: {message or log[-1]}" if message or log else ""
        )
    return JobErrorDocument(error=name, message=message or f"failed with exit code {exit_code}", exit_code=exit_code)


def _message(log: Sequence[str]) -> str:
    """The last complaint of the command line and what belongs to it."""
    for at in range(len(log) - 1, -1, -1):
        for prefix in _PREFIXES:
            if log[at].startswith(prefix):
                rest = [line for line in log[at + 1 :] if not line.startswith("warning: ")]
                return "\n".join([log[at].removeprefix(prefix), *rest]).strip()
    return ""


def _told(result: Any) -> str:
    """The message of a report that tells its failure in its document, as uploads do."""
    said = result.get("message") if isinstance(result, dict) else None
    return said if isinstance(said, str) else ""


def _parsed(text: bytes) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None
