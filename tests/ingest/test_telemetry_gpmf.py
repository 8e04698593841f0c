"""GoPro's metadata, packets made by hand after its published layout."""

from __future__ import annotations

import struct

import pytest

from photomap_gis.ingest.telemetry import Clock
from photomap_gis.ingest.telemetry.gpmf import fixes_of, track_of_gpmf


def klv(key: bytes, kind: str, size: int, payload: bytes) -> bytes:
    """Return one element, padded."""
    head = key + (kind.encode() or b"\0") + bytes([size]) + (len(payload) // size).to_bytes(2, "big")
    return head + payload + b"\0" * (-len(payload) % 4)


def nest(key: bytes, *children: bytes) -> bytes:
    """Return a nested element."""
    return klv(key, "", 1, b"".join(children))


def gps5(*rows: tuple[float, float, float], fix: int = 3, stamp: bytes = b"240501102030.000") -> bytes:
    """Return a packet of a HERO5 to HERO10."""
    values = b"".join(struct.pack(">5i", round(a * 1e7), round(b * 1e7), round(c * 1e3), 0, 0) for a, b, c in rows)
    accelerometer = nest(b"STRM", klv(b"SCAL", "s", 2, struct.pack(">h", 100)), klv(b"ACCL", "s", 6, bytes(60)))
    receiver = nest(
        b"STRM",
        klv(b"GPSF", "L", 4, struct.pack(">I", fix)),
        klv(b"GPSU", "U", 16, stamp),
        klv(b"GPSP", "S", 2, struct.pack(">H", 120)),
        klv(b"SCAL", "l", 4, struct.pack(">5i", 10_000_000, 10_000_000, 1000, 1000, 100)),
        klv(b"GPS5", "l", 20, values),
    )
    return nest(b"DEVC", klv(b"DVID", "L", 4, bytes(4)), accelerometer, receiver)


def test_older_cameras() -> None:
    packets = [(float(s), 1.0, gps5(*[(52.0 + (s + i / 10) * 1e-4, 9.6, 100.0) for i in range(10)])) for s in range(3)]
    track = track_of_gpmf(packets, "GX010001.MP4")
    assert track.clock is Clock.VIDEO
    assert len(track.points) == 30
    for p in track.points:
        assert p.lat_deg == pytest.approx(52.0 + p.time_s * 1e-4, abs=1e-6)
        assert (p.lon_deg, p.alt_m, p.height_m) == (pytest.approx(9.6), 100.0, None)
        assert p.sigma_m == pytest.approx(3.0)


def test_newer_cameras() -> None:
    row = struct.pack(">7i2H", 520000000, 96000000, 100_000, 0, 0, 8887, 37_230_500, 90, 3)
    lost = struct.pack(">7i2H", 0, 0, 0, 0, 0, 8887, 37_230_600, 9999, 0)
    scales = klv(b"SCAL", "l", 4, struct.pack(">9i", 10**7, 10**7, 1000, 1000, 100, 1, 1000, 100, 1))
    packet = nest(b"DEVC", nest(b"STRM", scales, klv(b"GPS9", "?", 32, row + lost)))
    (fix,) = fixes_of(packet)
    assert (fix.lat_deg, fix.lon_deg, fix.alt_m, fix.sigma_m) == pytest.approx((52.0, 9.6, 100.0, 2.25))
    assert fix.utc_s == pytest.approx(1_714_558_830.5)
    assert track_of_gpmf([(2.0, 1.0, packet)], "x").epoch_utc_s == pytest.approx(1_714_558_828.5)


def test_no_fix_and_damage() -> None:
    assert fixes_of(gps5((52.0, 9.6, 1.0), fix=0)) == []
    whole = gps5((52.0, 9.6, 1.0), (52.1, 9.6, 1.0))
    for cut in range(0, len(whole), 5):
        fixes_of(whole[:cut])
    deep = b""
    for _ in range(100):
        deep = nest(b"DEVC", deep) if deep else nest(b"DEVC", bytes(8))
    assert fixes_of(deep) == []
