"""Known truth: pictures moved by a known similarity come back with it."""

import math

import cv2
import numpy as np
import pytest

from photomap_gis.core.similarity import Similarity2D
from photomap_gis.ifmi import Prior, make_spectrum, register, register_images


def ground(rng: np.random.Generator, side: int = 900) -> np.ndarray:
    """A procedural ground without repeats: blurred noise of many sizes, with patches of hard edges."""
    g = sum(
        s**-0.4 * cv2.GaussianBlur(rng.standard_normal((side, side)), (0, 0), s) * s for s in (1.0, 2.0, 4.0, 9.0, 20.0)
    )
    for _ in range(120):
        x, y = rng.integers(0, side, 2)
        w, h = rng.integers(8, 60, 2)
        g[y : y + h, x : x + w] += rng.normal() * 6.0
    g = (g - g.mean()) / g.std()
    return np.clip(128 + 45 * g, 0, 255).astype(np.uint8)


def view(g: np.ndarray, T_ground_image: Similarity2D, shape: tuple[int, int]) -> np.ndarray:
    """The picture that a straight-down camera takes of the ground."""
    m = T_ground_image.matrix[:2]
    return cv2.warpAffine(g, m, shape[::-1], flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)


def pose(x: float, y: float, angle_deg: float, scale: float, shape: tuple[int, int]) -> Similarity2D:
    """``T_ground_image`` with the image's centre at (x, y) of the ground."""
    c = Similarity2D.translation_of(-(shape[1] - 1) / 2, -(shape[0] - 1) / 2)
    return Similarity2D(x, y, math.radians(angle_deg), math.log(scale)) @ c


def rms_px(T: Similarity2D, U: Similarity2D, shape: tuple[int, int]) -> float:
    h, w = shape
    corners = np.array([[0, 0], [w - 1, 0], [0, h - 1], [w - 1, h - 1]], float)
    return float(np.sqrt(np.mean(np.sum((T.apply(corners) - U.apply(corners)) ** 2, axis=1))))


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
    assert rms_px(r.T_a_b, truth, shape) < 0.4
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
