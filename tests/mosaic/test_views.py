"""Who may be pasted, in which rank, and where."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.camera import Camera
from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.mosaic.outline import convex_hull, distance_inside
from photomap_gis.mosaic.seen import SeenGround
from photomap_gis.mosaic.views import views_of
from tests.mosaic.flight import GSD_M, place


def views(*placements):
    return views_of(Trajectory(tuple(placements)))


def test_only_registered_and_gps_placed_frames_are_pasted():
    placements = [place(i, 100.0 * i, 0.0, status=status) for i, status in enumerate(FrameStatus)]
    assert {v.placement.status for v in views(*placements)} == {FrameStatus.REGISTERED, FrameStatus.GPS_ONLY}


def test_registered_frames_rank_before_gps_placed_ones():
    near, far = views(place(0, 0, 0, status=FrameStatus.GPS_ONLY), place(1, 10, 0))
    assert far.tier < near.tier


def test_a_hovering_drone_gives_one_frame():
    assert len(views(*(place(i, 0.02 * i, 0.0) for i in range(30)))) == 1


def test_a_crowded_frame_that_sees_more_stays_as_a_spare():
    first, turned = views(place(0, 0, 0), place(1, 0.1, 0, heading_rad=math.pi / 2))
    assert (first.tier, turned.tier) == (0, 1)


def test_a_finer_frame_over_the_same_place_gets_its_own_cell():
    coarse, fine = views(place(0, 0, 0), place(1, 0, 0, scale=0.5))
    assert fine.tier == coarse.tier == 0 and fine.resolution_cost < coarse.resolution_cost


def test_an_outlying_frame_that_makes_no_sense_is_ignored():
    assert views(place(0, math.nan, 0.0), place(1, 0, 0))[0].frame == 1


def test_a_horizon_in_the_picture_does_not_reach_to_infinity():
    camera = Camera.of_hfov(240, 180, math.radians(90))
    (view,) = views(place(0, 0, 0, camera=camera, tilt_rad=(math.radians(60), 0.0)))
    low, high = view.bounds_map_m
    assert np.max(high - low) < 20 * 240 * GSD_M
    assert np.isnan(view.locate(np.array([[0.0, -1e5], [0.0, 1e5]]), slack_m=1.0)).all()


def test_a_distorted_camera_does_not_show_ground_folded_back():
    camera = Camera(240, 180, focal_px=220.0, k1=-0.2, k2=0.0)
    (view,) = views(place(0, 0, 0, camera=camera))
    # Where the polynomial of the lens comes back to the middle of the picture: r (1 + k1 r^2) = 0.
    ghost = np.array([[math.sqrt(1 / 0.2) * 220.0 * GSD_M, 0.0]])
    assert sum(np.polyval([-0.2, 0.0, 1.0, 0.0], ghost[0] / (220.0 * GSD_M))) == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(view.locate(ghost, slack_m=5.0)).all()


def test_a_lens_that_bends_more_than_a_lens_can_gives_its_middle_only():
    camera = Camera(240, 180, focal_px=150.0, k1=-0.2, k2=0.0)
    (view,) = views(place(0, 0, 0, camera=camera))
    low, high = view.bounds_map_m
    assert (high - low < 1.6 * GSD_M * np.array([240, 180])).all()
    assert distance_inside(view.hull_xy_map_m, [[0.0, 0.0]]) > 60 * GSD_M


@given(st.lists(st.tuples(st.integers(-50, 50), st.integers(-50, 50)), min_size=3, max_size=30, unique=True))
def test_a_hull_holds_its_points(points):
    p = np.array(points, dtype=float)
    hull = convex_hull(p)
    if len(hull) >= 3:
        assert distance_inside(hull, p).min() >= -1e-6
        assert {tuple(h) for h in hull} <= {tuple(q) for q in p}


def test_distance_inside_a_square():
    square = convex_hull(np.array([[0.0, 0.0], [4, 0], [4, 4], [0, 4], [2, 0]]))
    assert len(square) == 4
    assert distance_inside(square, [[2, 2], [1, 2], [5, 2]]) == pytest.approx([2, 1, -1])


@given(st.lists(st.tuples(st.integers(-300, 300), st.integers(-300, 300), st.integers(1, 60)), max_size=6))
def test_seen_ground_counts_cells_once(squares):
    """Twin: a set of cells."""
    seen, cells = SeenGround(1.0), set()
    for x, y, side in squares:
        mine = {(i, j) for i in range(x, x + side) for j in range(y, y + side)}
        hull = np.array([[x, y], [x + side, y], [x + side, y + side], [x, y + side]], dtype=float)
        expected = len(mine - cells)
        if expected < 0.1 * len(mine):
            assert seen.add(hull, least_new=0.1) == -1
        assert seen.add(hull, least_new=0.0) == expected
        cells |= mine
