"""Maps of change against known truth: what came and went is found, season, drift and leaning roofs mostly are not."""

import json
import sqlite3
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import rasterio
from click.testing import CliRunner
from PIL import Image
from rasterio.warp import Resampling, calculate_default_transform, reproject
from shapely.geometry import shape

from benchmarks.compare.judge import judge
from photomap_gis.cli.app import cli
from photomap_gis.core.errors import DataError, OutputError, UsageError
from photomap_gis.pipeline.compare import compare_maps
from photomap_gis.pipeline.compare_values import CompareOutputs, CompareSettings


def test_what_came_and_went_is_found_and_little_else(compared):
    told = judge(compared.pair, compared.outputs.raster, compared.outputs.polygons)
    assert told.objects == 12
    assert told.recall >= 0.65
    assert told.precision >= 0.6
    assert told.false_m2_per_km2 < 12_000  # 1.2 %


def test_the_score_is_a_probability(compared):
    """Of the pixels that are called likely, as many have changed as the score says (within a fifth)."""
    told = judge(compared.pair, compared.outputs.raster, compared.outputs.polygons)
    low, high = told.bins[0], told.bins[4]
    assert low[1] < 0.03
    assert high[2] > 1000
    assert abs(high[1] - high[0]) < 0.2


def test_old_and_new_are_laid_on_each_other(compared):
    found = compared.summary.registration
    assert found.sure and found.agreed == found.places >= 3
    # The drift of the pair is 2 pixels of 0.16 m, one sigma.
    assert found.shift_east_m == pytest.approx(3.1, abs=1.3)
    assert found.shift_north_m == pytest.approx(-2.2, abs=1.3)


def test_the_raster_is_a_score_with_nodata_where_one_of_them_shows_nothing(compared):
    with rasterio.open(compared.outputs.raster) as dataset:
        score = dataset.read(1)
        assert dataset.count == 1 and dataset.nodata == -1.0 and dataset.crs.to_epsg() == 32632
        assert dataset.res[0] == pytest.approx(0.2, rel=0.01)
        assert dataset.tags()["REGISTERED"] == "yes"
    known = score[score != -1.0]
    assert known.min() >= 0.0 and 0.9 < known.max() <= 1.0
    assert 0.9 < len(known) / score.size < 1.0


def test_polygons_lie_where_the_score_is_high_and_carry_its_numbers(compared):
    features = json.loads(compared.outputs.polygons.read_text())["features"]
    assert len(features) == compared.summary.areas > 5
    areas = [f["properties"]["area_m2"] for f in features]
    assert areas == sorted(areas, reverse=True) and min(areas) >= compared.summary.min_area_m2
    assert sum(areas) == pytest.approx(compared.summary.changed_m2, rel=1e-3)
    for f in features:
        assert shape(f["geometry"]).is_valid
        assert 0.4 < f["properties"]["score"] <= f["properties"]["score_max"] <= 1.0


def test_the_picture_shows_three_panels(compared):
    with Image.open(compared.outputs.picture) as picture:
        assert picture.format == "PNG" and picture.width > 2.5 * picture.height


def test_nothing_has_changed_between_a_map_and_itself(compared, tmp_path):
    summary = compare_maps(compared.new, compared.new, CompareOutputs.of(tmp_path / "same.tif"))
    assert summary.areas == 0 and summary.changed_m2 == 0.0
    assert json.loads((tmp_path / "same.geojson").read_text())["features"] == []
    # A GeoPackage says the same: a layer that holds nothing, with the fields that a GIS expects.
    outputs = CompareOutputs.of(tmp_path / "same.tif", tmp_path / "same.gpkg")
    compare_maps(compared.new, compared.new, outputs)
    info = pyogrio.read_info(tmp_path / "same.gpkg", layer="change")
    assert (info["features"], info["geometry_type"]) == (0, "Polygon")
    assert list(info["fields"]) == ["id", "score", "score_max", "area_m2", "raster"]


def test_other_crs_bits_and_bands_give_the_same_areas(compared, tmp_path):
    """The old imagery in degrees, 16 bits and with an alpha band is still the same imagery."""
    other = tmp_path / "degrees.tif"
    with rasterio.open(compared.old) as source:
        place, width, height = calculate_default_transform(
            source.crs, "EPSG:4326", source.width, source.height, *source.bounds
        )
        profile = {
            "driver": "GTiff", "width": width, "height": height, "count": 4, "dtype": "uint16", "crs": "EPSG:4326",
            "transform": place, "photometric": "rgb", "alpha": "unspecified",
        }  # fmt: skip
        with rasterio.open(other, "w", **profile) as out:
            for band in range(1, 4):
                pixels = np.zeros((height, width), np.uint16)
                reproject(
                    source.read(band).astype(np.uint16) * 64, pixels, src_crs=source.crs,
                    src_transform=source.transform,
                    dst_crs="EPSG:4326", dst_transform=place, resampling=Resampling.cubic,
                )  # fmt: skip
                out.write(pixels, band)
            seen = np.zeros((height, width), np.uint16)
            reproject(
                np.full(source.shape, 65535, np.uint16), seen, src_crs=source.crs, src_transform=source.transform,
                dst_crs="EPSG:4326", dst_transform=place, resampling=Resampling.nearest,
            )  # fmt: skip
            out.write(seen, 4)
    summary = compare_maps(other, compared.new, CompareOutputs.of(tmp_path / "change.tif"))
    assert summary.crs == "EPSG:32632" and summary.registration.sure
    assert summary.changed_m2 == pytest.approx(compared.summary.changed_m2, rel=0.35)


def test_threads_do_not_change_the_result(compared, tmp_path):
    alone = CompareOutputs.of(tmp_path / "one.tif")
    compare_maps(compared.old, compared.new, alone, CompareSettings(workers=1))
    with rasterio.open(alone.raster) as a, rasterio.open(compared.outputs.raster) as b:
        assert np.array_equal(a.read(1), b.read(1))


def test_the_command_writes_a_geopackage_and_one_document(compared, tmp_path):
    out = tmp_path / "out" / "c.tif"
    out.parent.mkdir()
    words = ["compare", str(compared.old), str(compared.new), "-o", str(out), "--polygons", str(tmp_path / "c.gpkg"),
             "--min-area", "20", "--gsd", "0.4", "--json", "-q"]  # fmt: skip
    result = CliRunner().invoke(cli, words, standalone_mode=False)
    document = json.loads(result.stdout)
    assert document["min_area_m2"] == 20 and document["gsd_m_per_px"] == 0.4
    assert all(Path(p).is_file() for p in document["outputs"])
    with sqlite3.connect(tmp_path / "c.gpkg") as db:
        rows = db.execute("SELECT area_m2, score FROM change").fetchall()
        (organization,) = db.execute(
            "SELECT organization FROM gpkg_spatial_ref_sys JOIN gpkg_contents USING (srs_id)"
        ).fetchone()
    db.close()
    assert len(rows) == document["areas"] > 0 and min(r[0] for r in rows) >= 20 and organization == "EPSG"


def _picture(path: Path, west: float, crs: str | None = "EPSG:32632", side: int = 100) -> Path:
    profile = {"driver": "GTiff", "width": side, "height": side, "count": 1, "dtype": "uint8", "crs": crs}
    with rasterio.open(path, "w", transform=rasterio.Affine(1, 0, west, 0, -1, 5_800_000), **profile) as out:
        out.write(np.random.default_rng(1).integers(1, 255, (1, side, side), dtype=np.uint8))
    return path


def test_imagery_of_two_places_cannot_be_compared(tmp_path):
    a, b = _picture(tmp_path / "a.tif", 400_000), _picture(tmp_path / "b.tif", 401_000)
    with pytest.raises(DataError, match="do not overlap: they lie 900 m apart"):
        compare_maps(a, b, CompareOutputs.of(tmp_path / "c.tif"))
    assert not (tmp_path / "c.tif").exists()


def test_unusable_inputs_say_what_to_do(tmp_path):
    a = _picture(tmp_path / "a.tif", 400_000)
    (tmp_path / "text.tif").write_text("no raster")
    for bad, words in (
        (tmp_path / "none.tif", "no such file"),
        (tmp_path / "text.tif", "cannot be read"),
        (_picture(tmp_path / "b.tif", 400_000, crs=None), "no CRS"),
        (tmp_path, "no mission folder"),
    ):
        with pytest.raises(DataError, match=words):
            compare_maps(bad, a, CompareOutputs.of(tmp_path / "c.tif"))
    with pytest.raises(UsageError, match="input of the comparison"):
        compare_maps(a, a, CompareOutputs(a, tmp_path / "c.geojson", tmp_path / "c.png"))
    with pytest.raises(OutputError, match="does not exist"):
        compare_maps(a, a, CompareOutputs.of(tmp_path / "nowhere" / "c.tif"))
    with pytest.raises(OutputError, match="cannot be made"):
        CompareOutputs.of(a / "folder")
    with pytest.raises(UsageError, match="threshold"):
        CompareSettings(threshold=1.5)
    with pytest.raises(UsageError, match=r"end in \.tif"):
        CompareOutputs.of(tmp_path / "c.jpg")


def test_imagery_that_does_not_fit_is_said_to_be_unsure(tmp_path):
    rng = np.random.default_rng(3)
    paths = []
    for name in "ab":
        path = tmp_path / f"{name}.tif"
        profile = {"driver": "GTiff", "width": 300, "height": 300, "count": 3, "dtype": "uint8", "crs": "EPSG:32632"}
        with rasterio.open(path, "w", transform=rasterio.Affine(1, 0, 400_000, 0, -1, 5_800_000), **profile) as out:
            out.write(rng.integers(1, 255, (3, 300, 300), dtype=np.uint8))
        paths.append(path)
    summary = compare_maps(*paths, CompareOutputs.of(tmp_path / "c.tif"))
    assert not summary.registration.sure
    assert any("could not be laid on each other" in w for w in summary.warnings)


def test_boxes_on_a_real_orthophoto_are_found_and_nothing_else(shared_data, tmp_path):
    """Darker, moved by 1.2 m, and with three new boxes: 24, 32 and 9 square metres."""
    with Image.open(shared_data / "ortho_yellowstone" / "2019_YELL_2_541000_4977000_image_crop.png") as picture:
        ground = np.asarray(picture.convert("RGB"))
    new = np.clip(ground * 0.8 + 10.0, 0, 255).astype(np.uint8)
    for x, y, w, h in ((200, 200, 60, 40), (800, 300, 40, 80), (500, 700, 30, 30)):
        new[y : y + h, x : x + w] = (200, 60, 40)
    for name, pixels, west in (("old", ground, 541_000.0), ("new", new, 541_001.2)):
        height, width = pixels.shape[:2]
        profile = {"driver": "GTiff", "width": width, "height": height, "count": 3, "dtype": "uint8"}
        place = rasterio.Affine(0.1, 0, west, 0, -0.1, 4_978_000)
        with rasterio.open(tmp_path / f"{name}.tif", "w", crs="EPSG:32612", transform=place, **profile) as out:
            out.write(pixels.transpose(2, 0, 1))
    summary = compare_maps(tmp_path / "old.tif", tmp_path / "new.tif", CompareOutputs.of(tmp_path / "c.tif"))
    assert summary.areas == 3
    assert summary.registration.shift_east_m == pytest.approx(-1.2, abs=0.02)
    assert summary.changed_m2 == pytest.approx(65.0, rel=0.25)
