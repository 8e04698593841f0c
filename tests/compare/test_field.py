"""The field of shifts: what drifted smoothly is followed, what moved alone is not."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.compare.laid import ArrayImagery
from photomap_gis.compare.align import LaidPair, coarser, field_on, fine_field
from photomap_gis.compare.field import NodeShift, ShiftField, match_node, with_nodes
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.simulate.noise import fractal_noise


def _texture(rng, side=320):
    grey = 128 + 40 * fractal_noise((side, side), rng, wavelength_px=24.0, octaves=3)
    return np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def test_a_drift_is_followed_to_a_fifth_of_a_pixel(rng):
    new = _texture(rng)
    x, y = np.meshgrid(np.arange(320, dtype=np.float32), np.arange(320, dtype=np.float32))
    dx, dy = 3.0 * np.sin(y / 90.0), 2.0 * np.cos(x / 110.0)
    old = cv2.remap(new, x + dx, y + dy, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    a, b = ArrayImagery(old, 0.1), ArrayImagery(new, 0.1)
    field = fine_field(LaidPair(a, b, b.grid, ShiftField.none(b.grid)), workers=1)
    at_x, at_y = field.at(Window(0, 0, 320, 320))
    # old(p) = new(p + d(p)): where the field leads to, the drift must lead back.
    back_x = at_x + cv2.remap(dx.astype(np.float32), at_x, at_y, cv2.INTER_LINEAR)
    back_y = at_y + cv2.remap(dy.astype(np.float32), at_x, at_y, cv2.INTER_LINEAR)
    error = np.hypot(back_x - x, back_y - y)[48:-48, 48:-48]
    assert np.median(error) < 0.2 and np.percentile(error, 95) < 0.6


def test_one_node_that_moved_alone_is_left_out():
    grid = MapGrid(None, 0.0, 0.0, 1.0, 320, 320)
    still = [NodeShift(r, c, 0.5, -0.25, 0.5) for r in range(11) for c in range(11) if (r, c) != (5, 5)]
    field = with_nodes(ShiftField.none(grid), [*still, NodeShift(5, 5, 8.0, 8.0, 0.9)])
    x, y = field.at(Window(160, 160, 1, 1))
    assert float(x[0, 0]) == pytest.approx(160.5, abs=0.01) and float(y[0, 0]) == pytest.approx(159.75, abs=0.01)


def test_a_flat_place_has_no_match():
    flat = np.zeros((84, 84), np.float32)
    assert match_node(flat, flat, np.ones((84, 84), bool)) == (0.0, 0.0, 0.0)


@settings(max_examples=25, deadline=None)
@given(
    factor=st.sampled_from([2, 4, 8]),
    tx=st.floats(-30, 30),
    ty=st.floats(-30, 30),
    angle=st.floats(-0.05, 0.05),
)
def test_a_field_leads_to_the_same_ground_at_any_pixel_size(factor, tx, ty, angle):
    fine = MapGrid(None, 0.0, 0.0, 0.5, 640, 480)
    rough = coarser(fine, factor)
    field = ShiftField.none(fine, Similarity2D(tx, ty, angle, 0.01))
    on_rough = field_on(field, fine, rough)
    p = np.array([[123.0, 77.0]])
    ground = fine.to_crs(field.T_old_new.apply(p))
    again = rough.to_crs(on_rough.T_old_new.apply(rough.to_px(fine.to_crs(p))))
    assert np.allclose(ground, again, atol=1e-6)
    back = field_on(on_rough, rough, fine)
    assert np.allclose(back.T_old_new.matrix, field.T_old_new.matrix, atol=1e-9)
