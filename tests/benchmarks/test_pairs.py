"""Pairs with known truth: the truth checked by other means than those that made it."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.registration.camera import Lens, Pose, Relief, attitude, render_flat, transfer
from benchmarks.registration.nuisance import CORRUPTIONS, Nuisance, corrupted, spoil
from benchmarks.registration.pairs import CLASSES, GRID, SUCCESS_CLASSES, PairClass, make_pair, pairs
from benchmarks.registration.pictures import Scene
from benchmarks.registration.textures import KINDS, repetitive_ground
from photomap_gis.core.similarity import Similarity2D, fit_similarity

CLEAN = Nuisance(noise=0.0, gain=0.0)


def by_hand(pixel, yaw, tilt, direction, height, eye, focal, centre):
    """Where on the ground a pixel looks: its ray turned by yaw, leant by Rodrigues' formula, and followed down."""
    ray = np.array([(pixel[0] - centre[0]) / focal, (pixel[1] - centre[1]) / focal, 1.0])
    c, s = math.cos(yaw), math.sin(yaw)
    ray = np.array([c * ray[0] - s * ray[1], s * ray[0] + c * ray[1], ray[2]])
    axis = np.array([-math.sin(direction), math.cos(direction), 0.0])
    ray = ray * math.cos(tilt) + np.cross(axis, ray) * math.sin(tilt) + axis * (axis @ ray) * (1 - math.cos(tilt))
    return np.array(eye) + ray[:2] * height / ray[2]


@pytest.mark.parametrize(("tilt_deg", "direction"), [(0.0, 0.0), (3.0, 1.0), (15.0, -2.0)])
def test_the_homography_of_a_camera_is_what_its_rays_say(tilt_deg, direction):
    lens = Lens.of((256, 192), 60.0)
    assert lens.focal_px == pytest.approx(128 / math.tan(math.radians(30)))
    pose = Pose(40.0, -7.0, 300.0, attitude(0.7, math.radians(tilt_deg), direction))
    for pixel in ([0, 0], [255, 191], [127.5, 95.5], [31, 180]):
        seen = transfer(pose.to_ground(lens), np.array([pixel], float))[0]
        np.testing.assert_allclose(
            seen,
            by_hand(pixel, 0.7, math.radians(tilt_deg), direction, 300.0, (40.0, -7.0), lens.focal_px, (127.5, 95.5)),
            atol=1e-9,
        )
    # leaning by a tilt moves the middle of the picture by its tangent, towards the direction
    middle = transfer(pose.to_ground(lens), lens.centre[None])[0] - (40.0, -7.0)
    expected = 300.0 * math.tan(math.radians(tilt_deg)) * np.array([math.cos(direction), math.sin(direction)])
    np.testing.assert_allclose(middle, expected, atol=1e-9)


def test_a_rendered_frame_shows_each_pixel_its_place(rng):
    """A ground of two ramps tells where each pixel looks."""
    lens = Lens.of((64, 48), 60.0)
    pose = Pose(120.0, 130.0, 1.5 * lens.focal_px, attitude(0.4, math.radians(4), 2.0))
    x, y = np.meshgrid(np.arange(256, dtype=np.uint8), np.arange(256, dtype=np.uint8))
    frame = np.dstack([render_flat(g, pose, lens, 2) for g in (x, y)])
    assert frame.shape == (52, 68, 2)
    pixels = np.array([[0, 0], [63, 47], [30, 20], [-2, -2]])
    seen = transfer(pose.to_ground(lens), pixels.astype(float))
    np.testing.assert_allclose(frame[pixels[:, 1] + 2, pixels[:, 0] + 2], seen, atol=0.3)


def correlation(a, b):
    a, b = a - a.mean(), b - b.mean()
    return float((a * b).sum() / math.sqrt((a * a).sum() * (b * b).sum() + 1e-9))


@pytest.mark.parametrize("cls", ["tilt-0", "nominal", "rotation", "scale-1.6", "translation-40", "tilt-10"])
def test_b_lies_on_a_where_the_truth_says(scenes, cls):
    spec = replace(CLASSES[cls], nuisance=CLEAN)
    for pair in pairs(cls, 3, 5, sources=scenes, change=spec):
        H, _ = cv2.findHomography(pair.points_b, pair.points_a)
        h, w = pair.a.shape
        warped = cv2.warpPerspective(pair.b, H, (w, h), flags=cv2.INTER_CUBIC).astype(float)
        seen = cv2.warpPerspective(np.full_like(pair.b, 255), H, (w, h)) == 255
        seen = cv2.erode(seen.astype(np.uint8), np.ones((9, 9))) > 0
        at = {
            (dx, dy): correlation(np.roll(pair.a, (dy, dx), (0, 1))[seen].astype(float), warped[seen])
            for dx in (-1, 0, 1)
            for dy in (-1, 0, 1)
        }
        assert at[0, 0] > (0.97 if cls != "scale-1.6" else 0.9)
        for other in ((1, 0), (0, 1)):  # the top of the parabola through three shifts
            low, high = at[-other[0], -other[1]], at[other]
            assert abs(0.5 * (low - high) / (low - 2 * at[0, 0] + high)) < 0.06


@pytest.mark.parametrize("cls", ["relief-5", "relief-10"])
def test_with_relief_each_spot_lies_where_its_ray_says(scenes, cls):
    spec = replace(CLASSES[cls], nuisance=CLEAN)
    for pair in pairs(cls, 2, 3, sources=scenes, change=spec):
        near, moved = [], []
        for p, q in zip(pair.points_a[::37], pair.points_b[::37], strict=True):
            if not all(12 < v < 244 for v in (*p, *q)):
                continue
            # the patch around p, turned and grown as the truth is there, against the one around q
            m = np.c_[pair.T_a_b.linear, p - pair.T_a_b.linear @ (7.0, 7.0)]
            there = cv2.warpAffine(pair.a, m, (15, 15), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
            here = cv2.getRectSubPix(pair.b, (15, 15), tuple(float(v) for v in q))
            if here.std() > 12:
                near.append(correlation(there.astype(float), here.astype(float)))
                shifted = cv2.getRectSubPix(pair.b, (15, 15), (float(q[0]) + 3.0, float(q[1])))
                moved.append(correlation(there.astype(float), shifted.astype(float)))
        assert len(near) > 30
        assert np.median(near) > 0.93 > np.median(moved) + 0.1
        assert 0.3 < pair.residual_px < 6.0


def test_occluded_ground_is_no_part_of_the_truth():
    """A wall hides a strip of ground behind it from a camera that stands before it, and from no other."""
    height = np.zeros((400, 400), np.float32)
    height[:, 200:204] = 40.0
    relief = Relief(Scene(np.zeros((400, 400), np.uint8), height), (0, 0, 400, 400), 1.0)
    lens = Lens.of((128, 128), 60.0)
    left, right = (Pose(x, 200.0, 200.0, attitude(0.0, 0.0, 0.0)) for x in (120.0, 280.0))
    # ground at x is pixel (x - eye) / 200 * focal + centre
    x = np.arange(215.0, 280.0, 1.0)
    pixels = np.stack([(x - 280.0) / 200.0 * lens.focal_px + 63.5, np.full(len(x), 63.5)], axis=-1)[None]
    there, visible = relief.correspond(left, right, lens, pixels)
    np.testing.assert_allclose(there[0, :, 0], (x - 120.0) / 200.0 * lens.focal_px + 63.5, atol=0.05)
    # the ray over the wall's far edge: 84 sideways within 160 of depth, 21 more within the last 40
    shadow_ends = 120.0 + (203.5 - 120.0) / 160.0 * 200.0
    assert not visible[0, x < shadow_ends - 2.0].any()
    assert visible[0, x > shadow_ends + 2.0].all()
    assert relief.correspond(right, right, lens, pixels)[1].all()


@pytest.mark.parametrize("cls", SUCCESS_CLASSES)
def test_truth_is_the_closest_similarity_of_the_true_mapping(scenes, cls):
    (pair,) = pairs(cls, 1, 11, sources=scenes)
    assert pair.a.shape == pair.b.shape == (256, 256) and pair.a.dtype == np.uint8
    T = fit_similarity(pair.points_a, pair.points_b)
    np.testing.assert_allclose(T.matrix, pair.T_a_b.matrix, atol=1e-9)
    d = T.apply(pair.points_b) - pair.points_a
    assert pair.residual_px == pytest.approx(math.sqrt(np.mean((d**2).sum(1))))
    for points in (pair.points_a, pair.points_b):
        assert (points >= -0.5).all() and (points <= 255.5).all()
    rivals = [Similarity2D(0.05, 0.0), Similarity2D(0.0, 0.0, 3e-4), Similarity2D(0.0, 0.0, 0.0, 3e-4)]
    for rival in rivals:
        off = (T @ rival).apply(pair.points_b) - pair.points_a
        assert np.mean((off**2).sum(1)) > np.mean((d**2).sum(1))


@pytest.mark.parametrize("share", [10, 30, 60])
def test_translations_are_of_the_length_that_they_say(scenes, share):
    level = replace(CLASSES[f"translation-{share}"], tilt_deg=0.0)
    for pair in pairs(f"translation-{share}", 4, 2, sources=scenes, change=level):
        centre = np.array([127.5, 127.5])
        assert np.hypot(*(pair.T_a_b.apply(centre) - centre)) == pytest.approx(2.56 * share, abs=1e-6)
        assert abs(math.degrees(pair.T_a_b.angle_rad)) <= 10.0


def test_classes_keep_their_ranges(scenes):
    turns = [abs(math.degrees(p.T_a_b.angle_rad)) for p in pairs("rotation", 12, 4, sources=scenes)]
    assert max(turns) > 90.0
    scales = [p.T_a_b.scale for p in pairs("scale-1.6", 12, 4, sources=scenes)]
    assert 0.55 < min(scales) < 0.85 and 1.1 < max(scales) < 1.7
    assert all(max(p.tilt_deg) <= 5.0 for p in pairs("tilt-5", 6, 4, sources=scenes))
    assert all(p.tilt_deg == (0.0, 0.0) and p.residual_px < 1e-9 for p in pairs("tilt-0", 3, 4, sources=scenes))


def test_the_residual_is_that_of_the_facts(scenes):
    """256 px, 60 deg HFOV: a median of 1.0 px up to 3 degrees of tilt, 3.0 px up to 10."""
    for cls, expected in (("nominal", 1.0), ("tilt-10", 3.0)):
        found = np.median([p.residual_px for p in pairs(cls, 40, 1, sources=scenes)])
        assert expected * 0.6 < found < expected * 1.5


def test_the_same_seed_is_the_same_pair_whichever_others_are_made(scenes):
    five = list(pairs("noise-10", 5, 9, sources=scenes))
    (third,) = pairs("noise-10", 1, 9, first=2, sources=scenes)
    assert np.array_equal(five[2].a, third.a) and np.array_equal(five[2].b, third.b)
    assert five[2].T_a_b == third.T_a_b
    assert not np.array_equal(five[1].a, third.a)
    (elsewhere,) = pairs("noise-10", 1, 10, first=2, sources=scenes)
    assert not np.array_equal(elsewhere.a, third.a)


@pytest.mark.parametrize("size", [(256, 256), (320, 240), (512, 512)])
def test_frames_have_the_size_asked_for(scenes, size):
    pair = make_pair("nominal", np.random.default_rng(0), scenes, size=size, hfov_deg=75.0)
    assert pair.size_px == size
    assert len(pair.points_b) <= GRID**2
    assert pair.overlap == pytest.approx(len(pair.points_b) / GRID**2)


def test_wrong_pairs_have_no_truth_and_nothing_in_common(scenes):
    found = list(pairs("wrong", 12, 0, sources=scenes))
    assert all(p.T_a_b is None and len(p.points_b) == 0 and p.overlap == 0.0 for p in found)
    assert any("|" in p.picture for p in found) and any("|" not in p.picture for p in found)


def test_repetitive_grounds_differ_by_part_and_repeat_themselves(scenes):
    seeds = {int(p.picture.partition("-")[2]) for p in pairs("repetitive", 6, 0, sources=scenes)}
    assert all(s % 2 == 1 for s in seeds)
    tuning = replace(scenes, part="tuning")
    assert all(int(p.picture.partition("-")[2]) % 2 == 0 for p in pairs("repetitive", 3, 0, "tuning", sources=tuning))
    for seed in range(len(KINDS)):
        g = repetitive_ground(seed)[:512, :512].astype(float)
        g -= g.mean()
        F = np.abs(np.fft.fft2(g * np.outer(np.hanning(512), np.hanning(512)))) ** 2
        again = np.fft.ifft2(F).real
        again /= again[0, 0]
        y, x = np.meshgrid(np.fft.fftfreq(512) * 512, np.fft.fftfreq(512) * 512, indexing="ij")
        ring = (np.hypot(x, y) > 8) & (np.hypot(x, y) < 170)
        assert again[ring].max() > 0.25


def test_blurs_move_nothing(scenes):
    """A blurred and a sharp view of one place correlate best at no shift."""
    still = PairClass(translation=(0, 0), rotation_deg=0, scale=(1, 1), tilt_deg=0.0)
    for nuisance in (replace(CLEAN, motion_blur_px=16.0), replace(CLEAN, blur_px=3.0)):
        for pair in pairs("still", 3, 1, sources=scenes, change=replace(still, nuisance=nuisance)):
            assert np.abs(pair.T_a_b.matrix - np.eye(3)).max() < 1e-9
            w = np.outer(np.hanning(256), np.hanning(256))
            A, B = (np.fft.fft2((f - f.mean()) * w) for f in (pair.a, pair.b))
            c = np.fft.fftshift(np.fft.ifft2(A * B.conj()).real)[116:141, 116:141]
            assert np.abs(c - c[::-1, ::-1]).max() < 0.03 * c.max()


def test_nuisances_do_what_they_say(rng):
    flat = np.full((128, 128), 120.0, np.float32)
    a, b = spoil(Nuisance(noise=10.0, gain=0.0), rng, flat, flat, None)
    assert a.std() == pytest.approx(10.0, rel=0.1) and not np.array_equal(a, b)
    ramp = np.tile(np.linspace(60, 190, 128, dtype=np.float32), (128, 1))
    a, _ = spoil(replace(CLEAN, contrast=0.12), rng, ramp, ramp, None)
    assert np.ptp(a) == pytest.approx(0.12 * 130, abs=1.5)
    a, b = spoil(replace(CLEAN, vignetting=True), rng, flat, flat, None)
    assert a[64, 64] > 1.3 * a[0, 0] and abs(int(a[64, 64]) - int(a[64, 63])) <= 1
    a, b = spoil(replace(CLEAN, illumination=True), rng, ramp, ramp, None)
    assert np.abs(a.astype(float) - b).mean() > 5.0
    (pair, other) = spoil(replace(CLEAN, moving_objects=True), rng, flat, flat, Similarity2D.identity())
    assert 0.03 < np.mean(pair != 120) < 0.25 and np.mean(pair != other) > 0.02


def test_a_quarter_of_the_rows_is_corrupt(rng):
    frame = rng.integers(40, 216, (256, 256)).astype(np.uint8)
    other = rng.integers(40, 216, (256, 256)).astype(np.uint8)
    for _ in range(3 * len(CORRUPTIONS)):
        touched = (corrupted(rng, frame, other, 0.25) != frame).any(axis=1).sum()
        assert 0.15 * 256 <= touched <= 0.26 * 256


def test_what_cannot_be_placed_says_so(scenes):
    with pytest.raises(RuntimeError, match="room"):
        make_pair("nominal", np.random.default_rng(0), scenes, size=(1400, 1400))
    with pytest.raises(ValueError, match="scene"):
        make_pair("relief-5", np.random.default_rng(0), replace(scenes, groups=()))
