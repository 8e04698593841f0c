"""Tiles on disk: what was written is read, whole, by any window, from any thread; nothing else is touched."""

import json
import threading
import zlib
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from photomap_gis.core.errors import DataError, OutputError
from photomap_gis.core.grid import MapGrid, TileIndex, Window
from photomap_gis.mosaic import TileStore
from photomap_gis.mosaic.tile_codec import decode_tile, encode_tile

GRID = MapGrid("a CRS", 100.0, 200.0, 0.5, 150, 90, 64)


def filled(tmp_path, rng):
    whole = rng.integers(0, 256, (GRID.height, GRID.width, 4), dtype=np.uint8)
    whole[..., 3] = 255
    whole[:40, 30:90, 3] = rng.integers(0, 256, (40, 60))
    store = TileStore.create(tmp_path / "map", GRID, revision=7, fingerprint="f")
    for tile in GRID.tiles():
        x, y, w, h = GRID.window(tile)
        store.write(tile, whole[y : y + h, x : x + w])
    return store, whole


@pytest.mark.parametrize(
    "window", [(0, 0, 150, 90), (10, 20, 100, 50), (60, 60, 8, 8), (149, 89, 1, 1), (-20, -30, 300, 200)]
)
def test_any_window_is_read_exactly(tmp_path, rng, window):
    store, whole = filled(tmp_path, rng)
    padded = np.zeros((500, 500, 4), np.uint8)
    padded[100:190, 100:250] = whole
    x, y, w, h = window
    assert np.array_equal(store.read(Window(*window)), padded[100 + y : 100 + y + h, 100 + x : 100 + x + w])


def test_a_window_beside_the_grid_is_empty(tmp_path, rng):
    store, _ = filled(tmp_path, rng)
    assert not store.read(Window(1000, 1000, 5, 5)).any() and not store.read(Window(-50, 3, 20, 20)).any()


def test_a_store_is_reopened_as_it_was(tmp_path, rng):
    store, whole = filled(tmp_path, rng)
    again = TileStore(store.folder)
    assert (again.grid, again.revision, again.fingerprint) == (GRID, 7, "f")
    assert np.array_equal(again.read(Window(0, 0, 150, 90)), whole)


def test_tiles_stay_for_the_same_plan_and_go_for_another(tmp_path, rng):
    store, _ = filled(tmp_path, rng)
    (store.folder / "notes.txt").write_text("mine")
    assert TileStore.create(store.folder, GRID, revision=8, fingerprint="f").done(TileIndex(0, 0))
    other = TileStore.create(store.folder, GRID, revision=8, fingerprint="g")
    assert not any(other.done(tile) for tile in GRID.tiles())
    assert (store.folder / "notes.txt").read_text() == "mine"


def test_an_empty_tile_is_done_and_takes_no_space(tmp_path):
    store = TileStore.create(tmp_path, GRID, revision=1)
    tile = TileIndex(1, 1)
    assert not store.done(tile)
    store.write(tile, np.zeros((26, 64, 4), np.uint8))
    assert store.done(tile) and [p.suffix for p in tmp_path.glob("*/*")] == [".empty"]
    assert not store.read(GRID.window(tile)).any()


def test_a_tile_that_is_written_again_is_read_anew(tmp_path, rng):
    store, _ = filled(tmp_path, rng)
    window = GRID.window(TileIndex(0, 0))
    store.read(window)
    new = np.full((64, 64, 4), 255, np.uint8)
    store.write(TileIndex(0, 0), new)
    assert np.array_equal(store.read(window), new)
    store.write(TileIndex(0, 0), np.zeros_like(new))
    assert not store.read(window).any()


def test_readers_and_writers_share_a_store(tmp_path, rng):
    store, whole = filled(tmp_path, rng)
    stop = threading.Event()

    def rewrite():
        while not stop.is_set():
            store.write(TileIndex(0, 1), whole[:64, 64:128])

    writer = threading.Thread(target=rewrite)
    writer.start()
    try:
        with ThreadPoolExecutor(4) as pool:
            for got in pool.map(store.read, [Window(0, 0, 150, 90)] * 40):
                assert np.array_equal(got, whole)
    finally:
        stop.set()
        writer.join()


def test_no_store_and_damaged_stores_are_named(tmp_path, rng):
    with pytest.raises(DataError, match="no rendered map"):
        TileStore(tmp_path)
    store, _ = filled(tmp_path, rng)
    path = store.folder / "00000" / "00000.tile"
    good = path.read_bytes()
    for data in (b"", b"PMT1", b"PMT1\x03nonsense", good[:-1], good[:40] + bytes([good[40] ^ 1]) + good[41:]):
        path.write_bytes(data)
        with pytest.raises(DataError, match="damaged"):
            TileStore(store.folder).read(Window(0, 0, 9, 9))
    head = store.folder / "grid.json"
    head.write_text(json.dumps({**json.loads(head.read_text()), "format": 99}))
    with pytest.raises(DataError, match="version"):
        TileStore(store.folder)
    head.write_text("{")
    with pytest.raises(DataError, match="damaged"):
        TileStore(store.folder)


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        TileStore.create(tmp_path / "file" / "map", GRID, revision=1)


def test_a_tile_of_the_wrong_size_is_refused(tmp_path):
    store = TileStore.create(tmp_path, GRID, revision=1)
    with pytest.raises(ValueError, match="rgba"):
        store.write(TileIndex(1, 2), np.zeros((64, 64, 4), np.uint8))


def test_which_frame_shows_what_is_kept(tmp_path, rng):
    store, whole = filled(tmp_path, rng)
    tile = TileIndex(0, 1)
    shown = rng.integers(-1, 70_000, (64, 64)).astype(np.int32)
    store.write(tile, whole[:64, 64:128], shown)
    assert np.array_equal(TileStore(store.folder).read_source(tile), shown)
    store.write(TileIndex(1, 2), np.zeros((26, 22, 4), np.uint8))
    assert (store.read_source(TileIndex(1, 2)) == -1).all()
    path = store.folder / "00000" / "00001.from"
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(DataError, match="damaged"):
        store.read_source(tile)
    path.unlink()
    with pytest.raises(DataError, match="which frame shows what"):
        store.read_source(tile)


def test_tiles_of_older_versions_are_read_and_replaced(tmp_path, rng):
    store = TileStore.create(tmp_path, GRID, revision=1)
    rgba = rng.integers(0, 256, (64, 64, 4), dtype=np.uint8)
    shown = rng.integers(0, 9, (64, 64)).astype("<i4")
    row = tmp_path / "00000"
    row.mkdir()
    (row / "00000.png").write_bytes(cv2.imencode(".png", cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGRA))[1].tobytes())
    (row / "00000.src").write_bytes(zlib.compress(shown.tobytes(), 1))
    tile = TileIndex(0, 0)
    assert store.done(tile) and np.array_equal(store.read(GRID.window(tile)), rgba)
    assert np.array_equal(store.read_source(tile), shown)
    store.write(tile, rgba[::-1].copy(), shown[::-1].copy())
    assert np.array_equal(store.read(GRID.window(tile)), rgba[::-1])
    assert np.array_equal(store.read_source(tile), shown[::-1])
    assert not (row / "00000.png").exists()


@given(arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9), st.just(4))))
def test_a_tile_keeps_every_bit(rgba):
    shape = rgba.shape[:2]
    assert np.array_equal(decode_tile(encode_tile(rgba), shape), rgba)
    assert decode_tile(encode_tile(rgba), (shape[0], shape[1] + 1)) is None
    opaque = rgba.copy()
    opaque[..., 3] = 255
    assert np.array_equal(decode_tile(encode_tile(opaque), shape), opaque)


@given(st.binary(max_size=40))
def test_nonsense_is_no_tile(data):
    assert decode_tile(data, (8, 8)) is None and decode_tile(b"PMT1\x04" + data, (8, 8)) is None
