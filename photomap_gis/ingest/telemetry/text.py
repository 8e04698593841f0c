"""Text logs as people really have them: any encoding, any size, or not text at all."""

from __future__ import annotations

import codecs
from datetime import UTC, datetime, timedelta
from pathlib import Path

from photomap_gis.core.errors import DataError

MAX_TEXT_BYTES = 512 * 1024 * 1024
"""A day of 30 Hz telemetry is 400 MB; more is no log."""


def read_text(path: Path) -> str:
    """Return a text file's content with ``\\n`` line ends, whatever its encoding."""
    try:
        size = path.stat().st_size
        if size > MAX_TEXT_BYTES:
            raise DataError(f"{path}: {size / 1e6:.0f} MB is too big for a text log; cut out the flight you need")
        return decode_text(path.read_bytes())
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error}); check the path and its rights") from error


def decode_text(data: bytes) -> str:
    """Return text of UTF-8, UTF-16 or Latin-1 bytes with ``\\n`` line ends and without NULs."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = data.decode("utf-16", errors="replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n").replace("\0", "")


def unix_s(year: int, month: int, day: int, hour: int, minute: int, second: float) -> float | None:
    """Return Unix seconds of a date and time read as UTC, ``None`` where there is no such moment."""
    try:
        base = datetime(year, month, day, hour, minute, tzinfo=UTC)
    except ValueError:
        return None
    if not 0.0 <= second < 61.0:
        return None
    return (base + timedelta(seconds=second)).timestamp()


def unix_s_of_iso(text: str) -> tuple[float, bool] | None:
    """Return Unix seconds of an ISO-like time stamp, and whether it named its zone; ``None`` where it is none."""
    cleaned = text.strip().replace("/", "-").replace("_", "-") if text else ""
    if len(cleaned) < 8 or len(cleaned) > 48:
        return None
    if len(cleaned) > 10 and cleaned[4:5] == ".":
        cleaned = cleaned[:10].replace(".", "-") + cleaned[10:]
    named_utc = cleaned.upper().endswith(("UTC", "GMT"))
    if named_utc:
        cleaned = cleaned[:-3].strip() + "Z"
    try:
        moment = datetime.fromisoformat(cleaned)
    except ValueError:
        return None
    has_zone = moment.tzinfo is not None
    try:
        return (moment if has_zone else moment.replace(tzinfo=UTC)).timestamp(), has_zone
    except (OverflowError, ValueError):
        return None
