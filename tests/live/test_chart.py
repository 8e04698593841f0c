"""The chart: a solution is taken over whole, and what came since hangs on it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.frame import FrameRef
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.live.chart import Belief, Chart, LiveSolution

numbers = st.floats(-100.0, 100.0)
motions = st.builds(Similarity2D, numbers, numbers, st.floats(-3.0, 3.0), st.floats(-1.0, 1.0))


def ref(k: int) -> FrameRef:
    return FrameRef(k, f"f{k}", "made", 640, 480, frame_number=k)


def solution(poses: list[Similarity2D | None], revision: int = 1) -> LiveSolution:
    n = len(poses)
    motion = np.array([(np.nan,) * 4 if p is None else (p.tx, p.ty, p.angle_rad, p.log_scale) for p in poses])
    return LiveSolution(
        revision, MapFrame(None), motion, motion.copy(), np.tile(np.eye(3).ravel(), (n, 1)), np.zeros((n, 2)),
        np.tile(0.5 * np.eye(4), (n, 1, 1)), np.array([-1 if p is None else 0 for p in poses]),
    )  # fmt: skip


def chart_of(poses: list[Similarity2D]) -> Chart:
    chart = Chart()
    for k, T in enumerate(poses):
        chart.add(ref(k), Belief(T, np.eye(4)), 0)
    return chart


@given(st.lists(motions, min_size=3, max_size=6), st.lists(motions, min_size=2, max_size=3))
def test_the_chain_behind_a_solution_keeps_its_shape(chained: list[Similarity2D], solved: list[Similarity2D]) -> None:
    n = min(len(solved), len(chained) - 1)
    chart = chart_of(chained)
    relative = chained[n - 1].inverse() @ chained[-1]
    chart.adopt(solution(list(solved[:n])))
    for k in range(n):
        np.testing.assert_allclose(chart.belief(k).T_map_plane.matrix, solved[k].matrix, rtol=1e-9, atol=1e-9)
    now = chart.belief(n - 1).T_map_plane.inverse() @ chart.belief(len(chained) - 1).T_map_plane
    np.testing.assert_allclose(now.matrix, relative.matrix, rtol=1e-6, atol=1e-5)


def test_a_snapshot_does_not_change_any_more() -> None:
    chart = chart_of([Similarity2D(float(k)) for k in range(4)])
    kept = chart.snapshot()
    chart.adopt(solution([Similarity2D(10.0), Similarity2D(11.0)]))
    chart.add(ref(4), Belief(Similarity2D(20.0), np.eye(4)), 1)
    assert len(kept) == 4 and kept.belief(0).T_map_plane.tx == 0.0 and kept.revision == 0
    assert chart.belief(3).T_map_plane.tx == pytest.approx(13.0) and chart.revision == 1


def test_what_is_known_of_a_chained_frame_is_never_more_than_of_its_anchor() -> None:
    chart = chart_of([Similarity2D(float(k)) for k in range(3)])
    chart.adopt(solution([Similarity2D(0.0), Similarity2D(1.0)]))
    covariance = chart.belief(2).covariance
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()
    assert covariance[0, 0] >= 0.5


def test_key_frames_come_in_order() -> None:
    chart = chart_of([Similarity2D()])
    with pytest.raises(ValueError, match="expected 1, got 5"):
        chart.add(ref(5), Belief(Similarity2D(), np.eye(4)), 0)


def test_a_segment_moves_as_one() -> None:
    chart = chart_of([Similarity2D(float(k)) for k in range(2)])
    for k in (2, 3):
        chart.add(ref(k), Belief(Similarity2D(100.0 + k), np.eye(4)), 1)
    moved = chart.move_segment(1, Similarity2D(-50.0, 3.0), 0)
    assert moved == [2, 3] and chart.segments == [0, 0, 0, 0]
    assert chart.belief(3).T_map_plane.tx == pytest.approx(53.0)
    assert chart.belief(1).T_map_plane.tx == 1.0
