"""The chain of slices solves what one dense system does, whatever fixes and known places share."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import dense_of, make_world

from photomap_gis.core.ground import HeightField
from photomap_gis.slam.bundle import Marks, bundle_adjust, solve
from photomap_gis.slam.bundle.equations import SpotPrior, reduced_equations
from photomap_gis.slam.bundle.fixes import FixNoise
from photomap_gis.slam.bundle.layout import POSE, Layout
from photomap_gis.slam.bundle.marks import mark_terms
from photomap_gis.slam.bundle.model import cameras_of, linearise
from photomap_gis.slam.bundle.problem import BundleState

BENDS = 2


def drifting(n: int, rng) -> FixNoise:
    """Fixes of two flights that share drifts and biases; one is a blunder."""
    flight = (np.arange(n) >= n // 2).astype(int)
    phase = np.where(flight == 0, np.arange(n), np.arange(n) - n // 2) * 0.03
    white = np.full(n, 0.2)
    white[n // 3] = 1e6
    return FixNoise(flight, phase, white, np.full(n, 1.7), np.full(n, 0.8))


def equations(problem, rng, marks=None):
    """Return the equations at a state near the start, everything in them."""
    state = replace(BundleState.start(problem), z=rng.normal(0, 1.0, problem.ties.spots))
    spots = problem.ties.spots
    prior = SpotPrior(
        rng.normal(0, 1, spots), rng.uniform(0.1, 0.3, spots), rng.normal(0, 1, (spots, BENDS)),
        rng.uniform(0.5, 1.0, BENDS), np.zeros(spots, int), state.log_focal + 0.01,
    )  # fmt: skip
    terms = None
    if marks is not None:
        problem = replace(problem, marks=marks)
        terms = mark_terms(marks, state, cameras_of(problem, state), problem.lens_of, HeightField.level(0.1))
    layout = Layout.of(problem, BENDS)
    found, free = linearise(problem, state), np.ones((1, 2), bool)
    return problem, reduced_equations(layout, problem, state, found, problem.ties.information, prior, free, terms)


def dense_marks(problem, rng) -> tuple[Marks, np.ndarray]:
    """Return marks of which some share their place's error, and the covariance of all of them together."""
    view, group = np.array([0, 3, 4, 9, 5]), np.array([0, 0, -1, 1, 1])
    own = np.tile(0.04 * np.eye(2), (5, 1, 1))
    place = np.array([[[0.5, 0.1], [0.1, 0.3]], [[0.2, 0.0], [0.0, 0.4]]])
    whole = np.zeros((10, 10))
    for i in range(5):
        whole[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] += own[i]
        for j in range(5):
            if group[i] == group[j] >= 0:
                whole[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] += place[group[i]]
    return Marks(view, rng.uniform(200, 900, (5, 2)), rng.uniform(-30, 30, (5, 2)), own, group, place), whole


def test_what_fixes_share_joins_all_views_as_their_full_covariance_does(rng):
    world = make_world(rng, strips=2, a_strip=5, spots=3)
    n = len(world.problem.views)
    noise = drifting(n, rng)
    problem = replace(world.problem, fix_noise=noise)
    _, shared = equations(problem, np.random.default_rng(1))
    loose = replace(problem, fix_noise=FixNoise.white(np.full(n, 1e12)))
    _, bare = equations(loose, np.random.default_rng(1))
    H, g = dense_of(problem, bare)
    off = np.array([v.centre[:2] for v in problem.views]) - problem.fix_xy
    information = np.linalg.inv(noise.covariance)
    for axis in (0, 1):
        rows = POSE * problem.fix_of + axis
        H[np.ix_(rows, rows)] += information
        g[rows] += information @ off[:, axis]
    H_shared, g_shared = dense_of(problem, shared)
    assert H_shared == pytest.approx(H, rel=1e-7, abs=1e-6)
    assert g_shared == pytest.approx(g, rel=1e-7, abs=1e-6)
    assert shared.normal.step() == pytest.approx(-np.linalg.solve(H, g), rel=1e-5, abs=1e-8)


def test_known_places_share_their_error(rng):
    world = make_world(rng, strips=2, a_strip=5, spots=3)
    marks, whole = dense_marks(world.problem, rng)
    problem, with_marks = equations(world.problem, np.random.default_rng(1), marks)
    _, without = equations(world.problem, np.random.default_rng(1))
    state = BundleState.start(problem)
    terms = mark_terms(marks, state, cameras_of(problem, state), problem.lens_of, HeightField.level(0.0))
    J = np.zeros((10, 6 * len(problem.views) + 2 + BENDS))
    first = 6 * len(problem.views)
    level = HeightField.level(0.1)
    seen = mark_terms(marks, state, cameras_of(problem, state), problem.lens_of, level)
    for k, view in enumerate(marks.view.tolist()):
        J[2 * k : 2 * k + 2, 6 * view : 6 * view + 6] = seen.by_view[k]
        J[2 * k : 2 * k + 2, first : first + 2] = seen.by_lens[k]
        lean = np.linalg.inv(seen.own[k]) - np.linalg.inv(terms.own[k])
        whole[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] += lean
    H, g = dense_of(problem, without)
    information = np.linalg.inv(whole)
    assert seen.weigh(J.reshape(5, 2, -1)).reshape(10, -1) == pytest.approx(information @ J, rel=1e-8, abs=1e-8)
    assert seen.cost == pytest.approx(seen.residual.ravel() @ information @ seen.residual.ravel())
    H, g = H + J.T @ information @ J, g + J.T @ information @ seen.residual.ravel()
    H_marked, g_marked = dense_of(problem, with_marks)
    assert H_marked == pytest.approx(H, rel=1e-7, abs=1e-6)
    assert g_marked == pytest.approx(g, rel=1e-7, abs=1e-6)


def test_a_long_flight_is_solved_in_slices_as_in_one_piece(rng):
    """Three hundred views: step, covariances of poses and lens, and damped steps, against one dense matrix."""
    world = make_world(rng, strips=15, a_strip=20, spots=3, reach_m=60.0)
    n = len(world.problem.views)
    problem = replace(world.problem, fix_noise=drifting(n, rng))
    _, reduced = equations(problem, rng)
    normal = reduced.normal
    assert n == 300 and len(normal.layout.slices) > 3
    H, g = dense_of(problem, reduced)
    step = -np.linalg.solve(H, g)
    assert normal.step() == pytest.approx(step, rel=1e-6, abs=1e-6 * np.abs(step).max())
    scale = 1.0 / np.sqrt(np.diag(H))  # metres and radians in one matrix would cost digits
    inverse = np.linalg.inv(H * np.outer(scale, scale)) * np.outer(scale, scale)
    expected = np.array([inverse[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] for k in range(n)])
    size = np.sqrt(np.diagonal(expected, axis1=1, axis2=2))
    off = (normal.pose_covariances() - expected) / (size[:, :, None] * size[:, None, :])
    assert np.abs(off).max() < 1e-6
    shared, with_shared = normal.shared_covariance()
    assert shared == pytest.approx(inverse[6 * n :, 6 * n :], rel=1e-6, abs=1e-12)
    assert with_shared.reshape(6 * n, -1) == pytest.approx(inverse[: 6 * n, 6 * n :], rel=1e-6, abs=1e-10)
    short = normal.step(damping=1.0)
    assert -short @ g > 0.0 and np.linalg.norm(short) < np.linalg.norm(step)


def test_views_of_all_pieces_are_in_one_slice_each_and_meet_only_neighbours(rng):
    world = make_world(rng, strips=6, a_strip=10, spots=3, reach_m=45.0)
    layout = Layout.of(world.problem, 0)
    of = np.empty(len(world.problem.views), int)
    for k, s in enumerate(layout.slices):
        of[(layout.first >= s.begin) & (layout.first < s.begin + s.size)] = k
    assert np.abs(np.diff(of[layout.slots], axis=1)).max() <= 1
    assert layout.width == 6 * len(world.problem.views), "nothing drifts here"
    assert len(np.unique(layout.first)) == len(world.problem.views)


def test_a_lens_that_is_held_does_not_move(rng):
    world = make_world(rng, strips=1, a_strip=4, spots=3)
    _, reduced = equations(world.problem, rng)
    held = reduced.normal.without(np.array([0]))
    step = held.step()
    size = 6 * len(world.problem.views)
    assert step[size] == 0.0 and step[size + 1] != 0.0
    assert np.abs(step[:size]).max() > 0.0


def test_equations_that_no_laptop_holds_are_not_put_up(rng, monkeypatch):
    problem = make_world(rng, strips=2, a_strip=4, spots=3).problem
    needed = Layout.of(problem, 6).bytes
    assert needed >= 8 * (6 * len(problem.views)) ** 2, "here all views meet"
    monkeypatch.setattr(solve, "MOST_BYTES", needed - 1)
    with pytest.raises(np.linalg.LinAlgError, match="same ground"):
        bundle_adjust(problem)
