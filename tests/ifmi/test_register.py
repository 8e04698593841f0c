"""Known truth: pictures moved by a known similarity come back with it."""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from ifmi_ground import ground, noisy, pose, rms_px, view

from photomap_gis.core.similarity import Similarity2D, fit_similarity
from photomap_gis.ifmi import Prior, make_spectrum, register, register_images


@pytest.mark.parametrize("shape", [(256, 256), (192, 256), (270, 480)])
@pytest.mark.parametrize(
    ("dx", "dy", "angle_deg", "scale"),
    [(0, 0, 0, 1.0), (40, -30, 10, 1.0), (-25, 20, 178, 1.1), (10, 60, -95, 0.85), (60, 10, 45, 1.2)],
)
def test_a_known_motion_comes_back(rng, shape, dx, dy, angle_deg, scale):
    g = ground(rng)
    T_g_a = pose(450, 450, 20, 1.0, shape)
    T_g_b = pose(450 + dx, 450 + dy, 20 + angle_deg, scale, shape)
    truth = T_g_a.inverse() @ T_g_b
    r = register_images(view(g, T_g_a, shape), view(g, T_g_b, shape), fallback=False)
    assert r.accepted
    assert r.method == "ifmi"
    assert rms_px(r.T_a_b, truth, shape) < 0.12
    assert np.linalg.eigvalsh(r.covariance)[0] > 0.0


def test_different_grounds_are_not_accepted(rng):
    shape = (192, 256)
    for _ in range(5):
        a, b = (view(ground(rng), pose(450, 450, 0, 1.0, shape), shape) for _ in range(2))
        assert not register_images(a, b).accepted


def test_large_pictures_come_back_in_their_own_pixels(rng):
    g = ground(rng, 1800)
    shape = (900, 1201)
    T_g_a, T_g_b = pose(900, 900, 0, 1.0, shape), pose(960, 880, 12, 1.05, shape)
    truth = T_g_a.inverse() @ T_g_b
    a, b = (cv2.cvtColor(view(g, T, shape), cv2.COLOR_GRAY2BGR) for T in (T_g_a, T_g_b))
    r = register_images(a, b)
    assert r.accepted
    assert r.size_b_px == (1201, 900)
    assert rms_px(r.T_a_b, truth, shape) < 0.5


def test_a_prior_keeps_out_what_lies_elsewhere(rng):
    shape = (192, 256)
    g = ground(rng)
    T_g_a, T_g_b = pose(450, 450, 0, 1.0, shape), pose(500, 460, 5, 1.0, shape)
    truth = T_g_a.inverse() @ T_g_b
    a, b = make_spectrum(view(g, T_g_a, shape), index=3), make_spectrum(view(g, T_g_b, shape), index=4)
    right = register(a, b, prior=Prior(truth @ Similarity2D(4.0, -3.0, 0.01, 0.0), 6.0, 0.03, 0.02))
    assert right.accepted and (right.a, right.b) == (3, 4)
    assert rms_px(right.T_a_b, truth, shape) < 0.4
    wrong = register(a, b, prior=Prior(truth @ Similarity2D(60.0, 0.0, 0.0, 0.0), 6.0, 0.03, 0.02))
    assert not wrong.accepted


def test_same_input_same_result(rng):
    shape = (192, 256)
    g = ground(rng)
    a, b = (view(g, pose(450 + 20 * k, 450, 0, 1.0, shape), shape) for k in range(2))
    r, s = register_images(a, b), register_images(a, b)
    assert r.T_a_b == s.T_a_b
    assert np.array_equal(r.covariance, s.covariance)


@pytest.mark.parametrize("value", [0, 128, 255])
def test_empty_pictures_abstain(value):
    flat = np.full((120, 160), value, np.uint8)
    r = register_images(flat, flat)
    assert not r.accepted
    assert np.linalg.eigvalsh(r.covariance)[0] > 0.0


def test_threads_share_spectra_and_agree(rng):
    shape = (192, 256)
    g = ground(rng)
    spectra = [make_spectrum(view(g, pose(400 + 25 * k, 450, 3 * k, 1.0, shape), shape), index=k) for k in range(4)]
    pairs = [(a, b) for a in spectra for b in spectra if a.index < b.index]
    alone = [register(a, b) for a, b in pairs]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda pair: register(*pair), pairs))
    assert [r.T_a_b for r in alone] == [r.T_a_b for r in together]
    assert [(r.a, r.b) for r in together] == [(a.index, b.index) for a, b in pairs]


def test_fixed_overlays_do_not_hold_the_picture_fast(rng):
    """A caption burnt into both frames says "no motion"; the mask takes its word away."""
    shape = (256, 320)
    g = ground(rng)
    T_g_a, T_g_b = pose(450, 450, 0, 1.0, shape), pose(490, 420, 4, 1.0, shape)
    a, b = view(g, T_g_a, shape).copy(), view(g, T_g_b, shape).copy()
    mask = np.ones(shape, bool)
    caption = rng.integers(0, 2, (40, 320)).astype(np.uint8) * 255
    for image in (a, b):
        image[:40] = caption
        image[200:, 100:220] = 20
    mask[:40] = mask[200:, 100:220] = False
    r = register_images(a, b, mask_a=mask, mask_b=mask)
    assert r.accepted
    assert rms_px(r.T_a_b, T_g_a.inverse() @ T_g_b, shape) < 0.3


def test_repeating_texture_abstains(rng):
    """Rows that repeat fit at every period: nothing says which is right."""
    y, x = np.mgrid[0:256, 0:256].astype(np.float64)
    for angle in (0.0, 0.4):
        u, v = np.cos(angle) * x + np.sin(angle) * y, -np.sin(angle) * x + np.cos(angle) * y
        a = 128 + 50 * np.sign(np.sin(2 * np.pi * u / 16)) + 20 * np.cos(2 * np.pi * v / 22)
        b = 128 + 50 * np.sign(np.sin(2 * np.pi * (u + 5) / 16)) + 20 * np.cos(2 * np.pi * (v - 3) / 22)
        r = register_images(*(noisy(rng, np.clip(p, 0, 255), 4.0) for p in (a, b)))
        assert not r.accepted


def test_small_overlap_without_and_with_prior(rng):
    shape = (256, 256)
    g = ground(rng)
    T_g_a, T_g_b = pose(350, 450, 0, 1.0, shape), pose(350 + 150, 450, 30, 1.1, shape)
    truth = T_g_a.inverse() @ T_g_b
    a, b = (make_spectrum(noisy(rng, view(g, T, shape), 3.0)) for T in (T_g_a, T_g_b))
    for prior in (None, Prior(truth @ Similarity2D(8.0, 5.0, 0.03, 0.02), 10.0, 0.04, 0.04)):
        r = register(a, b, prior=prior)
        assert r.accepted
        assert rms_px(r.T_a_b, truth, shape) < 1.0


@pytest.mark.parametrize("tilt", [0.0, 3e-4])
def test_the_covariance_holds_the_truth_and_tilt_is_told_apart(rng, tilt):
    """Normalised errors of about one; perspective shows in the model sigma, at its true size."""
    shape, errors, sigmas, trues = (192, 256), [], [], []
    g = ground(rng, 1200)
    centre = Similarity2D.translation_of((shape[1] - 1) / 2, (shape[0] - 1) / 2)
    for k in range(12):
        T_g_a = pose(600, 600, 30.0 * k, 1.0, shape)
        T_g_b = pose(*(600 + rng.uniform(-40, 40, 2)), 30.0 * k + rng.uniform(-20, 20), 1.0, shape)
        truth = T_g_a.inverse() @ T_g_b
        a, b = view(g, T_g_a, shape), view(g, T_g_b, shape)
        # Perspective about b's centre: pixel p of the tilted picture shows pixel W(p) of the level one.
        turn = rng.uniform(0, 2 * np.pi)
        W = np.eye(3)
        W[2, :2] = tilt * np.cos(turn), tilt * np.sin(turn)
        W = centre.matrix @ W @ centre.inverse().matrix
        b = cv2.warpPerspective(g, T_g_b.matrix @ W, shape[::-1], flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
        x, y = np.meshgrid(np.arange(1.5, 255, 4.0), np.arange(1.5, 191, 4.0))
        p = np.stack([x.ravel(), y.ravel()], axis=1)
        seen = cv2.perspectiveTransform(p[None], W)[0]
        q = truth.apply(seen)
        inside = (q >= -0.5).all(axis=1) & (q <= [255.5, 191.5]).all(axis=1)
        closest = fit_similarity(q[inside], p[inside])
        trues.append(np.sqrt(np.mean(np.sum((closest.apply(p[inside]) - q[inside]) ** 2, axis=1)) / 2))
        r = register_images(noisy(rng, a, 3.0), noisy(rng, b, 3.0), fallback=False)
        xi = (centre.inverse() @ r.T_a_b.inverse() @ closest @ centre).log()
        errors.append(float(xi @ np.linalg.solve(r.covariance, xi)) / 4.0)
        sigmas.append(r.model_sigma_px)
    assert 0.05 < np.mean(errors) < 2.0
    assert np.quantile(errors, 0.9) < 2.5
    if tilt:
        assert 0.8 < np.median(np.array(sigmas) / trues) < 1.25
    else:
        assert max(sigmas) < 0.15


@pytest.mark.parametrize("shapes", [((384, 512), (200, 300)), ((200, 300), (384, 512)), ((700, 700), (384, 512))])
def test_frames_of_different_sizes_register(rng, shapes):
    """A preview beside a photo: their pyramids do not pair until they are made to."""
    g = ground(rng, 1400)
    T_g_a, T_g_b = pose(700, 700, 0, 1.0, shapes[0]), pose(720, 690, 5, 1.0, shapes[1])
    a, b = (make_spectrum(view(g, T, s)) for T, s in zip((T_g_a, T_g_b), shapes, strict=True))
    r = register(a, b, fallback=False)
    assert r.accepted
    assert rms_px(r.T_a_b, T_g_a.inverse() @ T_g_b, shapes[1]) < 0.1


def _parking(rng, empty: float) -> np.ndarray:
    """Rows of lots; a share of them ``empty``, the others with cars of one kind or of many."""
    g = np.full((700, 700), 105.0)
    for y in range(0, 700, 60):
        for x in range(0, 700, 24):
            g[y : y + 40, x] = g[y, x : x + 24] = 210.0
            if rng.random() >= empty:
                g[y + 6 : y + 34, x + 5 : x + 19] = 60.0
                g[y + 14 : y + 20, x + 8 : x + 16] = 150.0
    return cv2.GaussianBlur(np.clip(g, 0, 255).astype(np.uint8), (0, 0), 1.0)


def test_among_rows_the_odd_ones_out_decide(rng):
    """Some lots are empty: only one motion fits them all, whatever the period says of the others."""
    shape, right = (256, 256), 0
    for _ in range(6):
        g = _parking(rng, 0.25)
        T_g_a, T_g_b = pose(330, 340, 0, 1.0, shape), pose(330 + rng.uniform(40, 90), 340, 3, 1.0, shape)
        r = register_images(*(noisy(rng, view(g, T, shape), 2.0) for T in (T_g_a, T_g_b)), fallback=False)
        off = rms_px(r.T_a_b, T_g_a.inverse() @ T_g_b, shape) > 2.0
        assert not (r.accepted and off)
        right += r.accepted
    assert right >= 4  # the others abstain


def test_among_equal_rows_the_other_motions_are_told(rng):
    shape = (256, 256)
    g = _parking(rng, 0.0)
    T_g_a, T_g_b = pose(330, 340, 0, 1.0, shape), pose(370, 348, 0, 1.0, shape)
    r = register_images(*(noisy(rng, view(g, T, shape), 2.0) for T in (T_g_a, T_g_b)), fallback=False)
    assert not r.accepted
    assert r.alternatives
