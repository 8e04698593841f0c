"""The GeoTIFF itself: layout, alpha, overviews, words."""

import numpy as np
import pytest
import rasterio
from rasterio.enums import ColorInterp
from rio_cogeo.cogeo import cog_validate

from photomap_gis.core.errors import NotGeoreferencedError, UsageError
from photomap_gis.core.grid import MapGrid
from photomap_gis.export import write_geotiff

UTM33 = rasterio.CRS.from_epsg(32633).to_wkt()


def large(scene, rng, width=2300, height=1700):
    """Smooth enough to compress, larger than a read and several blocks, with nothing seen on the left."""
    rgba = np.zeros((height, width, 4), np.uint8)
    rgba[..., :3] = rng.integers(60, 200, (height // 100, width // 100, 3)).repeat(100, 0).repeat(100, 1)
    rgba[..., 3] = 255
    rgba[:, :700] = (*scene.hidden, 0)
    return scene.of_array(rgba, MapGrid(UTM33, 391_000.0, 5_820_000.0, 0.05, width, height))


def test_layout(scene, rng, tmp_path):
    source = large(scene, rng)
    grid = write_geotiff(source, tmp_path / "map.tif", metadata={"PHOTOMAP_DATE": "2026-11-22", "ATTRIBUTION": "Äé"})
    assert grid == source.grid
    valid, errors, warnings = cog_validate(tmp_path / "map.tif", strict=True, quiet=True)
    assert valid, (errors, warnings)
    with rasterio.open(tmp_path / "map.tif") as dataset:
        assert dataset.crs.to_epsg() == 32633
        assert dataset.colorinterp == (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
        assert dataset.block_shapes[0] == (512, 512)
        assert dataset.overviews(1) == [2, 4, 8]
        assert dataset.nodata is None
        assert dataset.compression.value == "DEFLATE"
        tags = dataset.tags()
        assert tags["PHOTOMAP_DATE"] == "2026-11-22"
        assert tags["ATTRIBUTION"] == "Äé"
        assert tags["AREA_OR_POINT"] == "Area"
        assert tuple(dataset.transform)[:6] == source.grid.transform
        np.testing.assert_array_equal(dataset.read()[:, :, 700:], source.rgba[:, 700:].transpose(2, 0, 1))
        assert not dataset.read()[:, :, :700].any()


def test_overviews_are_means_of_what_was_seen(scene, rng, tmp_path):
    source = large(scene, rng)
    source.rgba[:, 701::2, :3] = 40  # stripes
    source.rgba[:, 700::2, :3] = 160
    write_geotiff(source, tmp_path / "map.tif")
    with rasterio.open(tmp_path / "map.tif", overview_level=1) as dataset:
        rgba = dataset.read()
    seen = rgba[3] > 0
    assert abs(int(seen.sum()) - 425 * 400) <= 425
    np.testing.assert_allclose(rgba[0][seen].astype(int), 100, atol=31)  # the border cell holds one stripe more
    np.testing.assert_allclose(rgba[0][:, 180:].astype(int), 100, atol=1)


@pytest.mark.parametrize("compression", ["ZSTD", "LZW", "NONE", "WEBP", "JPEG"])
def test_compressions(scene, tmp_path, compression):
    source = scene.source()
    write_geotiff(source, tmp_path / "map.tif", compression=compression)
    assert cog_validate(tmp_path / "map.tif", strict=True, quiet=True)[0]
    with rasterio.open(tmp_path / "map.tif") as dataset:
        np.testing.assert_array_equal(dataset.dataset_mask() > 0, source.rgba[..., 3] > 0)
        picture = dataset.read((1, 2, 3)).astype(int)
    seen = source.rgba[..., 3] > 0
    assert np.abs(picture[:, seen] - source.rgba[seen][:, :3].T).mean() < (
        4 if compression in ("WEBP", "JPEG") else 1e-9
    )


@pytest.mark.parametrize(
    ("width", "height"), [(1, 1), (3, 700), (513, 1), (512, 512), (1025, 513), (1024, 1536), (512, 1100)]
)
def test_odd_sizes(scene, rng, tmp_path, width, height):
    rgba = rng.integers(0, 256, (height, width, 4), dtype=np.uint8)
    rgba[..., 3] = 255
    write_geotiff(
        scene.of_array(rgba, MapGrid(UTM33, 391_000.0, 5_820_000.0, 0.1, width, height)), tmp_path / "map.tif"
    )
    with rasterio.open(tmp_path / "map.tif") as dataset:
        np.testing.assert_array_equal(dataset.read().transpose(1, 2, 0), rgba)


def test_a_map_that_shows_nothing_is_still_a_map(scene, tmp_path):
    rgba = np.zeros((600, 700, 4), np.uint8)
    write_geotiff(scene.of_array(rgba, MapGrid(UTM33, 391_000.0, 5_820_000.0, 0.1, 700, 600)), tmp_path / "map.tif")
    with rasterio.open(tmp_path / "map.tif") as dataset:
        assert not dataset.read().any()


def test_local_maps_say_so_and_have_no_epsg(scene, tmp_path):
    write_geotiff(scene.source(None, -50.0, 80.0, 1.0), tmp_path / "map.tif")
    assert cog_validate(tmp_path / "map.tif", strict=True, quiet=True)[0]
    with rasterio.open(tmp_path / "map.tif") as dataset:
        assert dataset.crs is None or dataset.crs.to_epsg() is None
        assert "NOT GEOREFERENCED" in dataset.tags()["GEOREFERENCE"]
        assert not dataset.crs.is_projected
        assert not dataset.crs.is_geographic
        assert tuple(dataset.transform)[:6] == (1.0, 0.0, -50.0, 0.0, -1.0, 80.0)


def test_local_maps_cannot_be_reprojected(scene, tmp_path):
    with pytest.raises(NotGeoreferencedError, match="--track"):
        write_geotiff(scene.source(None), tmp_path / "map.tif", crs="EPSG:3857")
    with pytest.raises(UsageError, match="leave out"):
        write_geotiff(scene.source(None), tmp_path / "map.tif", pixel_size=2.0)


def test_wrong_arguments(scene, tmp_path):
    with pytest.raises(ValueError, match="compression must be one of"):
        write_geotiff(scene.source(), tmp_path / "map.tif", compression="ZIP")
    with pytest.raises(UsageError, match="pixel size"):
        write_geotiff(scene.source(), tmp_path / "map.tif", pixel_size=0.0)
    with pytest.raises(UsageError, match="choose larger"):
        write_geotiff(scene.source(), tmp_path / "map.tif", pixel_size=1e-9)
    assert list(tmp_path.iterdir()) == []


def test_progress_and_bounded_reads(scene, rng, tmp_path):
    source, seen = large(scene, rng), []
    write_geotiff(source, tmp_path / "map.tif", on_progress=lambda done, total: seen.append((done, total)))
    assert seen[-1][0] == seen[-1][1]
    assert [d for d, _ in seen] == sorted(d for d, _ in seen)
    assert max(w.width * w.height for w in source.windows) <= 2048 * 512
