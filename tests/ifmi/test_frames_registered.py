"""Registered frames are judged again: what does not fit is masked or rejected, and what is drawn over is found."""

import cv2
import numpy as np
import pytest
from ifmi_ground import ground, noisy, pose, view

from photomap_gis.core.measurement import Registration
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.ifmi import (
    Fault,
    fixed_overlay_mask,
    judge_registered,
    look_at,
    make_spectrum,
    register,
    register_images,
)
from photomap_gis.ifmi.frames.fit import fit
from photomap_gis.ifmi.frames.rescue import register_part

SHAPE = (240, 320)


def registered(T: Similarity2D, *, accepted: bool = True, shape=SHAPE) -> Registration:
    return Registration(T, np.eye(4), 1.0, (shape[1], shape[0]), accepted=accepted)


class Take:
    """Two frames of a moving camera, the truth of their motion, and an earlier one."""

    def __init__(self, rng, shape=SHAPE, step=(17.0, 8.0), turn_deg=1.5):
        land = ground(rng, 700)
        where = [pose(300.0 + k * step[0], 300.0 + k * step[1], k * turn_deg, 1.0, shape) for k in range(-2, 1)]
        self.shape = shape
        self.earlier, self.before, self.frame = (noisy(rng, view(land, T, shape), 2.0) for T in where)
        self.T = where[1].inverse() @ where[2]
        self.registration = registered(self.T, shape=shape)

    def judge(self, frame, **more):
        return judge_registered(frame, self.before, self.registration, **more)


@pytest.fixture
def take(rng):
    return Take(rng)


@pytest.mark.parametrize("shape", [(240, 320), (320, 240), (256, 256), (384, 512), (90, 120)])
def test_a_sound_frame_fits(rng, shape):
    take = Take(rng, shape)
    verdict = take.judge(take.frame)
    assert verdict.ok and verdict.fault is None and verdict.mask is None and verdict.lost_share == 0.0


def test_light_and_a_small_misplacement_are_no_misfit(rng, take):
    dark = np.clip(take.frame * 0.7 + 20, 0, 255).astype(np.uint8)
    assert take.judge(dark).mask is None
    off = registered(Similarity2D.translation_of(2.0, -1.5) @ take.T)
    assert judge_registered(take.frame, take.before, off).mask is None


@pytest.mark.parametrize(("first", "last"), [(0, 60), (100, 160), (180, 240)])
def test_a_quarter_of_the_rows_from_an_earlier_frame_is_masked(take, first, last):
    """No row of it is damaged by itself: only the registration tells."""
    stale = take.frame.copy()
    stale[first:last] = take.before[first:last]
    verdict = take.judge(stale)
    assert verdict.ok and verdict.fault in (Fault.TORN, Fault.STALE)
    assert verdict.mask.shape == SHAPE and verdict.mask.dtype == bool
    assert (~verdict.mask[first + 6 : last - 6, 20:-20]).mean() > 0.75
    rest = np.ones(SHAPE, bool)
    rest[max(0, first - 12) : last + 12] = False
    assert verdict.mask[rest].mean() > 0.95
    assert verdict.lost_share == pytest.approx(0.25, abs=0.08)
    assert f"{verdict.lost_share:.0%}" in verdict.reason
    with pytest.raises(ValueError, match="read-only"):
        verdict.mask[0, 0] = False


def test_shifted_rows_are_masked_and_too_many_rejected(take):
    torn = take.frame.copy()
    torn[150:200] = np.roll(torn[150:200], 60, axis=1)
    verdict = take.judge(torn)
    assert verdict.ok and verdict.fault is Fault.TORN and not verdict.mask[160:190, 30:-30].any()
    torn[60:200] = np.roll(torn[60:200], 45, axis=1)
    verdict = take.judge(torn)
    assert not verdict.ok or (verdict.lost_share > 0.3 and verdict.mask[70:140, 60:-60].mean() < 0.3)


def test_lost_blocks_and_menus_are_told(rng, take):
    blocks = take.frame.copy()
    for k in range(28):
        y, x = (k * 7 % 14) * 16 + 8, (k * 11 % 19) * 16
        blocks[y : y + 16, x : x + 32] = take.frame[40:56, 200:232] if k % 2 else 128
    verdict = take.judge(blocks)
    assert verdict.fault is not None and (not verdict.ok or (~verdict.mask).mean() > 0.05)
    menu = take.frame.copy()
    menu[60:150, 40:200] = 30
    for k, line in enumerate(("EXPOSURE  4", "MIRROR", "EXIT")):
        cv2.putText(menu, line, (50, 85 + 25 * k), cv2.FONT_HERSHEY_SIMPLEX, 0.6, 255, 1)
    verdict = take.judge(menu)
    assert verdict.fault is Fault.MENU and verdict.ok and verdict.mask[70:140, 50:190].mean() < 0.05
    assert verdict.mask[200:].all()


def test_a_picture_that_rolled_over_is_rejected(take):
    rolled = np.roll(take.frame, 80, axis=0)
    moved = registered(take.T @ Similarity2D.translation_of(0.0, -80.0))
    verdict = judge_registered(rolled, take.before, moved)
    assert not verdict.ok and verdict.fault is Fault.TORN


def test_ground_that_repeats_itself_has_not_rolled_over(rng):
    """Laid a frame's height off, furrows fit too; but nothing cuts them."""
    rows = np.sin(np.arange(1000) * 2.0 * np.pi / 20.0)[:, None] * np.ones(700)
    field = np.clip(128.0 + 50.0 * rows + rng.normal(0.0, 3.0, rows.shape), 0, 255).astype(np.uint8)
    before, frame = field[200:440, 100:420], field[230:470, 104:424]
    assert judge_registered(frame, before, registered(Similarity2D.translation_of(4.0, 30.0))).ok


@pytest.mark.parametrize(("first", "last", "off"), [(120, 240, 60.0), (160, 240, -50.0), (0, 90, 45.0)])
def test_light_that_jumps_at_a_row_is_told(take, first, last, off):
    """A decoder that lost a step of brightness goes on with another; all detail still fits."""
    lit = take.frame.astype(np.float64)
    lit[first:last] += off
    verdict = take.judge(np.clip(lit, 0, 255).astype(np.uint8))
    assert verdict.fault is Fault.BLOCKS
    if verdict.ok:
        assert (~verdict.mask[first + 8 : last - 8, 30:-30]).mean() > 0.9


def test_a_shadow_and_a_change_of_exposure_are_no_jump(take):
    ramp = 1.0 / (1.0 + np.exp(-np.linspace(-6.0, 6.0, SHAPE[0])))[:, None]
    shaded = np.clip(take.frame * (1.0 - 0.5 * ramp), 0, 255).astype(np.uint8)
    assert take.judge(shaded).fault is None


def test_a_picture_that_rolled_over_without_a_visible_cut_is_told(rng):
    """Bare ground shows no seam; what lies at the other end fits there and nowhere near."""
    land = cv2.GaussianBlur(rng.normal(0.0, 1.0, (700, 700)), (0, 0), 5.0)
    land = np.clip(128.0 + 30.0 * land / land.std(), 0, 255).astype(np.uint8)
    before, frame = noisy(rng, land[200:440, 100:420], 1.0), noisy(rng, land[206:446, 104:424], 1.0)
    assert not judge_registered(np.roll(frame, 90, axis=0), before, registered(Similarity2D.translation_of(4, -84))).ok


def test_text_over_both_frames_is_masked_but_no_fault(take):
    """The telemetry of every frame: the frame is sound, its text is no ground."""
    frames = [take.before.copy(), take.frame.copy()]
    for k, f in enumerate(frames):
        cv2.putText(f, f"ALT 84 REC {k}", (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, 255, 2)
    verdict = judge_registered(frames[1], frames[0], take.registration)
    assert verdict.ok and verdict.lost_share < 0.1
    assert verdict.mask is not None and verdict.mask[40:].mean() > 0.97
    known = np.ones(SHAPE, bool)
    known[:32, :180] = False
    a, b = look_at(frames[0], mask=known), look_at(frames[1], mask=known)
    assert judge_registered(b, a, take.registration).mask is None, "what is masked already is not looked at"


def test_without_a_registration_doubt_decides(take):
    lost = registered(Similarity2D(), accepted=False)
    assert judge_registered(take.frame, take.before, lost).ok
    assert judge_registered(take.frame, take.before, lost, doubt=0.3).ok
    assert not judge_registered(take.frame, take.before, lost, doubt=0.8).ok
    assert judge_registered(take.frame, take.before[:100], lost, doubt=0.8).ok, "another size is not compared"


def test_verdicts_do_not_depend_on_left_and_right(take):
    stale = take.frame.copy()
    stale[100:160] = take.before[100:160]
    mirror = np.array([[-1.0, 0.0, SHAPE[1] - 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    T = Similarity2D.from_matrix(mirror @ take.T.matrix @ mirror)
    one = take.judge(stale)
    other = judge_registered(np.fliplr(stale).copy(), np.fliplr(take.before).copy(), registered(T))
    assert one.fault == other.fault and one.ok == other.ok
    assert (one.mask != np.fliplr(other.mask)).mean() < 0.03


def test_the_homography_is_used_where_there_is_one(take):
    H = take.T.matrix @ np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [4e-4, 0.0, 1.0]])
    leaning = cv2.warpPerspective(take.before, H, SHAPE[::-1], flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
    r = Registration(take.T, np.eye(4), 1.0, SHAPE[::-1], accepted=True, H_a_b=H)
    seen = fit(look_at(leaning), look_at(take.before), H)
    assert judge_registered(leaning, take.before, r).mask is None
    assert seen.agreement > 0.95 > fit(look_at(leaning), look_at(take.before), take.T.matrix).agreement


def test_a_masked_frame_registers_where_the_whole_frame_does(rng, take):
    stale = take.frame.copy()
    stale[180:] = take.before[180:]
    r = register_images(take.before, stale)
    verdict = judge_registered(stale, take.before, r)
    assert verdict.ok and verdict.mask is not None
    again = register(make_spectrum(take.before), make_spectrum(stale, mask=verdict.mask))
    assert again.accepted
    corners = np.array([[0, 0], [319, 0], [0, 239], [319, 239]], float)
    assert np.abs(again.T_a_b.apply(corners) - take.T.apply(corners)).max() < 1.5


def test_a_half_that_is_whole_is_registered_by_itself(rng, take):
    half = take.frame.copy()
    half[110:] = noisy(rng, ground(np.random.default_rng(9), 400)[:130, :320], 2.0)
    found = register_part(make_spectrum(take.before), half)
    assert found is not None and found.accepted
    assert np.abs(found.T_a_b.apply([[160.0, 60.0]]) - take.T.apply([[160.0, 60.0]])).max() < 1.5
    stranger = noisy(rng, ground(np.random.default_rng(9), 400)[:240, :320], 2.0)
    assert register_part(make_spectrum(take.before), stranger) is None


def flight(rng, count=7):
    land = ground(rng, 900)
    return [
        noisy(rng, view(land, pose(350 + 23 * k, 330 + 14 * k, 2 * k, 1.0, SHAPE), SHAPE), 2.0) for k in range(count)
    ]


def test_a_fixed_overlay_is_found_and_the_ground_is_not(rng):
    frames = flight(rng)
    plain = fixed_overlay_mask(frames)
    assert plain.shape == SHAPE and plain.dtype == bool and plain.mean() > 0.99
    for k, f in enumerate(frames):
        cv2.putText(f, f"ALT 8{k} SPD 5", (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, 255, 2)
        f[215:] = 0
        f[100:140, 270:310] = np.clip(0.5 * f[100:140, 270:310] + 100, 0, 255)
        cv2.circle(f, (290, 120), 14, 250, 3)
    mask = fixed_overlay_mask(frames)
    assert not mask[217:].any(), "the bar"
    assert mask[8:22, 10:60].mean() < 0.2, "the text"
    assert mask[108:132, 276:304].mean() < 0.5, "the logo"
    assert mask[40:90].mean() > 0.98 and mask[150:200].mean() > 0.98


def test_no_overlay_is_claimed_where_nothing_moved(rng):
    land = ground(rng, 500)[:240, :320]
    assert fixed_overlay_mask([noisy(rng, land, 2.0) for _ in range(5)]).all()


def test_overlays_need_frames_of_one_size(rng):
    frames = flight(rng, 5)
    with pytest.raises(ValueError, match="at least"):
        fixed_overlay_mask(frames[:2])
    with pytest.raises(ValueError, match="one size"):
        fixed_overlay_mask([*frames, frames[0][:100]])


def test_masks_of_looks_must_fit(take):
    with pytest.raises(ValueError, match="mask must have"):
        look_at(take.frame, mask=np.ones((3, 3), bool))
