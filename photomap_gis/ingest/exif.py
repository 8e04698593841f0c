"""EXIF tags become facts: which camera, which lens, when, where. Every trap of the format ends here.

Traps [EXIF 2.32, section 4.6]: rationals with a zero denominator (no value); a latitude without its hemisphere; the
altitude's sign in a tag of its own; the GPS clock is UTC while ``DateTimeOriginal`` is local time; 0, 0 means no fix.
"""

from __future__ import annotations

import calendar
import re
from dataclasses import dataclass

from photomap_gis.ingest.tiff_tags import Rational, TagValue, TiffTags, number, text

_DATE_TIME = re.compile(r"(\d{4})[:\-/.](\d{1,2})[:\-/.](\d{1,2})[ T]+(\d{1,2}):(\d{1,2}):(\d{1,2})(?:\.(\d+))?")
_DATE = re.compile(r"(\d{4})[:\-/.](\d{1,2})[:\-/.](\d{1,2})")
_OFFSET = re.compile(r"([+\-])(\d{1,2}):?(\d{2})")
_MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}  # FocalPlaneResolutionUnit: inch, cm, mm, um


@dataclass(frozen=True, slots=True)
class ExifFacts:
    """What a photo's EXIF says, ``None`` or empty where it says nothing usable.

    ``local_s`` is ``DateTimeOriginal`` read as if it were UTC, sub-seconds included (``has_subsec``);
    ``utc_offset_s`` is what must be subtracted from it. ``gps_s`` is the GPS receiver's UTC. ``step_deg`` is the
    step in which latitude and longitude are written. ``full_width_px`` and ``full_height_px`` are the raster's
    size when the camera wrote it; ``focal_plane_px_per_mm`` is the pixel density of that raster on the sensor.
    """

    make: str = ""
    model: str = ""
    serial: str = ""
    orientation: int = 1
    full_width_px: int | None = None
    full_height_px: int | None = None
    focal_mm: float | None = None
    focal_35mm: float | None = None
    digital_zoom: float = 1.0
    focal_plane_px_per_mm: float | None = None
    local_s: float | None = None
    has_subsec: bool = False
    utc_offset_s: float | None = None
    gps_s: float | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    step_deg: float = 0.0
    alt_m: float | None = None
    sigma_m: float | None = None


def read_exif(tags: TiffTags) -> ExifFacts:
    """Return the facts of a photo's tags."""
    main, exif, gps = tags.main, tags.exif, tags.gps
    local_s, has_subsec = _local_time(tags)
    width, height = number(exif.get(0xA002)), number(exif.get(0xA003))
    lat, lon = _angle(gps.get(2), gps.get(1), "NS", 90.0), _angle(gps.get(4), gps.get(3), "EW", 180.0)
    if lat is None or lon is None or (lat == 0.0 and lon == 0.0):
        lat = lon = None
    if text(gps.get(9)).upper() == "V":  # GPSStatus: the receiver warns that this is no fix
        lat = lon = None
    zoom = _positive(exif.get(0xA404), 1.0, 200.0)
    return ExifFacts(
        make=text(main.get(0x10F)),
        model=text(main.get(0x110)),
        serial=text(exif.get(0xA431)) or text(main.get(0xC62F)),
        orientation=int(number(main.get(0x112)) or 1),
        full_width_px=int(width) if width and 0 < width < 1e6 else None,
        full_height_px=int(height) if height and 0 < height < 1e6 else None,
        focal_mm=_positive(exif.get(0x920A), 0.5, 3000.0),
        focal_35mm=_positive(exif.get(0xA405), 3.0, 6000.0),
        digital_zoom=zoom or 1.0,
        focal_plane_px_per_mm=_focal_plane(exif.get(0xA20E), exif.get(0xA210)),
        local_s=local_s,
        has_subsec=has_subsec,
        utc_offset_s=_utc_offset(tags),
        gps_s=_gps_time(gps.get(29), gps.get(7)),
        lat_deg=lat,
        lon_deg=lon,
        step_deg=max(_step(gps.get(2)), _step(gps.get(4))) if lat is not None else 0.0,
        alt_m=_altitude(gps.get(6), gps.get(5)),
        sigma_m=_positive(gps.get(31), 1e-3, 1e4),
    )


def parse_date_time(words: str) -> tuple[float, bool] | None:
    """Return a date and time as Unix seconds, as if it were UTC, and whether it has a fraction; else ``None``."""
    found = _DATE_TIME.search(words)
    if found is None:
        return None
    year, month, day, hour, minute, second = (int(g) for g in found.groups()[:6])
    if not (1980 <= year <= 2200 and 1 <= month <= 12 and 1 <= day <= 31):  # "0000:00:00", clocks never set
        return None
    if hour > 23 or minute > 59 or second > 60:
        return None
    fraction = found.group(7)
    seconds = float(calendar.timegm((year, month, day, hour, minute, second, 0, 0, 0)))
    return seconds + (float("0." + fraction) if fraction else 0.0), bool(fraction)


def _local_time(tags: TiffTags) -> tuple[float | None, bool]:
    """Return the shutter's local time: original, digitised, then the file's, each with its own sub-second tag."""
    for stamp, subsec in (
        (tags.exif.get(0x9003), tags.exif.get(0x9291)),
        (tags.exif.get(0x9004), tags.exif.get(0x9292)),
        (tags.main.get(0x132), tags.exif.get(0x9290)),
    ):
        parsed = parse_date_time(text(stamp))
        if parsed is not None:
            digits = text(subsec)
            if digits.isdigit() and not parsed[1]:
                return parsed[0] + float("0." + digits[:9]), True
            return parsed
    return None, False


def _utc_offset(tags: TiffTags) -> float | None:
    """Return what local time is ahead of UTC, in seconds; the sign holds for the minutes too."""
    for tag in (0x9011, 0x9012, 0x9010):
        found = _OFFSET.fullmatch(text(tags.exif.get(tag)).strip())
        if found and int(found.group(2)) <= 14 and int(found.group(3)) < 60:
            seconds = 3600.0 * int(found.group(2)) + 60.0 * int(found.group(3))
            return -seconds if found.group(1) == "-" else seconds
    return None


def _gps_time(date: TagValue | None, clock: TagValue | None) -> float | None:
    found = _DATE.search(text(date))
    parts = [number(clock, i) for i in range(3)]
    if found is None or any(p is None for p in parts):
        return None
    year, month, day = (int(g) for g in found.groups())
    hour, minute, second = (p for p in parts if p is not None)
    if not (1980 < year <= 2200 and 1 <= month <= 12 and 1 <= day <= 31):  # 1980 is a receiver without a fix
        return None
    if not (0 <= hour < 24 and 0 <= minute < 60 and 0 <= second < 61):
        return None
    return calendar.timegm((year, month, day, 0, 0, 0, 0, 0, 0)) + 3600.0 * hour + 60.0 * minute + second


def _angle(value: TagValue | None, ref: TagValue | None, letters: str, limit: float) -> float | None:
    """Return degrees from degrees, minutes, seconds; without a hemisphere the sign of the number itself holds."""
    parts = [number(value, i) for i in range(3)]
    if parts[0] is None:
        return None
    if isinstance(value, tuple) and any(isinstance(v, Rational) and v.denominator == 0 for v in value[:1]):
        return None
    degrees = abs(parts[0]) + (parts[1] or 0.0) / 60.0 + (parts[2] or 0.0) / 3600.0
    hemisphere = text(ref).upper()[:1]
    negative = hemisphere == letters[1] or (hemisphere != letters[0] and parts[0] < 0)
    return None if degrees > limit else -degrees if negative else degrees


def _step(value: TagValue | None) -> float:
    """Return the step in degrees in which an angle is written: its finest denominator that is in use."""
    if not isinstance(value, tuple):
        return 0.0
    steps = [
        unit / part.denominator
        for unit, part in zip((1.0, 1 / 60.0, 1 / 3600.0), value, strict=False)
        if isinstance(part, Rational) and part.denominator > 0 and (part.numerator > 0 or part.denominator > 1)
    ]
    return min(steps) if steps else 0.0


def _altitude(value: TagValue | None, ref: TagValue | None) -> float | None:
    altitude = number(value)
    if altitude is None or abs(altitude) > 1e5:
        return None
    return -abs(altitude) if number(ref) == 1.0 else altitude


def _focal_plane(resolution: TagValue | None, unit: TagValue | None) -> float | None:
    density = number(resolution)
    per = _MM_PER_UNIT.get(int(number(unit) or 2))
    if density is None or density <= 0 or per is None:
        return None
    px_per_mm = density / per
    return px_per_mm if 10.0 < px_per_mm < 5000.0 else None


def _positive(value: TagValue | None, low: float, high: float) -> float | None:
    found = number(value)
    return found if found is not None and low <= found <= high else None
