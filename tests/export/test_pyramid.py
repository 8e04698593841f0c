"""Tiles of every zoom in one pass over the map."""

import numpy as np
import pytest

from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.export.pixels import shrink
from photomap_gis.export.pyramid import Pyramid, TileKey
from photomap_gis.export.warp import Resampler


@pytest.mark.parametrize("levels", [0, 1, 2, 3, 5])
def test_every_level_shows_the_map(scene, levels):
    source = scene.source()
    reader = Resampler(source, source.grid)
    pyramid = Pyramid(reader, Window(0, 0, 420, 380), levels, tile_px=32)
    tiles = {t.key: t.rgba for t in pyramid.tiles()}
    assert len(tiles) == sum(1 for _ in tiles)  # no key twice: a dict would hide it
    leaves = np.zeros((640, 640, 4), np.uint8)
    for key, rgba in tiles.items():
        assert rgba.shape == (32, 32, 4)
        assert rgba[..., 3].any()
        if key.zoom == levels and key.x < 20 and key.y < 20:
            leaves[key.y * 32 : key.y * 32 + 32, key.x * 32 : key.x * 32 + 32] = rgba
    np.testing.assert_array_equal(leaves[:380, :420][source.rgba[..., 3] > 0], source.rgba[source.rgba[..., 3] > 0])
    for key, rgba in tiles.items():
        if key.zoom < levels:
            canvas = np.zeros((64, 64, 4), np.uint8)
            for row in (0, 1):
                for col in (0, 1):
                    child = tiles.get(TileKey(key.zoom + 1, 2 * key.x + col, 2 * key.y + row))
                    if child is not None:
                        canvas[row * 32 : row * 32 + 32, col * 32 : col * 32 + 32] = child
            np.testing.assert_array_equal(rgba, shrink(canvas, 2))


def test_children_come_before_parents_and_once(scene):
    source = scene.source()
    pyramid = Pyramid(Resampler(source, source.grid), Window(0, 0, 420, 380), 4, tile_px=32)
    keys = [t.key for t in pyramid.tiles()]
    assert len(set(keys)) == len(keys)
    seen = set()
    for key in keys:
        assert TileKey(key.zoom - 1, key.x // 2, key.y // 2) not in seen
        seen.add(key)


def test_finer_tiles_can_be_kept_back(scene):
    source = scene.source()
    pyramid = Pyramid(Resampler(source, source.grid), Window(0, 0, 420, 380), 4, 1, 2, tile_px=32)
    assert {t.key.zoom for t in pyramid.tiles()} == {1, 2}


def test_the_map_is_read_once(scene):
    source = scene.source()
    pyramid = Pyramid(Resampler(source, source.grid), Window(0, 0, 420, 380), 4, tile_px=32)
    list(pyramid.tiles())
    assert sum(w.width * w.height for w in source.windows) < 2.2 * 420 * 380  # margins of small blocks


def test_keys_of_an_extent():
    grid = MapGrid(None, 0, 0, 1.0, 1000, 1000)
    pyramid = Pyramid(Resampler.__new__(Resampler), Window(100, 300, 200, 10), 3, tile_px=64)
    assert pyramid.keys(3) == [TileKey(3, x, 4) for x in (1, 2, 3, 4)]
    assert pyramid.keys(2) == [TileKey(2, x, 2) for x in (0, 1, 2)]
    assert pyramid.leaf_count == 4
    assert grid.tile_rows == 2
