"""The benchmark of drawing: frames see the ground that they are said to see, and straight seams are straight."""

import numpy as np

from benchmarks.mosaic.flight import GSD_M, Pictures, lawnmower, texture
from benchmarks.mosaic.seams import _cheapest, _gradient_energy


def test_pictures_show_the_ground_where_their_placements_say():
    trajectory = lawnmower(3, width_px=160, height_px=120, per_strip=2)
    read, ground = Pictures(trajectory, kept=2), texture().astype(float)
    for p in trajectory.placements:
        image = read(p.frame)
        px = np.random.default_rng(p.frame).integers((5, 5), (155, 115), (200, 2))
        at = np.rint(p.camera_to_map.project(px) / GSD_M).astype(int) % len(ground)
        seen, true = image[px[:, 1], px[:, 0]].astype(float).ravel(), ground[at[:, 1], at[:, 0]].ravel()
        assert np.corrcoef(seen, true)[0, 1] > 0.9
        assert read(p.frame) is image, "kept"


def test_strips_run_there_and_back():
    headings = [p.heading_rad for p in lawnmower(4, width_px=160, height_px=120, per_strip=2).placements]
    assert np.cos(headings[0]) > 0.9 and np.cos(headings[2]) < -0.9


def test_straight_seams_are_where_frames_cost_the_same():
    costs = np.array([[[1.0, 2.0, np.inf]], [[2.0, 1.0, np.inf]]])
    assert _cheapest(costs, [], [], edges=(0, 0)).tolist() == [[0, 1, -1]]


def test_gradient_energy_is_that_of_a_slope():
    ramp = np.tile(np.arange(40, dtype=np.uint8) * 3, (30, 1))
    assert np.allclose(
        _gradient_energy(ramp)[2:-2, 2:-2], 36.0
    )  # a central difference over two pixels of 3 grey levels
