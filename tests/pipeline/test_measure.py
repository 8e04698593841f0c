"""Which pairs are registered, and what is expected of them."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from photomap_gis.core.frame import FrameRef
from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.pipeline import measure
from photomap_gis.pipeline.measure import Measurements, Pair, prior_of, rejoining_pairs, sequential_pairs
from photomap_gis.pipeline.settings import MapSettings
from photomap_gis.slam.candidates import Candidate
from photomap_gis.store import PreparedFrame


def frames(*flights: int) -> list[FrameRef]:
    return [FrameRef(i, f"{i}", "", 800, 600, flight) for i, flight in enumerate(flights)]


def test_sequential_pairs_step_over_error_frames_and_stay_within_a_flight():
    prepared = {i: PreparedFrame(i, usable=i != 1) for i in range(5)}
    pairs = sequential_pairs(frames(0, 0, 0, 1, 1), prepared)
    assert [(p.a, p.b) for p in pairs] == [(0, 2), (3, 4)]
    assert all(p.kind is EdgeKind.SEQUENTIAL for p in pairs)


def test_a_candidates_motion_becomes_a_prior_in_working_pixels():
    """A point of b's working image lands in a's where the predicted motion between the planes says."""
    work = {0: Similarity2D(-400, -300, 0.0, math.log(3.125)), 1: Similarity2D(-380, -310, 0.0, math.log(2.5))}
    prepared = {i: PreparedFrame(i, True, None, T) for i, T in work.items()}
    T = Similarity2D(120, -40, 0.3, 0.05)
    covariance = np.diag([100.0, 80.0, 0.2, 0.3]) ** 2
    prior = prior_of(Candidate(0, 1, 0.5, T, covariance), prepared)
    assert prior is not None
    point = np.array([[17.0, 230.0]])
    np.testing.assert_allclose(work[0].apply(prior.T_a_b.apply(point)), T.apply(work[1].apply(point)), atol=1e-9)
    assert prior.sigma_xy_px == pytest.approx(100.0 * math.exp(0.05) / 3.125)
    assert prior.sigma_angle_rad == pytest.approx(0.2)


def test_an_unknown_heading_leaves_the_search_free():
    prepared = {i: PreparedFrame(i, True) for i in range(2)}
    covariance = np.diag([10.0, 10.0, 2.0, 0.1]) ** 2
    assert prior_of(Candidate(0, 1, 0.5, Similarity2D(), covariance), prepared) is None


def test_rejoining_pairs_are_between_groups_untried_and_bounded():
    pairs = {(p.a, p.b) for p in rejoining_pairs([[0, 1, 2], [3, 4]], {(2, 3)})}
    assert pairs == {(0, 3), (0, 4), (1, 3), (1, 4), (2, 4)}
    many = rejoining_pairs([[i] for i in range(200)], set(), reach=3, budget=100)
    assert len(many) == 100
    assert all(p.b - p.a <= 3 for p in many)


def test_pairs_are_registered_frame_by_frame_so_that_spectra_stay_at_hand(rng, monkeypatch):
    """Taken by worth, a flight of more frames than the shelf holds made most spectra several times over."""
    asked: list[tuple[int, int]] = []
    monkeypatch.setattr(measure, "measured_pair", lambda shelf, pair: asked.append((pair.a, pair.b)))
    pairs = [Pair(a, a + gap, EdgeKind.LOOP, fallback=False) for a in range(200) for gap in (2, 5, 21)]
    rng.shuffle(pairs)
    mission = SimpleNamespace(registrations=[], paths=None)
    Measurements(mission, None, {}, MapSettings(), lambda *_: None)._take(pairs, "loops")
    assert asked == sorted((p.a, p.b) for p in pairs)


@pytest.mark.parametrize(
    ("settings", "count", "fallback", "executor"),
    [
        (MapSettings(), 5000, False, "serial"),
        (MapSettings(processes=True), 5000, False, "processes"),
        (MapSettings(processes=True), 100, False, "serial"),
        (MapSettings(processes=True, workers=1), 5000, False, "serial"),
        (MapSettings(), 10, True, "threads"),
    ],
)
def test_only_many_registrations_are_worth_processes(settings, count, fallback, executor, monkeypatch):
    monkeypatch.setattr(measure, "usable_cpus", lambda: 2)
    mission = SimpleNamespace(registrations=[], paths=None)
    measurements = Measurements(mission, None, {}, settings, lambda *_: None)
    assert measurements._executor([Pair(0, 1, EdgeKind.LOOP, fallback=fallback)] * count) == executor
