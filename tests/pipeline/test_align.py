"""A logger's clock that is off by a minute or by hours: the motion of the pictures tells."""

from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.slam.world import CAMERA, EdgeNoise, GpsNoise, Plan, fly, frame_refs, map_frame_here, registration
from photomap_gis.core.frame import Flight, FlightTrack, Footage, GpsFix, TrackFix
from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.georef import fix_to_map, map_to_lonlat, plane_view
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.pipeline.align import aligned, track_shifts
from photomap_gis.pipeline.measure import Measurements
from photomap_gis.pipeline.settings import MapSettings
from photomap_gis.pipeline.solve import lag_warnings, solve_mission
from photomap_gis.pipeline.solved import Solved
from photomap_gis.store import Mission, MissionHeader, PreparedFrame, RegistrationRecord

PLAN = Plan(150, strip_m=150.0, forward=0.72)
MAP = map_frame_here()
QUIET = GpsNoise(white_m=0.3, drift_m=1.0, bias_m=0.5, blunders=0.0, dropouts=0.0)
TO_PLANE = Similarity2D.translation_of(*-CAMERA.principal_xy_px)


def kept(flown, late_s, rng):
    """The track as a logger writes it whose clock is late by so much, by the frames' clock."""
    when_s = flown.path_s[::5]
    lonlat = map_to_lonlat(MAP, flown.path_m[::5] + rng.normal(0, 0.3, (len(when_s), 2)))
    points = [
        TrackFix(float(t + late_s), GpsFix(float(q[1]), float(q[0]))) for t, q in zip(when_s, lonlat, strict=True)
    ]
    return FlightTrack(0, tuple(points))


@pytest.fixture
def mission_of(tmp_path):
    """A mission whose sequential frames are registered, with a track that is late."""

    opened = ExitStack()

    def make(rng, late_s, plan=PLAN):
        flown = fly(rng, plan)
        track = kept(flown, late_s, rng)
        frames = aligned_by(track, frame_refs(rng, flown, MAP, QUIET))
        header = MissionHeader((), {}, MAP, "2026-01-01T00:00:00Z", "test")
        mission = opened.enter_context(
            Mission.create(tmp_path / "m", header, Footage(frames, (Flight(0, "flight", "camera"),), (), (track,)))
        )
        prepared = {k: PreparedFrame(k, True, None, TO_PLANE) for k in range(len(frames))}
        mission.prepared.extend(prepared.values())
        pairs = [(k, k + 1) for k in range(len(frames) - 1)]
        noise = EdgeNoise()
        mission.registrations.extend(
            RegistrationRecord.of(registration(rng, flown, a, b, noise), EdgeKind.SEQUENTIAL) for a, b in pairs
        )
        return flown, mission, frames, prepared

    with opened:
        yield make


def aligned_by(track, frames):
    """The frames placed by a track as ingest does it, clocks believed."""
    times = np.array([p.time_s for p in track.points])
    at = np.array([[p.fix.lat_deg, p.fix.lon_deg] for p in track.points])
    out = []
    for f in frames:
        lat, lon = (np.interp(f.time_s, times, at[:, k], left=np.nan, right=np.nan) for k in (0, 1))
        out.append(replace(f, fix=GpsFix(float(lat), float(lon)) if np.isfinite(lat) else None))
    return tuple(out)


def misses_m(flown, frames):
    """Distance of each frame's fix from its true place."""
    with_fix = [f for f in frames if f.fix is not None]
    at = fix_to_map(MAP, [f.fix.lat_deg for f in with_fix], [f.fix.lon_deg for f in with_fix])
    return np.linalg.norm(at - flown.xy_m[[f.index for f in with_fix]], axis=1)


@pytest.mark.parametrize("late_s", [25.0, -41.5, 3600.0 - 18.0])
def test_the_frames_are_placed_anew_by_a_late_track(mission_of, late_s):
    flown, mission, frames, prepared = mission_of(np.random.default_rng(7), late_s)
    shifts = track_shifts(mission, frames, list(mission.registrations), prepared)
    assert shifts[0] == pytest.approx(late_s, abs=1.0)
    moved = aligned(mission, frames, shifts)
    assert sum(f.fix is not None for f in moved) == len(frames)
    assert np.median(misses_m(flown, moved)) < 8.0  # a second at 8 m/s at most: the solver does the rest


def test_a_punctual_track_stays(mission_of):
    _, mission, frames, prepared = mission_of(np.random.default_rng(3), 0.4)
    assert track_shifts(mission, frames, list(mission.registrations), prepared) == {}
    assert aligned(mission, frames, {}) == frames


def test_a_straight_steady_flight_does_not_tell(mission_of):
    plan = replace(PLAN, strip_m=5000.0, speed_wander=0.0, wander_m=0.0)
    _, mission, frames, prepared = mission_of(np.random.default_rng(4), 20.0, plan)
    assert track_shifts(mission, frames, list(mission.registrations), prepared) == {}


def test_shift_and_fine_lag_are_told_as_one(mission_of):
    _, mission, frames, prepared = mission_of(np.random.default_rng(9), 25.2)
    settings = MapSettings(ingest=IngestOptions())
    views = {f.index: plane_view(f) for f in frames}
    measurements = Measurements(mission, None, prepared, settings, lambda *_: None)
    measurements.take_sequential(frames)
    shifts = track_shifts(mission, frames, measurements.accepted, prepared)
    solved = solve_mission(mission, aligned(mission, frames, shifts), views, measurements, settings, shifts_s=shifts)
    assert solved.fix_lags[0].lag_s == pytest.approx(25.2, abs=0.1) and solved.fix_lags[0].sigma_s < 0.1
    (word,) = lag_warnings(mission, solved.fix_lags)
    assert "+25.2" in word or "+25.1" in word
    solved.save(mission)
    again = Solved.load(mission)
    assert (again.fix_lags, again.track_shifts_s) == (solved.fix_lags, solved.track_shifts_s)
    assert again.track_lags({0: "flight"})["flight"]["corrected"] is True
