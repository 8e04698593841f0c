"""Weights: one giver a pixel, no slivers, consensus that is smooth, complete and fair to trusted frames."""

import numpy as np
import pytest

from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.mosaic.blend import (
    FEATHER_PX,
    SLIVER_PX,
    Seen,
    consensus_weights,
    labels_of,
    nobodys_part,
    part_of,
    shift_to_consensus,
)
from photomap_gis.mosaic.choice import sight
from photomap_gis.mosaic.lattice import STEP_PX, Box, Lattice
from photomap_gis.mosaic.views import views_of
from tests.mosaic.flight import GSD_M, MAP_FRAME, place

GRID = MapGrid("a CRS", 500_000.0, 4_000_000.0, GSD_M, 400, 300, 512)


def look(*placements):
    lattice = Lattice.over(Window(0, 0, GRID.width, GRID.height), GRID, MAP_FRAME)
    views = views_of(Trajectory(placements))
    return lattice, [
        Seen(v, sight(v, lattice.nodes_xy_map_m, lattice.shape, slack_m=3 * STEP_PX * GSD_M)) for v in views
    ]


def inner(image):
    return image[STEP_PX : STEP_PX + GRID.height, STEP_PX : STEP_PX + GRID.width]


def test_each_spot_is_taken_from_the_frame_whose_centre_is_nearest():
    lattice, seen = look(place(0, 40, 35), place(1, 62, 40))
    labels = inner(labels_of(seen, lattice))
    centres = np.array([[40, 35], [62, 40]]) / GSD_M - 0.5
    y, x = np.mgrid[: GRID.height, : GRID.width]
    nearest = np.argmin([np.hypot(x - cx, y - cy) for cx, cy in centres], axis=0)
    both = (abs(x - centres[:, :1, None]) < 114).all(axis=0) & (abs(y - centres[:, 1:, None]) < 84).all(axis=0)
    assert (labels == nearest)[both].mean() > 0.99


def test_registered_frames_win_and_gps_placed_ones_fill():
    lattice, seen = look(place(0, 50, 40, status=FrameStatus.GPS_ONLY), place(1, 70, 40))
    labels = inner(labels_of(seen, lattice))
    registered, alone = (next(i for i, s in enumerate(seen) if s.view.frame == f) for f in (1, 0))
    inside_registered = np.abs(np.arange(GRID.width) - (70 / GSD_M - 0.5)) < 119
    assert (labels[160, inside_registered] == registered).all()
    assert alone in labels[160, ~inside_registered]


def test_slivers_are_left_to_others_but_ground_is_never_lost():
    # The fine frame would win a few pixels only, along its rim.
    lattice, seen = look(place(0, 50, 40), place(1, 50, 40, scale=0.05, size=(200, 200)))
    labels = labels_of(seen, lattice)
    assert set(np.unique(labels)) == {-1, 0}
    alone_lattice, alone = look(place(1, 50, 40, scale=0.05, size=(200, 200)))
    assert 0 < np.count_nonzero(labels_of(alone, alone_lattice) == 0) < SLIVER_PX


def test_detail_is_feathered_over_a_few_pixels():
    lattice, seen = look(place(0, 40, 35), place(1, 62, 35))
    labels = labels_of(seen, lattice)
    box = Box(STEP_PX, STEP_PX, GRID.width, GRID.height)
    part, own, mixed = part_of(labels, 0, box, nobodys_part(labels, box))
    assert own.shape == (part.height, part.width)
    middle = part.height // 2
    assert np.array_equal(own[middle] > 0, labels[part.slices][middle] == 0)
    ramp = mixed.weight[mixed.row == middle]
    assert FEATHER_PX <= len(ramp) <= 2 * FEATHER_PX + 1
    assert (np.diff(ramp.astype(int)) < 0).all()  # towards the other frame
    assert part_of(labels, 5, box) is None


def test_beside_nobody_nothing_is_mixed():
    lattice, seen = look(place(0, 50, 37))
    labels = labels_of(seen, lattice)
    box = Box(STEP_PX, STEP_PX, GRID.width, GRID.height)
    assert (inner(labels) < 0).any()
    assert part_of(labels, 0, box, nobodys_part(labels, box))[2] is None
    assert nobodys_part(np.zeros_like(labels), box) is None


def test_a_frame_that_gives_all_is_told_so():
    labels = np.full((60, 80), 2, dtype=np.int16)
    box = Box(STEP_PX, STEP_PX, 60, 40)
    assert part_of(labels, 2, box) == (box, None, None)
    labels[:STEP_PX] = 1  # meets the box's first row
    part, own, mixed = part_of(labels, 1, box)
    assert part == Box(STEP_PX, STEP_PX, 60, FEATHER_PX) and not own.any()
    assert set(mixed.row) == set(range(FEATHER_PX))


def test_consensus_adds_up_to_one_wherever_somebody_looks(rng):
    placements = [
        place(i, *rng.uniform((20, 20), (80, 55)), heading_rad=rng.uniform(-3, 3), status=status)
        for i, status in enumerate([FrameStatus.REGISTERED] * 6 + [FrameStatus.GPS_ONLY] * 3)
    ]
    _, seen = look(*placements)
    weights = consensus_weights(seen)
    anybody = np.any([np.nan_to_num(s.at_nodes.border_px, nan=-1) > 0 for s in seen], axis=0)
    assert weights.min() >= 0
    assert np.allclose(weights.sum(axis=0)[anybody], 1.0, atol=1e-5)
    deep = np.any([np.nan_to_num(s.at_nodes.border_px, nan=-1) > 30 for s in seen if s.view.tier < 2], axis=0)
    fills = weights[[i for i, s in enumerate(seen) if s.view.tier >= 2]].sum(axis=0)
    assert fills[deep].max() < 1e-4


def test_consensus_changes_smoothly():
    _, seen = look(place(0, 40, 35), place(1, 55, 38), place(2, 62, 30))
    weights = consensus_weights(seen)
    inside_all = np.all([np.nan_to_num(s.at_nodes.border_px, nan=-1) > 10 for s in seen], axis=0)
    steps = np.abs(np.diff(weights, axis=2))[:, inside_all[:, 1:] & inside_all[:, :-1]]
    assert steps.max() < 0.25


def test_light_is_shared_and_things_are_not():
    ground = np.full((4, 4, 3), 100, np.float32)
    half = np.full((4, 4, 1), 0.5, np.float32)
    brighter, roof = ground * 1.1, ground * 2.2
    light = shift_to_consensus(ground, [(half, ground), (half, brighter)])
    assert light == pytest.approx(np.full_like(ground, 5.0), rel=0.05)
    thing = shift_to_consensus(ground, [(half, ground), (half, roof)])
    assert np.abs(thing).max() < 0.1 * 60.0
