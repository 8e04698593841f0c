"""Whom to try for loops."""

import flights as fl
import numpy as np
import pytest

from photomap_gis.core.similarity import Similarity2D
from photomap_gis.slam import candidates

OUTLINE = np.array([[-256.0, -192], [256, -192], [256, 192], [-256, 192]])


def lawn(rng, strips=8, per_strip=10, **known):
    flight = fl.lawnmower(rng, strips, per_strip, **known)
    poses = {k: (p, np.diag([9.0, 9, 1e-4, 1e-4])) for k, p in enumerate(flight.poses)}
    return flight, poses, dict.fromkeys(poses, OUTLINE)


def test_every_neighbouring_strip_is_tried(rng):
    _, poses, outlines = lawn(rng)
    chain = {(k, k + 1) for k in range(79)}
    found = candidates(poses, outlines, exclude=chain)
    strips = {(c.a // 10, c.b // 10) for c in found}
    assert {(s, s + 1) for s in range(7)} <= strips
    assert not chain & {(c.a, c.b) for c in found}
    counts = np.bincount([f for c in found for f in (c.a, c.b)], minlength=80)
    assert counts.max() <= 12 and counts.min() >= 2
    assert all(c.overlap >= 0.3 and c.a < c.b for c in found)


def test_predictions_are_those_of_the_poses(rng):
    flight, poses, outlines = lawn(rng)
    for c in candidates(poses, outlines)[:20]:
        expected = flight.poses[c.a].inverse() @ flight.poses[c.b]
        np.testing.assert_allclose(c.T_a_b.matrix, expected.matrix, atol=1e-9)


def test_covariance_is_that_of_independent_poses(rng):
    _, poses, outlines = lawn(rng)
    c = next(c for c in candidates(poses, outlines) if abs(c.T_a_b.angle_rad) > 3.0)
    (T_a, cov_a), (T_b, cov_b) = poses[c.a], poses[c.b]
    roots = [np.sqrt(np.diagonal(cov)) for cov in (cov_a, cov_b)]
    samples = []
    for _ in range(4000):
        xa, xb = (rng.normal(size=4) * root * 0.05 for root in roots)
        moved = (T_a @ Similarity2D.exp(xa)).inverse() @ (T_b @ Similarity2D.exp(xb))
        samples.append((c.T_a_b.inverse() @ moved).log())
    np.testing.assert_allclose(np.sqrt(np.diagonal(np.cov(np.array(samples).T))) / 0.05,
                               np.sqrt(np.diagonal(c.covariance)), rtol=0.06)  # fmt: skip


@pytest.mark.parametrize("forward", [0.7, 0.96])
def test_neighbours_in_time_leave_room_for_other_strips(rng, forward):
    """Frames that follow each other densely share most ground, and would take the whole budget by overlap alone."""
    per_strip, width, height = 40, 512.0, 384.0
    poses = {}
    for k in range(3 * per_strip):
        strip, along = divmod(k, per_strip)
        x = (along if strip % 2 == 0 else per_strip - 1 - along) * (1 - forward) * width
        poses[k] = (Similarity2D(x, strip * 0.4 * height, 0.0 if strip % 2 == 0 else np.pi, 0.0), None)
    chain = {(k, k + 1) for k in range(len(poses) - 1)}
    found = candidates(poses, dict.fromkeys(poses, OUTLINE), exclude=chain, max_per_frame=6)
    near = {f for c in found if c.b - c.a <= 3 for f in (c.a, c.b)}
    across = {f for c in found if c.a // per_strip != c.b // per_strip for f in (c.a, c.b)}
    assert len(across) > 0.9 * len(poses)
    assert len(near) > 0.9 * len(poses)


def test_the_order_does_not_hang_on_chance(rng):
    _, poses, outlines = lawn(rng)
    one = candidates(poses, outlines)
    two = candidates(dict(reversed(poses.items())), dict(reversed(outlines.items())))
    assert [(c.a, c.b) for c in one] == [(c.a, c.b) for c in two]


def test_excluded_pairs_count_in_either_order(rng):
    _, poses, outlines = lawn(rng, 2, 3)
    found = {(c.a, c.b) for c in candidates(poses, outlines)}
    pair = min(found)
    assert pair not in {(c.a, c.b) for c in candidates(poses, outlines, exclude={pair[::-1]})}


@pytest.mark.parametrize("count", [0, 1])
def test_few_frames_have_no_candidates(rng, count):
    _, poses, outlines = lawn(rng, 1, 2)
    assert candidates({k: poses[k] for k in range(count)}, outlines) == []


def test_broken_footprints_are_left_out(rng):
    _, poses, outlines = lawn(rng, 2, 4)
    outlines[1] = np.full((4, 2), np.nan)
    outlines[2] = np.zeros((4, 2))
    outlines[3] = np.zeros((0, 2))
    poses[0] = (poses[0][0], None)
    found = candidates(poses, outlines)
    assert not {1, 2, 3} & {f for c in found for f in (c.a, c.b)}
    assert any(c.covariance is None for c in found) or all(0 not in (c.a, c.b) for c in found)


def test_what_earlier_rounds_spent_counts(rng):
    _, poses, outlines = lawn(rng)
    whole = candidates(poses, outlines, max_per_frame=6)
    frame = whole[0].a
    left = candidates(poses, outlines, max_per_frame=6, spent={frame: 5})
    assert sum(frame in (c.a, c.b) for c in whole) == 6
    assert sum(frame in (c.a, c.b) for c in left) == 1
