"""DJI's (and Autel's) subtitle telemetry, in all its dialects.

Every dialect is one of three families, told apart entry by entry: ``[key: value]`` brackets (Mavic 2, Air, Mini 2 and
later), ``HOME(...) date / GPS(...) BAROMETER:x`` (Mavic Pro, Phantom, Matrice 300, Autel) and the one line
``F/2.8, SS 400, ..., GPS (...), D 10m, H 20m`` (Mavic Mini, Phantom 4 RTK). Traps: ``GPS(a, b, c)`` is longitude first
in most and latitude first in Matrice 300; its third number is the count of satellites unless it has a unit or decimals;
``longtitude`` is really written so; positions repeat for many frames.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

from photomap_gis.core.frame import Attitude
from photomap_gis.ingest.options import SrtOrder
from photomap_gis.ingest.telemetry.clean import clean_points, distance_m, is_fix
from photomap_gis.ingest.telemetry.text import read_text, unix_s
from photomap_gis.ingest.telemetry.track import Clock, Track, TrackPoint

_CUE = re.compile(
    r"(\d{1,4}):(\d{1,2}):(\d{1,2})[,.:](\d{1,3})[ \t]*-->[ \t]*(\d{1,4}):(\d{1,2}):(\d{1,2})[,.:](\d{1,3})"
)
_COUNTER_THEN_DATE = re.compile(r"^[ \t]*\d{1,9}[ \t]*\n(?=[ \t]*\d{4}[-./]\d{1,2}[-./]\d{1,2}[ T])", re.MULTILINE)
_DATE = re.compile(r"(\d{4})[-./](\d{1,2})[-./](\d{1,2})[ T]+(\d{1,2}):(\d{1,2}):(\d{1,2})(?:[.,:](\d{1,6}))?(?!\d)")
_TAG = re.compile(r"<[^>\n]{0,200}>")
_NUMBER = r"[-+]?\d{1,12}(?:\.\d{0,12})?"
_PAIR = re.compile(rf"\b([A-Za-z_]{{2,24}})\s{{0,4}}:\s{{0,4}}({_NUMBER})")
_GPS = re.compile(r"\bGPS\s{0,4}\(([^()\n]{3,120})\)", re.IGNORECASE)
_HOME = re.compile(r"\bHOME\s{0,4}\(([^()\n]{3,120})\)", re.IGNORECASE)
_VALUE = re.compile(rf"([NSEW])?\s{{0,3}}:?\s{{0,3}}({_NUMBER})\s{{0,3}}([A-Za-z°]{{0,3}})", re.IGNORECASE)
_BAROMETER = re.compile(rf"\bBAROMETER\s{{0,3}}:\s{{0,3}}({_NUMBER})", re.IGNORECASE)
_HEIGHT = re.compile(rf"(?:^|[\s,])H\s{{1,3}}({_NUMBER})\s?m\b")
_DISTANCE = re.compile(rf"(?:^|[\s,])D\s{{1,3}}({_NUMBER})\s?m\b")
_GIMBAL = re.compile(rf"\bG\.PRY\s{{0,3}}\(({_NUMBER})[^\d,]{{0,4}},\s*({_NUMBER})[^\d,]{{0,4}},\s*({_NUMBER})")


@dataclass(frozen=True, slots=True)
class _Entry:
    """One subtitle as written; ``pair`` are the two numbers of ``GPS(...)`` in their order."""

    cue_s: float | None
    local_s: float | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    pair: tuple[float, float] | None = None
    home: tuple[float, float] | None = None
    pair_unit: str = ""
    satellites_third: bool = False
    home_distance_m: float | None = None
    alt_m: float | None = None
    height_m: float | None = None
    attitude: Attitude | None = None
    focal_35mm: float | None = None
    digital_zoom: float = 1.0


def looks_like_srt(head: str) -> bool:
    """Whether the beginning of a text can be that of subtitles with telemetry."""
    return bool(_CUE.search(head) or _COUNTER_THEN_DATE.search(head))


def read_srt(path: Path, *, order: SrtOrder = SrtOrder.AUTO) -> Track:
    """Return the track of a subtitle file; an empty one with a warning where it holds no position."""
    return track_of_srt(read_text(path), str(path), order=order)


def track_of_srt(text: str, source: str, *, order: SrtOrder = SrtOrder.AUTO) -> Track:
    """Return the track of a subtitle file's text."""
    return track_of_entries(_split(text), source, order=order)


def track_of_entries(
    entries: Iterable[tuple[float | None, str]], source: str, *, order: SrtOrder = SrtOrder.AUTO
) -> Track:
    """Return the track of subtitles given as (seconds since the video's start or ``None``, text)."""
    parsed = [_parse(cue_s, text) for cue_s, text in entries]
    name = Path(source).name
    warnings: list[str] = []
    timed, epoch_local_s = _on_video_clock(parsed, warnings)
    order, order_warning = _decide_order([e for _, e in timed], order)
    points, no_position = [], 0
    zoomed = False
    for time_s, e in timed:
        lat, lon = e.lat_deg, e.lon_deg
        if e.pair is not None:
            lat, lon = e.pair if order is SrtOrder.LAT_LON else (e.pair[1], e.pair[0])
        if lat is None or lon is None:
            no_position += 1
            continue
        zoomed |= e.digital_zoom != 1.0
        focal = None if e.focal_35mm is None else e.focal_35mm * e.digital_zoom
        points.append(
            TrackPoint(time_s, lat, lon, e.alt_m, e.height_m, e.attitude, focal_35mm=focal),
        )
    clean, dropped = clean_points(points)
    if order_warning and clean:
        warnings.append(f"{name}: {order_warning}")
    if zoomed:
        warnings.append(f"{name}: digital zoom was used, the field of view is uncertain; --fov-deg sets it")
    if no_position:
        warnings.append(f"{name}: {no_position} of {len(parsed)} subtitles hold no position (cut short or no fix)")
    warnings += [f"{name}: {w}" for w in dropped]
    if not clean:
        warnings.append(f"{name}: no position in these subtitles; give another log by --track FILE")
    return Track(clean, Clock.VIDEO, source, warnings=tuple(warnings), epoch_local_s=epoch_local_s)


def _split(text: str) -> list[tuple[float | None, str]]:
    """Cut a file at its cues, or where it has none at its counters."""
    cues = list(_CUE.finditer(text))
    if cues:
        ends = [c.start() for c in cues[1:]] + [len(text)]
        return [(_cue_s(c), text[c.end() : end]) for c, end in zip(cues, ends, strict=True)]
    starts = [m.end() for m in _COUNTER_THEN_DATE.finditer(text)]
    if starts:
        return [(None, text[a:b]) for a, b in zip(starts, [*starts[1:], len(text)], strict=True)]
    return [(None, text)] if text.strip() else []


def _cue_s(cue: re.Match[str]) -> float:
    hours, minutes, seconds, fraction = cue.group(1, 2, 3, 4)
    return int(hours) * 3600 + int(minutes) * 60 + int(seconds) + float(f"0.{fraction}")


def _parse(cue_s: float | None, text: str) -> _Entry:
    """Read one subtitle; every field that is not there stays ``None``."""
    text = _TAG.sub(" ", text[:4000])
    entry = _Entry(cue_s, local_s=_local_s(text))
    pairs = {key.lower(): float(value) for key, value in _PAIR.findall(text)}
    entry = replace(
        entry,
        lat_deg=pairs.get("latitude"),
        lon_deg=pairs.get("longitude", pairs.get("longtitude")),
        alt_m=pairs.get("abs_alt", pairs.get("altitude")),
        height_m=pairs.get("rel_alt"),
        focal_35mm=_focal_35mm(text, pairs),
        digital_zoom=_digital_zoom(pairs),
    )
    if "gb_pitch" in pairs:
        entry = replace(entry, attitude=_attitude(pairs["gb_pitch"], pairs.get("gb_roll", 0.0), pairs.get("gb_yaw")))
    if (gps := _GPS.search(text)) is not None:
        entry = _with_gps(entry, gps.group(1))
    if (home := _HOME.search(text)) is not None:
        values = _VALUE.findall(home.group(1))
        if len(values) >= 2:
            entry = replace(entry, home=(float(values[0][1]), float(values[1][1])))
    if (distance := _DISTANCE.search(text)) is not None:
        entry = replace(entry, home_distance_m=float(distance.group(1)))
    if entry.height_m is None and (height := _HEIGHT.search(text) or _BAROMETER.search(text)) is not None:
        entry = replace(entry, height_m=float(height.group(1)))
    if (gimbal := _GIMBAL.search(text)) is not None:
        pitch, roll, yaw = (float(v) for v in gimbal.groups())
        entry = replace(entry, attitude=_attitude(pitch, roll, yaw))
    return entry


def _with_gps(entry: _Entry, inside: str) -> _Entry:
    """Read what stands in ``GPS(...)``: letters name the axes (Autel), else the order is decided later."""
    values = _VALUE.findall(inside)
    if len(values) < 2:
        return entry
    (la, a, _), (lb, b, _) = values[:2]
    la, lb = la.upper(), lb.upper()
    third_unit = values[2][2].lower() if len(values) > 2 else ""
    has_decimals = len(values) > 2 and "." in values[2][1]
    # The bare third number of Mavic Pro, Mini and Phantom counts satellites: 15 to 19 wherever they fly.
    if third_unit == "m" or has_decimals:
        entry = replace(entry, alt_m=float(values[2][1]))
    if la in "NS" and lb in "EW" and la and lb:
        return replace(entry, lat_deg=_signed(a, la), lon_deg=_signed(b, lb))
    if la in "EW" and lb in "NS" and la and lb:
        return replace(entry, lat_deg=_signed(b, lb), lon_deg=_signed(a, la))
    return replace(
        entry,
        pair=(float(a), float(b)),
        pair_unit=third_unit,
        satellites_third=len(values) > 2 and not third_unit and not has_decimals,
    )


def _signed(value: str, hemisphere: str) -> float:
    number = float(value)
    return -abs(number) if hemisphere in "SW" else number


def _local_s(text: str) -> float | None:
    date = _DATE.search(text)
    if date is None:
        return None
    year, month, day, hour, minute, second = (int(v) for v in date.groups()[:6])
    fraction = date.group(7)
    return unix_s(year, month, day, hour, minute, second + (float(f"0.{fraction}") if fraction else 0.0))


def _focal_35mm(text: str, pairs: dict[str, float]) -> float | None:
    """``focal_len`` is the 35 mm equivalent: 24.00 in some firmware, 240 (tenths) in others."""
    value = pairs.get("focal_len")
    if value is None or value <= 0:
        return None
    written = re.search(r"focal_len\s*:\s*(\d+(\.\d+)?)", text)
    tenths = written is not None and written.group(2) is None and value >= 100
    return value / 10.0 if tenths else value


def _digital_zoom(pairs: dict[str, float]) -> float:
    ratio = pairs.get("dzoom_ratio", pairs.get("dzoom", 1.0))
    ratio = ratio / 10_000.0 if ratio >= 1000 else ratio
    return ratio if 1.0 < ratio <= 100.0 else 1.0


def _attitude(pitch_deg: float, roll_deg: float, yaw_deg: float | None) -> Attitude | None:
    if yaw_deg is None or abs(pitch_deg) > 360 or abs(roll_deg) > 360 or abs(yaw_deg) > 720:
        return None
    return Attitude(math.radians(yaw_deg), math.radians(pitch_deg), math.radians(roll_deg))


def _on_video_clock(entries: list[_Entry], warnings: list[str]) -> tuple[list[tuple[float, _Entry]], float | None]:
    """Give each entry its second of the video; also when the video began on the wall clock."""
    if entries and all(e.cue_s is None for e in entries):
        # A file without cues: its wall clock counts, or, where that stands still, one entry a second.
        first = next((e.local_s for e in entries if e.local_s is not None), None)
        entries = [
            replace(e, cue_s=float(i) if first is None or e.local_s is None else e.local_s - first)
            for i, e in enumerate(entries)
        ]
    timed: list[tuple[float, _Entry]] = []
    backwards = 0
    for e in entries:
        if e.cue_s is None:
            continue
        if timed and e.cue_s <= timed[-1][0]:
            backwards += e.cue_s < timed[-1][0]  # a second that is written twice is a clock's rounding, no fault
            continue
        timed.append((e.cue_s, e))
    if backwards:
        warnings.append(f"{backwards} subtitles whose time does not advance were left out")
    starts = [e.local_s - t for t, e in timed if e.local_s is not None]
    return timed, median(starts) if starts else None


def _decide_order(entries: list[_Entry], wanted: SrtOrder) -> tuple[SrtOrder, str | None]:
    """Decide how ``GPS(a, b, c)`` is to be read; also what to tell the user where that is a guess."""
    pairs = [e for e in entries if e.pair is not None and is_fix(0.0, e.pair[0]) and is_fix(0.0, e.pair[1])]
    if wanted is not SrtOrder.AUTO or not pairs:
        return (SrtOrder.LON_LAT if wanted is SrtOrder.AUTO else wanted), None
    # A latitude beyond 90 degrees cannot be: this is proof. One damaged line is not.
    first_is_lon = sum(abs(e.pair[0]) > 90.0 >= abs(e.pair[1]) for e in pairs if e.pair)
    second_is_lon = sum(abs(e.pair[1]) > 90.0 >= abs(e.pair[0]) for e in pairs if e.pair)
    if max(first_is_lon, second_is_lon) > len(pairs) / 2:
        return (SrtOrder.LON_LAT if first_is_lon > second_is_lon else SrtOrder.LAT_LON), None
    by_distance = _order_by_home_distance(pairs)
    if by_distance is not None:
        return by_distance, None
    if any(e.pair_unit == "m" for e in pairs):
        return SrtOrder.LAT_LON, None  # Matrice 300
    if any(e.home is not None or e.satellites_third for e in pairs):
        return SrtOrder.LON_LAT, None  # Mavic Pro, Mini, Phantom
    return SrtOrder.LON_LAT, (
        "whether GPS(a, b) is longitude or latitude first is a guess (longitude first); --srt-order lat-lon turns it"
    )


def _order_by_home_distance(entries: list[_Entry]) -> SrtOrder | None:
    """Compare the reported distance from home with both readings; ``None`` where they do not tell apart."""
    errors = {SrtOrder.LON_LAT: 0.0, SrtOrder.LAT_LON: 0.0}
    for e in entries:
        if e.home is None or e.pair is None or not e.home_distance_m or e.home_distance_m < 20.0:
            continue
        (a, b), (home_a, home_b) = e.pair, e.home
        if max(abs(a), abs(b), abs(home_a), abs(home_b)) > 90.0:
            continue
        ground = {
            SrtOrder.LON_LAT: distance_m(b, a, home_b, home_a),
            SrtOrder.LAT_LON: distance_m(a, b, home_a, home_b),
        }
        for order, metres in ground.items():
            # D is the slant range in some firmware: compare with both and take the better.
            slant = math.hypot(metres, e.height_m or 0.0)
            errors[order] += min(abs(metres - e.home_distance_m), abs(slant - e.home_distance_m)) / e.home_distance_m
    good, bad = sorted(errors, key=lambda o: errors[o])
    return good if errors[bad] > 0.0 and errors[good] < errors[bad] / 4.0 else None
