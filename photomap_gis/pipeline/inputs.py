"""Which files a mission was made of, and their hashes: read once, kept in the mission for when the files are gone."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from photomap_gis.core.frame import FrameRef
from photomap_gis.parallel import map_jobs
from photomap_gis.publish import write_file
from photomap_gis.store import Mission

_CACHE = "inputs.json"
_LISTED = 100  # longer lists stay in the mission: metadata of a picture must stay small


@dataclass(frozen=True, slots=True)
class InputFile:
    """A source file as it was when its hash was taken; ``sha256`` is ``None`` where nobody could read it."""

    path: str
    size: int = 0
    mtime_ns: int = 0
    sha256: str | None = None


_KNOWN: TypeAdapter[tuple[InputFile, ...]] = TypeAdapter(tuple[InputFile, ...])


def input_files(
    mission: Mission, frames: tuple[FrameRef, ...], on_progress: Callable[[int, int], None] = lambda done, total: None
) -> tuple[InputFile, ...]:
    """Return photos, videos and tracks with their SHA-256, in the order of the frames."""
    tracks = [f.track_source for f in mission.flights if f.track_source is not None]
    paths = tuple(dict.fromkeys([*(f.source for f in frames), *tracks]))
    cache = mission.folder / "cache" / _CACHE
    known = {f.path: f for f in _load(cache)}
    found: dict[str, InputFile] = {}
    fresh: list[str] = []
    for path in paths:
        now = _stat(path)
        old = known.get(path)
        if old is not None and (now is None or (old.size, old.mtime_ns) == (now.size, now.mtime_ns)):
            found[path] = old
        elif now is None:
            found[path] = InputFile(path)
        else:
            fresh.append(path)
    for hashed in map_jobs(_hashed, fresh, on_progress=on_progress):
        found[hashed.path] = hashed
    if fresh and cache.parent.is_dir():
        write_file(cache, _KNOWN.dump_json(tuple(found.values())))
    return tuple(found[path] for path in paths)


def inputs_document(files: tuple[InputFile, ...]) -> dict[str, Any]:
    """Return what an output says of its inputs.

    ``sha256`` is of the sorted lines ``<sha256>  <name>`` as ``sha256sum`` prints them, so anybody can work it out
    again from the same files; single files are listed where they are few.
    """
    hashed = [f for f in files if f.sha256 is not None]
    lines = sorted(f"{f.sha256}  {Path(f.path).name}\n" for f in hashed)
    document: dict[str, Any] = {
        "files": len(files),
        "hashed": len(hashed),
        "sha256": hashlib.sha256("".join(lines).encode()).hexdigest() if hashed else None,
    }
    if len(files) <= _LISTED:
        document["list"] = [{"name": Path(f.path).name, "sha256": f.sha256} for f in files]
    return document


def _load(cache: Path) -> tuple[InputFile, ...]:
    try:
        return _KNOWN.validate_json(cache.read_bytes())
    except (OSError, ValidationError):
        return ()


def _stat(path: str) -> InputFile | None:
    try:
        stat = Path(path).stat()
    except (OSError, ValueError):
        return None
    return InputFile(path, stat.st_size, stat.st_mtime_ns)


def _hashed(path: str) -> InputFile:
    now = _stat(path)
    try:
        with Path(path).open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return InputFile(path)
    return InputFile(path) if now is None else InputFile(path, now.size, now.mtime_ns, digest)
