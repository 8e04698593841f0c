"""Flights are posed in space where ties and lenses allow it, and stay flat where they do not."""

import json
from dataclasses import replace

import numpy as np
import pytest

from photomap_gis.core.placement import PlanePlacement, PosedPlacement
from photomap_gis.core.posegraph import FixLag
from photomap_gis.georef import plane_view
from photomap_gis.pipeline import MapSettings, in_space, map_flight
from photomap_gis.pipeline.measure import Measurements
from photomap_gis.pipeline.solve import solve_mission
from photomap_gis.pipeline.solved import Solved
from photomap_gis.simulate import FlightSpec, Motion, run_simulation
from photomap_gis.simulate.evaluate import evaluate_map
from photomap_gis.slam.bundle import bundle_adjust
from photomap_gis.store import Mission


def test_a_mapped_flight_is_posed_in_space_and_reads_back_the_same(mapped):
    with Mission.open(mapped.folder) as mission:
        solved = Solved.load(mission)
        solved.save(mission)
        again = Solved.load(mission)
    assert all(isinstance(p.camera_to_map, PosedPlacement) for p in solved.trajectory.placements)
    pixels = np.array([[0.0, 0.0], [639.0, 479.0], [320.0, 200.0]])
    for p, q in zip(solved.trajectory.placements, again.trajectory.placements, strict=True):
        assert p.camera_to_map.project(pixels) == pytest.approx(q.camera_to_map.project(pixels), abs=1e-3)
        assert p.pose_covariance.shape == (6, 6) and (np.linalg.eigvalsh(p.pose_covariance) > 0).all()
    assert solved.lenses == again.lenses and len(solved.lenses) == 1


def test_what_the_flight_told_of_its_lens_is_in_the_document(mapped):
    (lens,) = json.loads(json.dumps(mapped.summary.as_document()))["lenses"]
    assert lens["focal_px"] == pytest.approx(640 / 1.5, rel=0.02)
    assert isinstance(lens["focal_observed"], bool) and lens["focal_sigma_rel"] > 0


@pytest.mark.parametrize("reported", [True, False])
def test_a_camera_that_looks_ahead_gives_a_straight_map(tmp_path, reported):
    spec = FlightSpec(
        frames=16,
        altitude_m=80.0,
        width_px=640,
        height_px=480,
        motion=Motion(tilt_deg=1.0, lean_deg=12.0),
        report_attitude=reported,
        seed=5,
    )
    flown = run_simulation("procedural", tmp_path / "sim", spec)
    summary = map_flight([flown.source], tmp_path / "m")
    errors = evaluate_map(summary.map, flown.truth.folder)
    assert summary.frames["registered"] == 16
    assert errors.relative_rmse_gsd < 3.0


def test_without_a_known_lens_the_map_stays_flat(flown, tmp_path):
    from PIL import Image

    bare = tmp_path / "bare"
    bare.mkdir()
    for photo in sorted(flown.photos.glob("*.JPG"))[:5]:
        with Image.open(photo) as picture:
            picture.save(bare / photo.name, quality=92)
    map_flight([bare], tmp_path / "m")
    with Mission.open(tmp_path / "m") as mission:
        solved = Solved.load(mission)
    assert solved.trajectory.placements
    assert all(isinstance(p.camera_to_map, PlanePlacement) for p in solved.trajectory.placements)
    assert solved.lenses == ()


def test_the_fit_is_to_the_fixes_as_they_were_used(mapped, monkeypatch):
    """Where fixes were freed of a lag, what is left is left against those."""
    asked = []

    def spy(problem):
        asked.append(problem)
        return bundle_adjust(problem)

    late = {0: FixLag(2.0, 0.05)}
    monkeypatch.setattr(in_space, "lags_by_flight", lambda solution, fixes: late)
    with Mission.open(mapped.folder) as mission:
        frames = tuple(mission.frames)
        views = {f.index: plane_view(f) for f in frames}
        prepared = {p.frame: p for p in mission.prepared}
        measurements = Measurements(mission, None, prepared, MapSettings(), lambda *_: None)
        measurements.take_kept()
        flat = solve_mission(mission, frames, views, measurements, MapSettings())
    flat = replace(flat, solution=replace(flat.solution, fix_lags=late))
    posed = in_space.solve_in_space(frames, views, measurements, flat, adjust=spy)
    raw, used = asked
    assert np.abs(raw.fix_xy - used.fix_xy).max() > 3.0
    centres = {p.frame: p.camera_to_map.centre_map[:2] for p in posed.trajectory.placements}
    off = np.array([centres[used.views[k].frame] for k in used.fix_of]) - used.fix_xy
    trusted = np.diag(used.fix_noise.information)  # a lag that is not there makes blunders, which do not count
    off = off[trusted > 1e-3 * np.median(trusted)]
    assert len(off) >= 5
    assert posed.fit_to_gps_rms_m == pytest.approx(np.sqrt(np.mean(np.sum(off**2, axis=1))), rel=1e-6)
    assert posed.fix_lags == late
