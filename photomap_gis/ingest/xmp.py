"""The XMP packets of drones become facts: position, height, where the camera looks, how the lens was calibrated.

Makers write the same facts as attributes or as elements, in their own namespaces, with leading plus signs and with
spelling mistakes that have become standards. Names are matched without their namespace, makers in a fixed order.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element, ParseError

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import fromstring

from photomap_gis.core.frame import Attitude

MAX_PACKET_BYTES = 1 << 20
_LEAF = re.compile(r"\{([^}]*)\}(.*)")
_RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"


@dataclass(frozen=True, slots=True)
class Calibration:
    """A maker's lens calibration in pixels of the camera's full raster; ``radial`` is Brown's k1, k2, k3.

    The centre counts from the raster's corner and is ``None`` where it is not given; so is the focal length.
    """

    focal_px: float
    centre_xy_px: tuple[float, float] | None = None
    centre_offset_xy_px: tuple[float, float] | None = None
    radial: tuple[float, float, float] = (0.0, 0.0, 0.0)
    origin: str = "xmp"


@dataclass(frozen=True, slots=True)
class XmpFacts:
    """What a photo's XMP says, ``None`` or empty where it says nothing usable.

    ``height_m`` is above take-off (or ground); ``alt_m`` has an uncertain datum. ``sigma_m`` is per axis.
    ``source`` is the maker's word for which of several cameras took the photo.
    """

    make: str = ""
    model: str = ""
    serial: str = ""
    source: str = ""
    band: str = ""
    created: str = ""
    utc_at_exposure: str = ""
    lat_deg: float | None = None
    lon_deg: float | None = None
    alt_m: float | None = None
    height_m: float | None = None
    sigma_m: float | None = None
    attitude: Attitude | None = None
    calibrations: tuple[Calibration, ...] = ()


def read_xmp(packet: bytes, make: str = "") -> XmpFacts:
    """Return the facts of an XMP packet; the empty facts where it is none. ``make`` is the EXIF's, for conventions."""
    values = _flatten(packet)
    if not values:
        return XmpFacts()
    get = _Getter(values)
    make = make or get.text("Make")
    lat, lon = _position(get)
    return XmpFacts(
        make=get.text("Make"),
        model=get.text("Model"),
        serial=get.text("DroneSerialNumber", "CameraSerialNumber", "SerialNumber"),
        source=get.text("ImageSource"),
        band=get.text("BandName"),
        created=get.text("DateTimeOriginal", "CreateDate"),
        utc_at_exposure=get.text("UTCAtExposure"),
        lat_deg=lat,
        lon_deg=lon,
        alt_m=get.number("AbsoluteAltitude", limit=1e5),
        height_m=_height(get),
        sigma_m=_sigma(get),
        attitude=_attitude(get, make),
        calibrations=_calibrations(get),
    )


class _Getter:
    """Looks values up by local names, first name first; a value object, not a dictionary with known keys."""

    def __init__(self, values: Mapping[str, str]) -> None:
        self._values = values

    def text(self, *names: str) -> str:
        return next((self._values[n] for n in names if self._values.get(n)), "")

    def number(self, *names: str, limit: float) -> float | None:
        for name in names:
            found = parse_number(self._values.get(name, ""))
            if found is not None and abs(found) <= limit:
                return found
        return None

    def angles(self, yaw: str, pitch: str, roll: str) -> tuple[float, float, float] | None:
        """Yaw, pitch, roll in degrees; a missing roll is level, exact zeros throughout mean that nothing was known."""
        y, p, r = (self.number(n, limit=720.0) for n in (yaw, pitch, roll))
        if y is None or p is None:
            return None
        r = r or 0.0
        return None if y == p == r == 0.0 else (y, p, r)


def parse_number(words: str) -> float | None:
    """Return a number written with a leading plus, a fraction bar or a trailing unit; ``None`` if it is none."""
    found = re.match(r"\s*([+\-]?\d*\.?\d+(?:[eE][+\-]?\d+)?)(?:\s*/\s*(\d+))?", words)
    if found is None:
        return None
    value, under = float(found.group(1)), found.group(2)
    if under is not None:
        if int(under) == 0:
            return None
        value /= int(under)
    return value if math.isfinite(value) else None


def _flatten(packet: bytes) -> dict[str, str]:
    """Return every leaf of the packet by its local name, structures as ``Outer.Inner``; first come, first kept."""
    start, end = packet.find(b"<x:xmpmeta"), packet.rfind(b"</x:xmpmeta>")
    if start < 0:
        start, end = packet.find(b"<rdf:RDF"), packet.rfind(b"</rdf:RDF>")
        closing = b"</rdf:RDF>"
    else:
        closing = b"</x:xmpmeta>"
    if start < 0 or end < start or end - start > MAX_PACKET_BYTES:
        return {}
    try:
        root = fromstring(packet[start : end + len(closing)], forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError, LookupError):
        return {}
    values: dict[str, str] = {}
    for rdf in root.iter(f"{{{_RDF}}}RDF"):
        for description in rdf:
            _collect(description, "", values, 0)
    return values


def _collect(element: Element, outer: str, values: dict[str, str], depth: int) -> None:
    for key, value in element.attrib.items():
        namespace, name = _split(key)
        if namespace != _RDF and value.strip():
            values.setdefault(outer + name, value.strip())
    if depth > 8:
        return
    for child in element:
        if not isinstance(child.tag, str):
            continue
        namespace, name = _split(child.tag)
        if namespace == _RDF and name in ("Seq", "Bag", "Alt"):  # the items of a list are one value
            items = [item.text.strip() for item in child if item.text and item.text.strip()]
            if items and outer:
                values.setdefault(outer.rstrip("."), ", ".join(items))
        inner = outer if namespace == _RDF else f"{outer}{name}."
        if namespace != _RDF and len(child) == 0 and child.text and child.text.strip():
            values.setdefault(outer + name, child.text.strip())
        _collect(child, inner, values, depth + 1)


def _split(tag: str) -> tuple[str, str]:
    found = _LEAF.fullmatch(tag)
    return (found.group(1), found.group(2)) if found else ("", tag)


def _position(get: _Getter) -> tuple[float | None, float | None]:
    lat = get.number("GpsLatitude", "GPSLatitude", "Latitude", limit=90.0)
    # DJI and Autel write "GpsLongtitude"; later firmware mends it
    lon = get.number("GpsLongtitude", "GpsLongitude", "GPSLongtitude", "Longitude", limit=180.0)
    if lat is None or lon is None or (lat == 0.0 and lon == 0.0):
        return None, None
    # exif:GPSLatitude "52,24.5N" is another dialect, and EXIF proper holds it too
    if "," in get.text("GpsLatitude", "GPSLatitude", "Latitude"):
        return None, None
    return lat, lon


def _height(get: _Getter) -> float | None:
    height = get.number("RelativeAltitude", "AboveGroundAltitude", "HeightAboveTakeoff", limit=2e4)
    # at or below take-off it says nothing of the scale, and 0 is what a barometer writes that was never read
    return height if height is not None and height > 0.0 else None


def _sigma(get: _Getter) -> float | None:
    """Return the reported horizontal sigma: RTK's where the solution is fixed or floating, else a stated accuracy."""
    lon, lat = get.number("RtkStdLon", limit=1e3), get.number("RtkStdLat", limit=1e3)
    flag = get.number("RtkFlag", limit=1e3)
    if lon is not None and lat is not None and lon > 0 and lat > 0 and flag != 0.0:
        sigma = max(lon, lat)
        # 16 is a single-point solution, 34 a float one, 50 a fixed one [DJI Phantom 4 RTK user manual]
        return max(sigma, 0.02)
    stated = get.number("GPSXYAccuracy", limit=1e4)
    return stated if stated is not None and stated > 0 else None


def _attitude(get: _Getter, make: str) -> Attitude | None:
    """Return where the camera looks: the gimbal's angles, a camera's own, or a body's with the camera in its belly."""
    for yaw, pitch, roll in (
        ("GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree"),
        ("CameraYawDegree", "CameraPitchDegree", "CameraRollDegree"),
        ("CameraOrientationNED.Yaw", "CameraOrientationNED.Pitch", "CameraOrientationNED.Roll"),
    ):
        found = get.angles(yaw, pitch, roll)
        if found is not None:
            return _gimbal(*found)
    found = get.angles("Yaw", "Pitch", "Roll")
    if found is not None:
        # Pix4D's Camera namespace counts pitch from nadir (fixed wings); Autel counts it from the horizon
        return _gimbal(*found) if "autel" in make.lower() or found[1] <= -45.0 else _body(*found)
    found = get.angles("FlightYawDegree", "FlightPitchDegree", "FlightRollDegree")
    return None if found is None else _body(*found)


def _gimbal(yaw_deg: float, pitch_deg: float, roll_deg: float) -> Attitude:
    return Attitude(math.remainder(math.radians(yaw_deg), 2 * math.pi), math.radians(pitch_deg), math.radians(roll_deg))


def _body(yaw_deg: float, pitch_deg: float, roll_deg: float) -> Attitude:
    return Attitude.of_body_camera(
        roll_rad=math.radians(roll_deg), pitch_rad=math.radians(pitch_deg), yaw_rad=math.radians(yaw_deg)
    )


def _calibrations(get: _Getter) -> tuple[Calibration, ...]:
    found = (_dewarp(get), _calibrated(get))
    return tuple(c for c in found if c is not None)


def _dewarp(get: _Getter) -> Calibration | None:
    """Read ``DewarpData``: "date;fx,fy,cx,cy,k1,k2,p1,p2,k3", centre as an offset from the raster's middle.

    OpenCV's model [DJI P4 Multispectral Image Processing Guide]. ``DewarpFlag`` 1: the photo is straightened already.
    """
    numbers = [parse_number(w) for w in get.text("DewarpData").rpartition(";")[2].split(",")]
    values = [v for v in numbers if v is not None]
    if len(values) != 9 or not 100.0 < values[0] < 1e5:
        return None
    straightened = get.number("DewarpFlag", limit=9.0) == 1.0
    radial = (0.0, 0.0, 0.0) if straightened else (values[4], values[5], values[8])
    return Calibration(
        math.sqrt(values[0] * values[1]) if values[1] > 0 else values[0],
        centre_offset_xy_px=(values[2], values[3]),
        radial=radial,
        origin="xmp dewarp data",
    )


def _calibrated(get: _Getter) -> Calibration | None:
    focal = get.number("CalibratedFocalLength", limit=1e5)
    if focal is None or focal < 100.0:  # some firmware writes millimetres here
        return None
    x, y = get.number("CalibratedOpticalCenterX", limit=1e5), get.number("CalibratedOpticalCenterY", limit=1e5)
    centre = (x, y) if x is not None and y is not None and x > 0 and y > 0 else None
    return Calibration(focal, centre_xy_px=centre, origin="xmp calibrated focal length")
