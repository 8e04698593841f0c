"""Unreported tilt: told by the pairs' bends, over flat and over sloping ground."""

import math
from itertools import pairwise

import numpy as np
import pytest

from photomap_gis.slam.slope import fit_slope
from photomap_gis.slam.tilt import Bend, Leaning, estimate_tilts, leans, level_from_tilt, levelled

FOCAL_PX = 1000.0
HEIGHT_M = 100.0


def plane_points(ground_xy, camera_xy, heading, tilt_rad, slope):
    """Return the unlevelled plane points of ground points: exact perspective of a camera that leans by ``tilt_rad``."""
    depth = HEIGHT_M + slope @ camera_xy - ground_xy @ slope
    d = ground_xy - camera_xy
    c, s = math.cos(heading), math.sin(heading)
    level = np.column_stack([c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1], depth])
    rays = level @ level_from_tilt(tilt_rad)  # the inverse of levelling
    return FOCAL_PX * rays[:, :2] / rays[:, 2:]


def flight(rng, tilt_sigma_rad, slope, noise_px=0.2):
    """Return the bends of a small lawnmower flight and the true tilts."""
    centres = [np.array([30.0 * (k if row % 2 == 0 else 5 - k), 35.0 * row]) for row in range(4) for k in range(6)]
    headings = [0.0 if (k // 6) % 2 == 0 else math.pi for k in range(24)]
    tilts = [tuple(rng.normal(0.0, tilt_sigma_rad, 2)) for _ in centres]
    pairs = [*pairwise(range(24)), *((k, m) for k in range(24) for m in range(k + 2, 24)
             if np.linalg.norm(centres[k] - centres[m]) < 50)]  # fmt: skip
    bends = []
    for a, b in pairs:
        middle = (centres[a] + centres[b]) / 2
        x, y = np.meshgrid(np.linspace(-35, 35, 9), np.linspace(-30, 30, 9))
        ground = middle + np.column_stack([x.ravel(), y.ravel()])
        seen = [plane_points(ground, centres[f], headings[f], tilts[f], slope) for f in (a, b)]
        seen = [p + rng.normal(0, noise_px, p.shape) for p in seen]
        bends.append(Bend(a, b, seen[0], seen[1], FOCAL_PX, FOCAL_PX, 1.0))
    return bends, np.array(tilts)


def scatter_deg(found, true):
    """RMS error of the tilts against each other: an even lean of all and an even slope of the ground look alike."""
    error = np.array([found[k] for k in range(24)]) - true
    error[(np.arange(24) // 6) % 2 == 1] *= -1.0  # along the map's axes: every other strip flies back
    assert np.degrees(np.abs(error.mean(axis=0) + true_mean(true))).max() < 0.05, "an even lean is left to the slope"
    return np.degrees(np.sqrt(np.mean((error - error.mean(axis=0)) ** 2)))


def true_mean(true):
    along = true.copy()
    along[(np.arange(24) // 6) % 2 == 1] *= -1.0
    return along.mean(axis=0)


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.04, -0.03)])
def test_tilts_are_recovered(rng, slope):
    bends, true = flight(rng, math.radians(2), np.array(slope))
    found = estimate_tilts(bends)
    assert scatter_deg(found, true) < 0.25


def test_levelled_pairs_are_explained_and_agree_with_the_truth(rng):
    bends, true = flight(rng, math.radians(2), np.zeros(2))
    found = estimate_tilts(bends)
    left = []
    for bend in bends:
        a, b = (Leaning(FOCAL_PX, found[f]).level(p) for f, p in ((bend.a, bend.points_a), (bend.b, bend.points_b)))
        motion = fit_slope(a, b, FOCAL_PX, FOCAL_PX)
        assert motion is not None
        left.append(motion.left_px)
    assert np.median(left) < 0.35
    assert true.std() > 0.02


def test_level_flights_do_not_lean(rng):
    assert not leans(flight(rng, 0.0, np.zeros(2))[0])
    assert not leans(flight(rng, 0.0, np.array([0.05, -0.04]))[0])
    assert leans(flight(rng, math.radians(2), np.array([0.02, 0.01]))[0])
    assert not leans([])


def test_levelling_undoes_a_lean():
    ground = np.array([[10.0, -20.0], [0.0, 0.0], [30.0, 25.0]])
    seen = plane_points(ground, np.zeros(2), 0.0, (0.1, -0.05), np.zeros(2))
    np.testing.assert_allclose(levelled(seen, FOCAL_PX, (0.1, -0.05)) * HEIGHT_M / FOCAL_PX, ground, atol=1e-9)
    assert estimate_tilts([]) == {}


def test_a_false_pair_does_not_lean_the_others(rng):
    bends, true = flight(rng, math.radians(2), np.zeros(2))
    wrong = bends[5]
    bends[5] = Bend(wrong.a, wrong.b, wrong.points_a + rng.normal(0, 40, wrong.points_a.shape), wrong.points_b,
                    FOCAL_PX, FOCAL_PX, 1.0)  # fmt: skip
    assert scatter_deg(estimate_tilts(bends), true) < 0.3
