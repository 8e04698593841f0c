"""MISB ST 0601: the real stream, and packets made by hand."""

from __future__ import annotations

import math
from pathlib import Path

import av
import numpy as np
import pytest

from photomap_gis.core.errors import DataError
from photomap_gis.ingest.telemetry import Clock, read_track
from photomap_gis.ingest.telemetry.klv import UAS_KEY, checksum, packets_of


def packet(**elements: bytes) -> bytes:
    """Return a packet of tags given as t5=b'..'; time first, checksum last."""
    body = b"".join(bytes([int(k[1:]), len(v)]) + v for k, v in elements.items())
    whole = UAS_KEY + bytes([0x81, len(body) + 4]) + body + b"\x01\x02" + b"\0\0"
    return whole[:-2] + checksum(whole).to_bytes(2, "big")


def _scaled(value: float, low: float, high: float, size: int, *, signed: bool) -> bytes:
    if signed:
        return round(value / high * ((1 << 8 * size - 1) - 1)).to_bytes(size, "big", signed=True)
    return round((value - low) / (high - low) * ((1 << 8 * size) - 1)).to_bytes(size, "big")


def _flight_packet(second: float = 0.0, *, elevation: float = -90.0, heading: float = 30.0) -> bytes:
    return packet(
        t2=int((1_714_558_830 + second) * 1e6).to_bytes(8, "big"),
        t5=_scaled(heading, 0, 360, 2, signed=False),
        t6=_scaled(2.0, -20, 20, 2, signed=True),
        t7=_scaled(0.0, -50, 50, 2, signed=True),
        t13=_scaled(52.1 + second * 1e-4, -90, 90, 4, signed=True),
        t14=_scaled(9.6, -180, 180, 4, signed=True),
        t15=_scaled(300.0, -900, 19000, 2, signed=False),
        t16=_scaled(40.0, 0, 180, 2, signed=False),
        t18=_scaled(0.0, 0, 360, 4, signed=False),
        t19=_scaled(elevation, -180, 180, 4, signed=True),
        t20=_scaled(0.0, 0, 360, 4, signed=False),
        t25=_scaled(100.0, -900, 19000, 2, signed=False),
    )


def test_real_stream(shared_data: Path) -> None:
    track = read_track(shared_data / "misb_video" / "sample-stream.ts")
    assert track.clock is Clock.VIDEO
    assert len(track.points) == 277
    assert track.warnings == ()
    first, last = track.points[0], track.points[-1]
    assert (first.time_s, last.time_s) == pytest.approx((0.0, 9.2), abs=1e-6)
    assert (first.lat_deg, first.lon_deg) == pytest.approx((34.72115, -86.68913), abs=1e-5)
    assert (last.lat_deg, last.lon_deg) == pytest.approx((34.71639, -86.69108), abs=1e-5)
    assert first.alt_m == pytest.approx(3047.8, abs=0.1)
    assert first.hfov_rad is not None
    assert math.degrees(first.hfov_rad) == pytest.approx(13.0, abs=0.01)
    assert track.epoch_utc_s == pytest.approx(1340980354.1, abs=0.01)


def test_optical_axis_of_the_real_stream_meets_its_frame_centre(shared_data: Path) -> None:
    """The stream tells the frame's centre, too (tags 23 and 24, not used): the attitude must lead there."""
    path = shared_data / "misb_video" / "sample-stream.ts"
    with av.open(str(path)) as container:
        data = b"".join(bytes(p) for p in container.demux(container.streams.data[0]))
    track = read_track(path)
    for packet_number in (0, 100, 276):
        raw = data.split(UAS_KEY)[packet_number + 1]
        centre = {}
        at = 2 if raw[0] == 0x81 else 1
        while at < len(raw):
            tag, size = raw[at], raw[at + 1]
            centre[tag] = raw[at + 2 : at + 2 + size]
            at += 2 + size
        lat = int.from_bytes(centre[23], "big", signed=True) * 180.0 / (2**32 - 2)
        lon = int.from_bytes(centre[24], "big", signed=True) * 360.0 / (2**32 - 2)
        p = track.points[packet_number]
        assert p.attitude is not None
        assert p.height_m is not None
        axis = p.attitude.R_ned_camera[:, 2]
        reach = p.height_m / axis[2]
        north = (lat - p.lat_deg) * 111_000
        east = (lon - p.lon_deg) * 111_320 * math.cos(math.radians(lat))
        # Within 2 degrees of the direction: the ground is not level, the ellipsoid no sphere.
        seen = np.array([axis[0] * reach, axis[1] * reach])
        assert np.hypot(*(seen - [north, east])) < 0.05 * np.hypot(north, east)


def test_bare_stream(tmp_path: Path) -> None:
    path = tmp_path / "a.klv"
    path.write_bytes(b"".join(_flight_packet(s) for s in range(5)))
    track = read_track(path)
    assert track.clock is Clock.UTC
    assert [p.time_s - 1_714_558_830 for p in track.points] == [0, 1, 2, 3, 4]
    p = track.points[0]
    assert p.height_m == pytest.approx(200.0, abs=0.5)
    assert p.attitude is not None
    assert math.degrees(p.attitude.off_nadir_rad) == pytest.approx(2.0, abs=0.01)  # the platform's pitch
    assert math.degrees(p.attitude.heading_rad) == pytest.approx(30.0, abs=0.1)


def test_damage_costs_the_damaged_packets_only(tmp_path: Path) -> None:
    packets = [bytearray(_flight_packet(s)) for s in range(10)]
    packets[3][40] ^= 0xFF
    packets[6][16:18] = b"\x84\xff"  # an impossible length
    path = tmp_path / "a.klv"
    path.write_bytes(b"noise" + b"".join(packets) + bytes(packets[0][:50]))
    track = read_track(path)
    assert [round(p.time_s - 1_714_558_830) for p in track.points] == [0, 1, 2, 4, 5, 7, 8, 9]
    assert "3 damaged" in track.warnings[0]


def test_reserved_values_and_wrong_sizes() -> None:
    whole = packet(t2=(0).to_bytes(8, "big"), t13=b"\x80\0\0\0", t14=b"\x01\x02", t15=b"\xff\xff")
    (found,) = packets_of(whole)
    assert found is not None
    assert set(found.values) == {"alt_m"}
    assert found.values["alt_m"] == pytest.approx(19_000.0)


def test_no_positions(tmp_path: Path) -> None:
    path = tmp_path / "a.klv"
    path.write_bytes(packet(t2=(1_714_558_830_000_000).to_bytes(8, "big")))
    with pytest.raises(DataError, match="no positions"):
        read_track(path)
