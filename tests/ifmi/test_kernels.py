"""The compiled loops against independent implementations in NumPy, SciPy and OpenCV."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photomap_gis.core.similarity import Similarity2D
from photomap_gis.ifmi import block_steps, descent, field_sums, passes, small
from photomap_gis.ifmi.align import align, outlying
from photomap_gis.ifmi.blocks import block_motion
from photomap_gis.ifmi.field import Frame, field_matrix, fit_field
from photomap_gis.ifmi.kernels import FAR
from photomap_gis.ifmi.spectrum import make_spectrum
from photomap_gis.ifmi.steepest import choose
from photomap_gis.ifmi.template import BLOCKS

from .ifmi_ground import ground, pose, view


def definite(rng, n):
    half = rng.standard_normal((n, n + 2))
    return half @ half.T


@pytest.mark.parametrize("n", [1, 4, 8])
def test_small_systems_and_their_axes_are_lapack_s(rng, n):
    M, right = definite(rng, n), rng.standard_normal((n, 3))
    X = right.copy()
    small.solve(M.copy(), X)
    np.testing.assert_allclose(X, np.linalg.solve(M, right), rtol=1e-8, atol=1e-10)
    values, axes = M.copy(), np.empty((n, n))
    small.eigen(values, axes)
    np.testing.assert_allclose(np.sort(values.diagonal()), np.linalg.eigvalsh(M), rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose((axes * values.diagonal()) @ axes.T, M, rtol=1e-9, atol=1e-10)


def test_what_is_not_definite_has_no_solution():
    X = np.ones((2, 1))
    small.solve(np.array([[1.0, 2.0], [2.0, 1.0]]), X)
    assert not np.isfinite(X).all()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-9, 9, width=32), min_size=1, max_size=60), st.integers(0, 59))
def test_the_ranked_value_is_that_of_the_sorted_ones(values, rank):
    some = np.array(values, np.float32)
    rank %= len(some)
    assert small.ranked(some.copy(), rank) == np.sort(some)[rank]


def test_values_are_looked_up_as_opencv_does_and_nothing_beyond_the_border(rng):
    picture = rng.standard_normal((40, 56)).astype(np.float32)
    picture[10:14, 20:30] = FAR
    xy = np.stack([rng.uniform(-4, 60, 900), rng.uniform(-4, 44, 900)]).astype(np.float32)
    xy[:, :8] = [[0, 55, 0, 55, np.nan, np.inf, -np.inf, 1e30], [0, 0, 39, 39, 5, 5, 5, 5]]
    usable = rng.random(900) > 0.1
    seen, valid = np.empty(900, np.float32), np.empty(900, np.bool_)
    count = descent.look_up(picture, xy, usable, seen, valid)
    inside = (xy[0] >= 0) & (xy[0] <= 55) & (xy[1] >= 0) & (xy[1] <= 39)
    there = np.where(inside, xy, 0)
    twin = cv2.remap(picture, there[:1], there[1:], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).ravel()
    expected = inside & (twin < 30)
    np.testing.assert_array_equal(valid, expected & usable)
    np.testing.assert_allclose(seen, np.where(expected, twin, 0), atol=2e-4)
    assert count == valid.sum() and valid[:4].sum() + (~usable[:4]).sum() == 4


def test_slopes_of_a_are_differences_of_its_values(rng):
    picture = cv2.GaussianBlur(rng.standard_normal((40, 56)).astype(np.float32), (0, 0), 1.5)
    Q = np.ones((3, 500), np.float32)
    Q[0], Q[1] = rng.uniform(-1.0, 1.0, 500), rng.uniform(-0.7, 0.7, 500)
    G = Similarity2D(27.0, 20.0, 0.3, math.log(29.0)).matrix @ field_matrix(np.array([0, 0, 0, 0, 0.01, 0, 0.02, 0.01]))
    xy, J = np.empty((2, 500), np.float32), np.empty((8, 500), np.float32)
    descent.place(G, 1, Q, xy)
    np.testing.assert_allclose(xy, cv2.perspectiveTransform(Q[None, :2].T.reshape(-1, 1, 2), G)[:, 0].T, atol=1e-4)
    descent.slopes_of_a(picture, G, 1, Q, xy, J)
    x, y = xy[:1], xy[1:]
    at = lambda u, v: cv2.remap(picture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)  # noqa: E731
    linear = (G[:2, :2] - np.outer(G[:2, 2], G[2, :2]) / G[2, 2]) / G[2, 2]
    slopes = linear.T @ np.concatenate([at(x + 1, y) - at(x - 1, y), at(x, y + 1) - at(x, y - 1)]) / 2.0
    inside = ((xy.T >= 0) & (xy.T <= [55, 39])).all(axis=1)
    assert 100 < inside.sum() < 500
    np.testing.assert_allclose(J[:2, inside], slopes[:, inside], atol=5e-3)
    np.testing.assert_allclose(J[6, inside], (J[0] * Q[0] ** 2 + J[1] * Q[0] * Q[1])[inside], atol=1e-4)


@pytest.mark.parametrize("points", [100, 512, 1777])
def test_sums_of_products_are_matrix_products(rng, points):
    A, B = (rng.standard_normal((9, points)).astype(np.float32) for _ in range(2))
    weight = rng.random(points).astype(np.float32)
    own, both, pull = np.empty((9, 9)), np.empty((8, 8)), np.empty(9)
    descent.products(A, A, weight, True, own)
    descent.products(A[1:], B[1:], weight, False, both)
    descent.pulls(A, B[0], weight, pull)
    full = (A[1:].astype(float) * weight) @ B[1:].T
    np.testing.assert_allclose(own, (A.astype(float) * weight) @ A.T, atol=2e-3)
    np.testing.assert_allclose(both, 0.5 * (full + full.T), atol=2e-3)
    np.testing.assert_allclose(pull, (A.astype(float) * weight) @ B[0], atol=2e-3)


def test_a_curvature_is_kept_within_another(rng):
    alone, both = definite(rng, 8), definite(rng, 8)
    kept = both.copy()
    descent.keep_within(kept, alone)
    scale = 1.0 / np.sqrt(alone.diagonal())
    share, axes = np.linalg.eigh(both * np.outer(scale, scale))
    whole = ((alone * np.outer(scale, scale)) @ axes * axes).sum(axis=0)
    twin = (axes * np.clip(share, descent.LEAST_ATTENUATION * whole, whole)) @ axes.T / np.outer(scale, scale)
    np.testing.assert_allclose(kept, twin, rtol=1e-7, atol=1e-9)


@pytest.fixture(scope="module")
def spectra():
    rng = np.random.default_rng(11)
    g, shape = ground(rng), (192, 256)
    T_g_a, T_g_b = pose(450, 450, 0, 1.0, shape), pose(470, 440, 5, 1.02, shape)
    a, b = (make_spectrum(view(g, T, shape)) for T in (T_g_a, T_g_b))
    return a, b, T_g_a.inverse() @ T_g_b


def looked_up(floor, G, Q):
    """Twin of ``place`` and ``look_up``: values and whether they can be seen."""
    p = (np.diag([1 / floor.factor, 1 / floor.factor, 1.0]) @ G) @ Q.reshape(3, -1).astype(float)
    x, y = (p[:2] / p[2]).astype(np.float32)
    seen = cv2.remap(floor.seen, x[None], y[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=FAR)
    inside = (x >= 0) & (y >= 0) & (x <= floor.shape[1] - 1) & (y <= floor.shape[0] - 1) & (seen.ravel() < 30)
    return np.where(inside, seen.ravel(), 0).astype(float), inside


def robust_sigma(residual, valid):
    some = np.abs(residual[:: max(1, len(residual) // 600)][valid[:: max(1, len(residual) // 600)]])
    return 1.4826 * np.sort(some)[len(some) // 2] + 1e-6


def test_a_step_that_is_no_number_is_not_taken():
    G = np.eye(3)
    assert not math.isfinite(descent.move_on(G, np.full((8, 1), np.nan), 128.0, 4.0))
    np.testing.assert_array_equal(G, np.eye(3))


@pytest.mark.parametrize("freedom", [4, 8])
def test_one_step_is_that_of_gauss_and_newton(spectra, freedom):
    a, b, truth = spectra
    G = (truth @ Similarity2D(1.0, -0.7, 0.004, 0.003)).matrix @ Frame(*b.size_px).T_b_q.matrix
    fit = align(a.floors[0], b.floors[0], G, freedom=freedom, steps=1, stiffness=0.02)
    t = b.floors[0].template
    A = t.A.reshape(9, -1)[: 1 + freedom].astype(float)
    seen, valid = looked_up(a.floors[0], G, t.Q)
    valid &= t.usable.ravel()
    gain = (seen * A[0])[valid].sum() / (A[0] ** 2)[valid].sum()
    left = seen - gain * A[0]
    w = valid / (1.0 + (left / (descent.CAUCHY * robust_sigma(left, valid))) ** 2)
    own, pull = (A * w) @ A.T, (A * w) @ seen
    gain = pull[0] / own[0, 0]
    curvature = gain * own[1:, 1:]
    level = np.trace(curvature[:4, :4]) / 4
    curvature += level * np.diag([1e-6] * 4 + [0.02 + 1e-6] * (freedom - 4))
    step = np.linalg.solve(curvature, gain * own[1:, 0] - pull[1:])
    assert np.linalg.norm(step) * 128 < descent.LONGEST_STEP_PX
    twin = G @ field_matrix(step)
    np.testing.assert_allclose(fit.G, twin / twin[2, 2], rtol=2e-4, atol=2e-3)
    assert fit.correlation == pytest.approx(pull[0] / math.sqrt((w * seen**2).sum() * own[0, 0]), abs=1e-4)
    assert fit.support == valid.mean()


def test_a_step_of_blocks_is_that_of_each_alone(spectra):
    a, b, truth = spectra
    G = (truth @ Similarity2D(0.4, -0.3)).matrix @ Frame(*b.size_px).T_b_q.matrix
    T = np.array([[0.9, 0.05], [0.05, 0.8]])  # of what the blocks promise so much pulls
    t, px, every = b.floors[0].template, 2.0 / 256, np.arange(BLOCKS)
    values, axes = np.linalg.eigh(T)
    root = (axes * np.sqrt(values)) @ axes.T
    d, told = np.empty((BLOCKS, 2)), np.empty((BLOCKS, 7))
    solved, visible = np.empty(BLOCKS, np.bool_), np.empty(BLOCKS, np.bool_)
    A, Q, start = t.A.reshape(9, -1), t.Q.reshape(3, -1), np.zeros((BLOCKS, 2))
    block_steps.settle(a.floors[0].seen, G, 1, Q, A, t.usable, every, start, root, px, 1, d, told, solved, visible)
    seen, valid = (v.reshape(t.usable.shape) for v in looked_up(a.floors[0], G, t.Q))
    valid = valid & t.usable
    value, gx, gy = t.A[:3].astype(float)
    gain = np.clip((value * seen * valid).sum(1) / np.maximum((value**2 * valid).sum(1), 1e-9), 0.05, 3.0)[:, None]
    left = seen - gain * value
    w = valid / (1.0 + (left / (descent.CAUCHY * robust_sigma(left.ravel(), valid.ravel()))) ** 2)
    assert solved.sum() > 60
    for k in np.flatnonzero(solved)[::5]:
        J = np.stack([gx[k], gy[k]])
        H = (J * w[k]) @ J.T
        H += (1e-3 * np.trace(H) + 1e-6) * np.eye(2)
        step = np.linalg.solve(gain[k] * root @ H @ root, -(J * w[k]) @ left[k])
        step *= min(1.0, block_steps.LONGEST_STEP_PX * px / np.linalg.norm(step))
        np.testing.assert_allclose(d[k], step, rtol=2e-3, atol=2e-3 * px)
        rest = left[k] + gain[k] * (step @ J)
        total = max(w[k].sum(), 1.0)
        sigma2, power = (w[k] * rest**2).sum() / total, gain[k, 0] ** 2 * (w[k] * value[k] ** 2).sum() / total
        bread = np.linalg.inv(gain[k] * root @ H @ root)
        C = sigma2 * bread @ H @ bread
        np.testing.assert_allclose(told[k, 2:5], [C[0, 0], C[0, 1], C[1, 1]], rtol=0.02, atol=1e-3 * C.max())
        assert told[k, 5] == pytest.approx(math.sqrt(power / (power + sigma2)), abs=1e-3)
        assert visible[k] and told[k, 6] == valid[k].mean()
    # to the end, all blocks say together where the truth lies
    motion = block_motion(a.floors, b.floors, G, coarsest=None, attenuation=np.eye(2))
    there = np.median(motion.displacement[motion.solved], axis=0)
    back = np.linalg.inv((truth @ Similarity2D(0.4, -0.3)).linear) @ truth.linear @ [-0.4, 0.3]
    np.testing.assert_allclose(there, back / 128.0, atol=0.06 / 128.0)


def test_what_no_motion_explains_is_counted_in_company(spectra):
    a, b, truth = spectra
    G = truth.matrix @ Frame(*b.size_px).T_b_q.matrix
    fit = align(a.floors[0], b.floors[0], G, freedom=8, steps=6)
    assert outlying(b.floors[0], fit) < 0.01
    n = b.floors[0].template.usable.shape[1]
    fit.seen[40 * n : 52 * n] *= -3.0  # twelve of 144 blocks show something else
    assert outlying(b.floors[0], fit) == pytest.approx(12 / 144, abs=0.035)


def test_a_field_is_fitted_as_numpy_does(rng):
    q, noise = (
        rng.uniform(-1, 1, (90, 2)),
        np.stack([rng.uniform(1e-6, 4e-6, 90), np.full(90, 3e-7), np.full(90, 2e-6)]),
    )
    d = 2e-3 * rng.standard_normal((90, 2)) + [0.01, 0.02]
    field = fit_field(q, d, noise)
    x, y, one, zero = *q.T, np.ones(90), np.zeros(90)
    B = np.array([[one, zero], [zero, one], [-y, x], [x, y], [x, -y], [y, x], [x * x, x * y], [x * y, y * y]])
    prior = np.diag([field_sums.LOOSE] * 4 + [1 / field_sums.BEND_PRIOR**2] * 4)
    C = np.stack([noise[0], noise[1], noise[1], noise[2]], axis=1).reshape(-1, 2, 2)
    theta, left, usual = np.zeros(8), d, (noise[0] + noise[2]).mean() / 2
    for _ in range(field_sums.ROUNDS):
        mean2 = (left**2).sum(axis=1).mean() / 2 / max(0.3, 1 - 8 / 180)
        scatter2 = max(mean2 - (1 + field_sums.SIGNIFICANT / math.sqrt(90)) * usual, field_sums.LEAST_SCATTER * usual)
        inverse = np.linalg.inv(C + scatter2 * np.eye(2))
        m2 = 0.5 * np.einsum("ki,kij,kj->k", left, inverse, left)
        inverse /= (1.0 + m2 / field_sums.TAIL)[:, None, None]
        W = np.einsum("kij,pjk->pik", inverse, B)
        curvature = np.einsum("pik,qik->pq", W, B) + prior
        theta = theta + np.linalg.solve(curvature, np.einsum("pik,ki->p", W, left) - prior @ theta)
        h = np.column_stack([q, one]) @ field_matrix(theta).T
        left = d - (h[:, :2] / h[:, 2:] - q)
    bread = np.linalg.inv(curvature)
    np.testing.assert_allclose(field.theta, theta, rtol=1e-6, atol=1e-10)
    assert field.scatter2 == pytest.approx(scatter2, rel=1e-6)
    np.testing.assert_allclose(
        field.covariance, bread @ np.einsum("pik,kij,qjk->pq", W, C, W) @ bread, rtol=1e-6, atol=1e-14
    )
    np.testing.assert_allclose(field.shape, bread @ np.einsum("pik,qik->pq", W, W) @ bread, rtol=1e-6, atol=1e-10)
    even = np.linalg.solve(np.einsum("pik,qik->pq", B, B) + prior, np.einsum("pik,ki->p", B, left))
    np.testing.assert_allclose(field.pull, even, rtol=1e-6, atol=1e-10)


def test_a_homography_is_inverted(rng):
    H = np.eye(3) + 0.2 * rng.standard_normal((3, 3))
    np.testing.assert_allclose(field_sums.inverse(H) @ H, np.eye(3), atol=1e-12)


def test_phases_are_numpy_s(rng):
    A, B = (rng.standard_normal((24, 9)) + 1j * rng.standard_normal((24, 9)) for _ in range(2))
    A[3, 4] = 0.0
    low_pass = rng.random((12, 9)).astype(np.float32)
    D, white, power = (np.empty((24, 9), np.complex64) for _ in range(3))
    passes.phase_difference(A.astype(np.complex64), B.astype(np.complex64), low_pass, D)
    passes.whitened(B.astype(np.complex64), white)
    passes.powers(B.astype(np.complex64), power)
    np.testing.assert_allclose(D, np.exp(1j * np.angle(A * B.conj())) * np.tile(low_pass, (2, 1)) * (A != 0), atol=1e-5)
    np.testing.assert_allclose(white, B / np.abs(B), atol=1e-5)
    np.testing.assert_allclose(power, np.abs(B) ** 2, rtol=1e-5)


def test_overlaps_are_compared_as_opencv_warps_them(rng):
    a, b = (cv2.GaussianBlur(rng.standard_normal((48, 64)).astype(np.float32), (0, 0), 2.0) for _ in range(2))
    a[5:20, 30:40] = FAR
    H = Similarity2D(9.0, -6.0, 0.2, 0.1).matrix
    sums, common = np.empty(5), np.empty((49, 65), np.int32)
    count = passes.compare(a, b, field_sums.inverse(H), sums)
    warped = cv2.warpPerspective(b, H, (64, 48), borderMode=cv2.BORDER_CONSTANT, borderValue=(FAR,) * 4)
    both = (a < 30) & (warped < 3)  # OpenCV mixes a little of what is beyond the border into what is inside
    x, y = a[both].astype(float), warped[both].astype(float)
    assert count == pytest.approx(both.sum(), rel=0.02)
    np.testing.assert_allclose(sums, [x.sum(), y.sum(), x @ x, x @ y, y @ y], rtol=0.05, atol=1.5)
    passes.count_common(a, warped, common)
    np.testing.assert_array_equal(common, cv2.integral(((a < 30) & (warped < 30)).astype(np.uint8)))


def test_values_reach_a_limit_only_where_they_are_allowed_to(rng):
    values, allowed = rng.random((9, 7)).astype(np.float32), np.ones((9, 7), np.bool_)
    weight = np.full((9, 7), 2.0, np.float32)
    values[4, 5] = 3.0
    assert passes.reaches(values, weight, allowed, 5.9)
    allowed[4, 5] = False
    assert not passes.reaches(values, weight, allowed, 5.9)


def test_tiles_are_cut_without_their_mean_and_their_sum_is_read(rng):
    a, b = (rng.standard_normal((30, 30)).astype(np.float32) for _ in range(2))
    b[3:6, 3:6] = FAR
    window = np.outer(np.hanning(8), np.hanning(8)).astype(np.float32)
    y, x, tiles = np.array([0, 9, 22]), np.array([0, 14, 22]), np.empty((6, 8, 8), np.float32)
    passes.cut(a, b, y, x, window, tiles)
    for k in range(3):
        for n, picture in ((k, a), (k + 3, np.where(b < 30, b, 0))):
            tile = picture[y[k] : y[k] + 8, x[k] : x[k] + 8]
            np.testing.assert_allclose(tiles[n], (tile - tile.mean()) * window, atol=1e-5)
    near, far, scatter = passes.read_sum(tiles, 2.0, 3.0)
    summed, one = tiles.sum(axis=0), np.fft.fftfreq(8, 1 / 8)
    distance = np.hypot(one[:, None], one)
    assert near == pytest.approx(summed[distance <= 2.0].max(), abs=1e-5)
    assert far == pytest.approx(summed[distance > 3.0].max(), abs=1e-5)
    assert scatter == pytest.approx(summed[distance > 3.0].std(), rel=1e-4)


def test_masked_pixels_are_not_chosen(rng):
    values = rng.random((40, 52)).astype(np.float32)
    mask = np.where(rng.random((40, 52)) > 0.4, 255, 0).astype(np.uint8)
    for size, top, left in ((4, 0, 0), (3, 2, 5)):
        flat = np.empty(((40 - top) // size, (52 - left) // size), np.intp)
        choose(values, mask, size, top, left, flat)
        padded = np.pad(values, 1, mode="reflect")
        slope2 = (padded[1:-1, 2:] - padded[1:-1, :-2]) ** 2 + (padded[2:, 1:-1] - padded[:-2, 1:-1]) ** 2
        slope2[mask == 0] = 0.0
        for i, row in enumerate(flat):
            for j, at in enumerate(row):
                r, c = top + i * size, left + j * size
                cell = slope2[r : r + size, c : c + size]
                assert r <= at // 52 < r + size and c <= at % 52 < c + size
                assert slope2.flat[at] >= cell.max() * (1 - 1e-5)
