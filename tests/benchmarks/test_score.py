"""Scores and intervals against known values and against simulation."""

import math

import numpy as np
import pytest

from benchmarks.registration.pairs import Pair
from benchmarks.registration.score import (
    CHI2_95,
    bootstrap,
    calibration,
    centre_of,
    error_of,
    is_right,
    mahalanobis2,
    median,
    model_rms_px,
    rms_px,
    truth_of,
    wilson,
    xi_of,
)
from photomap_gis.core.similarity import Similarity2D


def pair(T, residual=1.0, size=(256, 200)):
    grid = np.stack([v.ravel() for v in np.meshgrid(np.arange(0.0, size[0], 8), np.arange(0.0, size[1], 8))], axis=1)
    image = np.zeros(size[::-1], np.uint8)
    there = grid if T is None else T.apply(grid)
    return Pair("x", "x", image, image, T, residual, 1.0, there, grid, (0.0, 0.0))


@pytest.mark.parametrize(
    ("hits", "count", "low", "high"),
    [(0, 10, 0.0, 0.2775), (5, 10, 0.2366, 0.7634), (74, 74, 0.9507, 1.0), (81, 263, 0.2553, 0.3662)],
)
def test_wilson_is_as_published(hits, count, low, high):
    i = wilson(hits, count)
    assert i.value == hits / count
    assert (i.low, i.high) == pytest.approx((low, high), abs=2e-4)


def test_wilson_of_nothing_says_nothing():
    i = wilson(0, 0)
    assert math.isnan(i.value) and (i.low, i.high) == (0.0, 1.0)


def test_errors_of_known_deviations():
    T = Similarity2D(12.0, -5.0, 0.3, 0.1)
    p = pair(T)
    assert error_of(T, p).rms_px == 0.0
    moved = Similarity2D.translation_of(3.0, 4.0) @ T
    e = error_of(moved, p)
    assert (e.rms_px, e.centre_px) == pytest.approx((5.0, 5.0))
    assert e.angle_deg == e.scale == 0.0
    c = Similarity2D.translation_of(*centre_of(p))
    turned = T @ c @ Similarity2D(0, 0, math.radians(0.5), math.log(1.01)) @ c.inverse()
    e = error_of(turned, p)
    assert (e.centre_px, e.angle_deg, e.scale) == pytest.approx((0.0, 0.5, 0.01), abs=1e-9)
    assert rms_px(turned, T, p.points_b) == e.rms_px > 0.5


def test_the_success_rule_is_a_share_of_the_width():
    assert is_right(4.09, 256) and not is_right(4.1, 256)


def test_xi_brings_the_estimate_to_the_truth_about_the_centre():
    T, p = Similarity2D(12.0, -5.0, 2.9, 0.3), pair(Similarity2D(12.5, -4.0, -3.1, 0.28))
    xi = xi_of(T, p)
    centre = Similarity2D.translation_of(*centre_of(p))
    again = T @ centre @ Similarity2D.exp(xi) @ centre.inverse()
    np.testing.assert_allclose(again.matrix, truth_of(p).matrix, atol=1e-9)


def test_a_pair_without_truth_has_no_errors():
    with pytest.raises(ValueError, match="no truth"):
        error_of(Similarity2D.identity(), pair(None))


def test_the_model_sigma_is_told_in_pixels_of_b():
    assert model_rms_px(pair(Similarity2D(0, 0, 0, math.log(2.0)), residual=4.0)) == pytest.approx(math.sqrt(2.0))


def test_honest_covariances_are_found_honest_and_liars_liars(rng):
    root = rng.standard_normal((4, 4)) + 2 * np.eye(4)
    C = root @ root.T
    xi = rng.standard_normal((4000, 4)) @ root.T
    honest = calibration(xi, np.broadcast_to(C, (4000, 4, 4)), rng)
    assert honest.held_4dof.value == pytest.approx(0.95, abs=0.012)
    assert honest.held_xy.value == pytest.approx(0.95, abs=0.012)
    assert honest.nees_per_dof.low < 1.0 < honest.nees_per_dof.high
    liar = calibration(xi, np.broadcast_to(C / 4.0, (4000, 4, 4)), rng)
    assert liar.held_4dof.value < 0.7 and liar.nees_per_dof.value == pytest.approx(4.0, rel=0.1)
    assert mahalanobis2(xi[0], C) == pytest.approx(float(xi[0] @ np.linalg.inv(C) @ xi[0]))


def test_chi_square_limits_are_those_of_scipy():
    from scipy.stats import chi2

    for dof, limit in CHI2_95.items():
        assert limit == pytest.approx(chi2.ppf(0.95, dof), abs=1e-9)


def test_the_interval_of_a_median_holds_it_in_nineteen_of_twenty(rng):
    held = 0
    for _ in range(120):
        i = median(rng.exponential(size=60), rng)
        held += i.low <= math.log(2.0) <= i.high
    assert held >= 104
    assert math.isnan(bootstrap([], np.mean, rng).value)
