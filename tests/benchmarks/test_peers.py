"""Judging other programs' cameras."""

import numpy as np

from benchmarks.peers import off_after_similarity


def test_a_turned_scaled_and_shifted_copy_is_off_by_nothing_else_by_its_error(rng):
    true = rng.normal(size=(40, 3)) * (50.0, 50.0, 2.0)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    points = (true @ q.T) * 0.03 + (7.0, -2.0, 1.0)
    assert off_after_similarity(points, true).max() < 1e-9
    mirrored = true * (1.0, 1.0, -1.0)
    assert off_after_similarity(mirrored, true).max() > 0.5  # no mirroring
    noise = rng.normal(size=true.shape) * 0.1
    assert 0.1 < np.sqrt(np.mean(off_after_similarity(true + noise, true) ** 2)) < 0.2
