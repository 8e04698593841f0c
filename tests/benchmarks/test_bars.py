"""A tenth of the registration benchmark: what the issue's bars ask for, on the reporting pictures."""

import numpy as np
import pytest

from benchmarks.registration.pairs import pairs
from benchmarks.registration.score import error_of, is_right, mahalanobis2, xi_of
from photomap_gis.ifmi import make_spectrum, register

pytestmark = [pytest.mark.slow, pytest.mark.shared]


def outcomes(cls, count):
    for pair in pairs(cls, count, 7, "reporting"):
        yield pair, register(make_spectrum(pair.a), make_spectrum(pair.b), fallback=False)


@pytest.mark.parametrize(
    ("cls", "least"),
    [("nominal", 0.99), ("translation-50", 0.80), ("rotation", 0.99), ("tilt-10", 0.99), ("low-contrast", 0.85)],
)
def test_success_and_covariance(shared_data, cls, least):
    right, held = 0, []
    for pair, r in outcomes(cls, 100):
        if is_right(error_of(r.T_a_b, pair).rms_px, pair.size_px[0]):
            right += 1
            if r.accepted:
                held.append(mahalanobis2(xi_of(r.T_a_b, pair), r.covariance))
    assert right >= least * 100
    assert 0.3 < np.mean(held) / 4.0 < 2.0
    assert np.mean(np.array(held) < 9.488) > 0.85


def test_wrong_pairs_are_not_accepted(shared_data):
    assert sum(r.accepted for _, r in outcomes("wrong", 500)) == 0


def test_repeating_ground_is_not_taken_for_another_place(shared_data):
    wrong = 0
    for pair, r in outcomes("repetitive", 500):
        wrong += r.accepted and not is_right(error_of(r.T_a_b, pair).rms_px, pair.size_px[0])
    assert wrong <= 1
