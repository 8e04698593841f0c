"""The newer formats put every landmark where it is too, read back by programs that are not ours."""

import sqlite3
import zipfile

import numpy as np
import pytest
import rasterio
from PIL import Image
from pmtiles.reader import MemorySource, Reader, all_tiles

from photomap_gis.export import write_atak, write_geopackage, write_geotiff, write_picture, write_pmtiles, write_tiles

from .test_positions import assemble, read_raster

# Lossy colours scatter a disc's centroid, GDAL's own JPEG alike; a shift would show in the mean of the discs.
COMPRESSIONS = {"DEFLATE": 0.02, "ZSTD": 0.02, "LZW": 0.02, "NONE": 0.02, "WEBP": 0.15, "JPEG": 0.15}


def read_masked(path):
    """RGBA of a raster with a mask in place of alpha."""
    with rasterio.open(path) as dataset:
        _, crs, to_crs = dataset.read(1), dataset.crs.to_wkt(), None
        rgba = np.dstack([dataset.read([1, 2, 3]).transpose(1, 2, 0), dataset.dataset_mask()])
        grid = dataset.transform

    def to_crs(xy):
        x, y = (np.asarray(xy) + 0.5).T
        return np.stack([grid.a * x + grid.c, grid.e * y + grid.f], axis=-1)

    return rgba, crs, to_crs


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_geotiff_in_every_compression(scene, tmp_path, compression):
    source = scene.source()
    write_geotiff(source, tmp_path / "map.tif", compression=compression)
    rgba, crs, to_crs = read_masked(tmp_path / "map.tif")
    assert scene.errors_px(source, rgba, crs, to_crs) < COMPRESSIONS[compression]
    found = scene.find(rgba)
    assert np.abs(np.mean([found[c] - xy for c, xy in scene.landmarks.items()], axis=0)).max() < 0.05
    assert ((rgba[..., 3] > 0) == (source.rgba[..., 3] > 0)).mean() > 0.999


@pytest.mark.parametrize("crs", [None, "EPSG:3857", "EPSG:4326", "EPSG:3035"])
@pytest.mark.parametrize("image_format", ["auto", "png", "webp"])
def test_geopackage(scene, tmp_path, crs, image_format):
    source = scene.source()
    write_geopackage(source, tmp_path / "map.gpkg", crs=crs, image_format=image_format)
    rgba, written, to_crs = read_raster(tmp_path / "map.gpkg")
    assert scene.errors_px(source, rgba, written, to_crs) < 0.1


def test_geopackage_at_places_all_over_the_earth(placed, scene, tmp_path):
    write_geopackage(placed, tmp_path / "map.gpkg")
    assert scene.errors_px(placed, *read_raster(tmp_path / "map.gpkg")) < 0.1


def test_pmtiles(placed, scene, tmp_path):
    count = write_pmtiles(placed, tmp_path / "map.pmtiles")
    data = MemorySource((tmp_path / "map.pmtiles").read_bytes())
    tiles = {key: bytes(tile) for key, tile in all_tiles(data)}
    assert len(tiles) == count
    header = Reader(data).header()
    rgba, to_crs = assemble(tiles, header["max_zoom"])
    assert scene.errors_px(placed, rgba, "EPSG:3857", to_crs) < 0.1
    for key, tile in tiles.items():
        assert Reader(data).get(*key) == tile


def test_tms_rows_count_from_the_south(scene, tmp_path):
    source = scene.source()
    write_tiles(source, tmp_path / "tms", tms=True)
    tiles = {}
    for path in (tmp_path / "tms").rglob("*.png"):
        zoom, x, row = int(path.parts[-3]), int(path.parts[-2]), int(path.stem)
        tiles[zoom, x, (1 << zoom) - 1 - row] = path.read_bytes()
    rgba, to_crs = assemble(tiles, max(k[0] for k in tiles))
    assert scene.errors_px(source, rgba, "EPSG:3857", to_crs) < 0.1


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_world_file(scene, tmp_path, suffix):
    source = scene.source()
    files = write_picture(source, tmp_path / f"map{suffix}", crs="EPSG:3857")
    assert [f.suffix for f in files] == [suffix, {".png": ".pgw", ".jpg": ".jgw"}[suffix], ".prj"]
    # by hand, as any program reads a world file: six lines, of the upper-left pixel's centre
    a, d, b, e, c, f = (float(line) for line in files[1].read_text().split())
    rgba = np.asarray(Image.open(files[0]).convert("RGBA"))

    def to_crs(xy):
        x, y = np.asarray(xy).T
        return np.stack([a * x + b * y + c, d * x + e * y + f], axis=-1)

    assert scene.errors_px(source, rgba, "EPSG:3857", to_crs) < 0.1
    with rasterio.open(files[0]) as dataset:  # GDAL agrees, and finds the CRS in the .prj
        np.testing.assert_allclose(dataset.transform[:6], (a, b, c - a / 2, d, e, f - e / 2), atol=1e-6)
    assert rasterio.CRS.from_wkt(files[2].read_text()).to_epsg() == 3857


def test_atak_holds_the_map_where_it_is(scene, tmp_path):
    from datetime import UTC, datetime

    source = scene.source()
    write_atak(source, tmp_path / "p.zip", now=datetime(2026, 11, 25, tzinfo=UTC))
    with zipfile.ZipFile(tmp_path / "p.zip") as archive:
        archive.extract("imagery/map.mbtiles", tmp_path)
    with sqlite3.connect(tmp_path / "imagery" / "map.mbtiles") as db:
        rows = db.execute("SELECT zoom_level, tile_column, tile_row, tile_data FROM tiles").fetchall()
    tiles = {(z, x, (1 << z) - 1 - row): data for z, x, row, data in rows}
    rgba, to_crs = assemble(tiles, max(z for z, *_ in tiles))
    assert scene.errors_px(source, rgba, "EPSG:3857", to_crs) < 0.1


def test_mixed_tiles_are_told_by_their_bytes(scene, tmp_path):
    source = scene.source()
    write_tiles(source, tmp_path / "t", image_format="mixed")
    kinds = set()
    for path in (tmp_path / "t").rglob("*.png"):
        with Image.open(path) as picture:
            kinds.add(picture.format)
            if picture.format == "PNG":
                assert np.asarray(picture.convert("RGBA"))[..., 3].min() < 255
    assert kinds == {"PNG", "JPEG"}
