"""The parts that keep false measurements out: bridges, the linear start, the anchoring, the weights."""

import flights as fl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.core.similarity import fit_similarity
from photomap_gis.slam.anchor import align
from photomap_gis.slam.bridges import bridges, contradicted_bridges
from photomap_gis.slam.components import by_size, component_labels
from photomap_gis.slam.initial import relative_poses
from photomap_gis.slam.problem import edge_terms, position_terms
from photomap_gis.slam.robust import geman_mcclure, redescending, spread


def graph_of(pairs, n):
    neighbours = [[] for _ in range(n)]
    for k, (a, b) in enumerate(pairs):
        neighbours[a].append((b, k))
        neighbours[b].append((a, k))
    return neighbours


@given(st.lists(st.tuples(st.integers(0, 7), st.integers(0, 7)).filter(lambda p: p[0] != p[1]), max_size=16))
def test_a_bridge_is_what_cuts(pairs):
    def parts(rest):
        a, b = (np.array([p[k] for p in rest], np.intp) for k in (0, 1))
        return len(set(component_labels(8, a, b).tolist()))

    whole = parts(pairs)
    expected = [k for k in range(len(pairs)) if parts(pairs[:k] + pairs[k + 1 :]) > whole]
    assert bridges(graph_of(pairs, 8)) == expected


def laid_out(flight, edges, fixes):
    node_of = {k: k for k in range(len(flight.poses))}
    terms = edge_terms(edges, node_of)
    return relative_poses(len(flight.poses), terms), terms, position_terms(fixes, node_of)[0]


def test_the_fixes_find_a_false_bridge(rng):
    flight = fl.lawnmower(rng)
    edges = [e for e in fl.edges(rng, flight) if (e.a < 40) == (e.b < 40)]
    good = fl.edge(rng, flight, 39, 40, EdgeKind.SEQUENTIAL)
    bad = type(good)(34, 40, good.T_a_b, good.covariance, EdgeKind.LOOP)  # true of another pair
    fixes = fl.fixes(rng, flight, blunders=0.05)
    assert not len(contradicted_bridges(*laid_out(flight, [*edges, good], fixes)))
    assert contradicted_bridges(*laid_out(flight, [*edges, bad], fixes)).tolist() == [len(edges)]


def test_good_chains_are_left_whole(rng):
    for _ in range(5):
        flight = fl.lawnmower(rng)
        edges = fl.edges(rng, flight, reach_m=0.1, noise=3.0)
        assert not len(contradicted_bridges(*laid_out(flight, edges, fl.fixes(rng, flight, blunders=0.05))))


def test_the_linear_start_is_near_whatever_the_headings(rng):
    flight = fl.lawnmower(rng, jitter_rad=2.0)  # no two frames point the same way
    relative, _, _ = laid_out(flight, fl.edges(rng, flight, false=0.2), [])
    centres = np.stack([relative.t.real, relative.t.imag], axis=1)
    fit = fit_similarity(flight.centres_m, centres)
    assert fl.rmse(fit.apply(centres), flight.centres_m) < 0.15
    np.testing.assert_allclose(relative.w.real + fit.log_scale, [p.log_scale for p in flight.poses], atol=0.01)


def test_parallel_edges_are_kept_apart(rng):
    flight = fl.lawnmower(rng, 2, 5)
    edges = fl.edges(rng, flight) + fl.edges(rng, flight, false=1.0)[9:]
    relative, _, _ = laid_out(flight, edges, [])
    assert (relative.labels == 0).all() and np.isfinite(relative.t).all()


def test_alignment_stands_blunders(rng):
    points = rng.normal(size=60) * 300 + 1j * rng.normal(size=60) * 300
    fixes = 0.1j * points + (5 - 7j) + (rng.normal(size=60) + 1j * rng.normal(size=60))
    fixes[:20] += rng.normal(size=20) * 500
    fit = align(points, fixes, np.full(60, 2.0))
    assert abs(fit.z - 0.1j) < 0.004 and abs(fit.t - (5 - 7j)) < 1.0 and fit.sigma_rad < 0.15


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_short_baselines_do_not_align(rng, count):
    points = np.arange(count) * 1.0 + 0j
    assert align(points, points * 0.5, np.full(count, 2.0)) is None
    assert align(np.zeros(count, complex), np.zeros(count, complex), np.ones(count)) is None


def test_weights():
    squared = np.array([0.0, 1.0, 16.0, 64.0, 1e9])
    np.testing.assert_allclose(redescending(squared, 4.0)[:4], [1.0, 1.0, 1.0, 1.0 / 16.0])
    assert redescending(squared, 4.0)[4] < 1e-10
    assert (np.diff(geman_mcclure(squared, 4.0)) < 0).all()


def test_spread_is_found_and_never_below_one(rng):
    chi2 = (rng.normal(size=(4000, 4)) ** 2).sum(axis=1)
    assert spread(chi2 * 9.0, 4) == pytest.approx(3.0, rel=0.05)
    assert spread(chi2 * 0.01, 4) == 1.0 and spread(np.zeros(0), 4) == 1.0


def test_the_largest_component_is_number_zero():
    labels = component_labels(6, np.array([1, 2, 4]), np.array([2, 3, 5]))
    np.testing.assert_array_equal(labels, [0, 1, 1, 1, 2, 2])
    np.testing.assert_array_equal(by_size(labels), [2, 0, 0, 0, 1, 1])
    assert len(by_size(np.zeros(0, np.intp))) == 0
