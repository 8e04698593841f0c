"""Layers as rasters: on the map's exact grid, lossless, units in their tags, the nearest pixel in another CRS."""

import warnings

import numpy as np
import pytest
import rasterio
import rasterio.warp
from rio_cogeo.cogeo import cog_validate

from photomap_gis.core.errors import OutputError
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.layer import LAYERS, Layer, empty
from photomap_gis.export import target_grid, write_layers
from photomap_gis.export.crs import parse_crs

UTM = parse_crs("EPSG:32632").to_wkt()
GRID = MapGrid(UTM, 476_000.0, 5_890_700.0, 0.25, 1300, 900)


class Made:
    """Layers whose every pixel tells its place; the first hundred columns were never seen."""

    def __init__(self, grid=GRID):
        self.grid = grid

    def read(self, layer, window):
        out = empty(layer, window.height, window.width)
        col, row = np.meshgrid(np.arange(window.width) + window.col_off, np.arange(window.height) + window.row_off)
        inside = (col >= 100) & (col < self.grid.width) & (row >= 0) & (row < self.grid.height)
        for band in range(len(out)):
            out[band][inside] = (1 + band + col // 20 + 10 * (row // 20)).astype(out.dtype)[inside]
        return out


def test_every_layer_is_a_cog_on_the_maps_grid(tmp_path):
    calls = []
    files = write_layers(Made(), tmp_path / "layers", metadata={"A": "b"}, on_progress=lambda *c: calls.append(c))
    assert [f.name for f in files] == [f"{layer}.tif" for layer in Layer]
    assert calls[-1][0] == calls[-1][1] == len(calls)
    for layer, path in zip(Layer, files, strict=True):
        spec = LAYERS[layer]
        assert cog_validate(str(path), quiet=True)[0]
        with rasterio.open(path) as raster:
            assert raster.transform[:6] == pytest.approx(GRID.transform) and raster.shape == (900, 1300)
            assert raster.crs.to_epsg() == 32632 and set(raster.dtypes) == {spec.dtype}
            assert raster.units == tuple(b.unit for b in spec.bands)
            assert raster.descriptions == tuple(b.name for b in spec.bands)
            assert np.array_equal([raster.nodata], [spec.nodata], equal_nan=True)
            tags = raster.tags()
            assert tags["A"] == "b" and tags["LAYER"] == layer
            assert all(tags[f"UNIT_{b.name.upper()}"] == b.unit for b in spec.bands)
            assert np.array_equal(raster.read(), whole(layer), equal_nan=True)
            assert not raster.read_masks(1)[:, :100].any() and raster.read_masks(1)[:, 100:].all()


def whole(layer):
    return Made().read(layer, Window(0, 0, GRID.width, GRID.height))


def test_overviews_never_mix_frames(tmp_path):
    files = write_layers(Made(), tmp_path / "layers")
    by_layer = dict(zip(Layer, files, strict=True))
    with rasterio.open(by_layer[Layer.SOURCE_FRAME], overview_level=0) as raster:
        assert set(np.unique(raster.read())) <= set(np.unique(whole(Layer.SOURCE_FRAME)))


def test_overviews_are_every_other_pixel_or_the_mean_of_what_is_known(tmp_path):
    """A twin: the whole layer, halved at once; its sides are odd at the second level."""
    files = write_layers(Made(MapGrid(UTM, 476_000.0, 5_890_700.0, 0.25, 2053, 1027)), tmp_path / "layers")
    for layer, path in zip(Layer, files, strict=True):
        with rasterio.open(path) as raster:
            values, counts = raster.read().astype(float), raster.overviews(1)
        assert counts == [2, 4, 8]
        values[values == LAYERS[layer].nodata] = np.nan
        for level in range(3):
            tall, wide = -(-values.shape[1] // 2), -(-values.shape[2] // 2)
            padded = np.full((len(values), 2 * tall, 2 * wide), np.nan)
            padded[:, : values.shape[1], : values.shape[2]] = values
            four = padded.reshape(len(values), tall, 2, wide, 2)
            with np.errstate(invalid="ignore"), warnings.catch_warnings(action="ignore"):
                values = np.nanmean(four, axis=(2, 4)) if LAYERS[layer].averaged else four[:, :, 0, :, 0]
            with rasterio.open(path, overview_level=level) as raster:
                got = raster.read().astype(float)
            got[got == LAYERS[layer].nodata] = np.nan
            assert np.allclose(got, values, rtol=1e-5, equal_nan=True)


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:3857"])
def test_in_another_crs_each_pixel_is_its_nearest(tmp_path, crs):
    grid = target_grid(GRID, crs)
    files = write_layers(Made(), tmp_path / "layers", grid=grid)
    with rasterio.open(files[0]) as raster:
        assert raster.crs.to_string() == crs and raster.shape == (grid.height, grid.width)
        values = raster.read(1)
        rows, cols = (v[::997] for v in np.nonzero(values))
        x, y = raster.xy(rows, cols)
        e, n = rasterio.warp.transform(crs, "EPSG:32632", x, y)
    px = GRID.to_px(np.stack([e, n], axis=1))
    off = np.abs(px - np.rint(px)).max(axis=1)
    col, row = np.rint(px).astype(int).T
    expected = 1 + col // 20 + 10 * (row // 20)
    sure = off < 0.48
    assert sure.sum() > 500 and np.array_equal(values[rows, cols][sure], expected[sure])


def test_a_relative_map_has_layers_too(tmp_path):
    files = write_layers(Made(MapGrid(None, 0.0, 0.0, 1.0, 300, 200)), tmp_path / "layers")
    with rasterio.open(files[0]) as raster:
        assert "NOT GEOREFERENCED" in raster.tags()["GEOREFERENCE"] and raster.shape == (200, 300)


def test_a_folder_of_other_things_is_not_touched(tmp_path):
    (tmp_path / "mine.txt").write_text("dear")
    with pytest.raises(OutputError, match="other files"):
        write_layers(Made(MapGrid(None, 0.0, 0.0, 1.0, 30, 20)), tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]
    folder = tmp_path / "layers"
    first = write_layers(Made(MapGrid(None, 0.0, 0.0, 1.0, 30, 20)), folder)
    assert write_layers(Made(MapGrid(None, 0.0, 0.0, 1.0, 31, 20)), folder) == first
    with rasterio.open(first[0]) as raster:
        assert raster.width == 31
