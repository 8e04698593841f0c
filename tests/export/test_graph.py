"""The pose graph for other programs and for the eye."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from photomap_gis.core.errors import NotGeoreferencedError
from photomap_gis.core.frame import GpsFix
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.posegraph import Edge, EdgeKind, PoseGraph, PositionObservation
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.export import SolvedGraph, write_g2o, write_graph_geojson, write_graph_picture
from photomap_gis.export.graph_picture import FULL_COLOUR_SIGMAS, colour_of, graph_picture
from photomap_gis.georef import choose_map_frame, map_to_lonlat
from photomap_gis.slam import edge_misfits, solve

SIGMA = np.array([0.3, 0.3, 4e-4, 4e-4])
FRAME = choose_map_frame([GpsFix(52.1, 19.3)])
COLUMNS, ROWS = 5, 6


def flown(rng, *, false=()):
    """Poses on strips, edges to the neighbours, ``false`` ones far off, and fixes."""
    poses = []
    for column in range(COLUMNS):
        for row in range(ROWS) if column % 2 == 0 else reversed(range(ROWS)):
            poses.append(Similarity2D(20.0 * column, -12.0 * row, rng.normal(0, 0.05), np.log(0.1)))
    edges = []
    for a in range(len(poses)):
        for b in range(a + 1, len(poses)):
            if np.hypot(*(poses[a].translation - poses[b].translation)) < 26.0:
                truth = poses[a].inverse() @ poses[b]
                if (a, b) in false:
                    truth = truth @ Similarity2D(150.0, -80.0, 0.2, 0.05)
                kind = EdgeKind.SEQUENTIAL if b == a + 1 else EdgeKind.LOOP
                noisy = truth @ Similarity2D.exp(rng.normal(size=4) * SIGMA)
                edges.append(Edge(a, b, noisy, np.diag(SIGMA**2), kind, 0.97, 0.6))
    fixes = [
        PositionObservation(k, p.translation + rng.normal(0, 0.5, 2), np.eye(2) * 0.25) for k, p in enumerate(poses)
    ]
    return poses, PoseGraph(tuple(range(len(poses))), tuple(edges), tuple(fixes))


def solved(graph, map_frame=FRAME):
    chain = tuple(e for e in graph.edges if e.kind is EdgeKind.SEQUENTIAL)
    solution = solve(graph)
    sequential = solve(replace(graph, edges=chain, positions=()))
    return SolvedGraph(graph, solution, sequential, edge_misfits(graph, solution), map_frame, {0: "DJI_0001.JPG"})


def test_good_edges_fit_and_false_ones_do_not(rng):
    _, graph = flown(rng, false={(0, 2)})
    misfits = edge_misfits(graph, solve(graph))
    false = next(k for k, e in enumerate(graph.edges) if (e.a, e.b) == (0, 2))
    assert misfits[false] > 50.0
    assert 0.3 < np.median(np.delete(misfits, false)) < 1.2
    stranger = replace(graph.edges[0], b=99)
    assert np.isnan(edge_misfits(replace(graph, edges=(stranger,)), solve(graph))[0])


def test_another_solver_reads_the_g2o_and_comes_to_the_same_poses(rng, tmp_path):
    gtsam = pytest.importorskip("gtsam", reason="gtsam reads g2o files")
    _, graph = flown(rng, false={(0, 2)})
    ours = solved(graph)
    write_g2o(ours, tmp_path / "graph.g2o")
    factors, values = gtsam.readG2o(str(tmp_path / "graph.g2o"), False)
    assert values.size() == len(graph.frames) and factors.size() == len(graph.edges) - 1
    first = ours.solution.pose_of(0).T_map_plane
    factors.push_back(gtsam.PriorFactorPose2(0, gtsam.Pose2(first.tx, -first.ty, -first.angle_rad),
                                             gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))  # fmt: skip
    found = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    theirs = np.array([found.atPose2(k).translation() for k in graph.frames])
    mine = np.array([ours.solution.pose_of(k).T_map_plane.translation * (1, -1) for k in graph.frames])
    # fixes bend ours, and the scale is free in ours: some centimetres on a map of 100 m
    assert np.abs(theirs - mine).max() < 0.15
    assert factors.error(found) < 3.0 * len(graph.edges)
    for k in graph.frames:
        assert found.atPose2(k).theta() == pytest.approx(-ours.solution.pose_of(k).T_map_plane.angle_rad, abs=2e-3)


def test_g2o_comments_hold_the_scale_and_what_was_put_aside(rng, tmp_path):
    _, graph = flown(rng, false={(0, 2)})
    write_g2o(solved(graph, MapFrame(None)), tmp_path / "graph.g2o")
    lines = (tmp_path / "graph.g2o").read_text().splitlines()
    assert sum(line.startswith("# EDGE_LOG_SCALE") for line in lines) == len(graph.edges)
    assert [line.split()[3:6] for line in lines if line.startswith("# put aside")] == [["EDGE_SE2", "0", "2"]]
    assert "FIX 0" in lines and any("pixels of the first frame" in line for line in lines)


def test_geojson_lies_where_the_frames_do(rng, tmp_path):
    poses, graph = flown(rng, false={(0, 2)})
    ours = solved(graph)
    write_graph_geojson(ours, tmp_path / "graph.geojson")
    features = json.loads((tmp_path / "graph.geojson").read_text())["features"]
    points = [f for f in features if f["geometry"]["type"] == "Point"]
    lines = [f for f in features if f["geometry"]["type"] == "LineString"]
    assert (len(points), len(lines)) == (len(poses), len(graph.edges))
    expected = map_to_lonlat(FRAME, [p.translation for p in poses])
    found = np.array([f["geometry"]["coordinates"] for f in points])
    assert np.abs(found - expected).max() < 1.5e-5  # a metre
    assert points[0]["properties"]["name"] == "DJI_0001.JPG"
    aside = [f["properties"] for f in lines if not f["properties"]["kept"]]
    assert [(p["a"], p["b"], p["kind"]) for p in aside] == [(0, 2, "loop")]
    assert aside[0]["residual_sigmas"] > 50.0 and aside[0]["probability"] == 0.97


def test_a_map_without_a_place_has_no_geojson(rng, tmp_path):
    _, graph = flown(rng)
    with pytest.raises(NotGeoreferencedError):
        write_graph_geojson(solved(graph, MapFrame(None)), tmp_path / "graph.geojson")
    assert not (tmp_path / "graph.geojson").exists()


def test_the_picture_shows_loops_in_their_colours_on_the_right_only(rng, tmp_path):
    _, graph = flown(rng)
    ours = solved(graph)
    # one loop is said to pull: nothing else can be red
    worst = next(k for k, e in enumerate(graph.edges) if e.kind is EdgeKind.LOOP)
    misfits = np.full(len(graph.edges), 0.5)
    misfits[worst] = 2.0 * FULL_COLOUR_SIGMAS
    write_graph_picture(replace(ours, misfit_sigmas=misfits), tmp_path / "graph.png")
    picture = cv2.imread(str(tmp_path / "graph.png")).astype(int)
    assert np.array_equal(picture, graph_picture(replace(ours, misfit_sigmas=misfits)))
    body = picture[70:-60]  # without title and legend
    left, right = body[:, : body.shape[1] // 2 - 5], body[:, body.shape[1] // 2 + 5 :]
    for panel, coloured in ((left, False), (right, True)):
        near = [np.abs(panel - colour_of(s)).max(axis=2) < 40 for s in (0.5, 2.0 * FULL_COLOUR_SIGMAS)]
        assert [bool(n.any()) for n in near] == [coloured, coloured]
        assert (panel.max(axis=2) < 80).sum() > 1000  # the path itself


def test_colours_go_from_blue_to_red():
    blue, red = colour_of(0.0), colour_of(10.0)
    assert blue[0] > 2 * blue[2] and red[2] > 2 * red[0]
    assert colour_of(FULL_COLOUR_SIGMAS) == red and colour_of(float("nan")) == blue


@pytest.mark.parametrize("count", [0, 1, 2])
def test_a_graph_of_few_frames_can_be_drawn(rng, count):
    _, graph = flown(rng)
    frames = tuple(range(count))
    few = PoseGraph(frames, tuple(e for e in graph.edges if {e.a, e.b} <= set(frames)), graph.positions[:count])
    assert graph_picture(solved(few)).ndim == 3
