"""The flights that the pose graph is measured on say the truth about themselves."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.registration.report import markdown
from benchmarks.slam import sections
from benchmarks.slam.measure import Options, absolute_nees, relative_rmse_m
from benchmarks.slam.world import EdgeNoise, Plan, fly, gauss_markov, graph_of, overlaps
from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.slam import solve

SMALL = Plan(60, strip_m=120.0, forward=0.7)


def errors(flown, graph):
    """``(E, 4)`` errors of the edges and their claimed covariances."""
    xi = [(e.T_a_b.inverse() @ flown.poses[e.a].inverse() @ flown.poses[e.b]).log() for e in graph.edges]
    return np.array(xi), np.array([e.covariance for e in graph.edges])


def test_claimed_covariances_hold_the_errors_of_good_registrations(rng):
    flown = fly(rng, SMALL)
    graph = graph_of(rng, flown, gps=None)
    xi, claimed = errors(flown, graph)
    nees = np.einsum("ni,ni->n", xi, np.linalg.solve(claimed, xi[:, :, None])[:, :, 0])
    assert len(graph.edges) > 200
    assert np.mean(nees) / 4.0 == pytest.approx(1.0, abs=0.12)  # the product's floor of covariances makes it smaller


def test_planted_loops_are_as_many_as_asked_for_and_the_others_are_the_same():
    flown = fly(np.random.default_rng(1), SMALL)
    clean, dirty = (graph_of(np.random.default_rng(2), flown, gps=None, false=f) for f in (0.0, 0.2))
    loops = sum(e.kind is EdgeKind.LOOP for e in clean.edges)
    changed = [
        (a.kind, np.abs(a.T_a_b.log() - b.T_a_b.log()).max())
        for a, b in zip(clean.edges, dirty.edges, strict=True)
        if a.T_a_b != b.T_a_b
    ]
    assert len(changed) == round(0.2 * loops)
    assert all(kind is EdgeKind.LOOP for kind, _ in changed)
    assert np.median([size for _, size in changed]) > 50.0


def test_strips_are_flown_to_and_fro(rng):
    flown = fly(rng, replace(SMALL, wander_m=0.0, speed_wander=0.0))
    speed = np.linalg.norm(np.diff(flown.path_m, axis=0), axis=1) / np.diff(flown.path_s)
    assert np.allclose(speed, SMALL.speed_m_s, rtol=0.02)
    assert np.ptp(flown.path_m[:, 1]) > SMALL.strip_m and np.ptp(flown.path_m[:, 0]) > 50.0
    gaps = [b - a for a, b, _ in overlaps(flown, 0.3)]
    assert max(gaps) > 10 and min(gaps) == 1
    np.testing.assert_allclose(flown.centres_m, flown.xy_m)


def test_gauss_markov_has_its_sigma_and_memory(rng):
    x = gauss_markov(rng, np.arange(40000.0), 2.0, 10.0)
    assert np.std(x) == pytest.approx(2.0, rel=0.1)
    assert np.mean(x[1:] * x[:-1]) / np.mean(x * x) == pytest.approx(np.exp(-0.1), abs=0.02)


def test_leaning_cameras_leave_a_misfit_that_is_claimed(rng):
    flown = fly(rng, replace(SMALL, tilt_sigma_rad=np.radians(2.0)))
    xi, claimed = errors(flown, graph_of(rng, flown, gps=None, noise=EdgeNoise(0.01)))
    sigma = np.sqrt(np.median(claimed[:, 0, 0]))
    assert 1.0 < sigma < 20.0 and 0.2 * sigma < np.median(np.abs(xi[:, 0])) < 2.0 * sigma


def test_a_solved_flight_is_judged(rng):
    flown = fly(rng, SMALL)
    solution = solve(graph_of(rng, flown))
    assert relative_rmse_m(flown, solution) < 0.2
    assert 0.0 < absolute_nees(flown, solution) < 6.0
    lost = replace(solution, poses=solution.poses[1:])
    assert relative_rmse_m(flown, lost) == float("inf")


def test_a_section_writes_its_table(monkeypatch):
    monkeypatch.setattr(sections, "TEN_MINUTES", replace(sections.TEN_MINUTES, frames=40, strip_m=100.0))
    text = markdown(sections.absolute(Options(seeds=2)))
    assert "over a perfect map" in text and "NEES" in text
