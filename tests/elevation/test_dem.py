"""Heights of the ground from elevation models."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin
from rasterio.warp import transform

from photomap_gis.core.errors import DataError
from photomap_gis.elevation import open_dem

WEST, NORTH, PIXEL = 500_000.0, 5_700_000.0, 10.0


def write_dem(path: Path, heights: np.ndarray, *, crs: str | None = "EPSG:32632", nodata: float | None = None) -> Path:
    rows, columns = heights.shape
    with rasterio.open(
        path, "w", driver="GTiff", width=columns, height=rows, count=1, dtype="float32", crs=crs,
        transform=from_origin(WEST, NORTH, PIXEL, PIXEL), nodata=nodata,
    ) as dataset:  # fmt: skip
        dataset.write(heights.astype(np.float32), 1)
    return path


def lonlat(east, north) -> np.ndarray:
    return np.stack(transform("EPSG:32632", "EPSG:4326", np.atleast_1d(east), np.atleast_1d(north)), axis=1)


def heights(path: Path, lonlat_deg: np.ndarray) -> np.ndarray:
    return open_dem(path).elevation_m(lonlat_deg[:, ::-1])


def plane(east, north):
    return 100.0 + 0.05 * (np.asarray(east) - WEST) - 0.02 * (np.asarray(north) - NORTH)


@pytest.fixture
def slope(tmp_path: Path) -> Path:
    row, column = np.mgrid[0:40, 0:50]
    return write_dem(tmp_path / "dem.tif", plane(WEST + PIXEL * (column + 0.5), NORTH - PIXEL * (row + 0.5)))


def test_heights_of_a_plane_are_those_of_the_plane_between_pixels_too(rng, slope):
    east, north = WEST + rng.uniform(10, 490, 50), NORTH - rng.uniform(10, 390, 50)
    assert heights(slope, lonlat(east, north)) == pytest.approx(plane(east, north), abs=1e-3)


def test_beyond_the_model_there_is_no_height(slope):
    found = heights(slope, lonlat([WEST + 100, WEST - 100], [NORTH - 100, NORTH - 100]))
    assert np.isfinite(found).tolist() == [True, False]


def test_holes_stay_holes_and_do_not_spread(tmp_path):
    known = np.full((20, 20), 50.0)
    known[10, 10] = -9999.0
    path = write_dem(tmp_path / "dem.tif", known, nodata=-9999.0)
    middle = WEST + PIXEL * 10.5, NORTH - PIXEL * 10.5
    found = heights(path, lonlat([middle[0], middle[0] + 2 * PIXEL], [middle[1], middle[1]]))
    assert np.isnan(found[0]) and found[1] == 50.0


@pytest.mark.parametrize("east", [WEST - 5_000.0, WEST + 50_000.0])
def test_a_model_of_another_place_knows_nothing(slope, east):
    assert np.isnan(heights(slope, lonlat(east, NORTH))).all()


def test_what_is_no_elevation_model_is_told_at_once(tmp_path):
    with pytest.raises(DataError, match="no such file"):
        open_dem(tmp_path / "none.tif")
    (tmp_path / "text.tif").write_text("heights")
    with pytest.raises(DataError, match="cannot be read"):
        open_dem(tmp_path / "text.tif")
    with pytest.raises(DataError, match="not where on Earth"):
        open_dem(write_dem(tmp_path / "bare.tif", np.zeros((4, 4)), crs=None))
