"""Wrong ties are put aside by what the others agree on; where nothing agrees, nothing is believed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photomap_gis.core.similarity import Similarity2D
from photomap_gis.reference.agree import agreeing


def ties(rng, n, wrong, T):
    predicted = rng.uniform(-100, 100, (n, 2))
    measured = T.apply(predicted) + rng.normal(0, 0.1, (n, 2))
    bad = rng.permutation(n)[:wrong]
    measured[bad] += rng.uniform(4, 12, (wrong, 2)) * rng.choice([-1, 1], (wrong, 2))
    return predicted, measured, np.isin(np.arange(n), bad)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(8, 40), st.floats(0, 0.4), st.floats(-6, 6), st.floats(-0.03, 0.03))
def test_planted_wrong_ties_are_found(seed, n, share, shift, turn):
    rng = np.random.default_rng(seed)
    T = Similarity2D(shift, -shift / 2, turn, turn / 2)
    p, m, bad = ties(rng, n, int(share * n), T)
    np.testing.assert_array_equal(agreeing(p, m, np.full(n, 1.0), np.ones(n)), ~bad)


def test_ties_that_lie_anywhere_agree_on_nothing(rng):
    for _ in range(20):
        p = rng.uniform(-100, 100, (20, 2))
        m = p + rng.uniform(-15, 15, (20, 2))
        assert not agreeing(p, m, np.full(20, 1.0), np.ones(20)).any()


def test_weak_ties_join_the_strong_but_do_not_outvote_them(rng):
    p = rng.uniform(-100, 100, (12, 2))
    m = p + np.array([2.0, 1.0])
    m[6:] = p[6:] + np.array([-5.0, 4.0])  # six weak ones agree on something else
    weight = np.array([1.0] * 6 + [0.2] * 6)
    np.testing.assert_array_equal(agreeing(p, m, np.full(12, 0.5), weight), np.arange(12) < 6)


@pytest.mark.parametrize(("offsets", "expected"), [([(1, 1)], [True]), ([(1, 1), (1.1, 1)], [True, True]),
                                                    ([(1, 1), (9, -4)], [False, False])])  # fmt: skip
def test_few_ties_must_all_agree(offsets, expected):
    p = np.array([[0.0, 0.0], [300.0, 20.0]])[: len(offsets)]
    m = p + np.array(offsets, float)
    tolerance = np.full(len(p), 0.5)
    found = agreeing(p, m, tolerance, np.ones(len(p)))
    assert found.tolist() == expected


def test_no_ties_no_agreement():
    assert agreeing(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0)).shape == (0,)
