"""What is kept of a track beside the frames."""

import pytest

from photomap_gis.core.frame import Attitude, FrameRef, GpsFix
from photomap_gis.ingest.kept_track import kept_track, placed_anew
from photomap_gis.ingest.resample import interpolate
from photomap_gis.ingest.telemetry.track import Clock, Track, TrackPoint


def track(**more):
    points = [
        TrackPoint(100.0 + t, 52.0 + 1e-5 * t, 19.0 - 2e-5 * t, 120.0, 60.0 + t, sigma_m=1.5, **more) for t in range(60)
    ]
    return Track(tuple(points), Clock.UTC, "log.csv")


def frames(apart_s, count=20, **more):
    return [FrameRef(k, f"{k}", "v.mp4", 640, 480, 3, time_s=100.0 + apart_s + 2.0 * k, **more) for k in range(count)]


def places(log, taken, apart_s):
    return interpolate(log, [f.time_s - apart_s for f in taken])


def test_the_track_is_kept_on_the_frames_clock():
    log, taken = track(), frames(3600.0)
    kept = kept_track(log, 3, taken, places(log, taken, 3600.0))
    assert kept.flight == 3 and len(kept.points) == len(log.points)
    assert kept.points[0].time_s == pytest.approx(3700.0) and kept.points[0].fix == GpsFix(52.0, 19.0, 120.0, 1.5)


def test_frames_are_placed_anew_as_they_would_have_been():
    level = Attitude(0.3, -1.5)
    log, taken = track(attitude=level), frames(0.0, frame_number=1)
    kept = kept_track(log, 3, taken, places(log, taken, 0.0))
    moved = placed_anew(taken, kept, 4.0)
    assert moved[0].fix.lat_deg == pytest.approx(52.0 + 4e-5, abs=1e-9)
    assert moved[0].height_m == pytest.approx(64.0)
    assert moved[0].attitude.yaw_rad == pytest.approx(0.3)
    assert placed_anew(moved, kept, 0.0)[5].fix.lon_deg == pytest.approx(19.0 - 20e-5, abs=1e-9)
    assert placed_anew(taken, kept, 500.0)[0].fix is None


def test_a_photo_keeps_its_attitude_and_other_flights_stay():
    own = Attitude(1.0, -1.5)
    log, taken = track(attitude=Attitude(0.3, -1.5)), frames(0.0, attitude=own)
    kept = kept_track(log, 3, taken, places(log, taken, 0.0))
    assert placed_anew(taken, kept, 4.0)[0].attitude == own
    other = [FrameRef(0, "0", "a.jpg", 640, 480, 4, time_s=100.0)]
    assert placed_anew(other, kept, 4.0) == tuple(other)


def test_frames_without_a_common_clock_keep_no_track():
    log, taken = track(), frames(0.0)
    matched = interpolate(log, [f.time_s - (2.0 if f.index > 5 else 0.0) for f in taken])
    assert kept_track(log, 3, taken, matched) is None
    assert kept_track(log, 3, taken, [None] * len(taken)) is None


def test_a_dense_track_is_thinned():
    points = [TrackPoint(0.02 * t, 52.0 + 1e-7 * t, 19.0) for t in range(5000)]
    log, taken = Track(tuple(points), Clock.UTC, "fast.ulg"), [FrameRef(0, "0", "a.jpg", 640, 480, time_s=50.0)]
    kept = kept_track(log, 0, taken, interpolate(log, [50.0]))
    assert len(kept.points) == 1000
