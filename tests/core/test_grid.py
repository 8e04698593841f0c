"""The map's frames and grids."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.grid import MapFrame, MapGrid, TileIndex, Window


def test_map_frame_flips_north():
    frame = MapFrame("X", 500000.0, 4000000.0)
    np.testing.assert_allclose(frame.to_crs([[3.0, 2.0]]), [[500003.0, 3999998.0]])
    np.testing.assert_allclose(frame.from_crs(frame.to_crs([[3.0, 2.0]])), [[3.0, 2.0]])


def test_tiles_cover_the_grid_once():
    grid = MapGrid("X", 0, 0, 0.5, 1300, 700, 512)
    seen = np.zeros((700, 1300), int)
    for t in grid.tiles():
        w = grid.window(t)
        seen[w.row_off : w.row_off + w.height, w.col_off : w.col_off + w.width] += 1
    assert (seen == 1).all()
    assert grid.window(TileIndex(1, 2)) == Window(1024, 512, 276, 188)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(0.01, 10))
def test_pixel_centres(x, y, size):
    grid = MapGrid.covering([[x, y], [x + 20 * size, y + 30 * size]], MapFrame("X"), pixel_size=size)
    np.testing.assert_allclose(grid.to_px(grid.to_crs([[3, 4]])), [[3, 4]], atol=1e-3)
    w, s, e, n = grid.bounds
    assert w <= x + 1e-6
    assert e >= x + 20 * size - 1e-6
    assert s <= y + 1e-6
    assert n >= y + 30 * size - 1e-6
    np.testing.assert_allclose(grid.to_crs([[-0.5, -0.5]]), [[w, n]], atol=1e-6)
