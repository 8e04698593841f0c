"""Rows are found in the predecessor without a registration: moved sideways by a link, not by a camera."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ifmi_ground import ground, noisy

from photomap_gis.core.measurement import Registration
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.ifmi import Fault, judge_frame, judge_registered, look_at
from photomap_gis.ifmi.frames.doubt import Doubt
from photomap_gis.ifmi.frames.drawn import drawn_out
from photomap_gis.ifmi.frames.registered import skew
from photomap_gis.ifmi.frames.row_sums import best_lags
from photomap_gis.ifmi.frames.rows import row_motion

SHAPE = (256, 320)
LAND = ground(np.random.default_rng(11), 800)
OTHER = ground(np.random.default_rng(12), 800)


def shot(land, x, y, seed=0):
    h, w = SHAPE
    return noisy(np.random.default_rng(seed), land[200 + y : 200 + y + h, 200 + x : 200 + x + w], 2.0)


def sheared(frame, slope, first=40, last=230):
    """Each row a little further than the one above, around the width."""
    out = frame.copy()
    for k in range(first, last):
        out[k] = np.roll(frame[k], round(slope * (k - first)))
    return out


def nowhere(*, probability=0.0):
    return Registration(Similarity2D(), np.eye(4), probability, SHAPE[::-1], accepted=False)


@settings(max_examples=12, deadline=None)
@given(x=st.integers(-40, 40), y=st.integers(-25, 25))
def test_rows_of_a_sound_frame_are_found_side_by_side(x, y):
    found = row_motion(look_at(shot(LAND, x, y, 1)), look_at(shot(LAND, 0, 0)))
    assert not found.is_torn and found.slanted_share == 0.0 and found.step < 0.02
    assert found.known_share > 0.5


@settings(max_examples=12, deadline=None)
@given(slope=st.floats(0.6, 2.0), back=st.booleans(), x=st.integers(-20, 20), y=st.integers(-15, 15))
def test_rows_each_a_little_further_than_the_one_above_are_torn(slope, back, x, y):
    frame = sheared(shot(LAND, x, y, 1), -slope if back else slope)
    found = row_motion(look_at(frame), look_at(shot(LAND, 0, 0)))
    assert found.is_torn and found.slanted_share > 0.3


@pytest.mark.parametrize("share", [0.07, 0.2, -0.4])
def test_a_step_is_measured_around_the_width(share):
    frame = shot(LAND, 7, 5, 1)
    frame[90:190] = np.roll(frame[90:190], round(share * SHAPE[1]), axis=1)
    found = row_motion(look_at(frame), look_at(shot(LAND, 0, 0)))
    assert found.is_torn and found.step == pytest.approx(abs(share), abs=0.01)


def test_other_ground_has_no_rows_in_common():
    found = row_motion(look_at(shot(LAND, 0, 0)), look_at(shot(OTHER, 0, 0)))
    assert not found.is_torn and found.known_share < 0.1


def test_rows_of_crop_fit_at_many_places_and_are_not_torn():
    x = np.arange(SHAPE[1])[None]
    crop = [np.clip(0.15 * shot(LAND, s, 0) + 90 + 60 * np.sin((x + s) / 3.0), 0, 255).astype(np.uint8) for s in (0, 9)]
    assert not row_motion(look_at(crop[1]), look_at(crop[0])).is_torn


def test_small_pictures_tell_nothing():
    tiny = np.zeros((20, 24), np.uint8)
    assert row_motion(look_at(tiny), look_at(tiny)).known_share == 0.0
    assert drawn_out(tiny) == 0.0


def test_the_compiled_loop_agrees_with_numpy(rng):
    likeness = rng.standard_normal((3, 17, 24)).astype(np.float32)
    slopes = np.array([-1.25, 0.0, 0.5])
    best, at = np.empty((2, 3), np.float32), np.zeros((2, 3, 2), np.int64)
    best_lags(likeness, slopes, 10, 5, best, at)
    for i in range(2):
        for j, slope in enumerate(slopes):
            shifts = [round(slope * (k - 5)) for k in range(10)]
            mean = np.mean([np.roll(likeness[:, 5 * i + k], -s, axis=1) for k, s in enumerate(shifts)], axis=0)
            assert best[i, j] == pytest.approx(mean.max(), abs=1e-6)
            assert tuple(at[i, j]) == np.unravel_index(mean.argmax(), mean.shape)


def test_an_unregistered_frame_is_torn_where_its_rows_are():
    before = shot(LAND, 0, 0)
    verdict = judge_registered(sheared(shot(LAND, 8, 4, 1), 1.3), before, nowhere())
    assert not verdict.ok and verdict.fault is Fault.TORN
    assert judge_registered(shot(LAND, 8, 4, 1), before, nowhere()).ok
    masked = look_at(sheared(shot(LAND, 8, 4, 1), 1.3), mask=np.arange(SHAPE[1])[None].repeat(SHAPE[0], 0) > 30)
    assert judge_registered(masked, before, nowhere()).ok, "of a levelled frame the borders would speak"


def test_a_registration_skewed_along_its_rows_that_fits_is_torn():
    before = shot(LAND, 0, 0)
    slope = 0.5
    H = np.array([[1.0, -slope, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    frame = cv2.warpPerspective(before, H, SHAPE[::-1], flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    found = Registration(Similarity2D(), np.eye(4), 1.0, SHAPE[::-1], accepted=True, H_a_b=H)
    verdict = judge_registered(frame, before, found)
    assert not verdict.ok and verdict.fault is Fault.TORN
    assert judge_registered(shot(OTHER, 0, 0), before, found).fault is not Fault.TORN, "it does not fit at all"
    leaning = np.array([[1.3, -0.5, 0.0], [0.5, 0.8, 0.0], [1e-4, 0.0, 1.0]])
    assert skew(H) == pytest.approx(slope) and skew(leaning) == 0.0, "a camera that leans and turns"


def drawn(frame, last=60):
    """What a decoder makes of a last row, with the noise of what was coded on top."""
    out = frame.copy()
    out[last:] = frame[last]
    return noisy(np.random.default_rng(3), out, 2.0)


def test_a_picture_drawn_out_is_none():
    before = shot(LAND, 0, 0)
    for frame in (drawn(shot(OTHER, 3, 2, 1)), np.ascontiguousarray(drawn(shot(OTHER, 3, 2, 1).T.copy()).T)):
        assert drawn_out(look_at(frame).coarse) > 0.8
        verdict = judge_registered(frame, before, nowhere())
        assert not verdict.ok and "drawn out" in verdict.reason
    assert drawn_out(look_at(before).coarse) < 0.3
    rows = np.clip(0.2 * before + 90 + 50 * np.sin(np.arange(SHAPE[1]) / 4.0)[None], 0, 255).astype(np.uint8)
    assert drawn_out(look_at(rows).coarse) > 0.8
    assert judge_registered(rows, np.roll(rows, 3, axis=1), nowhere()).ok, "rows of crop, and in the frame before too"


def test_doubt_that_other_ground_can_raise_is_believed_of_the_same_ground_only():
    frame, before = shot(LAND, 0, 0), shot(OTHER, 0, 0)
    assert judge_registered(frame, before, nowhere(), doubt=0.9).ok
    assert not judge_registered(frame, before, nowhere(probability=0.5), doubt=0.9).ok, "likely the same ground"
    smeared = frame.copy()
    smeared[60:] = frame[60]
    assert judge_frame(smeared, before).doubt > 0.9
    assert not judge_registered(smeared, before, nowhere(), doubt=0.9).ok, "no ground looks like that"


def test_what_the_decoder_complains_of_is_believed():
    before, frame = shot(LAND, 0, 0), shot(OTHER, 0, 0)
    assert judge_registered(frame, before, nowhere()).ok
    assert not judge_registered(frame, before, nowhere(), suspect=True).ok
    T = Similarity2D.translation_of(12.0, 6.0)
    found = Registration(T, np.eye(4), 1.0, SHAPE[::-1], accepted=True)
    here = shot(LAND, 12, 6, 1)
    assert judge_registered(here, before, found, suspect=True).mask is None, "a sound frame stays one"
    here[100:132, 60:100] = shot(OTHER, 0, 0)[100:132, 60:100]
    plain, suspect = judge_registered(here, before, found), judge_registered(here, before, found, suspect=True)
    assert suspect.ok and suspect.fault is not None and suspect.mask is not None
    assert suspect.lost_share >= plain.lost_share > 0.0


odds = st.floats(-3.0, 60.0)


@given(odds, odds, odds, odds, odds, st.floats(0.0, 1.0))
def test_strangers_are_doubted_no_more_than_kin(smeared, blocky, cornered, torn, flat, blurred):
    doubt = Doubt(smeared, blocky, cornered, torn, flat, blurred)
    assert 0.0 <= doubt.of_strangers <= doubt.of_kin <= 1.0
    assert doubt.of_strangers >= blurred, "a blur is one whatever came before"
