"""Bad frames are told from the picture and its predecessor, good ones pass."""

import cv2
import numpy as np
import pytest
from ifmi_ground import ground, noisy

from photomap_gis.core.similarity import Similarity2D
from photomap_gis.ifmi import Fault, judge_frame, look_at
from photomap_gis.ifmi.frames.blur import blur_score
from photomap_gis.ifmi.frames.still import stillness


@pytest.fixture
def land(rng):
    return ground(rng, 700)


@pytest.fixture
def good(rng, land):
    return noisy(rng, land[:360, :480], 2.0)


@pytest.fixture
def before(rng, land):
    """The frame before: the camera moved on by 14 and 9 pixels since."""
    return noisy(rng, land[9:369, 14:494], 2.0)


def shifted(rng, land, x, y, sigma=1.5):
    """The picture of a camera that hovers, a fraction of a pixel off."""
    T = Similarity2D.translation_of(x, y).matrix[:2]
    image = cv2.warpAffine(land, T, (480, 360), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
    return noisy(rng, image, sigma)


def recoded(image, quality):
    return cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 0)


def test_good_frames_pass(rng, good, before):
    assert judge_frame(good).ok
    verdict = judge_frame(good, before)
    assert verdict.ok and verdict.fault is None and verdict.mask is None and verdict.doubt < 0.1
    dull = [noisy(rng, np.clip(100 + 0.06 * (g.astype(float) - 128), 0, 255), 1.0) for g in (good, before)]
    assert judge_frame(dull[0]).ok and judge_frame(*dull).ok, "low texture is no fault"
    soft = [cv2.resize(cv2.GaussianBlur(g, (0, 0), 2.0), (640, 480)) for g in (good, before)]
    assert judge_frame(soft[0]).ok and judge_frame(*soft).ok, "a soft lens is no fault"
    boxed = [g.copy() for g in (good, before)]
    for g in boxed:
        g[:40] = g[-40:] = 0
    assert judge_frame(boxed[0]).ok and judge_frame(*boxed).ok, "a letter box is no fault"


def test_good_frames_pass_whatever_came_before(rng, good):
    stranger = noisy(rng, ground(np.random.default_rng(5), 500)[:360, :480], 2.0)
    assert judge_frame(good, stranger).ok
    assert judge_frame(good, good[:100]).ok, "another size is not compared"


def test_glare_furrows_and_a_sharp_codec_are_no_faults(rng, good, before):
    glare = [np.clip(128 + 4.0 * (g.astype(float) - 110), 0, 255).astype(np.uint8) for g in (good, before)]
    assert judge_frame(*glare).ok
    rows = 20 * np.sin(np.arange(360) / 3.0)[:, None]
    furrows = [np.clip(0.4 * g + 70 + rows, 0, 255).astype(np.uint8) for g in (good, before)]
    assert judge_frame(*furrows).ok
    assert judge_frame(recoded(good, 12), recoded(before, 12)).ok


@pytest.mark.parametrize(("value", "word"), [(0, "black"), (79, "one grey"), (128, "one grey"), (255, "white")])
@pytest.mark.parametrize("shape", [(120, 160), (240, 130), (720, 1280), (16, 16), (24, 400)])
def test_empty_frames(value, word, shape):
    verdict = judge_frame(np.full(shape, value, np.uint8))
    assert not verdict.ok and verdict.fault is Fault.EMPTY and word in verdict.reason


def test_empty_frames_with_noise_a_sign_or_stripes(rng, good, before):
    grey = noisy(rng, np.full(good.shape, 90, np.uint8), 2.0)
    assert judge_frame(grey, before).fault is Fault.EMPTY
    sign = np.full(good.shape, 40, np.uint8)
    cv2.putText(sign, "NO SIGNAL", (60, 200), cv2.FONT_HERSHEY_SIMPLEX, 1.8, 255, 3)
    assert judge_frame(sign, before).fault is Fault.EMPTY and judge_frame(sign).fault is Fault.EMPTY
    stripes = np.repeat(np.linspace(10, 240, 8).astype(np.uint8), 60)[None].repeat(360, 0)
    assert judge_frame(noisy(rng, stripes, 1.5), before).fault is Fault.EMPTY
    rest = good.copy()
    rest[150:] = 128
    verdict = judge_frame(rest, before)
    assert verdict.fault is Fault.EMPTY and "%" in verdict.reason


def test_a_camera_that_always_shows_little_is_not_empty(rng):
    a, b = (noisy(rng, np.full((200, 300), 90, np.uint8), 1.0) for _ in "ab")
    assert judge_frame(b, a).fault is not Fault.EMPTY


def test_snow(rng, before):
    snow = np.clip(120 + 60 * rng.standard_normal(before.shape), 0, 255).astype(np.uint8)
    assert judge_frame(snow, before).fault is Fault.SNOW and judge_frame(snow).fault is Fault.SNOW
    assert judge_frame(noisy(rng, before, 20.0), np.roll(before, 9, axis=1)).ok, "a noisy picture is a picture"


def test_a_repeated_frame_is_frozen_even_when_coded_anew(rng, good):
    assert judge_frame(good, good.copy()).fault is Fault.FROZEN
    assert judge_frame(recoded(good, 60), recoded(good, 85)).fault is Fault.FROZEN
    assert judge_frame(noisy(rng, good, 1.0), noisy(rng, good, 1.0)).fault is Fault.FROZEN, "the grabber's noise"


@pytest.mark.parametrize("off", [(0.3, 0.0), (-0.2, 0.4), (1.3, 0.8)])
def test_a_hovering_camera_is_not_frozen(rng, land, off):
    a, b = shifted(rng, land, 20.0, 20.0), shifted(rng, land, 20.0 + off[0], 20.0 + off[1])
    assert judge_frame(b, a).ok
    assert judge_frame(recoded(b, 60), recoded(a, 60)).ok
    s = stillness(look_at(b), look_at(a))
    moved = np.hypot(*off) * 256 / 480
    assert 0.6 * moved < s.common_px < 2.0 * moved, "about so much, whatever the texture"


def test_a_camera_that_stops_dead_has_frozen(rng, land):
    a, b = shifted(rng, land, 20.0, 20.0), shifted(rng, land, 20.3, 20.0)
    assert judge_frame(b, a, expected_px=0.5).ok
    assert judge_frame(b, a, expected_px=6.0).fault is Fault.FROZEN


@pytest.mark.parametrize("kernel", ["defocus", "along", "across", "aslant"])
def test_heavy_blur(rng, land, before, kernel):
    light = land[:360, :480]
    if kernel == "defocus":
        blurred = cv2.GaussianBlur(light, (0, 0), 16.0)
    else:
        k = np.zeros((81, 81), np.float32)
        ends = {"along": ((0, 40), (80, 40)), "across": ((40, 0), (40, 80)), "aslant": ((5, 20), (75, 60))}[kernel]
        cv2.line(k, *ends, 1.0, 1)
        blurred = cv2.filter2D(light, -1, k / k.sum())
    verdict = judge_frame(noisy(rng, blurred, 2.0), before)
    assert verdict.fault is Fault.BLURRED or verdict.doubt > 0.5


def test_a_light_blur_is_kept(rng, land, before):
    for sigma in (1.0, 2.5):
        light = noisy(rng, cv2.GaussianBlur(land[:360, :480], (0, 0), sigma), 2.0)
        verdict = judge_frame(light, before)
        assert verdict.ok and verdict.doubt < 0.3
    assert judge_frame(cv2.GaussianBlur(before, (0, 0), 16.0)).ok, "without a predecessor it may be the ground"


def test_smears_and_blocks_raise_doubt(rng, good, before):
    smeared = good.copy()
    smeared[150:] = smeared[150]
    assert judge_frame(smeared, before).doubt > 0.9
    blocks = good.copy()
    for _ in range(90):
        y, x = rng.integers(0, 360 // 16) * 16, rng.integers(0, 480 // 16) * 16
        blocks[y : y + 16, x : x + 16] = rng.integers(10, 245)
    assert judge_frame(blocks, before).doubt > 0.3
    assert judge_frame(blocks, np.roll(blocks, 7, axis=1)).doubt < 0.1, "what the predecessor shows too is the scene"


def test_streaks_raise_doubt_and_a_road_along_the_axis_does_not(rng, good, before):
    streaks = good.copy()
    streaks[200:300, 40:200] = good[200, 40:200]
    assert judge_frame(streaks, before).doubt > 0.9
    assert judge_frame(np.ascontiguousarray(streaks.T), np.ascontiguousarray(before.T)).doubt > 0.9
    road = good.copy()
    road[:, 200:260] = np.linspace(90, 200, 60).astype(np.uint8)
    assert judge_frame(noisy(rng, road, 2.0), before).doubt < 0.5


def test_a_few_corners_of_blocks_raise_doubt_and_eaves_do_not(rng, good, before):
    good, before = (cv2.GaussianBlur(p, (0, 0), 3.0)[:192, :256] // 2 + 60 for p in (good, before))
    blocks = good.copy()
    for k in range(6):
        y, x = 16 * (1 + k), 32 * (1 + k)
        blocks[y : y + 16, x : x + 16] += np.uint8(40)
    assert judge_frame(blocks, before).doubt > 0.5
    house = good.copy()
    box = cv2.boxPoints(((120.0, 90.0), (90.0, 60.0), 12.0)).astype(np.int32)
    cv2.fillPoly(house, [box], 190, cv2.LINE_AA)
    seen = cv2.GaussianBlur(house, (0, 0), 0.7)  # no lens draws a step one pixel wide
    assert look_at(seen).traits.cornered == 0.0


def test_verdicts_do_not_depend_on_left_and_right(rng, good, before):
    empty = good.copy()
    empty[150:] = 128
    for frame in (good, empty, cv2.GaussianBlur(good, (0, 0), 14.0), before):
        one = judge_frame(frame, before)
        other = judge_frame(np.fliplr(frame).copy(), np.fliplr(before).copy())
        assert (one.ok, one.fault) == (other.ok, other.fault)
        assert one.doubt == pytest.approx(other.doubt, abs=0.05)


def test_blur_is_told_relative_to_the_predecessor(good, before):
    soft = [look_at(cv2.GaussianBlur(g, (0, 0), 12.0)).traits for g in (good, before)]
    sharp = look_at(before).traits
    assert blur_score(soft[0], sharp) > 0.0 > blur_score(soft[0], soft[1])


def test_a_look_is_taken_once(good, before):
    look, look_before = look_at(good), look_at(before)
    assert look_at(look) is look
    verdict, again = judge_frame(good, before), judge_frame(look, look_before)
    assert (verdict.ok, verdict.doubt) == (again.ok, again.doubt)
    assert max(look.fine.shape) == 256 and max(look.coarse.shape) == 128


def test_small_frames_and_wrong_arguments(rng):
    assert judge_frame(np.full((10, 400), 128, np.uint8)).fault is Fault.SIZE
    tiny = [noisy(rng, ground(rng, 60)[:20, k : k + 30], 1.0) for k in (0, 3)]
    assert judge_frame(*tiny).ok
    with pytest.raises(ValueError, match="grey must be"):
        judge_frame(np.zeros((40, 40, 3), np.uint8))
    with pytest.raises(ValueError, match="uint8"):
        judge_frame(np.zeros((40, 40), np.float32))
