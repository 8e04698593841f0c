"""What became of each frame."""

import math

import flights as fl
import numpy as np

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.frame import Attitude, FrameRef, FrameStatus
from photomap_gis.core.posegraph import Solution
from photomap_gis.slam import placements, solve


def test_statuses_and_methods(rng):
    flight = fl.lawnmower(rng, 3, 5)
    edges = [e for e in fl.edges(rng, flight) if 7 not in (e.a, e.b)]
    graph = fl.graph(flight, edges, fl.fixes(rng, flight))
    solution = solve(graph, backend="scipy")
    camera = Camera(512, 384, 500.0)
    views = {k: PlaneView.flat(camera) for k in range(15) if k != 14}
    leaning = Attitude(0.0, math.radians(-50.0))
    refs = [FrameRef(k, f"{k}", f"{k}", 512, 384, attitude=leaning if k == 3 else None) for k in range(15)]
    trajectory = placements(solution, graph, refs, views)
    by_frame = {p.frame: p for p in trajectory.placements}
    assert set(by_frame) == set(range(14)) and trajectory.revision == graph.revision
    assert by_frame[7].status is FrameStatus.GPS_ONLY and by_frame[7].method == "gps" and by_frame[7].segment == 1
    assert by_frame[3].status is FrameStatus.OBLIQUE
    assert by_frame[0].status is FrameStatus.REGISTERED and by_frame[0].method == "ifmi"
    placed = by_frame[0]
    pose = solution.pose_of(0).T_map_plane
    np.testing.assert_allclose(placed.centre_xy_map_m, pose.translation, atol=1e-6)
    assert placed.gsd_m_per_px == np.float64(placed.gsd_m_per_px) > 0
    wider = placements(solution, graph, refs, views, max_off_nadir_rad=math.radians(45.0))
    assert {p.frame: p for p in wider.placements}[3].status is FrameStatus.REGISTERED


def test_nothing_solved_nothing_placed(rng):
    flight = fl.lawnmower(rng, 1, 3)
    graph = fl.graph(flight, [])
    assert placements(Solution((), 0.0), graph, [FrameRef(0, "", "", 512, 384)], {}).placements == ()
