"""Known points of the ground in the graph: they lay a map on the Earth, pull it, and a wrong one is put aside."""

from dataclasses import replace

import numpy as np
import pytest
from flights import HEIGHT, WIDTH, centres, edges, fixes, graph, lawnmower, rmse

from photomap_gis.core.posegraph import PointObservation
from photomap_gis.core.similarity import Similarity2D, transform_jacobian
from photomap_gis.slam import GraphBuilder, solve

CORNERS = ((0, "sw"), (9, "nw"), (45, "middle"), (70, "ne"), (79, "se"))


def control(rng, flight, chosen=CORNERS, *, sigma_m=0.03, sigma_px=0.5, frames_each=2, off=None, check=()):
    """Each point seen by a frame and the next ones at random pixels; ``off`` moves named points by metres."""
    out = []
    for frame, name in chosen:
        plane = rng.uniform((-WIDTH / 4, -HEIGHT / 4), (WIDTH / 4, HEIGHT / 4))
        truth = flight.poses[frame].apply(plane)
        given = truth + rng.normal(0, sigma_m, 2) + (off or {}).get(name, (0.0, 0.0))
        for k in range(frames_each):
            other = min(frame + k, len(flight.poses) - 1)
            p = flight.poses[other].inverse().apply(truth) + rng.normal(0, sigma_px, 2)
            xy_px = p + np.array([WIDTH, HEIGHT]) / 2
            noise = np.eye(2) * sigma_m**2
            out.append(PointObservation(other, xy_px, p, given, noise, sigma_px, name, name in check))
    return out


def with_points(g, points):
    return replace(g, points=tuple(points))


def all_frames(flight):
    return range(len(flight.poses))


@pytest.fixture(scope="module")
def flight():
    return lawnmower(np.random.default_rng(5))


@pytest.fixture(scope="module")
def ties(flight):
    return edges(np.random.default_rng(6), flight)


@pytest.fixture(scope="module")
def track(flight):
    return fixes(np.random.default_rng(7), flight, bias_m=2.0)


@pytest.mark.parametrize("backend", ["gtsam", "scipy"])
def test_points_lay_a_map_without_gps_on_the_earth(rng, flight, ties, backend):
    points = control(rng, flight)
    solution = solve(with_points(graph(flight, ties), points), backend=backend)
    assert len(solution.poses) == 80
    assert solution.rejected_points == ()
    assert rmse(centres(solution, all_frames(flight)), flight.centres_m) < 0.1


def test_two_points_are_enough_and_one_is_not(rng, flight, ties):
    points = control(rng, flight, CORNERS[::4])
    solution = solve(with_points(graph(flight, ties), points))
    assert rmse(centres(solution, all_frames(flight)), flight.centres_m) < 0.25
    one = with_points(graph(flight, ties), points[:2])
    assert not one.georeferenced
    assert rmse(centres(solve(one), all_frames(flight)), flight.centres_m) > 10  # still in pixels of the first frame


def test_both_solvers_agree(rng, flight, ties, track):
    g = with_points(graph(flight, ties, track), control(rng, flight))
    one, other = solve(g, backend="gtsam"), solve(g, backend="scipy")
    for a, b in zip(one.poses, other.poses, strict=True):
        np.testing.assert_allclose(a.T_map_plane.matrix, b.T_map_plane.matrix, atol=2e-3)
        np.testing.assert_allclose(a.covariance, b.covariance, rtol=2e-2, atol=1e-9)
    assert one.rejected_points == other.rejected_points == ()


def test_a_map_with_gps_is_pulled_to_its_points(rng, flight, ties, track):
    g = graph(flight, ties, track)
    by_gps = rmse(centres(solve(g), all_frames(flight)), flight.centres_m)
    pulled = solve(with_points(g, control(rng, flight)))
    assert by_gps > 1.0
    assert rmse(centres(pulled, all_frames(flight)), flight.centres_m) < 0.1
    sigma = np.mean(
        [np.trace(p.T_map_plane.linear @ p.covariance[:2, :2] @ p.T_map_plane.linear.T) for p in pulled.poses]
    )
    assert np.sqrt(sigma / 2) < 0.1


@pytest.mark.parametrize("off", [(40.0, -25.0), (4.0, 3.0), (0.8, 0.0)])
@pytest.mark.parametrize("with_gps", [True, False])
def test_a_wrong_point_does_not_bend_the_map_and_is_named(rng, flight, ties, track, off, with_gps):
    points = control(rng, flight, off={"middle": off})
    g = graph(flight, ties, track if with_gps else ())
    solution = solve(with_points(g, points))
    assert {points[k].name for k in solution.rejected_points} == {"middle"}
    assert rmse(centres(solution, all_frames(flight)), flight.centres_m) < 0.12


def test_of_two_points_gps_tells_the_wrong_one(rng, flight, ties, track):
    points = control(rng, flight, CORNERS[::4], off={"se": (60.0, 0.0)})
    solution = solve(with_points(graph(flight, ties, track), points))
    assert {points[k].name for k in solution.rejected_points} == {"se"}
    assert rmse(centres(solution, all_frames(flight)), flight.centres_m) < 1.0


def test_check_points_never_enter_the_fit(rng, flight, ties, track):
    points = control(rng, flight)
    checks = control(rng, flight, ((30, "check"),), off={"check": (5.0, 5.0)}, check=("check",))
    g = graph(flight, ties, track)
    one, other = solve(with_points(g, points)), solve(with_points(g, points + checks))
    for a, b in zip(one.poses, other.poses, strict=True):
        np.testing.assert_array_equal(a.T_map_plane.matrix, b.T_map_plane.matrix)
    only = with_points(g, checks)
    np.testing.assert_array_equal(centres(solve(only), [0]), centres(solve(g), [0]))


def test_clicks_that_are_worse_than_they_say_count_less_but_count(rng, flight, ties):
    rough = [replace(p, sigma_px=0.5) for p in control(rng, flight, sigma_px=6.0, frames_each=4)]
    solution = solve(with_points(graph(flight, ties), rough))
    assert len(solution.rejected_points) <= len(rough) // 4
    assert rmse(centres(solution, all_frames(flight)), flight.centres_m) < 0.8


def test_the_builder_hands_points_on(rng, flight):
    builder = GraphBuilder()
    builder.observe_points(control(rng, flight))
    assert len(builder.snapshot().points) == 2 * len(CORNERS)


def test_claimed_sigma_at_points_is_true():
    """Positions of ground points by the solved poses scatter as their covariances say (NEES over seeds)."""
    flight = lawnmower(np.random.default_rng(5), strips=4, per_strip=6)
    chosen, nees = ((0, "a"), (5, "b"), (18, "c"), (23, "d")), []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        g = graph(flight, edges(rng, flight), fixes(rng, flight))
        solution = solve(with_points(g, control(rng, flight, chosen)), backend="scipy")
        for frame, plane in ((3, (100.0, 50.0)), (11, (-120.0, 80.0)), (14, (0.0, -90.0))):
            pose = solution.pose_of(frame)
            j = transform_jacobian(pose.T_map_plane, plane)[0]
            miss = pose.T_map_plane.apply(plane) - flight.poses[frame].apply(plane)
            nees.append(miss @ np.linalg.solve(j @ pose.covariance @ j.T, miss))
    assert 0.6 < np.mean(nees) / 2 < 1.6


def test_lone_frames_are_laid_by_two_points():
    flight = lawnmower(np.random.default_rng(5), strips=1, per_strip=1)
    pose = flight.poses[0]
    places = np.array([[-100.0, 50.0], [120.0, -40.0]])
    points = [
        PointObservation(0, p, p, pose.apply(p), np.eye(2) * 1e-4, 0.5, name)
        for p, name in zip(places, "ab", strict=True)
    ]
    solution = solve(with_points(graph(flight, ()), points))
    assert isinstance(solution.poses[0].T_map_plane, Similarity2D)
    np.testing.assert_allclose(solution.poses[0].T_map_plane.matrix, pose.matrix, atol=1e-3)


def test_points_that_place_no_piece_leave_nothing_in_pixels(rng, flight, ties):
    """One point on each of two unconnected strips: neither can be placed, and pixels must not pass for metres."""
    apart = [e for e in ties if (e.a < 40) == (e.b < 40)]
    points = control(rng, flight, (CORNERS[0], CORNERS[-1]), frames_each=1)
    g = with_points(graph(flight, apart), points)
    assert g.georeferenced
    assert solve(g).poses == ()


def test_each_piece_is_placed_by_its_own_points(rng, flight, ties):
    apart = [e for e in ties if (e.a < 40) == (e.b < 40)]
    points = control(rng, flight, ((0, "a"), (31, "b"), (45, "c"), (79, "d")))
    solution = solve(with_points(graph(flight, apart), points))
    assert {p.segment for p in solution.poses} == {0, 1}
    assert rmse(centres(solution, all_frames(flight)), flight.centres_m) < 0.4
    first = solve(with_points(graph(flight, apart), points[:4]))
    assert {p.frame for p in first.poses} == set(range(40))


def test_one_point_shifts_a_map_with_gps(rng, flight, ties, track):
    g = graph(flight, ties, track)
    by_gps = rmse(centres(solve(g), all_frames(flight)), flight.centres_m)
    pulled = solve(with_points(g, control(rng, flight, CORNERS[2:3])))
    assert pulled.rejected_points == ()
    assert rmse(centres(pulled, all_frames(flight)), flight.centres_m) < 0.5 * by_gps
    for off in ((300.0, 0.0), (80.0, 0.0), (0.0, -25.0)):
        blunder = solve(with_points(g, control(rng, flight, CORNERS[2:3], off={"middle": off})))
        assert set(blunder.rejected_points) == {0, 1}
        assert rmse(centres(blunder, all_frames(flight)), flight.centres_m) == pytest.approx(by_gps, abs=0.1)
