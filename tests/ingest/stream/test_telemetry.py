"""Live telemetry: a simulated vehicle that flies a simulated path, logs that grow, metadata, hostile bytes."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.core.errors import DataError, LinkError, UsageError
from photomap_gis.core.live import FrameMoment, LiveFrame, LiveTelemetry, StreamFix
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.stream import open_stream, open_telemetry
from photomap_gis.ingest.stream.file_telemetry import FileTelemetry
from photomap_gis.ingest.stream.mavlink_telemetry import MavlinkTelemetry
from photomap_gis.ingest.stream.stream_clock import StreamClock
from photomap_gis.ingest.telemetry import read_track
from photomap_gis.simulate.vehicle.ardupilot import ArduPilot
from photomap_gis.simulate.vehicle.flying import Flier, FlownPath
from photomap_gis.vehicle_link import parse_url
from tests.ingest.stream.made import FakeClock, write_video
from tests.ingest.stream.test_links import free_port


class Silent:
    """A transport on which nothing comes."""

    def __init__(self) -> None:
        self.written: list[bytes] = []
        self._closed = threading.Event()

    def write(self, packet: bytes, system: int) -> None:
        self.written.append(packet)

    def read(self, timeout_s: float) -> bytes:
        self._closed.wait(min(timeout_s, 0.01))
        return b""

    def close(self) -> None:
        self._closed.set()


def path_of(seconds: float = 60.0, hz: float = 5.0) -> FlownPath:
    """A circle of 50 m at 5 m/s, the camera straight down, nose along."""
    t = np.arange(0.0, seconds, 1.0 / hz)
    angle = t * 0.1
    return FlownPath(
        t, 51.5 + 50.0 * np.sin(angle) / 111_195.0, 7.4 + 50.0 * np.cos(angle) / 69_220.0, 150.0 + 0.0 * t,
        50.0 + 0.0 * t, angle, -math.pi / 2 + 0.0 * t, 0.0 * t, 1_750_000_000.0,
    )  # fmt: skip


class Air:
    """A vehicle that flies in the time of a fake clock, and the bytes that come of it."""

    def __init__(self, clock: FakeClock, path: FlownPath) -> None:
        self.clock = clock
        self.vehicle = ArduPilot(system=7)
        self.vehicle.now_s = clock.now_s() - 100.0
        self.vehicle.boot()
        self.flier = Flier(path, self.vehicle, 10.0)
        self.flier.start(clock.now_s())
        self._mav = mavlink.MAVLink(None, 7, 1)

    def step(self, seconds: float) -> bytes:
        self.clock.sleep(seconds)
        self.vehicle.tick(self.clock.now_s())
        self.flier.tick(self.clock.now_s())
        return b"".join(bytes(m.pack(self._mav)) for m in self.vehicle.take_outbox())


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


def listening(clock: FakeClock, **options: object) -> MavlinkTelemetry:
    return MavlinkTelemetry(parse_url("udpin:127.0.0.1:14550"), "x", clock, transport=Silent(), **options)


def metres(fix, lat: float, lon: float) -> float:
    return math.hypot((fix.lat_deg - lat) * 111_195.0, (fix.lon_deg - lon) * 69_220.0)


def test_frames_find_their_place_in_what_the_autopilot_says(clock: FakeClock, tmp_path: Path) -> None:
    path = path_of()
    telemetry = listening(clock, tlog=tmp_path / "a.tlog")
    assert isinstance(telemetry, LiveTelemetry) and not telemetry.state().is_heard
    air = Air(clock, path)
    moments = []
    for n in range(500):
        telemetry.take(air.step(0.1))
        moments.append(FrameMoment(n * 0.1, clock.now_s() + (0.3 if n % 7 else 0.0)))  # most frames are held up
    state = telemetry.state()
    assert (
        state.is_heard
        and state.armed
        and state.mode == "AUTO"
        and state.satellites == 14
        and state.gps_fix == "RTK fixed"
    )
    placed = telemetry.place(moments)
    assert sum(p is not None for p in placed) >= 495
    for moment, fix in zip(moments[20:-20], placed[20:-20], strict=True):
        at_s = moment.stream_time_s + 0.1  # the first step was a tenth of a second after take-off
        lat, lon = (float(np.interp(at_s, path.times_s, c)) for c in (path.lat_deg, path.lon_deg))
        assert fix is not None and metres(fix.fix, lat, lon) < 0.3
        assert fix.height_m == pytest.approx(50.0) and fix.time_s == moment.stream_time_s
        yaw = float(np.interp(at_s, path.times_s, path.yaw_rad))
        assert fix.attitude is not None and abs(math.remainder(fix.attitude.heading_rad - yaw, 2 * math.pi)) < 0.02
        assert fix.attitude.off_nadir_rad < 0.01
    telemetry.set_lag(2.0, 0.1)  # pictures of two seconds ago
    before, after = placed[200], telemetry.place([moments[200]])[0]
    assert metres(after.fix, placed[180].fix.lat_deg, placed[180].fix.lon_deg) < 0.5
    assert metres(after.fix, before.fix.lat_deg, before.fix.lon_deg) > 5.0
    assert telemetry.state().lag_s == 2.0
    telemetry.close()
    kept = read_track(tmp_path / "a.tlog")  # the log is one that the map takes
    assert len(kept.points) > 400 and {m.name for m in kept.modes} >= {"AUTO"}


def test_a_whole_flight_is_remembered_and_memory_stays_small(clock: FakeClock) -> None:
    telemetry = listening(clock)
    air = Air(clock, path_of(1200.0))
    moments = []
    for n in range(6000):
        telemetry.take(air.step(0.2))
        moments.append(FrameMoment(n * 0.2, clock.now_s()))
    placed = telemetry.place(moments[::50])
    assert all(p is not None for p in placed)
    open_messages = sum(len(rows) for rows in telemetry._track._open.of.values())
    assert open_messages < 1500
    telemetry.close()


def test_a_reboot_amid_the_flight(clock: FakeClock) -> None:
    telemetry = listening(clock)
    path = path_of(120.0)
    air = Air(clock, path)
    moments = []
    began_s = clock.now_s()
    for n in range(1000):
        if n == 500:
            air.vehicle.faults.boot_s = 0.0
            air.vehicle.reboot()
        telemetry.take(air.step(0.1))
        moments.append(FrameMoment(clock.now_s() - began_s, clock.now_s()))
    placed = telemetry.place(moments)
    for moment, fix in zip(moments[10:-10:7], placed[10:-10:7], strict=True):
        lat, lon = (float(np.interp(moment.stream_time_s, path.times_s, c)) for c in (path.lat_deg, path.lon_deg))
        assert fix is None or metres(fix.fix, lat, lon) < 1.0
    assert sum(f is not None for f in placed) > 950
    telemetry.close()


def test_a_listener_sends_nothing_unless_asked(clock: FakeClock) -> None:
    for url, requests, sends in [
        ("udpin:127.0.0.1:1", False, set()),
        ("tcp:127.0.0.1:1", False, {"HEARTBEAT"}),
        ("udpin:127.0.0.1:1", True, {"HEARTBEAT", "COMMAND_LONG"}),
    ]:
        transport = Silent()
        telemetry = MavlinkTelemetry(parse_url(url), url, clock, request_streams=requests, transport=transport)
        telemetry.take(Air(clock, path_of()).step(0.1))
        clock.sleep(20.0)
        telemetry._call()
        telemetry.close()
        reader = mavlink.MAVLink(None)
        said = {m.get_type() for p in transport.written for m in reader.parse_buffer(p) or ()}
        assert said == sends


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(max_size=300), max_size=12), st.integers(0, 2**32 - 1))
def test_hostile_bytes_are_passed_over(chunks: list[bytes], seed: int) -> None:
    clock = FakeClock()
    telemetry = listening(clock)
    air = Air(clock, path_of())
    rng = np.random.default_rng(seed)
    for chunk in chunks:
        sound = bytearray(air.step(0.1))
        if len(sound):
            sound[int(rng.integers(len(sound)))] ^= 0x55
        telemetry.take(chunk + bytes(sound))
    for _ in range(40):
        telemetry.take(air.step(0.1))
    assert telemetry.state().fix is not None
    telemetry.place([FrameMoment(0.0, clock.now_s())])
    telemetry.close()


def test_messages_of_nonsense_are_no_crash(clock: FakeClock) -> None:
    telemetry = listening(clock)
    mav = mavlink.MAVLink(None, 3, 1)
    nonsense = [
        mavlink.MAVLink_global_position_int_message(2**32 - 1, 2**31 - 1, -(2**31), 0, 0, 0, 0, 0, 65_535),
        mavlink.MAVLink_gps_raw_int_message(2**63, 255, 0, 0, 0, 0, 0, 0, 0, 255),
        mavlink.MAVLink_attitude_message(0, math.nan, math.inf, math.nan, 0, 0, 0),
        mavlink.MAVLink_gimbal_device_attitude_status_message(0, 0, 5, 0, [math.nan] * 4, 0, 0, 0, 0),
        mavlink.MAVLink_heartbeat_message(99, 99, 255, 2**32 - 1, 0, 3),
        mavlink.MAVLink_global_position_int_message(0, 0, 0, 0, 0, 0, 0, 0, 0),
    ]
    for message in nonsense * 3:
        telemetry.take(bytes(message.pack(mav)))
        clock.sleep(7.0)
        telemetry.place([FrameMoment(1.0, clock.now_s())])
        telemetry.state()
    telemetry.close()


@pytest.fixture
def vehicle(tmp_path: Path) -> Iterator[int]:
    """The simulated vehicle as a process, flying a path of its own; its port."""
    from photomap_gis.simulate import FlightSpec, run_simulation

    run_simulation("procedural", tmp_path / "sim", FlightSpec(frames=12, width_px=64, height_px=48, altitude_m=40.0))
    port = free_port()
    process = subprocess.Popen(
        [sys.executable, "-m", "photomap_gis.simulate.vehicle", "--port", str(port), "--fly", str(tmp_path / "sim")],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    assert json.loads(process.stdout.readline())["event"] == "ready"
    yield port
    process.communicate('{"quit": true}\n')


def test_a_real_vehicle_over_tcp(vehicle: int, tmp_path: Path) -> None:
    source = open_stream(write_video(tmp_path / "a.mp4"), realtime=False)
    telemetry = open_telemetry(source, mavlink_url=f"tcp:127.0.0.1:{vehicle}", recording=tmp_path / "box")
    waited = threading.Event()
    while telemetry.state().fix is None or telemetry.state().mode is None:
        waited.wait(0.02)
    fix = telemetry.state().fix
    telemetry.close()
    assert abs(fix.lat_deg - 53.168) < 0.01 and (tmp_path / "box" / "telemetry.tlog").stat().st_size > 100


def write_srt(path: Path, count: int, rate: int = 10) -> None:
    def stamp(n: int) -> str:
        ms = n * 1000 // rate
        return f"00:{ms // 60000:02d}:{ms // 1000 % 60:02d},{ms % 1000:03d}"

    path.write_text(
        "".join(
            f'{n + 1}\n{stamp(n)} --> {stamp(n + 1)}\n<font size="28">FrameCnt: {n + 1}\n'
            f"[latitude: {51.5 + n * 1e-5:.6f}] [longitude: 7.400000] [rel_alt: 50.000 abs_alt: 150.000]</font>\n\n"
            for n in range(count)
        )
    )


def test_a_log_of_the_played_file(tmp_path: Path) -> None:
    source = open_stream(write_video(tmp_path / "a.mp4", count=30), realtime=False, recording=tmp_path / "box")
    write_srt(tmp_path / "later.srt", 30)
    telemetry = open_telemetry(source, track=tmp_path / "later.srt")
    placed = telemetry.place([FrameMoment(1.0, 5.0), FrameMoment(2.0, 6.0), FrameMoment(900.0, 7.0)])
    assert placed[0].fix.lat_deg == pytest.approx(51.5001, abs=2e-6) and placed[2] is None
    assert placed[1].height_m == 50.0 and telemetry.state().fix is not None
    list(source)


def test_a_log_that_grows_is_read_on(tmp_path: Path) -> None:
    log = tmp_path / "grows.srt"
    log.write_text("")
    telemetry = FileTelemetry(log, IngestOptions(), started_utc_s=lambda: None, span_s=None, follow=True)
    telemetry.close()  # the test looks itself
    moment = [FrameMoment(2.0, 0.0)]
    assert telemetry.place(moment) == (None,) and telemetry.state().fix is None
    write_srt(log, 10)
    assert telemetry.look() and telemetry.place(moment)[0] is None
    write_srt(log, 40)
    assert telemetry.look() and telemetry.place(moment)[0].fix.lat_deg == pytest.approx(51.5002, abs=2e-6)
    assert not telemetry.look()


def test_what_cannot_be_used_is_told(tmp_path: Path) -> None:
    source = open_stream(write_video(tmp_path / "a.mp4", count=5), realtime=False)
    with pytest.raises(DataError, match="no such file"):
        open_telemetry(source, track=tmp_path / "none.srt")
    with pytest.raises(UsageError, match="two clocks"):
        open_telemetry(source, track=tmp_path / "a.srt", mavlink_url="udpin:0.0.0.0:14550")
    with pytest.raises(UsageError, match="--mavlink 'carrier pigeon'"):
        open_telemetry(source, mavlink_url="carrier pigeon")
    with pytest.raises(LinkError):
        open_telemetry(source, mavlink_url="udpin:192.0.2.1:14550")


@pytest.mark.shared
def test_metadata_in_the_stream_places_its_frames(shared_data: Path) -> None:
    source = open_stream(shared_data / "misb_video" / "sample-stream.ts", realtime=False)
    telemetry = open_telemetry(source)
    moments, fixes = [], []
    for event in source:
        telemetry.hear(event)
        if isinstance(event, LiveFrame):
            moments.append(FrameMoment(event.stream_time_s, event.arrival_s))
        elif isinstance(event, StreamFix):
            fixes.append(replace(event))
    placed = telemetry.place(moments)
    assert sum(p is not None for p in placed) > 0.95 * len(moments)
    known = [p for p in placed if p is not None]
    assert known[-1].fix.lat_deg == pytest.approx(fixes[-1].fix.lat_deg, abs=1e-4)
    assert known[100].attitude is not None


def test_the_quickest_frames_tell_the_clock() -> None:
    clock = StreamClock()
    rng = np.random.default_rng(3)
    clock.hear([FrameMoment(t, 500.0 + t + d) for t, d in zip(range(100), rng.exponential(0.5, 100), strict=True)])
    assert clock.arrival_s(50.0) == pytest.approx(550.0, abs=0.1)
    with pytest.raises(ValueError):
        clock.arrival_s(5000.0)
