"""Where key frames lie: found by their tiles, thinned without a hole."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from photomap_gis.core.grid import TileIndex
from photomap_gis.live.outlines import Outlines, tiles_in


def quad(x: float, y: float, angle: float = 0.0, w: float = 640.0, h: float = 360.0) -> np.ndarray:
    corners = np.array([[-w, -h], [w, -h], [w, h], [-w, h]]) / 2.0
    c, s = np.cos(angle), np.sin(angle)
    return corners @ np.array([[c, s], [-s, c]]) + (x, y)


@given(st.lists(st.tuples(st.floats(-4000, 4000), st.floats(-4000, 4000), st.floats(-3, 3)), min_size=1, max_size=80))
@settings(max_examples=40, deadline=None)
def test_frames_over_tiles_are_those_whose_boxes_hold_them(places: list[tuple[float, float, float]]) -> None:
    outlines = Outlines()
    for k, place in enumerate(places):
        outlines[2 * k] = quad(*place)  # every other key frame has no place
    tiles = [TileIndex(0, 0), TileIndex(-2, 3), TileIndex(7, -1)]
    wanted = [2 * k for k, place in enumerate(places) if set(tiles_in(quad(*place))) & set(tiles)]
    assert outlines.over(tiles) == wanted


def test_a_box_that_makes_no_sense_has_no_tiles() -> None:
    assert tiles_in(quad(0.0, 0.0, w=1e6, h=1e6)) == []
    assert tiles_in(np.full((4, 2), np.nan)) == []
    assert len(tiles_in(quad(0.0, 0.0), 0.5)) > len(tiles_in(quad(0.0, 0.0)))


def test_of_key_frames_in_a_row_that_lie_close_one_is_left() -> None:
    """First and last are kept, one that looks another way too, and no two that follow each other are far apart."""
    outlines = Outlines()
    for k in range(30):
        outlines[k] = quad(20.0 * k, 0.0, 0.5 if k == 11 else 0.0)
    kept = outlines.uncrowded(range(30))
    assert {0, 11, 29} <= set(kept) and len(kept) < 12
    assert np.diff([20.0 * k for k in kept]).max() <= 0.18 * 640.0 + 20.0
    assert outlines.uncrowded(range(0, 30, 2)) == list(range(0, 30, 2))  # not in a row
