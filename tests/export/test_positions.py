"""Every format puts every landmark where it is: nothing mirrored, turned, or half a pixel off."""

import io
import json
import sqlite3
import zipfile

import numpy as np
import pytest
import rasterio
from PIL import Image

from photomap_gis.core.grid import MapGrid
from photomap_gis.export import write_geotiff, write_kmz, write_mbtiles, write_tiles

HALF_WORLD = np.pi * 6378137.0


def read_raster(path):
    with rasterio.open(path) as dataset:
        rgba = dataset.read().transpose(1, 2, 0)
        transform = dataset.transform

        def to_crs(xy):
            x, y = (np.asarray(xy) + 0.5).T
            a, b, c, d, e, f = tuple(transform)[:6]
            return np.stack([a * x + b * y + c, d * x + e * y + f], axis=-1)

        return rgba, dataset.crs.to_wkt(), to_crs


def assemble(tiles: dict[tuple[int, int, int], bytes], zoom: int):
    """One picture of the tiles of a zoom, and the way from its pixels to Web Mercator."""
    tiles = {k: v for k, v in tiles.items() if k[0] == zoom}
    if max(k[1] for k in tiles) - min(k[1] for k in tiles) > 2 ** (zoom - 1):  # columns start again from the west
        tiles = {(z, x + 2**z if x < 2 ** (z - 1) else x, y): v for (z, x, y), v in tiles.items()}
    keys = list(tiles)
    x0, y0 = min(k[1] for k in keys), min(k[2] for k in keys)
    x1, y1 = max(k[1] for k in keys), max(k[2] for k in keys)
    canvas = np.zeros(((y1 - y0 + 1) * 256, (x1 - x0 + 1) * 256, 4), np.uint8)
    for key in keys:
        picture = np.asarray(Image.open(io.BytesIO(tiles[key])).convert("RGBA"))
        canvas[(key[2] - y0) * 256 :, (key[1] - x0) * 256 :][:256, :256] = picture
    size = 2 * HALF_WORLD / (256 << zoom)
    grid = MapGrid("x", -HALF_WORLD + x0 * 256 * size, HALF_WORLD - y0 * 256 * size, size, 1, 1)
    return canvas, grid.to_crs


def test_geotiff_in_its_own_crs_is_exact(placed, scene, tmp_path):
    write_geotiff(placed, tmp_path / "map.tif")
    rgba, crs, to_crs = read_raster(tmp_path / "map.tif")
    assert scene.errors_px(placed, rgba, crs, to_crs) < 0.02
    seen = placed.rgba[..., 3] > 0
    np.testing.assert_array_equal(rgba[seen], placed.rgba[seen])
    assert (rgba[~seen][:, 3] == 0).all()


@pytest.mark.parametrize("crs", ["EPSG:3857", "EPSG:4326", "EPSG:3035"])
def test_geotiff_in_another_crs(scene, tmp_path, crs):
    source = scene.source()
    write_geotiff(source, tmp_path / "map.tif", crs=crs)
    rgba, written, to_crs = read_raster(tmp_path / "map.tif")
    assert rasterio.CRS.from_wkt(written).to_epsg() == int(crs[5:])
    assert scene.errors_px(source, rgba, written, to_crs) < 0.1


def test_geotiff_to_a_far_crs_everywhere(placed, scene, tmp_path):
    write_geotiff(placed, tmp_path / "map.tif", crs="EPSG:4326")
    assert scene.errors_px(placed, *read_raster(tmp_path / "map.tif")) < 0.1


@pytest.mark.parametrize("pixel_size", [0.1, 0.6, 1.1])
def test_geotiff_at_another_pixel_size(scene, tmp_path, pixel_size):
    source = scene.source()
    write_geotiff(source, tmp_path / "map.tif", pixel_size=pixel_size)
    rgba, crs, to_crs = read_raster(tmp_path / "map.tif")
    assert scene.errors_px(source, rgba, crs, to_crs) < 0.25


def test_tiles(placed, scene, tmp_path):
    write_tiles(placed, tmp_path / "tiles")
    document = json.loads((tmp_path / "tiles" / "tiles.json").read_text())
    tiles = {
        (int(p.parts[-3]), int(p.parts[-2]), int(p.stem)): p.read_bytes() for p in (tmp_path / "tiles").rglob("*.png")
    }
    rgba, to_crs = assemble(tiles, document["maxzoom"])
    assert scene.errors_px(placed, rgba, "EPSG:3857", to_crs) < 0.1
    rgba, to_crs = assemble(tiles, document["maxzoom"] - 1)
    assert scene.errors_px(placed, rgba, "EPSG:3857", to_crs) < 0.3


def test_mbtiles_rows_count_from_the_south(scene, tmp_path):
    source = scene.source()
    write_mbtiles(source, tmp_path / "map.mbtiles")
    with sqlite3.connect(tmp_path / "map.mbtiles") as db:
        rows = db.execute("SELECT zoom_level, tile_column, tile_row, tile_data FROM tiles").fetchall()
    tiles = {(z, x, (1 << z) - 1 - row): data for z, x, row, data in rows}
    rgba, to_crs = assemble(tiles, max(z for z, *_ in tiles))
    assert scene.errors_px(source, rgba, "EPSG:3857", to_crs) < 0.1
    rgba, crs, to_crs = read_raster(tmp_path / "map.mbtiles")  # GDAL's own reading of it
    assert scene.errors_px(source, rgba, crs, to_crs) < 0.1


def test_kmz(placed, scene, tmp_path):
    write_kmz(placed, tmp_path / "map.kmz")
    assert scene.errors_px(placed, *read_raster(tmp_path / "map.kmz")) < 0.1


def test_kml_beside_its_folder(scene, tmp_path):
    source = scene.source()
    write_kmz(source, tmp_path / "my map.kml")
    assert scene.errors_px(source, *read_raster(tmp_path / "my map.kml")) < 0.1


def test_kmz_overlay_for_simple_programs(scene, tmp_path):
    from xml.etree import ElementTree

    source = scene.source()
    write_kmz(source, tmp_path / "map.kmz")
    with zipfile.ZipFile(tmp_path / "map.kmz") as archive:
        root = ElementTree.fromstring(archive.read("doc.kml"))
        overlay = root.find(".//{*}Document/{*}GroundOverlay")
        picture = np.asarray(Image.open(archive.open(overlay.find("{*}Icon/{*}href").text)).convert("RGBA"))
    edge = {n: float(overlay.find(f"{{*}}LatLonBox/{{*}}{n}").text) for n in ("north", "south", "east", "west")}
    height, width = picture.shape[:2]

    def to_crs(xy):
        x, y = (np.asarray(xy) + 0.5).T / [[width], [height]]
        lon = edge["west"] + x * (edge["east"] - edge["west"])
        return np.stack([lon, edge["north"] - y * (edge["north"] - edge["south"])], axis=-1)

    assert scene.errors_px(source, picture, "EPSG:4326", to_crs) < 0.1
