"""The pieces of the algorithms, each against a law or an independent twin."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ifmi_ground import ground, pose, view

from photomap_gis.core.similarity import Similarity2D, fit_similarity
from photomap_gis.ifmi import Prior, make_spectrum
from photomap_gis.ifmi.field import Frame, closest_similarity, field_matrix, fit_field, project, visible
from photomap_gis.ifmi.kernels import fft_size, forward_fft, forward_fft_stack, inverse_fft, inverse_fft_stack
from photomap_gis.ifmi.logpolar import ANGLES, RADII
from photomap_gis.ifmi.pomf import gaussian_low_pass, pomf, pulse_of, whiten
from photomap_gis.ifmi.pulse import find_peaks
from photomap_gis.ifmi.search import turns_and_scales
from photomap_gis.ifmi.template import GRID, make_template, steepest_pixels
from photomap_gis.ifmi.tiles import tile_pulses


@pytest.mark.parametrize("shape", [(2, 2), (4, 6), (96, 128), (30, 54)])
def test_the_fast_transform_is_the_slow_one(rng, shape):
    image = rng.random(shape, dtype=np.float32)
    half = forward_fft(image)
    np.testing.assert_allclose(half, np.fft.rfft2(image), atol=1e-3)
    np.testing.assert_allclose(inverse_fft(half), image, atol=1e-5)
    stack = np.stack([image, image.T[: shape[0], : shape[1]] if shape[0] == shape[1] else 1 - image])
    np.testing.assert_allclose(inverse_fft_stack(forward_fft_stack(stack)), stack, atol=1e-5)


@given(st.integers(1, 3000))
def test_fft_sizes_are_even_and_large_enough(n):
    assert fft_size(n) >= n
    assert fft_size(n) % 2 == 0


@settings(max_examples=20, deadline=None)
@given(st.integers(-31, 31), st.integers(-23, 23))
def test_algorithm_1_points_at_the_shift(dx, dy):
    B = np.random.default_rng(3).random((48, 64), dtype=np.float32)
    A = np.roll(B, (dy, dx), axis=(0, 1))
    delta = pomf(A, B)
    assert np.unravel_index(np.argmax(delta), delta.shape) == (dy % 48, dx % 64)
    assert delta.max() == pytest.approx(1.0, abs=1e-3)


def test_a_peak_is_found_between_the_cells(rng):
    F = np.fft.rfft2(rng.standard_normal((64, 64)))
    fy, fx = np.fft.fftfreq(64)[:, None], np.fft.rfftfreq(64)[None, :]
    moved = F * np.exp(-2j * np.pi * (fx * 3.3 + fy * -5.6))
    low_pass = gaussian_low_pass((64, 64), 0.15)
    delta = pulse_of(whiten(moved.astype(np.complex64)), whiten(F.astype(np.complex64)), low_pass)
    (peak,) = find_peaks(delta, 1)
    assert peak.column == pytest.approx(3.3, abs=0.06)
    assert peak.row == pytest.approx(64 - 5.6, abs=0.06)
    assert peak.snr > 10.0


def test_peaks_keep_their_distance_and_the_allowed_region():
    delta = np.zeros((16, 16), np.float32)
    delta[0, 0], delta[0, 15], delta[8, 8] = 3.0, 2.5, 2.0
    assert [(round(p.row), round(p.column)) for p in find_peaks(delta, 2)] == [(0, 0), (8, 8)]
    allowed = np.zeros((16, 16), bool)
    allowed[6:10, 6:10] = True
    assert round(find_peaks(delta, 1, allowed=allowed)[0].row) == 8


@pytest.mark.parametrize(("angle_deg", "scale"), [(0, 1.0), (37, 1.0), (90, 0.8), (-61, 1.3)])
def test_turn_and_scale_are_read_from_the_log_polar_pulse(rng, angle_deg, scale):
    g = ground(rng)
    a, b = (make_spectrum(view(g, pose(450, 450, *p, (256, 256)), (256, 256))) for p in ((0, 1.0), (angle_deg, scale)))
    delta = pulse_of(a.log_polar_phases, b.log_polar_phases, gaussian_low_pass((ANGLES, RADII), 0.08))
    angle, log_scale = turns_and_scales(delta, 1, None)[0]
    assert abs(math.remainder(angle - math.radians(angle_deg), math.pi)) < math.radians(1.0)
    assert log_scale == pytest.approx(math.log(scale), abs=0.02)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-0.03, 0.03), min_size=8, max_size=8))
def test_a_field_is_found_again(theta):
    q = Frame(320, 240).grid()[::3]
    d = project(field_matrix(np.array(theta)), q) - q
    d_noisy = d.copy()
    d_noisy[::11] += 0.2  # some have lost their way
    field = fit_field(q, d_noisy, isotropic(np.full(len(q), 1e-6)), start=0.05)
    np.testing.assert_allclose(project(field_matrix(field.theta), q) - q, d, atol=4e-3)


def test_scatter_is_told_from_noise(rng):
    q = rng.uniform(-1, 1, (140, 2))
    noise2 = np.full(140, 1e-6)
    quiet = fit_field(q, 1e-3 * rng.standard_normal((140, 2)), isotropic(noise2))
    loud = fit_field(q, 5e-3 * rng.standard_normal((140, 2)), isotropic(noise2))
    assert quiet.scatter2 < 2e-7
    assert loud.scatter2 == pytest.approx(24e-6, rel=0.25)


def isotropic(noise2):
    """``(3, K)`` covariances of the same variance on both axes."""
    return np.stack([noise2, np.zeros(len(noise2)), noise2])


def test_a_direction_in_which_nothing_is_known_does_no_harm(rng):
    """Edges: half of the observations know only x, half only y, and say nonsense of the other."""
    q = rng.uniform(-1, 1, (200, 2))
    theta = np.array([0.02, -0.01, 0.005, 0.01, 0.0, 0.0, 0.0, 0.0])
    d = project(field_matrix(theta), q) - q + 1e-5 * rng.standard_normal((200, 2))
    know_x = np.arange(200) % 2 == 0
    d[know_x, 1] += 0.01 * rng.standard_normal(100)
    d[~know_x, 0] += 0.01 * rng.standard_normal(100)
    variance_x, variance_y = np.where(know_x, 1e-10, 1e-4), np.where(know_x, 1e-4, 1e-10)
    field = fit_field(q, d, np.stack([variance_x, np.zeros(200), variance_y]))
    assert np.abs(field.theta - theta).max() < 2e-4


def test_the_field_s_covariance_is_its_scatter(rng):
    """Monte Carlo: normalised squared errors of many fits average to one a degree of freedom."""
    q = rng.uniform(-1, 1, (100, 2))
    noise2 = rng.uniform(1e-6, 4e-6, 100)
    errors = []
    for _ in range(60):
        field = fit_field(q, rng.standard_normal((100, 2)) * np.sqrt(noise2)[:, None], isotropic(noise2))
        errors.append(field.theta @ np.linalg.solve(field.covariance, field.theta) / 8.0)
    assert 0.75 < np.mean(errors) < 1.35


@settings(max_examples=25, deadline=None)
@given(*[st.floats(-1, 1)] * 6)
def test_the_closest_similarity_is_that_of_all_pixels_that_a_shows(x, y, turn, growth, stretch, lean):
    """A twin: least squares over every pixel of b that lies in a."""
    frame = Frame(120, 90)
    about = Similarity2D(60.0 + 60.0 * x, 45.0 + 60.0 * y, 3.0 * turn, 0.3 * growth) @ Similarity2D.translation_of(
        -59.5, -44.5
    )
    G = (about @ frame.T_b_q).matrix @ field_matrix(np.array([0, 0, 0, 0, 0.05 * stretch, 0, 0.05 * lean, 0]))
    weight = visible(frame, G, (120, 90))
    p = np.stack([v.ravel() for v in np.meshgrid(np.arange(120.0), np.arange(90.0))], axis=1)
    q = cv2.perspectiveTransform(frame.T_q_b.apply(p)[None], G)[0]
    inside = ((q >= -0.5) & (q <= [119.5, 89.5])).all(axis=1)
    if inside.sum() < 2000:
        return
    twin = fit_similarity(q[inside], p[inside])
    closest = closest_similarity(frame, G, np.zeros((8, 8)), weight)
    assert weight.mean() == pytest.approx(inside.mean(), abs=0.015)
    assert np.abs(closest.T_a_b.apply(p[inside]) - twin.apply(p[inside])).max() < 0.1
    left = np.sqrt(np.mean(np.sum((twin.apply(p[inside]) - q[inside]) ** 2, axis=1)) / 2) / twin.scale
    assert math.sqrt(closest.bend2_px2) == pytest.approx(left, rel=0.05, abs=0.02)


@pytest.mark.parametrize("points", [300, 1200, 40_000])
def test_a_template_takes_the_steepest_pixel_of_every_cell(rng, points):
    values = rng.random((75, 101), dtype=np.float32)
    flat = steepest_pixels(values, None, points)
    t = make_template(values, None, flat, factor=1, size_px=(101, 75))
    x, y = (np.rint(q * 50.5 + c).astype(int) for q, c in ((t.Q[0], 50.0), (t.Q[1], 37.0)))
    np.testing.assert_array_equal(y * 101 + x, flat)
    np.testing.assert_array_equal(t.value, values[y, x])
    padded = np.pad(values, 1, mode="reflect")
    steepness = (padded[1:-1, 2:] - padded[1:-1, :-2]) ** 2 + (padded[2:, 1:-1] - padded[:-2, 1:-1]) ** 2
    cell = max(1, math.ceil(math.sqrt(75 * 101 / points)))
    top, left = ((n - max(1, (n - 4) // cell // GRID) * GRID * cell) // 2 for n in (75, 101))
    for px, py in zip(x.ravel()[::7], y.ravel()[::7], strict=True):
        r, c = top + (py - top) // cell * cell, left + (px - left) // cell * cell
        assert steepness[py, px] >= steepness[r : r + cell, c : c + cell].max() * (1 - 1e-5)
    assert len({*zip(x.ravel(), y.ravel(), strict=True)}) == t.usable.size


def test_tiles_speak_for_the_right_motion_only(rng):
    g, shape = ground(rng), (192, 256)
    T_g_a, T_g_b = pose(450, 450, 0, 1.0, shape), pose(480, 430, 10, 1.05, shape)
    truth = T_g_a.inverse() @ T_g_b
    a, b = (make_spectrum(view(g, T, shape)) for T in (T_g_a, T_g_b))
    floor_a, floor_b = a.floors[a.spectral], b.floors[b.spectral]
    right = tile_pulses(floor_a, floor_b, truth.matrix)
    wrong = tile_pulses(floor_a, floor_b, (truth @ Similarity2D(30.0, 9.0)).matrix)
    assert right.near.all() and right.rival < 0.2 and right.summed_snr > 30.0
    assert wrong.near.mean() < 0.5 and wrong.summed_snr < 0.3 * right.summed_snr
    assert tile_pulses(floor_a, floor_b, Similarity2D(900.0, 0.0).matrix) is None


def test_a_spectrum_is_modest_and_complains_of_nonsense(rng):
    s = make_spectrum(ground(rng)[:384, :512])
    arrays = [s.grey, s.phases, s.log_polar_phases]
    for f in s.floors:
        t = f.template
        arrays += [f.values, t.Q, t.A, t.usable]
    assert sum(a.nbytes for a in arrays) < 3.2e6
    with pytest.raises(ValueError, match="uint8"):
        make_spectrum(np.zeros((64, 64), np.float32))
    with pytest.raises(ValueError, match="mask"):
        make_spectrum(np.zeros((64, 64), np.uint8), mask=np.ones((3, 3), bool))
    with pytest.raises(ValueError, match="sigma_xy_px"):
        Prior(Similarity2D(), 0.0, 0.1, 0.1)


def test_the_whole_mask_off_is_no_crash(rng):
    s = make_spectrum(ground(rng)[:128, :160], mask=np.zeros((128, 160), bool))
    assert np.isfinite(s.phases).all()
