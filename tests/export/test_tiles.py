"""Folders of tiles and MBTiles."""

import io
import json
import sqlite3

import mercantile
import numpy as np
import pytest
from PIL import Image
from pyproj import Transformer

from photomap_gis.core.errors import DataError, NotGeoreferencedError, OutputError, UsageError
from photomap_gis.core.grid import MapGrid
from photomap_gis.export import write_mbtiles, write_tiles
from photomap_gis.export.encode import TileFormat, encode
from photomap_gis.export.words import MapWords


def keys_of(folder, suffix="png"):
    return {(int(p.parts[-3]), int(p.parts[-2]), int(p.stem)) for p in folder.rglob(f"*.{suffix}")}


def test_tile_json(scene, tmp_path):
    source = scene.source()
    count = write_tiles(source, tmp_path / "t", words=MapWords("Flood </script>", "d", "a"))
    document = json.loads((tmp_path / "t" / "tiles.json").read_text())
    keys = keys_of(tmp_path / "t")
    assert len(keys) == count
    assert document["tilejson"] == "3.0.0"
    assert document["scheme"] == "xyz"
    assert document["tiles"] == ["./{z}/{x}/{y}.png"]
    assert (document["minzoom"], document["maxzoom"]) == (min(k[0] for k in keys), max(k[0] for k in keys))
    west, south, east, north = document["bounds"]
    lon, lat, zoom = document["center"]
    assert west < lon < east
    assert south < lat < north
    assert document["minzoom"] <= zoom <= document["maxzoom"]
    to = Transformer.from_crs(32633, 4326, always_xy=True)
    x, y = to.transform(*source.grid.to_crs([[210, 190]])[0])
    assert west < x < east
    assert south < y < north
    page = (tmp_path / "t" / "index.html").read_text()
    assert "</script>" not in page[page.index("Flood") : page.index("Flood") + 40]
    assert "http://" not in page
    assert "https://" not in page


def test_the_finest_zoom_is_the_nearest_at_this_latitude(placed, tmp_path):
    write_tiles(placed, tmp_path / "t")
    document = json.loads((tmp_path / "t" / "tiles.json").read_text())
    lat = (document["bounds"][1] + document["bounds"][3]) / 2
    ground = 156543.0339 * np.cos(np.radians(lat)) / 2 ** document["maxzoom"]
    assert 1 / np.sqrt(2) - 0.01 <= ground / placed.grid.pixel_size <= np.sqrt(2) + 0.01


def test_every_tile_is_needed_and_none_is_missing(scene, tmp_path):
    source = scene.source()
    write_tiles(source, tmp_path / "t", min_zoom=12)
    keys = keys_of(tmp_path / "t")
    zoom = max(k[0] for k in keys)
    to = Transformer.from_crs(32633, 4326, always_xy=True)
    y, x = np.nonzero(source.rgba[..., 3])
    lon, lat = to.transform(*source.grid.to_crs(np.stack([x, y], axis=-1)[::7]).T)
    needed = {tuple(mercantile.tile(a, b, z)) for a, b in zip(lon, lat, strict=True) for z in (zoom, 12)}
    assert {(t[2], t[0], t[1]) for t in needed} <= keys
    for z, x, y in keys:
        if z > 12:
            assert (z - 1, x // 2, y // 2) in keys
    assert min(k[0] for k in keys) == 12


def test_zooms_that_were_asked_for(scene, tmp_path):
    source = scene.source()
    write_tiles(source, tmp_path / "t", min_zoom=15, max_zoom=17)
    assert {k[0] for k in keys_of(tmp_path / "t")} == {15, 16, 17}
    write_tiles(source, tmp_path / "finer", min_zoom=20, max_zoom=20)
    assert {k[0] for k in keys_of(tmp_path / "finer")} == {20}
    with pytest.raises(UsageError, match="widest zoom"):
        write_tiles(source, tmp_path / "t", min_zoom=19, max_zoom=17)
    with pytest.raises(UsageError, match="between 0 and"):
        write_tiles(source, tmp_path / "t", max_zoom=99)


def test_zoom_0_holds_the_map_in_one_tile(scene, tmp_path):
    write_tiles(scene.source(pixel_size=40.0), tmp_path / "t", min_zoom=0)
    assert (0, 0, 0) in keys_of(tmp_path / "t")


@pytest.mark.parametrize("tile_format", ["webp", "jpg", "jpeg"])
def test_formats(scene, tmp_path, tile_format):
    write_tiles(scene.small(), tmp_path / "t", image_format=tile_format)
    suffix = "jpg" if tile_format == "jpeg" else tile_format
    assert json.loads((tmp_path / "t" / "tiles.json").read_text())["tiles"] == [f"./{{z}}/{{x}}/{{y}}.{suffix}"]
    for path in (tmp_path / "t").rglob(f"*.{suffix}"):
        with Image.open(path) as picture:
            assert picture.size == (256, 256)
            assert picture.format == ("JPEG" if suffix == "jpg" else "WEBP")
    with pytest.raises(ValueError, match="image_format must be one of"):
        write_tiles(scene.source(), tmp_path / "x", image_format="gif")


@pytest.mark.parametrize("tile_format", list(TileFormat))
def test_encoding(rng, tile_format):
    rgba = np.full((256, 256, 4), 255, np.uint8)
    rgba[..., :3] = rng.integers(90, 110, 3)
    rgba[100:120, 50:90, :3] = (200, 30, 10)
    rgba[:, 128:] = 0
    back = np.asarray(Image.open(io.BytesIO(encode(rgba, tile_format))).convert("RGBA")).astype(int)
    np.testing.assert_allclose(back[110, 70, :3], (200, 30, 10), atol=12)
    if tile_format is TileFormat.JPG:
        np.testing.assert_allclose(back[50, 200], 255, atol=2)
    else:
        assert back[50, 200, 3] == 0
        assert back[50, 20, 3] == 255


def test_across_the_antimeridian_columns_start_again(placed, tmp_path):
    write_tiles(placed, tmp_path / "t", min_zoom=10)
    keys = keys_of(tmp_path / "t")
    for zoom, x, y in keys:
        assert 0 <= x < 2**zoom
        assert 0 <= y < 2**zoom
    if "60N" in placed.grid.crs_wkt:
        finest = max(k[0] for k in keys)
        columns = {k[1] for k in keys if k[0] == finest}
        assert {0, 2**finest - 1} <= columns
        assert json.loads((tmp_path / "t" / "tiles.json").read_text())["bounds"][::2] == [-180.0, 180.0]


def test_beyond_web_mercator(scene, tmp_path):
    with pytest.raises((DataError, UsageError), match="85 degrees"):
        write_tiles(scene.source("EPSG:32661", 2_000_000.0, 2_100_000.0), tmp_path / "t")


def test_local_maps_are_refused(scene, tmp_path):
    for write, name in ((write_tiles, "t"), (write_mbtiles, "m.mbtiles")):
        with pytest.raises(NotGeoreferencedError, match="--track"):
            write(scene.source(None), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_maps_that_show_nothing(scene, tmp_path):
    grid = scene.source().grid
    empty = scene.of_array(np.zeros((380, 420, 4), np.uint8), grid)
    for write, name in ((write_tiles, "t"), (write_mbtiles, "m.mbtiles")):
        with pytest.raises(OutputError, match="shows nothing"):
            write(empty, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_mbtiles_document(scene, tmp_path):
    count = write_mbtiles(scene.source(), tmp_path / "m.mbtiles", words=MapWords("Fire", attribution="us"))
    with sqlite3.connect(tmp_path / "m.mbtiles") as db:
        metadata = dict(db.execute("SELECT name, value FROM metadata"))
        assert db.execute("SELECT count(*) FROM tiles").fetchone() == (count,)
        assert db.execute("PRAGMA application_id").fetchone() == (0x4D504258,)
        indexes = {row[1] for row in db.execute("PRAGMA index_list(tiles)")}
        zooms = db.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles").fetchone()
        first = db.execute("SELECT tile_data FROM tiles LIMIT 1").fetchone()[0]
    assert "tile_index" in indexes
    assert metadata["name"] == "Fire"
    assert metadata["format"] == "png"
    assert first[:4] == b"\x89PNG"
    assert (int(metadata["minzoom"]), int(metadata["maxzoom"])) == zooms
    west, south, east, north = (float(v) for v in metadata["bounds"].split(","))
    assert -180 <= west < east <= 180
    assert -85.1 < south < north < 85.1
    lon, lat, zoom = metadata["center"].split(",")
    assert west < float(lon) < east
    assert south < float(lat) < north
    assert zooms[0] <= int(zoom) <= zooms[1]


def test_mbtiles_and_folder_are_one_pyramid(scene, tmp_path):
    source = scene.small()
    write_tiles(source, tmp_path / "t")
    write_mbtiles(source, tmp_path / "m.mbtiles")
    with sqlite3.connect(tmp_path / "m.mbtiles") as db:
        for z, x, row, data in db.execute("SELECT zoom_level, tile_column, tile_row, tile_data FROM tiles"):
            assert (tmp_path / "t" / str(z) / str(x) / f"{(1 << z) - 1 - row}.png").read_bytes() == data


def test_a_full_disk_in_sqlite(scene, tmp_path, monkeypatch):
    real = sqlite3.connect

    def small(path):
        db = real(path)
        db.execute("PRAGMA max_page_count = 5")
        return db

    monkeypatch.setattr(sqlite3, "connect", small)
    with pytest.raises(OutputError, match="full"):
        write_mbtiles(scene.small(), tmp_path / "m.mbtiles")
    assert list(tmp_path.iterdir()) == []


def test_progress(scene, tmp_path):
    seen = []
    write_tiles(scene.small(), tmp_path / "t", on_progress=lambda done, total: seen.append((done, total)))
    assert seen[-1][0] == seen[-1][1] > 0
    assert [d for d, _ in seen] == sorted(d for d, _ in seen)


def test_one_pixel_map(scene, tmp_path):
    grid = MapGrid(scene.small().grid.crs_wkt, 391_000.0, 5_820_000.0, 0.25, 1, 1)
    assert write_tiles(scene.of_array(np.full((1, 1, 4), 255, np.uint8), grid), tmp_path / "t") > 0
