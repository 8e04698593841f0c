"""The paper's algorithms to the letter: known motions come back, and its covariance is what the text says."""

import math

import numpy as np
import pytest
from ifmi_ground import ground, pose, rms_px, view

from photomap_gis.core.similarity import Similarity2D
from photomap_gis.ifmi.paper import fir_filter, log_polar, pulse_covariance, register_literal


@pytest.mark.parametrize("shape", [(256, 256), (192, 256)])
@pytest.mark.parametrize(
    ("dx", "dy", "angle_deg", "scale"), [(0, 0, 0, 1.0), (40, -30, 10, 1.0), (-25, 20, -60, 1.1), (10, 30, 25, 0.8)]
)
def test_a_known_motion_comes_back_to_the_cell(rng, shape, dx, dy, angle_deg, scale):
    g = ground(rng)
    T_g_a, T_g_b = pose(450, 450, 20, 1.0, shape), pose(450 + dx, 450 + dy, 20 + angle_deg, scale, shape)
    r = register_literal(view(g, T_g_a, shape), view(g, T_g_b, shape))
    assert rms_px(r.T_a_b, T_g_a.inverse() @ T_g_b, shape) < 2.5  # a cell of the log-polar picture is 2 px at a corner


def test_half_a_turn_cannot_be_told(rng):
    shape, g = (256, 256), ground(rng)
    T_g_a, T_g_b = pose(450, 450, 0, 1.0, shape), pose(455, 450, 175, 1.0, shape)
    r = register_literal(view(g, T_g_a, shape), view(g, T_g_b, shape))
    assert abs(r.T_a_b.angle_rad) < math.radians(90.5)


def test_the_pulse_sums_to_one_so_that_normalising_does_nothing(rng):
    shape, g = (128, 128), ground(rng)
    r = register_literal(view(g, pose(450, 450, 0, 1.0, shape), shape), view(g, pose(460, 450, 4, 1.0, shape), shape))
    assert r.delta_trans.sum() == pytest.approx(1.0, abs=1e-4)
    assert r.delta_rot_scale.sum() == pytest.approx(1.0, abs=1e-4)


def test_without_section_2_2_the_cross_of_the_border_wins(rng):
    shape, g = (256, 256), ground(rng)
    T_g_a, T_g_b = pose(450, 450, 20, 1.0, shape), pose(480, 450, 45, 1.0, shape)
    bare = register_literal(view(g, T_g_a, shape), view(g, T_g_b, shape), improved=False)
    assert rms_px(bare.T_a_b, T_g_a.inverse() @ T_g_b, shape) > 10.0


def test_algorithm_3_is_the_second_moment_of_the_pulse():
    y, x = np.mgrid[-16:16, -16:16]
    delta = np.exp(-0.5 * ((y / 1.5) ** 2 + (x / 2.5) ** 2)).astype(np.float32)
    np.testing.assert_allclose(pulse_covariance(delta, 16.0, 16.0, 12), np.diag([1.5**2, 2.5**2]), rtol=0.02, atol=1e-6)


def test_algorithm_3_need_not_be_positive_definite():
    delta = np.zeros((16, 16), np.float32)
    delta[8, 8], delta[8, 9], delta[8, 7] = 1.2, -0.1, -0.1
    assert np.linalg.eigvalsh(pulse_covariance(delta, 8, 8, 2))[0] < 0.0


def test_the_covariance_is_told_in_pixels_of_b_and_radians(rng):
    shape, g = (256, 256), ground(rng)
    T_g_a, T_g_b = pose(450, 450, 0, 1.0, shape), pose(460, 445, 30, 1.25, shape)
    r = register_literal(view(g, T_g_a, shape), view(g, T_g_b, shape))
    assert np.trace(r.covariance[:2, :2]) == pytest.approx(np.trace(r.covariance_trans) / r.T_a_b.scale**2)
    assert np.array_equal(r.covariance[2:, 2:], r.covariance_rot_scale)
    assert not r.covariance[:2, 2:].any()


def test_the_filter_gathers_and_keeps_the_sum(rng):
    delta = np.zeros((8, 8), np.float32)
    delta[0, 7] = 1.0
    filtered = fir_filter(delta)
    assert filtered.sum() == pytest.approx(1.0)
    assert (filtered[0, 7], filtered[0, 0], filtered[7, 7]) == pytest.approx((0.25, 0.125, 0.125))


def test_the_descriptor_moves_as_the_picture_turns(rng):
    shape, g = (256, 256), ground(rng)
    P_a, P_b = (log_polar(view(g, pose(450, 450, angle, 1.0, shape), shape).astype(np.float32)) for angle in (0, 45))
    # turning the camera by 45 degrees turns the picture's spectrum back by as much: 64 of 256 rows
    ring = slice(150, 230)
    gap = [float(np.mean((P_a[:, ring] - np.roll(P_b, k, axis=0)[:, ring]) ** 2)) for k in (64, -64, 0)]
    assert gap[0] < 0.7 * min(gap[1:])


@pytest.mark.parametrize("shapes", [((64, 64), (64, 66)), ((63, 64), (63, 64))])
def test_odd_or_unequal_shapes_are_refused(shapes):
    with pytest.raises(ValueError, match="even shape"):
        register_literal(*(np.zeros(s, np.uint8) for s in shapes))


def test_the_result_is_a_similarity(rng):
    shape, g = (128, 128), ground(rng)
    a = view(g, pose(450, 450, 0, 1.0, shape), shape)
    assert rms_px(register_literal(a, a).T_a_b, Similarity2D.identity(), shape) < 1e-6
