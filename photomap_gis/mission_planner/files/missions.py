"""Missions by the suffix of their file: QGroundControl's ``.plan``, Mission Planner's ``.waypoints``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.mission import Mission
from photomap_gis.mission_planner.files.qgc_plan import plan_document, read_plan_document
from photomap_gis.mission_planner.files.waypoints import read_waypoints, waypoints_text
from photomap_gis.publish import write_file

LARGEST_FILE_BYTES = 16 << 20
"""No autopilot holds a mission that needs more."""

MISSION_SUFFIXES = (".plan", ".waypoints", ".wpl", ".txt")
"""``.wpl`` and ``.txt`` are other names that ``.waypoints`` files go by."""


def read_mission(path: Path | str) -> Mission:
    """Read a ``.plan`` or ``.waypoints`` file, by what it holds.

    Raises ``DataError`` where the file cannot be read, is not of these formats, or holds what no vehicle could fly.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE_BYTES + 1)
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from error
    if len(content) > LARGEST_FILE_BYTES:
        raise DataError(f"{path} is too large for a mission (over {LARGEST_FILE_BYTES >> 20} MB)")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{path} is not a mission: it is not text; give a .plan or .waypoints file") from error
    start = text.lstrip()
    if start.startswith("{"):
        return read_plan_document(text, str(path))
    if start.startswith("QGC WPL"):
        return read_waypoints(text, str(path))
    raise DataError(
        f"{path} is neither a QGroundControl .plan (JSON) nor a .waypoints file (first line 'QGC WPL 110'): "
        "give one of these"
    )


def write_mission(path: Path | str, mission: Mission, *, file_format: str | None = None) -> None:
    """Write a mission in the format of the path's suffix, or as "plan" or "waypoints", whole or not at all.

    Raises ``UsageError`` for another suffix, ``OutputError`` where the disk refuses.
    """
    path = Path(path)
    suffix = path.suffix.lower() if file_format is None else f".{file_format}"
    make = _WRITERS.get(suffix)
    if make is None:
        raise UsageError(f"{path.name}: a mission is written as {', '.join(MISSION_SUFFIXES)}")
    write_file(path, make(mission).encode())


_WRITERS: dict[str, Callable[[Mission], str]] = {
    ".plan": plan_document,
    ".waypoints": waypoints_text,
    ".wpl": waypoints_text,
    ".txt": waypoints_text,
}
