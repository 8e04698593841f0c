"""Open a telemetry log of any dialect: what it holds decides, its name only where that leaves it open."""

from __future__ import annotations

import logging
from pathlib import Path

from photomap_gis.core.errors import DataError
from photomap_gis.ingest.options import SrtOrder
from photomap_gis.ingest.telemetry import dataflash, gpx, klv, media, srt, table, tlog, ulg
from photomap_gis.ingest.telemetry.text import decode_text
from photomap_gis.ingest.telemetry.track import Track

logger = logging.getLogger(__name__)

TRACK_SUFFIXES = (".srt", ".gpx", ".csv", ".tlog", ".bin", ".ulg", ".klv")
"""What may lie beside a video as its telemetry, best first."""

_HEAD_BYTES = 64 * 1024
_KINDS = "DJI .SRT, .gpx, .csv, MAVLink .tlog, ArduPilot .bin, PX4 .ulg, MISB .klv or .ts"


def read_track(path: Path, *, srt_order: SrtOrder = SrtOrder.AUTO) -> Track:
    """Return the track of a telemetry log; ``DataError`` where the file is none that is understood."""
    path = Path(path)
    head = _head(path)
    if not head:
        raise DataError(f"{path}: the file is empty; give another log by --track FILE")
    track = _read(path, head, srt_order)
    logger.info("%s: %d points, %d triggers, clock %s", path, len(track.points), len(track.triggers), track.clock)
    return track


def _head(path: Path) -> bytes:
    if path.is_dir():
        raise DataError(f"{path}: is a folder; name the telemetry file in it")
    try:
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such file; check the path given to --track") from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error}); check its rights") from error


def _read(path: Path, head: bytes, srt_order: SrtOrder) -> Track:
    suffix = path.suffix.lower()
    if head.startswith(ulg.MAGIC):
        return ulg.read_ulg(path)
    if head.startswith(dataflash.HEAD) or (suffix == ".bin" and dataflash.HEAD in head):
        return dataflash.read_dataflash(path)
    if tlog.looks_like_tlog(head):
        return tlog.read_tlog(path)
    if head[4:8] == b"ftyp" or _is_transport_stream(head):
        return media.read_media(path, order=srt_order)
    if klv.UAS_KEY in head:
        return klv.read_klv(path)
    text = decode_text(head)
    start = text.lstrip()[:2000].lower()
    if "<gpx" in start or (start.startswith("<?xml") and suffix == ".gpx"):
        return gpx.read_gpx(path)
    if "\0" not in head.decode("latin-1") or head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        if srt.looks_like_srt(text) or suffix == ".srt":
            return srt.read_srt(path, order=srt_order)
        if table.looks_like_table(text):
            return table.read_table(path)
    if path.name.lower().startswith("djiflightrecord"):
        raise DataError(f"{path}: DJI's flight records are encrypted; export this one as CSV, by Airdata for example")
    reader = {".tlog": tlog.read_tlog, ".gpx": gpx.read_gpx, ".csv": table.read_table}.get(suffix)
    if reader is not None:
        return reader(path)
    raise DataError(f"{path}: not a telemetry log that is understood; give {_KINDS}")


def _is_transport_stream(head: bytes) -> bool:
    """Whether sync bytes stand at every packet's start (188 bytes, or 192 with time codes)."""
    for start, step in ((0, 188), (4, 192)):
        marks = head[start::step][:8]
        if len(marks) >= 4 and set(marks) == {0x47}:
            return True
    return False
