"""Evidence: light and a contrast turned upside down are none; what is new is."""

import numpy as np
import pytest

from photomap_gis.compare.evidence import FEATURES, evidence, leant, look_at_pair
from photomap_gis.compare.score import products_of, score_of
from photomap_gis.simulate.noise import fractal_noise

ALL = np.ones((200, 200), bool)


@pytest.fixture
def ground(rng):
    grey = np.clip(0.5 + 0.15 * fractal_noise((200, 200), rng, wavelength_px=20.0, octaves=3), 0, 1)
    return np.repeat(grey[..., None], 3, axis=2).astype(np.float32)


def _score(old, new):
    return score_of(evidence(old, new, ALL, look_at_pair([(old, new, ALL)], has_colour=True), most_lean_px=6.0))


def test_another_light_is_no_change(ground):
    darker = (0.6 * ground**1.2).astype(np.float32)
    assert _score(ground, darker).max() < 0.3


def test_a_new_object_is_a_change_and_its_surroundings_are_not(ground):
    new = ground.copy()
    new[80:120, 80:120] = (0.9, 0.2, 0.1)
    score = _score(ground, new)
    assert score[45:55, 45:55].mean() > 0.9
    assert score[:25].mean() < 0.05


def test_it_does_not_matter_which_of_them_is_older(ground):
    new = ground.copy()
    new[80:120, 80:120] = 0.95
    came, went = _score(ground, new), _score(new, ground)
    assert came[45:55, 45:55].mean() > 0.9 and went[45:55, 45:55].mean() > 0.9


def test_what_leans_finds_itself_and_what_is_new_does_not(ground):
    old, new = ground.copy(), ground.copy()
    old[80:120, 80:120], new[84:124, 85:125] = (0.9, 0.2, 0.1), (0.9, 0.2, 0.1)
    moved = leant(old, new, ALL, 12.0)
    inner = np.s_[95:115, 95:115]
    assert np.abs(moved - new)[inner].mean() < 0.05
    gone = leant(ground, new, ALL, 12.0)
    assert np.abs(gone - new)[inner].mean() > 0.3


def test_products_are_those_of_the_law():
    rows = np.arange(2.0 * len(FEATURES), dtype=np.float32).reshape(2, -1)
    k = len(FEATURES)
    out = products_of(rows)
    assert out.shape == (2, k + k * (k + 1) // 2)
    assert out[1, k] == rows[1, 0] ** 2 and out[1, -1] == rows[1, -1] ** 2
