"""Pixels with alpha: no colour from where nothing was seen, and the quick ways equal the slow ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photomap_gis.export.pixels import is_opaque, sample, shrink


def grid(width, height, step=1.0, offset=0.0):
    y, x = np.mgrid[:height, :width].astype(float)
    return x * step + offset, y * step + offset


def textured(rng, height=64, width=80):
    rgba = rng.integers(0, 256, (height, width, 4), dtype=np.uint8)
    rgba[..., 3] = 255
    return rgba


@given(st.integers(0, 255), st.integers(0, 255), st.integers(2, 8))
@settings(max_examples=40, deadline=None)
def test_shrink_weighs_by_alpha(value, alpha, factor):
    rgba = np.zeros((factor * 2, factor * 2, 4), np.uint8)
    rgba[..., :3] = 200  # hidden colour
    rgba[:factor, :, :3], rgba[:factor, :, 3] = value, alpha
    out = shrink(rgba, factor)
    assert out.shape == (2, 2, 4)
    np.testing.assert_allclose(out[0, :, 3].astype(int), alpha, atol=1)
    if alpha > 8:
        np.testing.assert_allclose(out[0, :, :3].astype(int), value, atol=2)
    assert not out[1].any()


def test_shrink_takes_colour_from_the_seen_only():
    rgba = np.zeros((2, 2, 4), np.uint8)
    rgba[..., :3] = 255
    rgba[0, 0] = (10, 20, 30, 255)
    np.testing.assert_allclose(shrink(rgba, 2)[0, 0].astype(int), (10, 20, 30, 64), atol=1)


def test_shrink_wants_whole_blocks():
    with pytest.raises(ValueError, match="multiple of 3"):
        shrink(np.zeros((4, 6, 4), np.uint8), 3)


def test_sample_at_pixel_centres_changes_nothing(rng):
    rgba = textured(rng)
    np.testing.assert_array_equal(sample(rgba, *grid(80, 64)), rgba)
    rgba[10:20, 10:30] = 0
    out = sample(rgba, *grid(80, 64))
    np.testing.assert_array_equal(out, rgba)


def test_sample_with_alpha_equals_sample_without(rng):
    rgba = textured(rng)
    x, y = grid(20, 20, offset=20.37)
    quick = sample(rgba, x, y)
    rgba[0, 0, 3] = 0  # far away: forces the slow way
    assert not is_opaque(rgba)
    slow = sample(rgba, x, y)
    assert np.abs(quick.astype(int) - slow).max() <= 2


def test_no_dark_or_hidden_colour_at_a_border():
    rgba = np.zeros((40, 40, 4), np.uint8)
    rgba[..., :3] = (255, 0, 255)
    rgba[10:30, 10:30] = (90, 160, 40, 255)
    for step in (0.37, 1.0, 1.4):
        n = int(36 / step)
        out = sample(rgba, *grid(n, n, step, 1.7), shrink_xy=(step, step))
        shown = out[..., 3] >= 8
        assert shown.any()
        np.testing.assert_allclose(
            out[shown][:, :3].astype(int), np.broadcast_to((90, 160, 40), (shown.sum(), 3)), atol=8
        )


def test_outside_and_nan_are_transparent(rng):
    rgba = textured(rng)
    x, y = grid(20, 20, offset=10.0)
    x[3, 4] = np.nan
    y[5, 6] = np.inf
    x[7, 8] = -3.0
    y[9, 9] = 1e12
    out = sample(rgba, x, y)
    assert all(out[p][3] == 0 for p in ((3, 4), (5, 6), (7, 8), (9, 9)))
    assert out[0, 0, 3] == 255


def test_stripes_finer_than_the_samples_turn_grey():
    rgba = np.full((64, 64, 4), 255, np.uint8)
    rgba[:, ::2, :3] = 0
    out = sample(rgba, *grid(34, 34, 1.7, 3.3), shrink_xy=(1.7, 1.0))
    plain = sample(rgba, *grid(34, 34, 1.7, 3.3))
    assert out[4:-4, 4:-4, 0].std() < 0.45 * plain[4:-4, 4:-4, 0].std()
    assert abs(out[4:-4, 4:-4, 0].mean() - 127.5) < 8


@pytest.mark.parametrize("factor", [2, 4])
@pytest.mark.parametrize("kind", ["ragged border", "holes everywhere", "half transparent"])
def test_a_shrunk_image_is_that_of_the_floating_twin(rng, factor, kind):
    """Whole blocks by OpenCV's integers, partly seen ones one by one: both are the weighted mean, rounded."""
    rgba = rng.integers(0, 256, (96, 128, 4), dtype=np.uint8)
    y, x = np.mgrid[:96, :128]
    if kind == "ragged border":
        rgba[..., 3] = np.where(np.hypot(x - 50, y - 40) < 38, 255, 0)
    elif kind == "holes everywhere":
        rgba[..., 3] = 255 * rng.integers(0, 2, (96, 128))
    blocks = rgba.reshape(96 // factor, factor, 128 // factor, factor, 4).astype(float)
    alpha = blocks[..., 3:]
    weight = alpha.sum(axis=(1, 3))
    colour = (blocks[..., :3] * alpha).sum(axis=(1, 3)) / np.maximum(weight, 1.0)
    opacity = weight[..., 0] / factor**2
    out = shrink(rgba, factor).astype(int)
    assert np.abs(out[..., 3] - opacity).max() <= 0.51
    seen = out[..., 3] > 0
    assert np.abs(out[..., :3] - colour)[seen].max() <= 1.0
    assert not out[~seen].any()
