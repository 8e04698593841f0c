"""The judge of posed flights knows right sigmas from wrong ones, and where pixels truly lie."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.registration.report import markdown
from benchmarks.slam import posed, rendered
from benchmarks.slam.measure import Options
from benchmarks.slam.real import fixes_left_out
from photomap_gis.simulate import FlightSpec, Motion, run_simulation
from photomap_gis.slam.bundle.fixes import FixNoise


def test_errors_drawn_from_a_covariance_have_it(rng):
    n = 60
    root = rng.normal(0, 1, (2 * n, 2 * n)) / 8.0 + 0.5
    joint, xy = root @ root.T + 0.01 * np.eye(2 * n), rng.uniform(-50, 50, (n, 2))
    drawn = [(root @ rng.normal(size=2 * n) + 0.1 * rng.normal(size=2 * n)).reshape(n, 2) for _ in range(150)]
    whole = np.array([joint[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(n)])
    assert np.mean([posed.nees(e, whole) for e in drawn]) == pytest.approx(1.0, abs=0.25)
    left = [posed.nees(*posed.after_similarity(e, joint, xy)) for e in drawn]
    assert np.mean(left) == pytest.approx(1.0, abs=0.1)
    halved = [posed.nees(*posed.after_similarity(e, joint / 4.0, xy)) for e in drawn]
    assert np.mean(halved) == pytest.approx(4.0 * np.mean(left))


def test_a_similarity_is_no_relative_error(rng):
    xy = rng.uniform(-50, 50, (20, 2))
    moved = xy * 1.01 + xy[:, ::-1] * (0.02, -0.02) + (3.0, -4.0)
    off, _ = posed.after_similarity(moved - xy, np.eye(40), xy)
    assert np.abs(off).max() < 1e-9


def test_the_land_that_a_pixel_shows_is_seen_by_that_pixel(tmp_path):
    spec = FlightSpec(frames=2, width_px=200, height_px=150, altitude_m=60.0, motion=Motion(tilt_deg=4.0), seed=4)
    truth = run_simulation("procedural", tmp_path, spec).truth
    ground = truth.ground()
    x, y = np.meshgrid(np.linspace(5, 195, 8), np.linspace(5, 145, 6))
    xy = np.stack([x, y], axis=-1).reshape(-1, 2)
    everything = np.ones(ground.colour.shape[:2], bool)
    for frame in truth.frames:
        seen = rendered.land_seen(ground, everything, frame.pose, truth.camera, xy)
        shown = np.isfinite(seen).all(axis=1)
        assert shown.mean() > 0.5
        back = frame.pose.project(truth.camera, np.c_[seen, ground.heights_at(np.nan_to_num(seen))])
        assert back[shown] == pytest.approx(xy[shown], abs=0.1)
        none = rendered.land_seen(ground, ~everything, frame.pose, truth.camera, xy)
        assert np.isnan(none).all()


def test_a_flight_is_flown_posed_and_judged(monkeypatch):
    monkeypatch.setattr(rendered, "FRAMES", 9)
    monkeypatch.setattr(rendered, "WIDTH_PX", 480)
    monkeypatch.setattr(rendered, "HEIGHT_PX", 360)
    judged = posed.fly_and_judge("reported", 7)
    assert judged.placed == judged.frames == 9
    assert judged.rmse_gsd < 2.0
    assert all(0.0 < v < 20.0 for v in (judged.cameras, judged.cameras_relative, judged.pixels, judged.pixels_relative))
    other = replace(judged, kind="leaning", focal_observed=True, focal_off=0.02, k1_observed=True)
    told = posed.section([judged, other], Options(seeds=2))
    assert [f.name for f in told.missed if "focal" in f.name] == ["focal length where told: largest error"]
    assert "reported" in markdown(told) and "NEES" in markdown(told)


def test_a_fix_that_is_left_out_is_told_by_all_others(rng):
    """The twin: the solution made again without it, in a world that is linear."""
    n = 12
    noise = FixNoise(np.zeros(n, int), 0.1 * np.arange(n), np.full(n, 0.3), np.full(n, 1.5), np.full(n, 0.7))
    root = rng.normal(0, 1, (n, n))
    prior, R = root @ root.T + 0.2 * np.eye(n), noise.covariance
    seen = rng.normal(0, 3, (n, 2))

    def solved(kept):
        gain = prior[:, kept] @ np.linalg.inv((prior + R)[np.ix_(kept, kept)])
        return gain @ seen[kept], prior - gain @ prior[kept]

    every = np.arange(n)
    centre, P = solved(every)
    joint = np.zeros((6 * n, 6 * n))
    for axis in (0, 1):
        joint[axis::6, axis::6] = P
    problem = SimpleNamespace(fix_noise=noise, fix_xy=seen, fix_of=every)
    off, claimed = fixes_left_out(problem, SimpleNamespace(centre=np.c_[centre, np.zeros(n)], joint=joint))
    for k in range(n):
        kept = np.delete(every, k)
        gain = (prior + R)[k, kept] @ np.linalg.inv((prior + R)[np.ix_(kept, kept)])
        assert off[k] == pytest.approx(seen[k] - gain @ seen[kept])
        assert claimed[k] == pytest.approx((prior + R)[k, k] - gain @ (prior + R)[kept, k])
