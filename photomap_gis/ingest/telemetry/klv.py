"""MISB ST 0601 metadata (KLV) of military and survey video: bytes in, points of a track out.

A packet is a 16-byte key, a BER length and a set of tag, length, value; its last element is a checksum over everything
before it. Angles are integers scaled to a tag's range. The camera's attitude is the platform's (heading, pitch, roll)
followed by the sensor's relative azimuth, elevation and roll about the platform's axes.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import Attitude
from photomap_gis.ingest.telemetry.clean import clean_points
from photomap_gis.ingest.telemetry.rotations import attitudes_of_quaternions, multiply, quaternions_of_euler
from photomap_gis.ingest.telemetry.track import Clock, Track, TrackPoint

UAS_KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
_MAX_PACKET_BYTES = 1 << 20
_SIGMA_YAW_RAD = math.radians(3.0)  # an inertial platform, not a magnetic compass

# Tag -> (name, bytes, signed, low, high): a linear scale from the integer's whole range.
_SCALED: dict[int, tuple[str, int, bool, float, float]] = {
    5: ("heading_deg", 2, False, 0.0, 360.0),
    6: ("pitch_deg", 2, True, -20.0, 20.0),
    7: ("roll_deg", 2, True, -50.0, 50.0),
    13: ("lat_deg", 4, True, -90.0, 90.0),
    14: ("lon_deg", 4, True, -180.0, 180.0),
    15: ("alt_m", 2, False, -900.0, 19_000.0),
    16: ("hfov_deg", 2, False, 0.0, 180.0),
    18: ("sensor_azimuth_deg", 4, False, 0.0, 360.0),
    19: ("sensor_elevation_deg", 4, True, -180.0, 180.0),
    20: ("sensor_roll_deg", 4, False, 0.0, 360.0),
    25: ("centre_elevation_m", 2, False, -900.0, 19_000.0),
    75: ("ellipsoid_alt_m", 2, False, -900.0, 19_000.0),
    78: ("centre_ellipsoid_m", 2, False, -900.0, 19_000.0),
    90: ("pitch_full_deg", 4, True, -90.0, 90.0),
    91: ("roll_full_deg", 4, True, -90.0, 90.0),
}
_CHECKSUM_TAG, _TIME_TAG = 1, 2


@dataclass(frozen=True, slots=True)
class KlvPacket:
    """The wanted elements of one packet: ``utc_s`` and values by name (see ``_SCALED``), absent where not sent."""

    utc_s: float | None
    values: Mapping[str, float]


def packets_of(data: bytes) -> Iterator[KlvPacket | None]:
    """Yield the ST 0601 packets in a stream of bytes; ``None`` for one that is damaged or cut short."""
    at = data.find(UAS_KEY)
    while at >= 0:
        end = None
        length = _ber_length(data, at + 16)
        if length is not None:
            size, body = length
            if size <= _MAX_PACKET_BYTES and body + size <= len(data):
                end = body + size
        packet = None if end is None else _packet(data[at:end], body - at)
        yield packet
        # After damage the next key may lie inside what the length claimed.
        at = data.find(UAS_KEY, at + 16 if packet is None or end is None else end)


def _ber_length(data: bytes, at: int) -> tuple[int, int] | None:
    """Return (length, offset behind it) of a BER length, ``None`` where the data ends."""
    if at >= len(data):
        return None
    first = data[at]
    if first < 0x80:
        return first, at + 1
    count = first & 0x7F
    if count == 0 or count > 4 or at + 1 + count > len(data):
        return None
    return int.from_bytes(data[at + 1 : at + 1 + count], "big"), at + 1 + count


def checksum(packet: bytes) -> int:
    """Return the 16-bit running sum of ST 0601 over a packet without its last two bytes."""
    body = packet[:-2]
    if len(body) % 2:
        body += b"\0"
    words: tuple[int, ...] = struct.unpack(f">{len(body) // 2}H", body)
    return sum(words) & 0xFFFF


def _packet(packet: bytes, body: int) -> KlvPacket | None:
    """Decode one whole packet; ``None`` where its checksum does not hold."""
    values: dict[str, float] = {}
    utc_s: float | None = None
    checked = False
    at = body
    while at < len(packet):
        tag, at = _ber_oid(packet, at)
        length = _ber_length(packet, at)
        if length is None or length[1] + length[0] > len(packet):
            return None
        size, at = length
        value = packet[at : at + size]
        at += size
        if tag == _TIME_TAG and size == 8:
            utc_s = int.from_bytes(value, "big") / 1e6
        elif tag == _CHECKSUM_TAG and size == 2:
            if at != len(packet) or int.from_bytes(value, "big") != checksum(packet):
                return None
            checked = True
        elif tag in _SCALED and (number := _scaled(tag, value)) is not None:
            values[_SCALED[tag][0]] = number
    return KlvPacket(utc_s, values) if checked or utc_s is not None else None


def _ber_oid(data: bytes, at: int) -> tuple[int, int]:
    tag = 0
    while at < len(data):
        tag = tag << 7 | data[at] & 0x7F
        at += 1
        if not data[at - 1] & 0x80:
            break
    return tag, at


def _scaled(tag: int, value: bytes) -> float | None:
    """Return a scaled element's number; ``None`` for a wrong size or the reserved 'out of range'."""
    _, size, signed, low, high = _SCALED[tag]
    if len(value) != size:
        return None
    number = int.from_bytes(value, "big", signed=signed)
    if not signed:
        return low + (high - low) * number / ((1 << 8 * size) - 1)
    limit = (1 << 8 * size - 1) - 1
    return None if number < -limit else (low + high) / 2 + (high - low) / 2 * number / limit


def track_of_packets(packets: list[tuple[float | None, KlvPacket | None]], source: str) -> Track:
    """Return the track of packets, each with its second of the video or ``None``.

    With seconds of the video the clock is the video's, and the packets' own times tell when that began; without, UTC.
    """
    name = Path(source).name
    damaged = sum(p is None for _, p in packets)
    good = [(s, p) for s, p in packets if p is not None]
    on_video = bool(good) and sum(s is not None for s, _ in good) > len(good) / 2
    starts = [p.utc_s - s for s, p in good if p.utc_s is not None and s is not None]
    timed = [(s if on_video else p.utc_s, p) for s, p in good]
    usable = [(t, p) for t, p in timed if t is not None and "lat_deg" in p.values and "lon_deg" in p.values]
    attitudes = _attitudes([p for _, p in usable])
    points, dropped = clean_points(
        TrackPoint(
            t,
            p.values["lat_deg"],
            p.values["lon_deg"],
            alt_m=p.values.get("alt_m", p.values.get("ellipsoid_alt_m")),
            height_m=_height_m(p.values),
            attitude=attitude,
            hfov_rad=math.radians(p.values["hfov_deg"]) if p.values.get("hfov_deg", 0.0) > 0 else None,
        )
        for (t, p), attitude in zip(usable, attitudes, strict=True)
    )
    warnings = [f"{name}: {damaged} damaged metadata packets were left out"] if damaged else []
    warnings += [f"{name}: {w}" for w in dropped]
    if not points:
        raise DataError(f"{source}: its metadata holds no positions; give another log by --track FILE")
    epoch = float(np.median(starts)) if starts and on_video else None
    if epoch is not None and epoch < 1e8:
        epoch = None  # a clock that was never set
    clock = Clock.VIDEO if on_video else Clock.UTC if points[0].time_s > 1e8 else Clock.BOOT
    return Track(points, clock, source, warnings=tuple(warnings), epoch_utc_s=epoch)


def read_klv(path: Path) -> Track:
    """Return the track of a bare KLV file (what a demuxer writes); its times are the packets' own."""
    try:
        if path.stat().st_size > 1 << 30:
            raise DataError(f"{path}: more than 1 GB of metadata is no flight; cut out what you need")
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error}); check the path and its rights") from error
    return track_of_packets([(None, p) for p in packets_of(data)], str(path))


def _height_m(values: Mapping[str, float]) -> float | None:
    """Height above the ground in the frame's centre; both numbers must have the same datum."""
    for top, ground in (("alt_m", "centre_elevation_m"), ("ellipsoid_alt_m", "centre_ellipsoid_m")):
        if top in values and ground in values and values[top] > values[ground]:
            return values[top] - values[ground]
    return None


def _attitudes(packets: list[KlvPacket]) -> list[Attitude | None]:
    """Return the camera's attitude per packet, ``None`` where the platform's or the sensor's angles are missing."""
    if not packets:
        return []

    def column(*names: str) -> np.ndarray:
        return np.radians([next((p.values[n] for n in names if n in p.values), math.nan) for p in packets])

    platform = quaternions_of_euler(
        column("heading_deg"), column("pitch_full_deg", "pitch_deg"), column("roll_full_deg", "roll_deg")
    )
    sensor = quaternions_of_euler(
        column("sensor_azimuth_deg"), column("sensor_elevation_deg"), np.nan_to_num(column("sensor_roll_deg"))
    )
    return attitudes_of_quaternions(multiply(platform, sensor), sigma_yaw_rad=_SIGMA_YAW_RAD)
