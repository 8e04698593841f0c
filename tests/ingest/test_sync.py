"""Clocks and interpolation: known motions, rounded and repeated as logs do it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import Attitude
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.sync import interpolate, place_frames, place_photos
from photomap_gis.ingest.telemetry import read_track
from photomap_gis.ingest.telemetry.track import Clock, Track, TrackPoint, Trigger

T0 = 1_714_558_830.0
M_PER_DEG = 111_195.0
OPTIONS = IngestOptions()


def _line(count: int = 100, step_s: float = 1.0, *, start_s: float = 0.0, clock: Clock = Clock.VIDEO) -> Track:
    """Fly north at 10 m/s from 52 N 9.6 E."""
    points = tuple(
        TrackPoint(start_s + i * step_s, 52.0 + 10.0 * i * step_s / M_PER_DEG, 9.6, height_m=40.0 + i)
        for i in range(count)
    )
    return Track(points, clock, "line.log")


def _north_m(points: list[TrackPoint | None]) -> np.ndarray:
    return np.array([math.nan if p is None else (p.lat_deg - 52.0) * M_PER_DEG for p in points])


def _wandering(times_s: np.ndarray) -> np.ndarray:
    """``(N,)`` metres north of a lawnmower's way: 60 s there, 60 s back at 8 m/s."""
    return 8.0 * (60.0 - np.abs(times_s % 120.0 - 60.0))


def test_between_and_beyond_records() -> None:
    got = interpolate(_line(), [0.0, 10.25, 99.0, 100.0, 130.0, -0.5, -30.0])
    np.testing.assert_allclose(_north_m(got), [0, 102.5, 990, 1000, np.nan, -5, np.nan], atol=1e-3)
    assert got[1] is not None
    assert got[1].height_m == pytest.approx(50.25)
    assert got[1].time_s == 10.25
    assert got[1].sigma_m is None


def test_a_long_gap_is_unknown() -> None:
    line = _line()
    track = Track(tuple(p for p in line.points if not 20 < p.time_s < 60), Clock.VIDEO, "gap")
    got = interpolate(track, [19.5, 20.4, 40.0, 59.7, 61.0])
    assert [p is None for p in got] == [False, False, True, False, False]
    np.testing.assert_allclose(_north_m(got)[[0, 4]], [195, 610], atol=1e-3)


def test_repeated_fixes_are_one_fix() -> None:
    """A 30 Hz log of a 1 Hz receiver: true at the first appearance, straight between."""
    times = np.arange(0, 60, 1 / 30)
    true = _wandering(np.floor(times + 1e-9))
    points = tuple(TrackPoint(float(t), 52.0 + m / M_PER_DEG, 9.6) for t, m in zip(times, true, strict=True))
    at = np.arange(0.5, 58, 0.37)
    got = _north_m(interpolate(Track(points, Clock.VIDEO, "steps"), at.tolist()))
    np.testing.assert_allclose(got, _wandering(at), atol=0.3)
    naive = _north_m([points[int(t * 30)] for t in at])
    assert np.abs(naive - _wandering(at)).max() > 6.0


def test_a_hover_holds_until_it_ends() -> None:
    """Standing for 40 s, then flying on: no slow drift towards the next place."""
    times = np.arange(0, 80, 0.1)
    way = np.floor(np.clip(times - 20, 0, 1000) * 5) - np.floor(np.clip(times - 60, 0, 1000) * 5)
    way = np.where(times < 20, np.floor(times * 5) * 2, 200.0 + np.where(times > 60, np.floor((times - 60) * 5) * 2, 0))
    points = tuple(TrackPoint(float(t), 52.0 + m / M_PER_DEG, 9.6) for t, m in zip(times, way, strict=True))
    got = _north_m(interpolate(Track(points, Clock.VIDEO, "hover"), [30.0, 45.0, 59.0]))
    np.testing.assert_allclose(got, 200.0, atol=0.5)


@pytest.mark.parametrize("rate_hz", [1.0, 30.0])
def test_four_decimals(rate_hz: float) -> None:
    """Steps of 11 m: the borders between them are crossed at known moments, which is better than the values."""
    times = np.arange(0, 240, 1 / rate_hz)
    lat = np.round(52.0 + _wandering(times) / M_PER_DEG, 4)
    lon = np.round(9.6 + np.zeros_like(times), 4)
    track = Track(tuple(TrackPoint(*row) for row in zip(times.tolist(), lat.tolist(), lon.tolist(), strict=True)),
                  Clock.VIDEO, "coarse")  # fmt: skip
    at = np.arange(5, 235, 0.7)
    got = interpolate(track, at.tolist())
    assert got[0] is not None
    assert got[0].sigma_m == pytest.approx(11.12 / math.sqrt(12), rel=0.01)
    error = _north_m(got) - _wandering(at)
    assert np.sqrt(np.mean(error**2)) < 1.8  # against 3.2 for the values as they stand
    assert abs(error.mean()) < 0.5


def test_reported_and_implied_sigma_add_up() -> None:
    points = tuple(TrackPoint(float(i), round(52 + i * 1e-4, 4), 9.6, sigma_m=2.0) for i in range(20))
    got = interpolate(Track(points, Clock.VIDEO, "x"), [5.0])[0]
    assert got is not None
    assert got.sigma_m == pytest.approx(math.hypot(2.0, 3.21), rel=0.01)


def test_angles_go_the_short_way() -> None:
    points = tuple(
        TrackPoint(float(i), 52.0, 9.6 + i * 1e-5, attitude=Attitude(math.radians(a), math.radians(-90.0)))
        for i, a in enumerate((350.0, 10.0))
    )
    got = interpolate(Track(points, Clock.VIDEO, "turn"), [0.5])[0]
    assert got is not None
    assert got.attitude is not None
    assert math.degrees(got.attitude.heading_rad) == pytest.approx(0.0, abs=1e-6)


def test_tilt_is_interpolated_through_nadir() -> None:
    """Yaw and roll jump by 180 degrees where a belly camera tips over nadir; the rotation does not."""
    points = tuple(
        TrackPoint(float(i), 52.0, 9.6 + i * 1e-5, attitude=Attitude.of_body_camera(
            roll_rad=0.0, pitch_rad=math.radians(pitch), yaw_rad=1.0))
        for i, pitch in enumerate((-4.0, 4.0))
    )  # fmt: skip
    for t, expected in ((0.0, 4.0), (0.25, 2.0), (0.5, 0.0), (0.75, 2.0)):
        got = interpolate(Track(points, Clock.VIDEO, "tip"), [t])[0]
        assert got is not None
        assert got.attitude is not None
        assert math.degrees(got.attitude.off_nadir_rad) == pytest.approx(expected, abs=1e-4)
        assert got.attitude.heading_rad == pytest.approx(1.0, abs=1e-6)


def test_across_the_date_line() -> None:
    points = tuple(TrackPoint(float(i), 52.0, lon) for i, lon in enumerate((179.9999, -179.9999, -179.9997)))
    got = interpolate(Track(points, Clock.VIDEO, "fiji"), [0.5, 1.5])
    assert got[0] is not None
    assert got[1] is not None
    assert abs(got[0].lon_deg) == pytest.approx(180.0, abs=1e-6)
    assert got[1].lon_deg == pytest.approx(-179.9998)


@given(
    st.lists(st.tuples(st.floats(0.01, 20.0), st.integers(-900000, 900000), st.integers(-999999, 999999)), max_size=30),
    st.lists(st.floats(-100.0, 700.0), max_size=10),
)
def test_any_track_gives_places_that_are_places(rows: list[tuple[float, int, int]], at: list[float]) -> None:
    times = np.cumsum([r[0] for r in rows]).tolist()
    points = tuple(TrackPoint(t, la / 1e4, lo / 1e4) for t, (_, la, lo) in zip(times, rows, strict=True))
    got = interpolate(Track(points, Clock.VIDEO, "any"), at)
    assert len(got) == len(at)
    for p in got:
        assert p is None or (abs(p.lat_deg) <= 90.0 and abs(p.lon_deg) <= 180.0)


def test_video_clock_needs_no_start() -> None:
    placed = place_frames([0.0, 1.0, None], _line(), start_utc_s=None, options=OPTIONS)
    assert placed.offset_s == 0.0
    assert [f is None for f in placed.fixes] == [False, False, True]
    assert placed.heights_m == (40.0, 41.0, None)
    assert placed.attitudes == (None, None, None)


def test_video_clock_can_be_moved() -> None:
    placed = place_frames([10.0], _line(), start_utc_s=T0, options=IngestOptions(track_offset_s=4.0))
    np.testing.assert_allclose(_north_m(list(placed.points)), [60.0], atol=1e-3)


@pytest.mark.parametrize(
    ("zone_h", "expected_h"), [(0.0, 0.0), (2.0, 2.0), (-7.0, -7.0), (5.75, 5.75), (13.0, 13.0), (-3.5, -3.5)]
)
def test_clocks_of_other_time_zones(zone_h: float, expected_h: float) -> None:
    track = _line(600, start_s=T0, clock=Clock.UTC)
    placed = place_frames([0.0, 100.0, 200.0], track, start_utc_s=T0 + zone_h * 3600 + 50.0, options=OPTIONS)
    assert placed.offset_s == expected_h * 3600
    np.testing.assert_allclose(_north_m(list(placed.points)), [500, 1500, 2500], atol=1e-2)
    assert bool(placed.warnings) == (expected_h != 0)


def test_a_wrong_hour_that_overlaps_a_little_is_still_wrong() -> None:
    track = _line(5400, start_s=T0, clock=Clock.UTC)  # an hour and a half
    times = np.arange(0.0, 5400.0, 60.0)
    placed = place_frames(times.tolist(), track, start_utc_s=T0 + 3600.0, options=OPTIONS)
    assert placed.offset_s == 3600.0
    half = place_frames(times.tolist(), track, start_utc_s=T0 + 2000.0, options=OPTIONS)
    assert half.offset_s == 0.0
    assert "outside" in half.warnings[0]


def test_unknown_start_of_equal_length() -> None:
    track = _line(101, start_s=T0, clock=Clock.UTC)
    placed = place_frames(np.arange(0.0, 99.0).tolist(), track, start_utc_s=None, options=OPTIONS)
    np.testing.assert_allclose(_north_m(list(placed.points))[[0, 50]], [0, 500], atol=1e-2)
    assert "begin together" in placed.warnings[0]
    assert placed.offset_s == 0.0
    second_piece = place_frames([60.0], track, start_utc_s=None, options=OPTIONS, length_s=100.0)
    np.testing.assert_allclose(_north_m(list(second_piece.points)), [600], atol=1e-2)
    moved = place_frames([0.0], track, start_utc_s=None, options=IngestOptions(track_offset_s=-7.0))
    np.testing.assert_allclose(_north_m(list(moved.points)), [70.0], atol=1e-2)


def test_no_overlap_says_what_to_do() -> None:
    track = _line(100, start_s=T0, clock=Clock.UTC)
    for start in (T0 + 40 * 86400.0 + 400.0, None):
        with pytest.raises(DataError, match="--track-offset SECONDS"):
            place_frames([0.0, 700.0], track, start_utc_s=start, options=OPTIONS)
    away = place_frames([0.0], track, start_utc_s=T0 + 1e6, options=IngestOptions(track_offset_s=1e6))
    assert away.fixes[0] is not None


def test_an_empty_track_places_nothing() -> None:
    placed = place_frames([0.0, 1.0], Track((), Clock.VIDEO, "empty"), start_utc_s=0.0, options=OPTIONS)
    assert placed.points == (None, None)
    assert placed.warnings


def _survey(rng: np.random.Generator, count: int = 60) -> Track:
    """Lanes with a shot every 2 s and turns of a varying length, on the line's track."""
    gaps = np.where(np.arange(count) % 12 == 11, rng.uniform(6, 14, count), rng.uniform(1.8, 2.2, count))
    moments = np.cumsum(gaps)
    line = _line(int(moments[-1]) + 10, start_s=T0, clock=Clock.UTC)
    triggers = tuple(
        Trigger(T0 + float(t), i, 52.0 + 10 * float(t) / M_PER_DEG, 9.6, 100.0, 42.0) for i, t in enumerate(moments)
    )
    return Track(line.points, Clock.UTC, "survey.bin", triggers=triggers)


@pytest.mark.parametrize("off_s", [0.0, 7200.3, -431.7])
def test_photos_meet_their_shots(rng: np.random.Generator, off_s: float) -> None:
    track = _survey(rng)
    shots = [t.time_s for t in track.triggers]
    photos = [math.floor(t + off_s) for t in shots]
    placed = place_photos(photos, track, options=OPTIONS)
    north = [10 * (t - T0) for t in shots]
    np.testing.assert_allclose(_north_m(list(placed.points)), north, atol=1e-2)
    assert placed.offset_s == pytest.approx(off_s, abs=1.0)
    assert placed.heights_m[0] == 42.0
    lost = [p for i, p in enumerate(photos) if i not in (0, 17, 18, 40)]
    placed = place_photos(lost, track, options=OPTIONS)
    north = [n for i, n in enumerate(north) if i not in (0, 17, 18, 40)]
    np.testing.assert_allclose(_north_m(list(placed.points)), north, atol=1e-2)


def test_even_spacing_is_not_taken_for_evidence() -> None:
    line = _line(200, start_s=T0, clock=Clock.UTC)
    triggers = tuple(
        Trigger(T0 + 10 + 2.0 * i, i, 52.0 + 10 * (10 + 2.0 * i) / M_PER_DEG, 9.6, height_m=7.0) for i in range(60)
    )
    track = Track(line.points, Clock.UTC, "even.bin", triggers=triggers)
    for late_s, by_shot in ((0.0, True), (0.3, True), (3600.2, True), (7.0, False)):
        photos = [T0 + 20 + 2.0 * i + late_s for i in range(40)]
        placed = place_photos(photos, track, options=OPTIONS)
        assert (placed.heights_m[0] == 7.0) == by_shot
        assert any("believed" in w for w in placed.warnings) != by_shot
        if by_shot:
            north = [10 * (20 + 2.0 * i) for i in range(40)]
            np.testing.assert_allclose(_north_m(list(placed.points)), north, atol=1e-2)


def test_photos_without_times_take_shots_in_order(rng: np.random.Generator) -> None:
    track = _survey(rng)
    placed = place_photos([None] * 60, track, options=OPTIONS)
    assert placed.fixes[59] is not None
    assert "by their order" in placed.warnings[0]
    with pytest.raises(DataError, match="no time"):
        place_photos([None] * 59, track, options=OPTIONS)


@pytest.mark.parametrize("suffix", ["tlog", "BIN"])
def test_photos_of_the_real_survey(shared_data: Path, suffix: str) -> None:
    """121 photos stamped to whole seconds by a clock that is 3 h and 37 s off, five of them lost."""
    folder = shared_data / "flightlogs"
    shots = json.loads((folder / "copter_survey_shots.json").read_text())["allshots"]
    kept = [s for i, s in enumerate(shots) if i not in (3, 50, 51, 52, 120)]
    photos = [math.floor(s[1] / 1e6 + 3 * 3600 + 37) for s in kept]
    placed = place_photos(photos, read_track(folder / f"copter_survey.{suffix}"), options=OPTIONS)
    assert placed.offset_s == pytest.approx(3 * 3600 + 37, abs=1.0)
    for shot, fix, height in zip(kept, placed.fixes, placed.heights_m, strict=True):
        assert fix is not None
        assert (fix.lat_deg, fix.lon_deg) == pytest.approx((shot[2] / 1e7, shot[3] / 1e7), abs=1e-9)
        assert height == pytest.approx(shot[5], abs=0.02)


def test_photos_beside_a_video_log(rng: np.random.Generator) -> None:
    line = _line(100)
    track = Track(line.points, Clock.VIDEO, "a.srt", epoch_local_s=T0)
    placed = place_photos([T0 + 5.0 - 3600.0], track, options=OPTIONS)
    assert placed.offset_s == -3600.0
    np.testing.assert_allclose(_north_m(list(placed.points)), [50.0], atol=1e-2)
