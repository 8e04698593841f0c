"""The blur that a picture tells of itself is the blur that was given to it."""

import math

import cv2
import numpy as np
import pytest

from photomap_gis.mosaic.sharpness import MAX_BLUR_PX, blur_of


@pytest.fixture(scope="module")
def blocks() -> np.ndarray:
    """Sharp edges in every place, softened as a camera does."""
    rng = np.random.default_rng(3)
    image = np.full((900, 1200), 120.0, np.float32)
    for _ in range(400):
        x, y, w, h = *rng.integers(0, (1200, 900)), *rng.integers(20, 90, 2)
        cv2.rectangle(image, (int(x), int(y)), (int(x + w), int(y + h)), float(rng.uniform(40, 210)), -1)
    return cv2.GaussianBlur(image, (0, 0), 0.5)


def noisy(image, rng):
    return np.clip(np.rint(image + rng.normal(0, 2, image.shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("sigma_px", [1.0, 2.0, 3.5])
def test_a_known_blur_is_found(blocks, rng, sigma_px):
    blurred = cv2.GaussianBlur(blocks, (0, 0), sigma_px)
    expected = math.hypot(sigma_px, 0.5)
    assert blur_of(noisy(blurred, rng)) == pytest.approx(expected, rel=0.25)


def test_blur_grows_with_blur_in_colour_too(blocks, rng):
    values = [blur_of(cv2.merge([noisy(cv2.GaussianBlur(blocks, (0, 0), s), rng)] * 3)) for s in (0.5, 1.0, 2.0, 4.0)]
    assert values == sorted(values) and values[-1] > 2.5 * values[0]


@pytest.mark.parametrize("shape", [(13, 1), (1, 13)])
def test_a_smear_along_one_axis_counts(blocks, rng, shape):
    sharp, smeared = blur_of(noisy(blocks, rng)), blur_of(noisy(cv2.blur(blocks, shape), rng))
    assert smeared > 2.5 > 1.2 > sharp


def test_what_tells_nothing_is_unknown_and_what_is_far_gone_is_bounded(rng):
    assert math.isnan(blur_of(np.full((300, 400), 90, np.uint8)))
    assert math.isnan(blur_of(noisy(np.full((300, 400), 90.0), rng)))
    assert math.isnan(blur_of(np.zeros((3, 3, 3), np.uint8)))
    step = np.where(np.arange(600) < 300, 20.0, 230.0) * np.ones((600, 1))
    assert 4.0 < blur_of(noisy(cv2.GaussianBlur(step, (0, 0), 15), rng)) <= MAX_BLUR_PX
