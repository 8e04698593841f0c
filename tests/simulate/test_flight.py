"""Where the frames are taken, and how wrong the drone believes it is."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from shapely.geometry import Polygon, box

from photomap_gis.core.errors import UsageError
from photomap_gis.core.similarity import wrap_angle
from photomap_gis.simulate.flight import fly, required_size_m
from photomap_gis.simulate.geodesy import GeoFrame
from photomap_gis.simulate.ground import Ground, placed_ground
from photomap_gis.simulate.pattern import plan_pattern
from photomap_gis.simulate.spec import FlightSpec, GpsError, Imaging, Motion

CALM = Motion(0.0, yaw_deg=0.0, height_sigma_m=0.0, wander_sigma_m=0.0)
PERFECT = GpsError(white_sigma_m=0.0, walk_sigma_m=0.0)


@pytest.fixture(scope="module")
def ground() -> Ground:
    return placed_ground(np.zeros((500, 600, 3), np.uint8), None, pixel_size_m=0.5)


@pytest.mark.parametrize("video", [False, True])
@pytest.mark.parametrize("headings", [(0.0,), (35.0,), (0.0, 90.0), (200.0,)])
@pytest.mark.parametrize("tilt", [0.0, 2.0])
def test_every_footprint_lies_on_the_ground(
    ground: Ground, video: bool, headings: tuple[float, ...], tilt: float
) -> None:
    spec = FlightSpec(frames=40, headings_deg=headings, motion=Motion(tilt_deg=tilt), seed=5)
    plan = fly(ground, spec, video=video)
    land = box(*ground.grid.bounds)
    outside = [Polygon(s.pose.footprint_en_m(spec.camera, 0.0)).difference(land).area for s in plan.shots]
    whole = Polygon(plan.shots[0].pose.footprint_en_m(spec.camera, 0.0)).area
    assert len(plan.shots) == 40
    assert max(outside) < 0.02 * whole


def test_photos_overlap_as_asked_and_fly_back_and_forth(ground: Ground) -> None:
    spec = FlightSpec(frames=24, front_overlap=0.7, side_overlap=0.6, motion=CALM, gps=PERFECT)
    plan = fly(ground, spec)
    pattern = plan.patterns[0]
    en = np.array([(s.pose.easting_m, s.pose.northing_m) for s in plan.shots])
    step = np.diff(en, axis=0)
    along = np.abs(step[:, 1]) > 1.0
    assert np.abs(step[along, 1]) == pytest.approx(0.3 * pattern.footprint_m[1])
    assert step[~along, 0] == pytest.approx(0.4 * pattern.footprint_m[0])
    headings = [s.pose.attitude().heading_rad for s in plan.shots]
    assert abs(headings[0]) < 1e-9
    assert abs(wrap_angle(headings[pattern.stations] - math.pi)) < 1e-9
    assert {s.pose.height_m for s in plan.shots} == {pattern.altitude_m}


def test_a_video_turns_its_nose_along_the_way(ground: Ground) -> None:
    spec = FlightSpec(frames=240, altitude_m=60.0, video_rate_hz=3.0, motion=CALM)
    shots = fly(ground, spec, video=True).shots
    assert np.diff([s.time_s for s in shots]) == pytest.approx(1 / 3.0, abs=1e-5)
    turn = np.abs([wrap_angle(b.pose.attitude().heading_rad - a.pose.attitude().heading_rad)
                   for a, b in pairwise(shots)])  # fmt: skip
    assert turn.max() < math.radians(30)
    assert turn.sum() > math.pi * 0.9


def test_the_same_spec_gives_the_same_flight_and_streams_do_not_mix(ground: Ground) -> None:
    spec = FlightSpec(frames=20, motion=Motion(tilt_deg=2.0))
    a, b = fly(ground, spec), fly(ground, spec)
    assert [s.fix for s in a.shots] == [s.fix for s in b.shots]
    other = fly(ground, replace(spec, gps=GpsError(walk_sigma_m=5.0), imaging=Imaging(noise=9.0)))
    assert [s.pose.easting_m for s in a.shots] == [s.pose.easting_m for s in other.shots]
    assert [s.fix for s in fly(ground, replace(spec, seed=1)).shots] != [s.fix for s in a.shots]


def test_tilt_has_the_sigma_asked_for(ground: Ground) -> None:
    spec = FlightSpec(frames=900, side_overlap=0.9, front_overlap=0.9, motion=Motion(tilt_deg=2.0))
    tilts = [s.pose.attitude().off_nadir_rad for s in fly(ground, spec).shots]
    # two axes of sigma 2: the off-nadir angle is Rayleigh
    assert math.degrees(np.sqrt(np.mean(np.square(tilts)))) == pytest.approx(2.0 * math.sqrt(2.0), rel=0.1)


def test_gps_error_is_walk_bias_and_dropouts(ground: Ground) -> None:
    gps = GpsError(white_sigma_m=0.3, walk_sigma_m=2.0, walk_tau_s=10.0, bias_east_m=30.0, dropout_share=0.2)
    shots = fly(ground, FlightSpec(frames=800, front_overlap=0.93, side_overlap=0.9, gps=gps)).shots
    kept = [s for s in shots if s.fix is not None]
    assert len(kept) == 640
    frame = GeoFrame(ground.crs_wkt)
    believed = frame.from_lon_lat([(s.fix.lon_deg, s.fix.lat_deg) for s in kept if s.fix])
    error = believed - [(s.pose.easting_m, s.pose.northing_m) for s in kept]
    assert error.mean(axis=0) == pytest.approx([30.0, 0.0], abs=0.9)
    assert error.std(axis=0) == pytest.approx([2.0, 2.0], rel=0.3)


def test_a_slow_receiver_repeats_itself(ground: Ground) -> None:
    spec = FlightSpec(frames=60, video_rate_hz=10.0, gps=GpsError(rate_hz=2.0))
    fixes = [s.fix for s in fly(ground, spec, video=True).shots]
    assert len({(f.lat_deg, f.lon_deg) for f in fixes if f}) == 12


def test_reports_are_true_or_absent(ground: Ground) -> None:
    spec = FlightSpec(frames=6, motion=Motion(tilt_deg=3.0), barometer_sigma_m=0.0)
    convergence = GeoFrame(ground.crs_wkt).convergence_rad(*ground.centre_en_m)
    for shot in fly(ground, spec).shots:
        assert shot.attitude is not None
        assert np.allclose(shot.attitude.R_ned_camera, shot.pose.attitude(convergence).R_ned_camera, atol=1e-9)
        assert shot.relative_height_m == pytest.approx(shot.pose.height_m)
    silent = fly(ground, replace(spec, report_attitude=False, report_height=False)).shots
    assert all(s.attitude is None and s.relative_height_m is None for s in silent)


def test_a_noisy_gimbal_is_off_by_its_sigma(ground: Ground) -> None:
    spec = FlightSpec(frames=200, side_overlap=0.9, attitude_sigma_deg=0.5, motion=CALM)
    off = [math.degrees(s.attitude.off_nadir_rad) for s in fly(ground, spec).shots if s.attitude]
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(0.5 * math.sqrt(2.0), rel=0.2)


def test_the_pattern_fills_the_ground(ground: Ground) -> None:
    pattern = plan_pattern(FlightSpec(), 80, 0.0, room_m=ground.size_m, video=False)
    width, height = pattern.box_m
    assert max(width / ground.size_m[0], height / ground.size_m[1]) == pytest.approx(1.0, abs=1e-6)


def test_a_made_ground_is_as_large_as_the_flight_needs() -> None:
    spec = FlightSpec(frames=30, altitude_m=70.0)
    size = required_size_m(spec, video=False)
    room = placed_ground(np.zeros((int(size[1]) + 2, int(size[0]) + 2, 3), np.uint8), None, pixel_size_m=1.0)
    assert fly(room, spec).patterns[0].altitude_m == 70.0


@pytest.mark.parametrize(("altitude", "words"), [(300.0, "at most"), (None, "too small")])
def test_what_does_not_fit_says_what_would(altitude: float | None, words: str) -> None:
    small = placed_ground(np.zeros((40, 40, 3), np.uint8), None, pixel_size_m=0.1 if altitude is None else 5.0)
    with pytest.raises(UsageError, match=words):
        fly(small, FlightSpec(frames=400, altitude_m=altitude))


@pytest.mark.parametrize(
    "wrong", [{"frames": 0}, {"hfov_deg": 180.0}, {"front_overlap": 1.0}, {"width_px": 3}, {"headings_deg": ()}]
)
def test_nonsense_is_refused(wrong: dict) -> None:
    with pytest.raises(UsageError, match="simulate:"):
        FlightSpec(**wrong)


def test_one_frame_is_a_flight_too(ground: Ground) -> None:
    for video in (False, True):
        assert len(fly(ground, FlightSpec(frames=1, altitude_m=50.0), video=video).shots) == 1
