"""A long export of tiles that was stopped goes on where it was."""

import sqlite3

import numpy as np
import pytest
from pyproj import CRS

from photomap_gis.core.errors import OutputError
from photomap_gis.core.grid import MapGrid
from photomap_gis.export import pieces as kept
from photomap_gis.export import write_geopackage, write_mbtiles, write_pmtiles, write_tiles
from photomap_gis.export.encode import TileFormat
from photomap_gis.export.pieces import EncodedTile, Pieces
from photomap_gis.export.pyramid import TileKey

WRITERS = {"t": write_tiles, "m.mbtiles": write_mbtiles, "m.pmtiles": write_pmtiles, "m.gpkg": write_geopackage}


@pytest.fixture(autouse=True)
def short_exports_keep_pieces(monkeypatch):
    monkeypatch.setattr(kept, "WORTH_TILES", 1)


@pytest.fixture
def ground(scene, rng):
    rgba = np.kron(rng.integers(0, 255, (60, 70, 4), dtype=np.uint8), np.ones((20, 20, 1), np.uint8))
    rgba[..., 3] = 255
    grid = MapGrid(CRS.from_epsg(32633).to_wkt(), 391_000.0, 5_820_000.0, 0.25, 1400, 1200)
    return lambda: scene.of_array(rgba, grid)


class Stopped(KeyboardInterrupt):
    """The user pressed control-C."""


def stop_half_way(done, total):
    if done > total / 2:
        raise Stopped


def pixels_read(source):
    return sum(w.width * w.height for w in source.windows)


def contents(path):
    if path.suffix in (".mbtiles", ".gpkg"):
        table = "map" if path.suffix == ".gpkg" else "tiles"
        with sqlite3.connect(path) as db:
            rows = f"SELECT zoom_level, tile_column, tile_row, tile_data FROM {table} ORDER BY 1, 2, 3"
            return db.execute(rows).fetchall()
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    return [(str(p.relative_to(path)), p.read_bytes()) for p in files]


def names(folder):
    return sorted(p.name for p in folder.iterdir())


@pytest.mark.parametrize("name", WRITERS)
def test_a_stopped_export_goes_on(ground, tmp_path, name):
    write, (stopped, whole) = WRITERS[name], (tmp_path / "stopped", tmp_path / "whole")
    stopped.mkdir(), whole.mkdir()
    first = ground()
    write(first, whole / name, source_key="map 1")
    assert names(whole) == [name]  # nothing is left of the pieces
    with pytest.raises(Stopped):
        write(ground(), stopped / name, source_key="map 1", on_progress=stop_half_way)
    assert [n.startswith(".photomap-pieces-") for n in names(stopped)] == [True]
    second = ground()
    write(second, stopped / name, source_key="map 1")
    assert pixels_read(second) < 0.75 * pixels_read(first)
    assert contents(stopped / name) == contents(whole / name)
    assert names(stopped) == [name]


@pytest.mark.parametrize(
    "other", [{"source_key": "map 2"}, {"quality": 30}, {"max_zoom": 17}, {"image_format": "webp"}]
)
def test_pieces_of_something_else_are_not_taken(ground, tmp_path, other):
    asked = {"source_key": "map 1", "image_format": "jpg", **other}
    write_tiles(ground(), tmp_path / "whole", **asked)
    with pytest.raises(Stopped):
        write_tiles(ground(), tmp_path / "t", source_key="map 1", image_format="jpg", on_progress=stop_half_way)
    source = ground()
    write_tiles(source, tmp_path / "t", **asked)
    fresh = ground()
    write_tiles(fresh, tmp_path / "fresh", **asked)
    assert pixels_read(source) == pixels_read(fresh)
    assert contents(tmp_path / "t") == contents(tmp_path / "whole")


def test_an_export_that_fails_keeps_nothing(ground, tmp_path):
    def full(done, total):
        raise OutputError("the disk is full")

    with pytest.raises(OutputError, match="the disk is full"):
        write_mbtiles(ground(), tmp_path / "m.mbtiles", source_key="map 1", on_progress=full)
    assert names(tmp_path) == []


def test_without_a_name_or_where_it_is_short_nothing_is_kept(ground, tmp_path, monkeypatch):
    with pytest.raises(Stopped):
        write_tiles(ground(), tmp_path / "t", on_progress=stop_half_way)
    monkeypatch.setattr(kept, "WORTH_TILES", 10_000)
    with pytest.raises(Stopped):
        write_tiles(ground(), tmp_path / "t", source_key="map 1", on_progress=stop_half_way)
    assert names(tmp_path) == []


@pytest.mark.parametrize("damage", [lambda b: b[:-7], lambda b: b[:40] + b"!" + b[41:], lambda b: b"", lambda b: b"{}"])
def test_a_damaged_piece_is_made_again(tmp_path, rng, damage):
    top = rng.integers(0, 255, (256, 256, 4), dtype=np.uint8)
    made = [
        EncodedTile(TileKey(18, 5, 7), TileFormat.PNG, b"abc\n"),
        EncodedTile(TileKey(17, 2, 3), TileFormat.JPG, b""),
    ]
    pieces, key = Pieces(tmp_path / "p", 256), TileKey(17, 2, 3)
    assert pieces.find(key) is None
    pieces.keep(key, made, top)
    found, pixels = pieces.find(key)
    assert [(t.key, t.format, t.data) for t in found] == [(t.key, t.format, t.data) for t in made]
    np.testing.assert_array_equal(pixels, top)
    pieces.keep(TileKey(17, 0, 0), [], None)
    assert pieces.find(TileKey(17, 0, 0)) == ([], None)
    (file,) = (tmp_path / "p").glob("17-2-3.piece")
    file.write_bytes(damage(file.read_bytes()))
    assert pieces.find(key) is None
