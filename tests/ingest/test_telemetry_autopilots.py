"""Logs of ArduPilot and PX4: real flights against their known shots, and made ones with damage and gimbals."""

from __future__ import annotations

import json
import math
import struct
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import Attitude
from photomap_gis.ingest.telemetry import Clock, Track, read_track
from photomap_gis.ingest.telemetry.clean import distance_m

T0_US = 1_714_558_830_000_000


@pytest.fixture(scope="module")
def shots(shared_data: Path) -> list[list[float]]:
    return json.loads((shared_data / "flightlogs" / "copter_survey_shots.json").read_text())["allshots"]


@pytest.mark.parametrize(("name", "late_s"), [("copter_survey.tlog", 1e-3), ("copter_survey.BIN", 0.05)])
def test_shots_of_the_survey(shared_data: Path, shots: list[list[float]], name: str, late_s: float) -> None:
    track = read_track(shared_data / "flightlogs" / name)
    assert track.clock is Clock.UTC
    assert len(track.triggers) == len(shots) == 121
    for shot, trigger in zip(shots, track.triggers, strict=True):
        index, time_us, lat_e7, lon_e7, alt_m, height_m, roll, pitch, yaw = shot[:9]
        assert trigger.index == index
        assert trigger.time_s == pytest.approx(time_us / 1e6, abs=late_s)
        assert trigger.lat_deg == pytest.approx(lat_e7 / 1e7, abs=1e-9)
        assert trigger.lon_deg == pytest.approx(lon_e7 / 1e7, abs=1e-9)
        assert trigger.alt_m == pytest.approx(alt_m, abs=0.02)
        assert trigger.height_m == pytest.approx(height_m, abs=0.02)
        r, p, y = (math.radians(v) for v in (roll, pitch, yaw))
        expected = Attitude.of_body_camera(roll_rad=r, pitch_rad=p, yaw_rad=y)
        assert trigger.attitude is not None
        np.testing.assert_allclose(trigger.attitude.R_ned_camera, expected.R_ned_camera, atol=5e-4)


@pytest.mark.parametrize("name", ["copter_survey.tlog", "copter_survey.BIN"])
def test_track_of_the_survey(shared_data: Path, shots: list[list[float]], name: str) -> None:
    track = read_track(shared_data / "flightlogs" / name)
    assert track.warnings == ()
    assert {m.name for m in track.modes} >= {"GUIDED", "AUTO"}
    times = np.array([p.time_s for p in track.points])
    assert (np.diff(times) > 0).all()
    # At every shot the track is where the shot was, within the way flown between two records.
    for _, time_us, lat_e7, lon_e7, *_ in shots:
        p = track.points[int(np.argmin(np.abs(times - time_us / 1e6)))]
        assert distance_m(p.lat_deg, p.lon_deg, lat_e7 / 1e7, lon_e7 / 1e7) < 1.5
        assert p.height_m == pytest.approx(40.0, abs=1.0)
        assert p.attitude is not None
        assert p.sigma_m == pytest.approx(0.3, abs=0.1)


def test_both_logs_of_one_flight_agree(shared_data: Path) -> None:
    tlog, onboard = (read_track(shared_data / "flightlogs" / f"copter_survey.{s}") for s in ("tlog", "BIN"))
    times = np.arange(1795320000.0, 1795320300.0, 5.0)
    for name in ("lat_deg", "lon_deg", "height_m"):
        a, b = (np.interp(times, [p.time_s for p in t.points], [getattr(p, name) for p in t.points])
                for t in (tlog, onboard))  # fmt: skip
        np.testing.assert_allclose(a, b, atol=1.0 if name == "height_m" else 1e-5)


def test_px4(shared_data: Path) -> None:
    track = read_track(shared_data / "flightlogs" / "px4_sitl_gps.ulg")
    assert track.clock is Clock.UTC
    first = track.points[0]
    assert (first.lat_deg, first.lon_deg) == pytest.approx((47.3977419, 8.5455939), abs=1e-7)
    assert first.time_s == pytest.approx(1651221936.48, abs=0.05)
    assert first.attitude is not None
    assert math.degrees(first.attitude.off_nadir_rad) < 1.0
    assert any("without a fix" in w for w in track.warnings)


@pytest.mark.parametrize("suffix", ["tlog", "BIN"])
def test_damage_is_stepped_over(shared_data: Path, tmp_path: Path, rng: np.random.Generator, suffix: str) -> None:
    size = 1_400_000 if suffix == "tlog" else 14_000_000
    data = bytearray((shared_data / "flightlogs" / f"copter_survey.{suffix}").read_bytes()[:size])
    for _ in range(20):
        at = int(rng.integers(100_000, len(data) - 3000))
        data[at : at + 1500] = rng.integers(0, 256, 1500, dtype=np.uint8).tobytes()
    path = tmp_path / f"damaged.{suffix}"
    path.write_bytes(bytes(data))
    track = read_track(path)
    assert len(track.points) > 1000
    assert len(track.triggers) > 40
    assert any("damaged" in w for w in track.warnings)
    lats = np.array([p.lat_deg for p in track.points])
    assert lats.min() > 53.16
    assert lats.max() < 53.18


@pytest.mark.parametrize("size", [0, 1, 10, 60])
@pytest.mark.parametrize("suffix", ["tlog", "BIN", "ulg"])
def test_stumps_are_refused_with_words(shared_data: Path, tmp_path: Path, suffix: str, size: int) -> None:
    source = "px4_sitl_gps.ulg" if suffix == "ulg" else f"copter_survey.{suffix}"
    path = tmp_path / f"stump.{suffix}"
    path.write_bytes((shared_data / "flightlogs" / source).read_bytes()[:size])
    with pytest.raises(DataError):
        read_track(path)


def test_a_cut_px4_log(shared_data: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.ulg"
    path.write_bytes((shared_data / "flightlogs" / "px4_sitl_gps.ulg").read_bytes()[:-30_001])
    assert len(read_track(path).points) > 20


@pytest.mark.parametrize("suffix", ["tlog", "bin", "ulg", "klv", "srt", "csv", "gpx", "dat"])
def test_noise_is_refused_with_words(tmp_path: Path, rng: np.random.Generator, suffix: str) -> None:
    path = tmp_path / f"noise.{suffix}"
    path.write_bytes(rng.integers(0, 256, 200_000, dtype=np.uint8).tobytes())
    try:
        track = read_track(path)
    except DataError as error:
        assert "\n" not in str(error)
    else:
        assert suffix == "srt"
        assert track.points == ()
        assert track.warnings


class _Tlog:
    """Write a telemetry log message by message."""

    def __init__(self, *, mavlink1: bool = False) -> None:
        self.data = bytearray()
        self.link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.mavlink1 = mavlink1

    def add(self, seconds: float, message: mavlink.MAVLink_message) -> None:
        self.data += struct.pack(">Q", T0_US + int(seconds * 1e6)) + message.pack(self.link, self.mavlink1)

    def fly(self, seconds: float) -> None:
        boot_ms = int(seconds * 1000)
        self.add(seconds, mavlink.MAVLink_system_time_message(T0_US + boot_ms * 1000, boot_ms))
        self.add(seconds, mavlink.MAVLink_attitude_message(boot_ms, 0.1, 0.2, math.radians(90.0), 0, 0, 0))
        self.add(seconds, mavlink.MAVLink_global_position_int_message(
            boot_ms, 521000000, 96000000 + boot_ms, 120_000, 40_000, 0, 0, 0, 9000))  # fmt: skip

    def read(self, path: Path) -> Track:
        path.write_bytes(bytes(self.data))
        return read_track(path)


def test_mavlink_1_packets(tmp_path: Path) -> None:
    log = _Tlog(mavlink1=True)
    for i in range(10):
        log.fly(i / 5)
    track = log.read(tmp_path / "a.tlog")
    assert len(track.points) == 10
    assert track.points[3].time_s == pytest.approx(T0_US / 1e6 + 0.6)
    assert track.points[3].height_m == 40.0


@pytest.mark.parametrize("kind", ["device", "orientation", "status"])
def test_a_gimbal_wins_over_the_vehicle(tmp_path: Path, kind: str) -> None:
    log = _Tlog()
    for i in range(20):
        s = i / 5
        log.fly(s)
        boot_ms = int(s * 1000)
        if kind == "device":  # yaw -80 to the vehicle, which heads east: 10 degrees to north
            half = [math.radians(-80.0) / 2, math.radians(-90.0) / 2]
            cy, sy, cp, sp = math.cos(half[0]), math.sin(half[0]), math.cos(half[1]), math.sin(half[1])
            q = [cy * cp, -sy * sp, cy * sp, sy * cp]
            message = mavlink.MAVLink_gimbal_device_attitude_status_message(0, 0, boot_ms, 32, q, 0, 0, 0, 0)
        elif kind == "orientation":
            message = mavlink.MAVLink_mount_orientation_message(boot_ms, 0.0, -90.0, -80.0, 10.0)
        else:
            message = mavlink.MAVLink_mount_status_message(0, 0, -9000, 0, -8000)
        log.add(s, message)
    track = log.read(tmp_path / "a.tlog")
    p = track.points[10]
    assert p.attitude is not None
    assert math.degrees(p.attitude.off_nadir_rad) == pytest.approx(0.0, abs=0.1)
    assert math.degrees(p.attitude.heading_rad) == pytest.approx(10.0, abs=0.2)
    assert track.warnings == ()


def test_a_gimbal_of_zeros_is_not_believed(tmp_path: Path) -> None:
    log = _Tlog()
    for i in range(20):
        log.fly(i / 5)
        log.add(i / 5, mavlink.MAVLink_mount_status_message(0, 0, 0, 0, 0))
    track = log.read(tmp_path / "a.tlog")
    assert track.points[0].attitude is not None
    assert math.degrees(track.points[0].attitude.off_nadir_rad) == pytest.approx(12.8, abs=0.1)
    assert "zeros" in track.warnings[0]


def test_no_fix_is_not_a_place(tmp_path: Path) -> None:
    log = _Tlog()
    for i in range(10):
        log.fly(i / 5)
        boot_ms = int(i * 200 + 100)
        log.add(i / 5 + 0.1, mavlink.MAVLink_global_position_int_message(boot_ms, 0, 0, 0, 0, 0, 0, 0, 0))
    track = log.read(tmp_path / "a.tlog")
    assert len(track.points) == 10
    assert all(p.lat_deg == pytest.approx(52.1) for p in track.points)


def test_triggers_without_positions(tmp_path: Path) -> None:
    log = _Tlog()
    for i in range(10):
        log.fly(i / 5)
        log.add(i / 5, mavlink.MAVLink_camera_trigger_message(int(i * 200_000), i))
    track = log.read(tmp_path / "a.tlog")
    assert [t.index for t in track.triggers] == list(range(10))
    assert track.triggers[5].time_s == pytest.approx(T0_US / 1e6 + 1.0)
    assert track.triggers[5].lat_deg is None


def _bin(records: list[tuple[str, str, str, list[tuple[float | int, ...]]]]) -> bytes:
    """Write a dataflash log: (name, numpy-like letters, columns, rows)."""
    codes = {"Q": "Q", "B": "B", "L": "i", "f": "f", "e": "i", "c": "h", "I": "I", "H": "H", "C": "H"}
    out = bytearray()
    for kind, (name, letters, columns, rows) in enumerate(records, start=130):
        layout = "<" + "".join(codes[c] for c in letters)
        length = struct.calcsize(layout) + 3
        texts = (t.encode() for t in (name, letters, columns))
        out += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, length, *texts)
        for row in rows:
            out += b"\xa3\x95" + bytes([kind]) + struct.pack(layout, *row)
    return bytes(out)


def test_onboard_log_with_a_gimbal_and_a_lost_fix(tmp_path: Path) -> None:
    weeks, in_week = divmod(T0_US / 1e6 + 18.0 - 315_964_800.0, 604_800.0)
    week, ms = int(weeks), int(in_week * 1000)
    gps = [
        (i * 200_000, 0, 3 if i != 10 else 1, ms + i * 200, week, 521000000, 96000000 + i, 12000, 1) for i in range(30)
    ]
    att = [(i * 100_000, 5.0, 6.0, 90.0) for i in range(60)]
    mnt = [(i * 100_000, 0, 0.0, -90.0, -80.0, float("nan")) for i in range(60)]
    data = _bin([
        ("GPS", "QBBIHLLeB", "TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt,U", gps),
        ("ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw", att),
        ("MNT", "QBffff", "TimeUS,I,Roll,Pitch,YawB,YawE", mnt),
    ])  # fmt: skip
    path = tmp_path / "00000012.BIN"
    path.write_bytes(data)
    track = read_track(path)
    assert track.points[0].time_s == pytest.approx(T0_US / 1e6, abs=1e-3)  # 18 leap seconds
    assert any("1 positions without a fix" in w for w in track.warnings)
    p = track.points[len(track.points) // 2]
    assert p.attitude is not None
    assert math.degrees(p.attitude.off_nadir_rad) == pytest.approx(0.0, abs=0.1)
    assert math.degrees(p.attitude.heading_rad) == pytest.approx(10.0, abs=0.1)


@pytest.mark.parametrize(
    ("utc", "leap_s"),
    [
        ("2005-12-31T23:59:58", 13), ("2006-01-01T00:00:02", 14), ("2012-06-30T23:59:50", 15),
        ("2015-06-30T12:00:00", 16), ("2016-12-31T23:59:50", 17), ("2017-01-01T00:00:02", 18),
        ("2026-05-01T10:00:00", 18),
    ],
)  # fmt: skip
def test_gps_time_is_ahead_of_utc_by_the_leap_seconds_of_its_day(tmp_path: Path, utc: str, leap_s: int) -> None:
    """The table is that of IERS Bulletin C: GPS time minus UTC."""
    start_s = datetime.fromisoformat(utc + "+00:00").timestamp()
    weeks, in_week = divmod(start_s + leap_s - 315_964_800.0, 604_800.0)
    gps = [(k * 200_000, 3, round(in_week * 1000) + k * 200, int(weeks), 521000000, 96000000 + k, 0) for k in range(5)]
    path = tmp_path / "leap.bin"
    path.write_bytes(_bin([("GPS", "QBIHLLe", "TimeUS,Status,GMS,GWk,Lat,Lng,Alt", gps)]))
    track = read_track(path)
    assert track.clock is Clock.UTC
    assert track.points[0].time_s == pytest.approx(start_s, abs=1e-3)


def test_onboard_log_without_gps_time_counts_from_boot(tmp_path: Path) -> None:
    gps = [(i * 200_000, 3, 0, 0, 521000000, 96000000 + i, 12000) for i in range(30)]
    path = tmp_path / "a.bin"
    path.write_bytes(_bin([("GPS", "QBIHLLe", "TimeUS,Status,GMS,GWk,Lat,Lng,Alt", gps)]))
    track = read_track(path)
    assert track.clock is Clock.BOOT
    assert "--track-offset" in track.warnings[0]
