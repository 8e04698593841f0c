"""Any picture, any GeoTIFF."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio

from photomap_gis.core.errors import DataError
from photomap_gis.simulate.geodesy import GeoFrame, utm_wkt
from photomap_gis.simulate.ground import Ground, load_ground, placed_ground, read_ground, write_ground


@pytest.fixture
def picture(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 256, (90, 120, 3), dtype=np.uint8)


def test_a_picture_is_laid_on_land(tmp_path: Path, picture: np.ndarray) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    ground = load_ground(tmp_path / "a.png", pixel_size_m=0.5)
    assert np.array_equal(ground.colour, picture)
    assert ground.height_m is None
    lon, lat = GeoFrame(ground.crs_wkt).to_lon_lat([ground.centre_en_m])[0]
    assert (lat, lon) == pytest.approx((53.168, 8.649), abs=1e-4)


def test_an_origin_in_the_south_is_kept(tmp_path: Path, picture: np.ndarray) -> None:
    cv2.imwrite(str(tmp_path / "a.jpg"), picture)
    ground = load_ground(tmp_path / "a.jpg", origin_lat_lon=(-33.9, 18.4))
    lon, lat = GeoFrame(ground.crs_wkt).to_lon_lat([ground.centre_en_m])[0]
    assert (lat, lon) == pytest.approx((-33.9, 18.4), abs=1e-4)


def test_a_geotiff_keeps_its_place(tmp_path: Path, picture: np.ndarray) -> None:
    _write(tmp_path / "a.tif", picture[..., ::-1].transpose(2, 0, 1), "EPSG:32633", _north_up(500100, 5800200, 0.2))
    ground = load_ground(tmp_path / "a.tif")
    assert (ground.west, ground.north, ground.pixel_size_m) == (500100, 5800200, 0.2)
    assert np.array_equal(ground.colour, picture)


def test_degrees_become_metres(tmp_path: Path, picture: np.ndarray) -> None:
    _write(tmp_path / "a.tif", picture.transpose(2, 0, 1), "EPSG:4326", _north_up(8.6, 53.2, 2e-6))
    ground = load_ground(tmp_path / "a.tif")
    assert 0.1 < ground.pixel_size_m < 0.3
    lon, lat = GeoFrame(ground.crs_wkt).to_lon_lat([ground.centre_en_m])[0]
    assert (lon, lat) == pytest.approx((8.6 + 60 * 2e-6, 53.2 - 45 * 2e-6), abs=1e-5)


def test_deep_grey_is_stretched_and_palettes_are_looked_up(tmp_path: Path, rng: np.random.Generator) -> None:
    deep = (rng.random((1, 50, 60)) * 3000 + 20000).astype(np.uint16)
    _write(tmp_path / "deep.tif", deep, "EPSG:32633", _north_up(0, 100, 1))
    colour = load_ground(tmp_path / "deep.tif").colour
    assert colour.shape == (50, 60, 3)
    assert colour.min() == 0 and colour.max() == 255
    with rasterio.open(
        tmp_path / "palette.tif", "w", driver="GTiff", width=4, height=4, count=1, dtype="uint8", crs="EPSG:32633",
        transform=_north_up(0, 100, 1),
    ) as out:  # fmt: skip
        out.write(np.full((1, 4, 4), 7, np.uint8))
        out.write_colormap(1, {7: (10, 20, 30, 255)})
    assert tuple(load_ground(tmp_path / "palette.tif").colour[0, 0]) == (30, 20, 10)


def test_a_huge_ground_is_cut_to_its_middle(
    tmp_path: Path, picture: np.ndarray, caplog: pytest.LogCaptureFixture
) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    ground = load_ground(tmp_path / "a.png", max_side_px=40)
    assert np.array_equal(ground.colour, picture[25:65, 40:80])
    assert "only its middle" in caplog.text


def test_heights_by_place_and_by_outline(tmp_path: Path, picture: np.ndarray) -> None:
    _write(tmp_path / "a.tif", picture.transpose(2, 0, 1), "EPSG:32633", _north_up(1000, 2000, 1))
    dem = np.arange(30, dtype=np.float32)[None, None, :].repeat(24, axis=1)
    _write(tmp_path / "dem.tif", dem, "EPSG:32633", _north_up(1000, 2004, 5))
    ground = load_ground(tmp_path / "a.tif", height_path=tmp_path / "dem.tif")
    assert ground.height_m is not None
    assert ground.height_m[40, 52] == pytest.approx(10.0, abs=0.11)
    np.save(tmp_path / "x.npy", dem)
    cv2.imwrite(str(tmp_path / "plain.png"), np.full((9, 12), 42, np.uint8))
    stretched = load_ground(tmp_path / "a.tif", height_path=tmp_path / "plain.png")
    assert stretched.height_m is not None and (stretched.height_m == 42.0).all()


@pytest.mark.parametrize("content", [None, b"", b"this is no picture at all"])
def test_what_is_no_picture_is_one_line(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "a.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DataError) as error:
        load_ground(path)
    assert "\n" not in str(error.value)


def test_a_written_ground_reads_back(tmp_path: Path, picture: np.ndarray, rng: np.random.Generator) -> None:
    heights = rng.normal(0, 5, picture.shape[:2]).astype(np.float32)
    ground = placed_ground(picture, heights, pixel_size_m=0.25)
    write_ground(ground, tmp_path / "g.tif", tmp_path / "h.tif")
    back = read_ground(tmp_path / "g.tif", tmp_path / "h.tif")
    assert np.array_equal(back.colour, picture)
    assert back.height_m is not None and np.abs(back.height_m - heights).max() < 1e-3
    assert (back.west, back.north, back.pixel_size_m) == (ground.west, ground.north, 0.25)


def test_heights_between_pixels_are_bilinear() -> None:
    height = np.array([[0.0, 1.0], [2.0, 3.0]], np.float32)
    ground = Ground(np.zeros((2, 2, 3), np.uint8), height, 1.0, 0.0, 2.0, utm_wkt(50, 8))
    assert ground.heights_at([(1.0, 1.0), (0.5, 1.5), (99.0, 99.0)]) == pytest.approx([1.5, 0.0, 1.0])


def _write(path: Path, bands: np.ndarray, crs: str, transform: rasterio.Affine) -> None:
    with rasterio.open(
        path, "w", driver="GTiff", count=len(bands), height=bands.shape[1], width=bands.shape[2], dtype=bands.dtype,
        crs=crs, transform=transform,
    ) as out:  # fmt: skip
        out.write(bands)


def _north_up(west: float, north: float, size: float) -> rasterio.Affine:
    return rasterio.Affine(size, 0.0, west, 0.0, -size, north)
