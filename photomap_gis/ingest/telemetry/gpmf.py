"""GoPro's metadata (GPMF) inside its MP4 files: key, type, size, repeat, values; nested and padded to four bytes.

A packet holds about a second: a ``DEVC`` with one ``STRM`` per sensor. The receiver's is ``GPS5`` (HERO5 to HERO10: up
to 18 fixes, with one time ``GPSU``, fix ``GPSF`` and dilution ``GPSP`` for all of them) or ``GPS9`` (HERO11 and later:
everything in each fix). Integers are divided by ``SCAL``.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import median

from photomap_gis.ingest.telemetry.clean import clean_points
from photomap_gis.ingest.telemetry.text import unix_s
from photomap_gis.ingest.telemetry.track import Clock, Track, TrackPoint

_MAX_DEPTH = 6
_3D_FIX = 3
_METRES_PER_DILUTION = 2.5
"""A small receiver's one-sigma per axis is about this times its dilution of precision."""

_DAY_2000_UNIX_S = 946_684_800.0


@dataclass(frozen=True, slots=True)
class GpmfFix:
    """One fix: ``since_s`` after the packet's beginning as a share of the packet (0 to 1); UTC where it is known."""

    share: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    sigma_m: float | None
    utc_s: float | None


def fixes_of(packet: bytes) -> list[GpmfFix]:
    """Return the valid fixes of one metadata packet."""
    out: list[GpmfFix] = []
    for stream in _streams(packet, 0):
        out += _of_gps9(stream) or _of_gps5(stream)
    return out


def track_of_gpmf(packets: Sequence[tuple[float, float, bytes]], source: str) -> Track:
    """Return the track of packets given as (second of the video, duration in s, bytes)."""
    points: list[TrackPoint] = []
    starts: list[float] = []
    for second, duration_s, data in packets:
        for fix in fixes_of(data):
            time_s = second + fix.share * duration_s
            points.append(TrackPoint(time_s, fix.lat_deg, fix.lon_deg, alt_m=fix.alt_m, sigma_m=fix.sigma_m))
            if fix.utc_s is not None:
                starts.append(fix.utc_s - time_s)
    clean, dropped = clean_points(points)
    epoch = median(starts) if starts else None
    return Track(clean, Clock.VIDEO, source, warnings=tuple(dropped), epoch_utc_s=epoch)


Element = tuple[bytes, str, int, int, bytes]


def _elements(data: bytes) -> Iterator[Element]:
    """Yield (key, type, size, repeat, payload) of one level; ends where the data makes no sense."""
    at = 0
    while at + 8 <= len(data):
        key, kind, size = data[at : at + 4], data[at + 4], data[at + 5]
        repeat = int.from_bytes(data[at + 6 : at + 8], "big")
        length = size * repeat
        if not key.strip(b"\0") or at + 8 + length > len(data):
            return
        yield key, chr(kind) if kind else "", size, repeat, data[at + 8 : at + 8 + length]
        at += 8 + (length + 3) // 4 * 4


def _streams(data: bytes, depth: int) -> Iterator[dict[bytes, Element]]:
    """Yield every sensor's stream as its elements by key."""
    if depth > _MAX_DEPTH:
        return
    for element in _elements(data):
        key, kind, *_, payload = element
        if key == b"STRM":
            yield {e[0]: e for e in _elements(payload)}
        elif kind == "":
            yield from _streams(payload, depth + 1)


def _scales(stream: dict[bytes, Element], count: int) -> list[float] | None:
    element = stream.get(b"SCAL")
    if element is None:
        return None
    letters = {"l": "i", "s": "h", "L": "I", "S": "H", "f": "f"}.get(element[1])
    if letters is None or not element[3]:
        return None
    values = [float(v) for v in struct.unpack(f">{element[3]}{letters}", element[4][: element[2] * element[3]])]
    values = values * count if len(values) == 1 else values
    return values if len(values) >= count and all(values) else None


def _of_gps5(stream: dict[bytes, Element]) -> list[GpmfFix]:
    element = stream.get(b"GPS5")
    scales = _scales(stream, 5)
    if element is None or scales is None or element[1] != "l" or element[2] != 20:
        return []
    fix = stream.get(b"GPSF")
    if fix is not None and int.from_bytes(fix[4][:4], "big") < _3D_FIX:
        return []
    dilution = stream.get(b"GPSP")
    sigma = _sigma_m(int.from_bytes(dilution[4][:2], "big") / 100.0) if dilution is not None else None
    stamp = stream.get(b"GPSU")
    utc_s = _utc_s(stamp[4]) if stamp is not None else None
    out = []
    for i, raw in enumerate(struct.iter_unpack(">5i", element[4])):
        lat, lon, alt = (v / s for v, s in zip(raw[:3], scales[:3], strict=True))
        out.append(GpmfFix(i / element[3], lat, lon, alt, sigma, utc_s if i == 0 else None))
    return out


def _of_gps9(stream: dict[bytes, Element]) -> list[GpmfFix]:
    element = stream.get(b"GPS9")
    scales = _scales(stream, 9)
    if element is None or scales is None or element[2] != 32:
        return []
    out = []
    for i, raw in enumerate(struct.iter_unpack(">7i2H", element[4])):
        lat, lon, alt, _, _, days, seconds, dilution, fix = (v / s for v, s in zip(raw, scales, strict=False))
        if fix >= _3D_FIX:
            utc_s = _DAY_2000_UNIX_S + days * 86_400.0 + seconds if days > 0 else None
            out.append(GpmfFix(i / element[3], lat, lon, alt, _sigma_m(dilution), utc_s))
    return out


def _sigma_m(dilution: float) -> float | None:
    return _METRES_PER_DILUTION * dilution if 0.0 < dilution < 50.0 else None


def _utc_s(stamp: bytes) -> float | None:
    """Read ``yymmddhhmmss.sss``."""
    text = stamp.decode("ascii", errors="replace").strip("\0 ")
    try:
        year, month, day, hour, minute = (int(text[i : i + 2]) for i in range(0, 10, 2))
        return unix_s(2000 + year, month, day, hour, minute, float(text[10:]))
    except ValueError:
        return None
