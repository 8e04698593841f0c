"""The block-tridiagonal solver against dense algebra."""

import numpy as np
import pytest
from scipy import sparse

from photomap_gis.slam import blocktri


def banded(rng, n, width, border=0):
    """A random positive definite matrix of a chain, shuffled, with dense last columns."""
    rows = rng.integers(0, n, 6 * n)
    cols = np.clip(rows + rng.integers(-width, width + 1, 6 * n), 0, n - 1)
    order = rng.permutation(n)
    parts = sparse.coo_array((rng.normal(size=6 * n), (order[rows], order[cols])), shape=(n, n)).toarray()
    whole = np.zeros((n + border, n + border))
    whole[:n, :n] = parts + parts.T
    whole[:n, n:] = rng.normal(size=(n, border))
    whole[n:, :n] = whole[:n, n:].T
    whole += np.diag(np.abs(whole).sum(axis=1) + 0.1)
    scale = np.exp(rng.normal(size=n + border) * 5)  # angles and pixels: six orders of magnitude
    return sparse.csc_array(whole * scale[:, None] * scale)


@pytest.mark.parametrize(("n", "width", "border"), [(1, 1, 0), (7, 2, 0), (400, 12, 0), (400, 12, 4), (900, 5, 2)])
def test_solutions_and_inverse_are_those_of_dense_algebra(rng, n, width, border):
    matrix = banded(rng, n, width, border)
    factor = blocktri.factor(matrix, np.arange(n, n + border, dtype=np.intp))
    dense = matrix.toarray()
    b = rng.normal(size=n + border)
    scale = 1.0 / np.sqrt(np.diagonal(dense))
    np.testing.assert_allclose(factor.solve(b) / scale, np.linalg.solve(dense, b) / scale, rtol=1e-6, atol=1e-8)
    first = np.arange(n + border, dtype=np.intp)
    inverse = np.diagonal(np.linalg.inv(dense * scale[:, None] * scale)) * scale**2
    np.testing.assert_allclose(factor.inverse_diagonal(1, first)[:, 0, 0], inverse, rtol=1e-6)


def test_several_components_are_solved_at_once(rng):
    matrix = sparse.csc_array(sparse.block_diag([banded(rng, 150, 4), banded(rng, 3, 1), banded(rng, 200, 4)]))
    b = rng.normal(size=353)
    factor = blocktri.factor(matrix, np.zeros(0, np.intp))
    np.testing.assert_allclose(matrix @ factor.solve(b), b, rtol=1e-6, atol=1e-6)


def test_what_is_tied_to_nothing_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        blocktri.factor(sparse.csc_array(np.diag([1.0, 0.0])), np.zeros(0, np.intp))


def test_unknowns_of_a_group_stay_together_though_nothing_couples_them(rng):
    """Poses that hang on nothing but their own fix: each of their unknowns is a component of its own."""
    poses = 40
    diagonal = np.exp(rng.normal(size=4 * poses) * 3)
    chain = banded(rng, 80, 3).toarray()
    whole = np.block([
        [np.diag(diagonal), np.zeros((4 * poses, 80))],
        [np.zeros((80, 4 * poses)), chain],
    ])  # fmt: skip
    matrix = sparse.csc_array(whole)
    group = np.arange(len(whole)) // 4
    factor = blocktri.factor(matrix, np.zeros(0, np.intp), group=group)
    for block in factor.blocks:
        assert np.array_equal(np.unique(group[block], return_counts=True)[1], np.full(len(block) // 4, 4))
    got = factor.inverse_diagonal(4, np.arange(0, len(whole), 4))
    scale = 1.0 / np.sqrt(np.diagonal(whole))
    inverse = np.linalg.inv(whole * scale[:, None] * scale) * scale[:, None] * scale
    wanted = np.array([inverse[k : k + 4, k : k + 4] for k in range(0, len(whole), 4)])
    sigma = np.sqrt(np.diagonal(wanted, axis1=1, axis2=2))
    np.testing.assert_allclose(got / sigma[:, :, None] / sigma[:, None], wanted / sigma[:, :, None] / sigma[:, None],
                               rtol=1e-6, atol=1e-9)  # fmt: skip
