"""The summary of what is there."""

import json
import math

import pytest

from photomap_gis.core.camera import Camera
from photomap_gis.core.frame import Attitude, Flight, Footage, FrameRef, GpsFix
from photomap_gis.ingest.describe import describe

CAMERA = Camera(1000, 750, 1000.0, name="X", origin="profile")


def lane(spacing_m=20.0, count=5, height=100.0, yaw=0.0, lon=21.0, camera=CAMERA):
    """Frames flown due north."""
    return [
        FrameRef(
            index=i,
            name=f"{i}.jpg",
            source=f"/d/{i}.jpg",
            width_px=1000,
            height_px=750,
            time_s=1e9 + 2 * i,
            fix=GpsFix(52 + i * spacing_m / 111_320, lon),
            attitude=Attitude(yaw, -math.pi / 2),
            height_m=height,
            camera=camera,
        )
        for i in range(count)
    ]


def footage(frames, *warnings):
    return Footage(tuple(frames), (Flight(0, "f", "X"),), warnings)


def test_a_lane():
    info = describe(footage(lane()))
    (flight,) = info.flights
    assert (info.frames, info.photos, info.usable, info.fixes, info.attitudes) == (5, 5, 5, 5, 5)
    assert info.gsd_m_per_px == pytest.approx(0.1)
    assert flight.length_m == pytest.approx(80.0)
    assert flight.speed_m_s == pytest.approx(10.0)
    assert flight.spacing_m == pytest.approx(20.0)
    assert flight.interval_s == 2.0
    assert flight.duration_s == 8.0
    assert flight.overlap == pytest.approx(1 - 20 / 75)  # the image's height is 75 m on the ground
    assert info.off_nadir_deg.high == pytest.approx(0.0, abs=1e-5)
    assert info.problems == ()


def test_overlap_follows_the_heading():
    info = describe(footage(lane(yaw=math.pi / 2)))
    assert info.flights[0].overlap == pytest.approx(1 - 20 / 100)


def test_small_overlap_is_a_problem():
    info = describe(footage(lane(spacing_m=60.0)))
    assert info.flights[0].overlap == pytest.approx(0.2, abs=0.01)
    assert any("overlap by 20 %" in p for p in info.problems)


def test_nothing_known():
    bare = [FrameRef(i, f"{i}.jpg", "", 0, 0, problem="unreadable: x" if i else None) for i in range(2)]
    info = describe(footage(bare, "a warning"))
    assert (info.usable, info.bounds, info.height_m, info.gsd_m_per_px) == (1, None, None, None)
    assert info.flights[0].overlap is None
    assert info.problems[0] == "a warning"
    assert any("no positions" in p for p in info.problems)
    assert any("lens is not known" in p for p in info.problems)
    assert any("1 of 2 frames cannot be read" in p for p in info.problems)
    assert describe(Footage((), ())).frames == 0


def test_oblique_frames_are_counted():
    frames = lane()
    tilted = [*frames[:3], *(f for f in lane()[3:])]
    tilted[3] = FrameRef(3, "o.jpg", "", 1000, 750, attitude=Attitude(0.0, -math.radians(30)), camera=CAMERA)
    info = describe(footage(tilted))
    assert info.oblique == 1
    assert any("off nadir" in p for p in info.problems)


def test_bounds_across_the_date_line():
    frames = lane(lon=179.9999)[:1] + lane(lon=-179.9999)[:1]
    bounds = describe(footage(frames)).bounds
    assert bounds.west_deg == pytest.approx(179.9999)
    assert bounds.east_deg == pytest.approx(-179.9999)
    assert describe(footage(frames)).flights[0].length_m < 30


def test_words():
    words = str(describe(footage(lane())))
    assert "5 photos" in words
    assert "53.1° across the width ± 3.0 %, from profile" in words
    assert "neighbours overlap by 73 %" in words
    assert "10.0 cm on the ground" in words
    assert "none" in str(describe(Footage((), ())))


def test_plain_values_for_json():
    plain = json.loads(json.dumps(describe(footage(lane())).as_dict()))
    assert plain["bounds"]["west_deg"] == 21.0
    assert plain["height_m"] == {"low": 100.0, "median": 100.0, "high": 100.0}
    assert plain["flights"][0]["height_m"]["high"] == 100.0
    assert plain["cameras"][0]["origin"] == "profile"
