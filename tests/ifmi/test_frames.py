"""Bad frames are told, good ones pass."""

import cv2
import numpy as np
import pytest
from ifmi_ground import ground, noisy

from photomap_gis.ifmi import judge_frame


@pytest.fixture
def good(rng):
    return noisy(rng, ground(rng, 600)[:360, :480], 2.0)


def test_good_frames_pass(rng, good):
    assert judge_frame(good).ok
    assert judge_frame(noisy(rng, good, 1.5), good).ok
    dull = np.clip(100 + 0.06 * (good.astype(float) - 128), 0, 255)
    assert judge_frame(noisy(rng, dull, 1.0)).ok, "low texture is no fault"
    thermal = cv2.resize(cv2.GaussianBlur(good, (0, 0), 2.0), (640, 480))
    assert judge_frame(thermal).ok, "a soft lens is no fault"
    boxed = good.copy()
    boxed[:40] = boxed[-40:] = 0
    assert judge_frame(boxed).ok, "a letter box is no fault"


@pytest.mark.parametrize(("value", "word"), [(0, "black"), (79, "empty"), (128, "empty"), (255, "white")])
def test_empty_frames(value, word):
    verdict = judge_frame(np.full((120, 160), value, np.uint8))
    assert not verdict.ok and word in verdict.reason


def test_a_repeated_frame_is_frozen(good):
    assert "frozen" in judge_frame(good, good.copy()).reason
    assert judge_frame(good, good[:100]).ok, "another size is not compared"


def test_faults_of_the_link(rng, good):
    grey = good.copy()
    grey[270:] = 128
    assert "empty" in judge_frame(grey).reason
    smeared = good.copy()
    smeared[250:] = smeared[250]
    assert "repeat" in judge_frame(smeared).reason
    torn = good.copy()
    torn[200:] = np.roll(torn[200:], 170, axis=1)
    assert "torn" in judge_frame(torn, good).reason
    blocks = good.copy()
    for _ in range(140):
        y, x = rng.integers(0, 360 // 16) * 16, rng.integers(0, 480 // 16) * 16
        blocks[y : y + 16, x : x + 16] = rng.integers(30, 220)
    assert "blocks" in judge_frame(blocks, good).reason
    assert "blurred" in judge_frame(cv2.GaussianBlur(good, (0, 0), 9.0), good).reason


def test_what_the_frame_before_shows_too_is_the_cameras_habit(rng, good):
    def with_overlay(image):
        out = image.copy()
        out[200:] = 60
        out[200] = rng.integers(0, 255, out.shape[1])
        return out

    assert not judge_frame(with_overlay(good)).ok
    before = with_overlay(noisy(rng, np.roll(good, 9, axis=1), 2.0))
    assert judge_frame(with_overlay(good), before).ok
