"""Photos as a drone's card holds them: JPEG with EXIF, and DJI's XMP for height and gimbal."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta, timezone
from fractions import Fraction
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

from photomap_gis.core.camera import Camera
from photomap_gis.core.frame import GpsFix, ImageArray
from photomap_gis.simulate.flight import Shot
from photomap_gis.simulate.spec import FlightSpec

SENSOR_WIDTH_MM = 6.4
LOCAL_ZONE = timezone(timedelta(hours=2))
"""The camera's clock runs in local time, as cameras' clocks do; the GPS stamp is UTC."""


def write_photo(path: Path, image: ImageArray, shot: Shot, spec: FlightSpec) -> None:
    """Write one photo, ``(H, W, 3)`` BGR or ``(H, W)`` grey, with what the flight reports of it."""
    stored = image if image.ndim == 2 else np.ascontiguousarray(image[..., ::-1])
    Image.fromarray(stored).save(
        path,
        "JPEG",
        quality=spec.imaging.jpeg_quality,
        exif=photo_exif(shot, spec).tobytes(),
        xmp=photo_xmp(shot, spec).encode("utf-8"),
    )


def photo_exif(shot: Shot, spec: FlightSpec) -> Image.Exif:
    """Return the EXIF block: camera, lens, local time with its offset, GPS position and UTC time."""
    camera, base, tag = spec.camera, ExifTags.Base, ExifTags.Base
    utc = datetime.fromtimestamp(shot.time_s, UTC)
    local = utc.astimezone(LOCAL_ZONE)
    stamp = local.strftime("%Y:%m:%d %H:%M:%S")
    exif = Image.Exif()
    exif[base.Make], exif[base.Model] = "photomap", "simulated thermal" if spec.imaging.thermal else "simulated"
    exif[base.Orientation], exif[base.DateTime] = 1, stamp
    detail = exif.get_ifd(ExifTags.IFD.Exif)
    detail[tag.DateTimeOriginal] = detail[tag.DateTimeDigitized] = stamp
    detail[tag.OffsetTimeOriginal] = detail[tag.OffsetTime] = local.strftime("%z")[:3] + ":" + local.strftime("%z")[3:]
    detail[tag.SubsecTimeOriginal] = f"{local.microsecond // 1000:03d}"
    detail[tag.ExifImageWidth], detail[tag.ExifImageHeight] = camera.width_px, camera.height_px
    focal = camera.focal_px or 1.0
    detail[tag.FocalLength] = _rational(focal * SENSOR_WIDTH_MM / camera.width_px, 1000)
    detail[tag.FocalLengthIn35mmFilm] = max(1, round(spec.focal_35mm))
    if spec.report_calibration:
        per_cm = camera.width_px / SENSOR_WIDTH_MM * 10.0
        detail[tag.FocalPlaneXResolution] = detail[tag.FocalPlaneYResolution] = _rational(per_cm, 1000)
        detail[tag.FocalPlaneResolutionUnit] = 3
    detail[tag.ExposureTime] = _rational(max(spec.imaging.exposure_ms, 0.01) / 1000.0, 1_000_000)
    if shot.fix is not None:
        exif.get_ifd(ExifTags.IFD.GPSInfo).update(_gps_ifd(shot.fix, utc))
    return exif


def photo_xmp(shot: Shot, spec: FlightSpec) -> str:
    """Return the XMP packet in DJI's namespace: signed decimals, as the drones write them."""
    values: list[tuple[str, str]] = []
    if shot.fix is not None:
        values += [("GpsLatitude", f"{shot.fix.lat_deg:+.7f}"), ("GpsLongitude", f"{shot.fix.lon_deg:+.7f}")]
        if shot.fix.alt_m is not None:
            values.append(("AbsoluteAltitude", f"{shot.fix.alt_m:+.2f}"))
    if shot.relative_height_m is not None:
        values.append(("RelativeAltitude", f"{shot.relative_height_m:+.2f}"))
    if shot.attitude is not None:
        for name, angle in (
            ("GimbalRollDegree", shot.attitude.roll_rad),
            ("GimbalYawDegree", shot.attitude.yaw_rad),
            ("GimbalPitchDegree", shot.attitude.pitch_rad),
        ):
            values.append((name, f"{math.degrees(angle):+.2f}"))
    if spec.report_calibration:
        values.append(("CalibratedFocalLength", f"{_focal(spec.camera):.6f}"))
    attributes = "\n".join(f'   drone-dji:{name}="{value}"' for name, value in values)
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n'
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">\n'
        ' <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
        '  <rdf:Description rdf:about="" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"\n'
        f"{attributes}/>\n </rdf:RDF>\n</x:xmpmeta>\n"
        '<?xpacket end="w"?>'
    )


def _gps_ifd(fix: GpsFix, utc: datetime) -> dict[int, object]:
    gps = ExifTags.GPS
    seconds = utc.second + utc.microsecond / 1e6
    block: dict[int, object] = {
        gps.GPSVersionID: b"\x02\x03\x00\x00",
        gps.GPSLatitudeRef: "N" if fix.lat_deg >= 0 else "S",
        gps.GPSLatitude: _dms(fix.lat_deg),
        gps.GPSLongitudeRef: "E" if fix.lon_deg >= 0 else "W",
        gps.GPSLongitude: _dms(fix.lon_deg),
        gps.GPSTimeStamp: (IFDRational(utc.hour), IFDRational(utc.minute), _rational(seconds, 1000)),
        gps.GPSDateStamp: utc.strftime("%Y:%m:%d"),
        gps.GPSMapDatum: "WGS-84",
    }
    if fix.alt_m is not None:
        block[gps.GPSAltitudeRef] = b"\x00" if fix.alt_m >= 0 else b"\x01"
        block[gps.GPSAltitude] = _rational(abs(fix.alt_m), 1000)
    return block


def _dms(degrees: float) -> tuple[IFDRational, IFDRational, IFDRational]:
    """Degrees, minutes, seconds; a ten-thousandth of a second is 3 mm."""
    units = round(abs(degrees) * 3600 * 10_000)
    return (
        IFDRational(units // 36_000_000),
        IFDRational(units // 600_000 % 60),
        IFDRational(units % 600_000, 10_000),
    )


def _rational(value: float, denominator: int) -> IFDRational:
    f = Fraction(round(value * denominator), denominator)
    return IFDRational(f.numerator, f.denominator)


def _focal(camera: Camera) -> float:
    return camera.focal_px or 0.0
