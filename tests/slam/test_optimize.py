"""The whole solution on flights with known truth."""

from dataclasses import replace

import flights as fl
import numpy as np
import pytest

from photomap_gis.core.posegraph import EdgeKind, PoseGraph
from photomap_gis.core.similarity import fit_similarity
from photomap_gis.slam import solve
from photomap_gis.slam.optimize import backend_named


def perfect_rmse(flight, positions):
    """RMSE of a perfect relative map aligned to this flight's fixes by least squares."""
    frames = [p.frame for p in positions]
    gps = np.array([p.xy_map_m for p in positions])
    return fl.rmse(fit_similarity(gps, flight.centres_m[frames]).apply(flight.centres_m), flight.centres_m)


def relative_rmse(flight, solution):
    centres = fl.centres(solution, range(len(flight.poses)))
    return fl.rmse(fit_similarity(flight.centres_m, centres).apply(centres), flight.centres_m)


def test_gps_does_not_bend_a_good_map():
    ours, perfect = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        flight = fl.lawnmower(rng)
        positions = fl.fixes(rng, flight, bias_m=0.0)
        solution = solve(fl.graph(flight, fl.edges(rng, flight), positions), backend="scipy")
        ours.append(fl.rmse(fl.centres(solution, range(80)), flight.centres_m))
        perfect.append(perfect_rmse(flight, positions))
        assert relative_rmse(flight, solution) < 0.05
    assert np.sqrt(np.mean(np.square(ours))) <= 1.15 * np.sqrt(np.mean(np.square(perfect)))


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_false_loops_do_not_bend_the_map(rng, share):
    flight = fl.lawnmower(rng)
    positions = fl.fixes(rng, flight)
    clean, dirty = (
        relative_rmse(flight, solve(fl.graph(flight, fl.edges(np.random.default_rng(3), flight, false=f), positions)))
        for f in (0.0, share)
    )
    assert dirty <= 1.5 * clean


def test_the_two_backends_agree(rng):
    flight = fl.lawnmower(rng, 5, 6)
    graph = fl.graph(flight, fl.edges(rng, flight, false=0.05), fl.fixes(rng, flight, blunders=0.05))
    one, two = solve(graph, backend="gtsam"), solve(graph, backend="scipy")
    assert one.rejected == two.rejected
    np.testing.assert_allclose(fl.centres(one, range(30)), fl.centres(two, range(30)), atol=0.01)
    for a, b in zip(one.poses, two.poses, strict=True):
        np.testing.assert_allclose(np.diagonal(a.covariance), np.diagonal(b.covariance), rtol=0.02)


def test_disconnected_segments_keep_their_fixes(rng):
    flight = fl.lawnmower(rng, 8, 8)
    edges = [e for e in fl.edges(rng, flight) if (e.a < 40) == (e.b < 40)]
    solution = solve(fl.graph(flight, edges, fl.fixes(rng, flight, blunders=0.03)))
    segments = np.array([p.segment for p in solution.poses])
    assert (segments[:40] == 0).all() and (segments[40:] == 1).all()
    assert fl.rmse(fl.centres(solution, range(64)), flight.centres_m) < 6.0


def test_without_gps_each_component_lies_in_the_frame_of_its_first_frame(rng):
    flight = fl.lawnmower(rng, 4, 8)
    edges = [e for e in fl.edges(rng, flight) if 19 not in (e.a, e.b) and (e.a < 20) == (e.b < 20)]
    solution = solve(fl.graph(flight, edges))
    assert solution.fit_to_gps_rms_m is None
    assert solution.pose_of(19) is None
    for first, members in ((0, range(19)), (20, range(20, 32))):
        origin = solution.pose_of(first)
        assert np.abs(origin.T_map_plane.log()).max() < 1e-3
        truth = [(flight.poses[first].inverse() @ flight.poses[k]).translation for k in members]
        assert fl.rmse(fl.centres(solution, members), truth) < 3.0
    assert solution.pose_of(0).segment == 0 and solution.pose_of(31).segment == 1


def test_frames_without_edges_are_placed_by_their_fix(rng):
    flight = fl.lawnmower(rng, 6, 8)
    lonely = {13, 30}
    edges = [e for e in fl.edges(rng, flight) if not lonely & {e.a, e.b}]
    solution = solve(fl.graph(flight, edges, fl.fixes(rng, flight)))
    for k in lonely:
        pose, truth = solution.pose_of(k), flight.poses[k]
        assert np.hypot(*(pose.T_map_plane.translation - truth.translation)) < 8.0
        assert abs(pose.T_map_plane.log_scale - truth.log_scale) < 0.2
        assert abs(np.angle(np.exp(1j * (pose.T_map_plane.angle_rad - truth.angle_rad)))) < 0.6
        assert pose.segment > 0


def test_headings_that_point_backwards_are_found_out(rng):
    flight = fl.lawnmower(rng, 4, 8)
    edges = [e for e in fl.edges(rng, flight) if 31 not in (e.a, e.b)]
    graph = fl.graph(flight, edges, fl.fixes(rng, flight), fl.heights(rng, flight), fl.yaws(rng, flight, flip=True))
    solution = solve(graph)
    for k in (5, 31):
        off = solution.pose_of(k).T_map_plane.angle_rad - flight.poses[k].angle_rad
        assert abs(np.angle(np.exp(1j * off))) < 0.4


def test_empty_graphs_have_empty_solutions():
    assert solve(PoseGraph((), ())).poses == ()
    assert solve(PoseGraph((3, 4), ())).poses == ()


def test_unknown_backends_are_refused():
    with pytest.raises(ValueError, match="backend"):
        backend_named("toro")


def test_edges_of_nonsense_are_put_aside(rng):
    flight = fl.lawnmower(rng, 2, 6)
    edges = fl.edges(rng, flight)
    bad = fl.edge(rng, flight, 0, 3, EdgeKind.LOOP)
    bad = type(bad)(0, 3, bad.T_a_b, np.full((4, 4), np.nan), EdgeKind.LOOP)
    loop = type(bad)(2, 2, bad.T_a_b, np.eye(4), EdgeKind.LOOP)
    solution = solve(fl.graph(flight, [*edges, bad, loop], fl.fixes(rng, flight)))
    assert set(solution.rejected) == {len(edges), len(edges) + 1}


def test_covariances_hold_the_error(rng):
    """NEES over a few flights with GPS error of every kind: near 1 per degree of freedom."""
    ratios = []
    for _ in range(14):
        flight = fl.lawnmower(rng, 6, 6, dt_s=6.0)
        solution = solve(fl.graph(flight, fl.edges(rng, flight), fl.fixes(rng, flight)), backend="scipy")
        for pose in solution.poses[::5]:
            xi = (pose.T_map_plane.inverse() @ flight.poses[pose.frame]).log()
            ratios.append(xi @ np.linalg.solve(pose.covariance, xi) / 4.0)
    assert 0.5 < np.mean(ratios) < 1.8


def test_two_flights_share_one_map_and_halve_their_bias(rng):
    one, two = fl.lawnmower(rng, 4, 6), fl.lawnmower(rng, 4, 6)
    both = fl.Flight(one.poses + two.poses, np.concatenate([one.times_s, two.times_s + 86400.0]))
    positions = fl.fixes(rng, one, bias_m=3.0) + [
        replace(p, time_s=p.time_s + 86400.0) for p in fl.fixes(rng, two, bias_m=3.0, number=1, first=24)
    ]
    alone, together = (
        solve(fl.graph(flight, fl.edges(rng, flight, reach_m=reach), positions[: len(flight.poses)]), backend="scipy")
        for flight, reach in ((one, 26.0), (both, 26.0))
    )
    assert {p.segment for p in together.poses} == {0}
    assert relative_rmse(both, together) < 0.1
    sigma = [np.trace(s.pose_of(8).covariance[:2, :2]) for s in (alone, together)]
    assert sigma[1] < 0.75 * sigma[0]


def test_frames_without_fix_follow_their_registrations(rng):
    flight = fl.lawnmower(rng, 5, 8)
    positions = [p for p in fl.fixes(rng, flight) if not 10 <= p.frame < 30]
    solution = solve(fl.graph(flight, fl.edges(rng, flight), positions))
    assert len(solution.poses) == 40 and relative_rmse(flight, solution) < 0.1


def test_a_part_without_any_fix_has_no_place(rng):
    flight = fl.lawnmower(rng, 4, 8)
    edges = [e for e in fl.edges(rng, flight) if (e.a < 16) == (e.b < 16)]
    positions = [p for p in fl.fixes(rng, flight) if p.frame < 16]
    assert {p.frame for p in solve(fl.graph(flight, edges, positions)).poses} == set(range(16))


def test_a_lone_photo_with_height_and_heading_is_placed(rng):
    flight = fl.lawnmower(rng, 1, 1)
    graph = fl.graph(flight, [], fl.fixes(rng, flight), fl.heights(rng, flight), fl.yaws(rng, flight))
    (pose,) = solve(graph).poses
    assert abs(pose.T_map_plane.log_scale - flight.poses[0].log_scale) < 0.4
    # nothing tells the scale of one photo with a fix alone
    assert solve(fl.graph(flight, [], fl.fixes(rng, flight))).poses == ()


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["gtsam", "scipy"])
def test_the_rubble_pile_630_frames(rng, backend):
    """The paper's case: 630 frames, 12,364 edges, here with a twentieth of false loops."""
    flight = fl.lawnmower(rng, 21, 30)
    edges = fl.edges(rng, flight, reach_m=70.0, limit=11735, false=0.05)
    solution = solve(fl.graph(flight, edges, fl.fixes(rng, flight, blunders=0.03, dropouts=0.1)), backend=backend)
    assert len(edges) == 12364 and len(solution.poses) == 630
    assert relative_rmse(flight, solution) < 0.02


def test_fixes_that_miss_the_map_together_widen_its_sigma():
    """A camera that leans forward unreported misses the fixes by metres, turned with each strip: not 80 samples."""
    errors, sigmas = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        flight = fl.lawnmower(rng)
        lean = np.repeat(rng.normal(0.0, 12.0, (8, 2)), 10, axis=0)  # metres, strip by strip
        positions = [replace(p, xy_map_m=p.xy_map_m + lean[p.frame]) for p in fl.fixes(rng, flight, bias_m=0.0)]
        solution = solve(fl.graph(flight, fl.edges(rng, flight), positions), backend="scipy")
        at = fl.centres(solution, range(80))
        errors.append(np.linalg.norm((at - flight.centres_m).mean(axis=0)))
        cov = [p.T_map_plane.linear @ p.covariance[:2, :2] @ p.T_map_plane.linear.T for p in solution.poses]
        sigmas.append(np.sqrt(np.trace(np.mean(cov, axis=0))))
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) / np.sqrt(np.mean(np.square(sigmas))) < 1.3
