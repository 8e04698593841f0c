"""Cursor-on-Target events (2.0) of a drone, its camera's footprint and finds: values in, XML out. Pure.

``point`` then ``detail``, as the schema of events has it. ``ce`` is the CE90 in metres, ``le`` and ``hae`` in metres,
9999999 where unknown. An event says the same thing as before where its ``uid`` is the same.
"""

from __future__ import annotations

import math
import uuid
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from xml.etree import ElementTree

DRONE_TYPE = "a-f-A-M-H-Q"
"""Friendly, air, military (the symbol set that ATAK draws), rotary wing, unmanned."""
FOOTPRINT_TYPE = "u-d-f"
FIND_TYPE = "b-m-p-s-m"
REMOVAL_TYPE = "t-x-d-d"

_UNKNOWN = "9999999.0"
_NAMESPACE = uuid.UUID("3f0c6f1e-2f0f-5b58-9f3c-0b6d1b0f7a55")
_LONGEST_TEXT = 2000
_MOST_CORNERS = 200
_STALE_MOVING = timedelta(seconds=15)
_STALE_FIND = timedelta(days=1)
_STROKE_ARGB = "-256"  # opaque yellow as the signed number that ATAK writes
_FILL_ARGB = "587202304"  # a breath of it


@dataclass(frozen=True, slots=True)
class CotDrone:
    """Where the drone is, in WGS84; ``hae_m`` is above the ellipsoid. ``None`` is unknown."""

    uid: str
    callsign: str
    lat_deg: float
    lon_deg: float
    hae_m: float | None = None
    ce90_m: float | None = None
    le90_m: float | None = None
    course_deg: float | None = None
    speed_m_s: float | None = None
    remarks: str = ""


@dataclass(frozen=True, slots=True)
class CotFootprint:
    """What the camera sees: (latitude, longitude) of the corners in order, not closed."""

    uid: str
    callsign: str
    corners: Sequence[tuple[float, float]]
    ce90_m: float | None = None


@dataclass(frozen=True, slots=True)
class CotFind:
    """Something that was found; ``seen_utc`` is when, ``argb`` its colour as the signed number that ATAK writes."""

    uid: str
    name: str
    lat_deg: float
    lon_deg: float
    ce90_m: float | None = None
    hae_m: float | None = None
    remarks: str = ""
    seen_utc: datetime | None = None
    argb: int = -65536


CotValue = CotDrone | CotFootprint | CotFind


def stable_uid(*parts: object) -> str:
    """Return an identifier that is the same whenever the parts are (mission, kind, number)."""
    return str(uuid.uuid5(_NAMESPACE, "|".join(str(p) for p in parts)))


def encode(value: CotValue, now: datetime) -> bytes:
    """Return one XML document; ``ValueError`` for a place that is none."""
    if isinstance(value, CotDrone):
        return _drone(value, now)
    if isinstance(value, CotFootprint):
        return _footprint(value, now)
    return _find(value, now)


def encode_removal(uid: str, now: datetime) -> bytes:
    """Return the event that takes another one away from the devices."""
    event, detail = _event(stable_uid("removal", uid), REMOVAL_TYPE, (0.0, 0.0), now, _STALE_MOVING, how="h-g-i-g-o")
    ElementTree.SubElement(detail, "link", uid=uid, relation="none", type="none")
    ElementTree.SubElement(detail, "__forcedelete")
    return _document(event)


def _drone(drone: CotDrone, now: datetime) -> bytes:
    event, detail = _event(
        drone.uid, DRONE_TYPE, (drone.lat_deg, drone.lon_deg), now, _STALE_MOVING,
        hae_m=drone.hae_m, ce90_m=drone.ce90_m, le90_m=drone.le90_m,
    )  # fmt: skip
    ElementTree.SubElement(detail, "contact", callsign=_clean(drone.callsign))
    course = 0.0 if drone.course_deg is None else drone.course_deg % 360.0
    if drone.course_deg is not None or drone.speed_m_s is not None:
        ElementTree.SubElement(detail, "track", course=f"{course:.1f}", speed=f"{drone.speed_m_s or 0.0:.2f}")
    ElementTree.SubElement(detail, "precisionlocation", geopointsrc="GPS", altsrc="GPS")
    if drone.remarks:
        ElementTree.SubElement(detail, "remarks").text = _clean(drone.remarks)
    return _document(event)


def _footprint(footprint: CotFootprint, now: datetime) -> bytes:
    corners = list(footprint.corners)[:_MOST_CORNERS]
    if len(corners) < 3:
        raise ValueError(f"a footprint needs at least 3 corners, got {len(corners)}")
    centre = _centre(corners)
    event, detail = _event(footprint.uid, FOOTPRINT_TYPE, centre, now, _STALE_MOVING, ce90_m=footprint.ce90_m)
    for lat, lon in (*corners, corners[0]):
        ElementTree.SubElement(detail, "link", point=f"{_lat(lat):.7f},{_lon(lon):.7f}")
    for name, value in (("strokeColor", _STROKE_ARGB), ("strokeWeight", "2.0"), ("fillColor", _FILL_ARGB)):
        ElementTree.SubElement(detail, name, value=value)
    ElementTree.SubElement(detail, "contact", callsign=_clean(footprint.callsign))
    ElementTree.SubElement(detail, "labels_on", value="false")
    return _document(event)


def _find(find: CotFind, now: datetime) -> bytes:
    event, detail = _event(
        find.uid, FIND_TYPE, (find.lat_deg, find.lon_deg), now, _STALE_FIND, hae_m=find.hae_m, ce90_m=find.ce90_m,
        how="h-e",
    )  # fmt: skip
    ElementTree.SubElement(detail, "contact", callsign=_clean(find.name) or "find")
    ElementTree.SubElement(detail, "usericon", iconsetpath=f"COT_MAPPING_SPOTMAP/{FIND_TYPE}/{find.argb}")
    ElementTree.SubElement(detail, "color", argb=str(find.argb))
    ElementTree.SubElement(detail, "archive")
    seen = "" if find.seen_utc is None else f"seen {_time(find.seen_utc)}"
    ce = "" if find.ce90_m is None else f"CE90 {find.ce90_m:.1f} m"
    ElementTree.SubElement(detail, "remarks").text = "; ".join(w for w in (_clean(find.remarks), seen, ce) if w)
    return _document(event)


def _event(
    uid: str, kind: str, lat_lon: tuple[float, float], now: datetime, valid: timedelta, *,
    hae_m: float | None = None, ce90_m: float | None = None, le90_m: float | None = None, how: str = "m-g",
) -> tuple[ElementTree.Element, ElementTree.Element]:  # fmt: skip
    event = ElementTree.Element(
        "event", version="2.0", uid=uid, type=kind, time=_time(now), start=_time(now), stale=_time(now + valid),
        how=how,
    )  # fmt: skip
    lat, lon = lat_lon
    ElementTree.SubElement(
        event, "point", lat=f"{_lat(lat):.7f}", lon=f"{_lon(lon):.7f}", hae=_metres(hae_m), ce=_metres(ce90_m),
        le=_metres(le90_m),
    )  # fmt: skip
    return event, ElementTree.SubElement(event, "detail")


def _document(event: ElementTree.Element) -> bytes:
    body: bytes = ElementTree.tostring(event, encoding="utf-8")
    return b'<?xml version="1.0" encoding="UTF-8" standalone="yes"?>\n' + body.split(b"?>\n", 1)[-1] + b"\n"


def _centre(corners: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the mean of the corners, also across the date line."""
    first_lon = corners[0][1]
    lons = [first_lon + math.remainder(lon - first_lon, 360.0) for _, lon in corners]
    lat = sum(lat for lat, _ in corners) / len(corners)
    return lat, math.remainder(sum(lons) / len(lons), 360.0)


def _lat(lat_deg: float) -> float:
    if not abs(lat_deg) <= 90.0:
        raise ValueError(f"a latitude must lie within ±90 degrees, got {lat_deg}")
    return lat_deg


def _lon(lon_deg: float) -> float:
    if not math.isfinite(lon_deg):
        raise ValueError(f"a longitude must be finite, got {lon_deg}")
    return math.remainder(lon_deg, 360.0)


def _metres(value: float | None) -> str:
    return _UNKNOWN if value is None or not math.isfinite(value) else f"{value:.2f}"


def _clean(text: str) -> str:
    """Return a text without what XML cannot hold, and not without end."""
    kept = "".join(
        c for c in text if c in "\t\n" or (c >= " " and not 0xD800 <= ord(c) <= 0xDFFF and c not in "\ufffe\uffff")
    )
    return kept[:_LONGEST_TEXT]


def _time(moment: datetime) -> str:
    utc = moment.astimezone(UTC)
    return utc.strftime("%Y-%m-%dT%H:%M:%S.") + f"{utc.microsecond // 1000:03d}Z"
