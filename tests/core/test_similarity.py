"""Laws of the plane's similarities."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from photomap_gis.core.similarity import Similarity2D, fit_similarity, transform_jacobian, wrap_angle

COORD = st.floats(-1e4, 1e4)
SIMILARITIES = st.builds(Similarity2D, COORD, COORD, st.floats(-3.1, 3.1), st.floats(-2, 2))
POINTS = np.array([[0.0, 0.0], [100.0, 3.0], [-7.0, 42.0]])


def assert_same_map(t: Similarity2D, u: Similarity2D, atol: float = 1e-6) -> None:
    np.testing.assert_allclose(t.apply(POINTS), u.apply(POINTS), atol=atol, rtol=1e-8)


@given(SIMILARITIES)
def test_inverse_undoes(t):
    assert_same_map(t @ t.inverse(), Similarity2D())
    assert_same_map(t.inverse() @ t, Similarity2D())


@given(SIMILARITIES, SIMILARITIES, SIMILARITIES)
def test_composition_is_associative_and_maps_in_turn(t, u, v):
    np.testing.assert_allclose(((t @ u) @ v).apply(POINTS), (t @ (u @ v)).apply(POINTS), rtol=1e-7, atol=1e-3)
    np.testing.assert_allclose((t @ u).apply(POINTS), t.apply(u.apply(POINTS)), rtol=1e-7, atol=1e-5)


@given(SIMILARITIES)
def test_matrix_round_trip(t):
    assert_same_map(Similarity2D.from_matrix(t.matrix), t)


@given(SIMILARITIES)
@example(Similarity2D(5.0, -3.0, 0.0, 0.0))
@example(Similarity2D(5.0, -3.0, 1e-5, -1e-5))
def test_exp_inverts_log(t):
    assert_same_map(Similarity2D.exp(t.log()), t)


@given(SIMILARITIES, st.tuples(*[st.floats(-1, 1)] * 4))
def test_adjoint_carries_perturbations(t, xi):
    xi = np.array(xi)
    left = Similarity2D.exp(t.adjoint() @ xi) @ t
    np.testing.assert_allclose(left.apply(POINTS), (t @ Similarity2D.exp(xi)).apply(POINTS), rtol=1e-6, atol=1e-4)


@given(SIMILARITIES)
def test_jacobian_agrees_with_differences(t):
    jac = transform_jacobian(t, POINTS)
    for k in range(4):
        h = np.zeros(4)
        h[k] = 1e-6
        diff = ((t @ Similarity2D.exp(h)).apply(POINTS) - (t @ Similarity2D.exp(-h)).apply(POINTS)) / 2e-6
        np.testing.assert_allclose(jac[:, :, k], diff, rtol=1e-4, atol=1e-2)


def test_paper_composition():
    """Section 2.1, the four equations of the composition."""
    t, u = Similarity2D(10, 20, 0.3, math.log(1.2)), Similarity2D(5, -4, -0.7, math.log(0.9))
    v = t @ u
    assert v.tx == pytest.approx(10 + 1.2 * (math.cos(0.3) * 5 - math.sin(0.3) * -4))
    assert v.ty == pytest.approx(20 + 1.2 * (math.sin(0.3) * 5 + math.cos(0.3) * -4))
    assert v.angle_rad == pytest.approx(-0.4)
    assert v.scale == pytest.approx(1.08)


@given(SIMILARITIES)
def test_fit_recovers(t):
    assert_same_map(fit_similarity(t.apply(POINTS), POINTS), t, atol=1e-4)


def test_fit_refuses_a_single_place():
    with pytest.raises(ValueError, match="coincide"):
        fit_similarity([[0, 0], [1, 1]], [[2, 2], [2, 2]])


def test_mirrors_are_refused():
    with pytest.raises(ValueError, match="mirror"):
        Similarity2D.from_matrix([[1, 0, 0], [0, -1, 0], [0, 0, 1]])


@given(SIMILARITIES, COORD, COORD)
def test_about_moves_the_origin(t, x, y):
    p = np.array([x, y])
    np.testing.assert_allclose(t.about(x, y).apply(POINTS) + p, t.apply(POINTS + p), rtol=1e-7, atol=1e-3)


@given(st.floats(-100, 100))
def test_wrap_angle(a):
    w = wrap_angle(a)
    assert -math.pi <= w <= math.pi
    assert math.cos(w) == pytest.approx(math.cos(a), abs=1e-9)
