"""A real photograph keeps its sharpness on the way."""

import cv2
import numpy as np
import pytest
from pyproj import CRS

from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.export import target_grid, warped
from photomap_gis.export.encode import TileFormat, encode

pytestmark = pytest.mark.shared


@pytest.fixture(scope="module")
def photo(shared_data) -> np.ndarray:
    """``(900, 1000, 4)`` RGBA of an airborne picture: trees, grass, dead wood."""
    bgr = cv2.imread(str(shared_data / "ortho_yellowstone" / "2019_YELL_2_541000_4977000_image_crop.png"))
    return cv2.cvtColor(bgr[:900, :1000], cv2.COLOR_BGR2RGBA)


def psnr(a, b):
    return 10 * np.log10(255**2 / np.mean((a.astype(float) - b) ** 2))


def energy(rgba):
    grey = cv2.cvtColor(rgba, cv2.COLOR_RGBA2GRAY).astype(np.float32)
    return float(np.mean(cv2.Sobel(grey, cv2.CV_32F, 1, 0) ** 2))


def test_there_and_back(photo, scene):
    source = scene.of_array(photo, MapGrid(CRS.from_epsg(32612).to_wkt(), 541_000.0, 4_977_000.0, 0.1, 1000, 900))
    there = warped(source, target_grid(source.grid, "EPSG:3857"))
    back = warped(there, source.grid).read(Window(0, 0, 1000, 900))
    inner = (slice(10, -10), slice(10, -10))
    assert (back[inner][..., 3] == 255).all()
    # twice bicubic on noise-sharp texture; a shift of half a pixel would give 22 dB
    assert psnr(back[inner][..., :3], photo[inner][..., :3]) > 26
    assert 0.6 < energy(back[inner]) / energy(photo[inner]) < 1.1


@pytest.mark.parametrize(
    ("tile_format", "least_db"), [(TileFormat.PNG, 99), (TileFormat.WEBP, 28), (TileFormat.JPG, 30)]
)
def test_tiles_of_a_photo(photo, tile_format, least_db):
    tile = np.ascontiguousarray(photo[200:456, 300:556])
    data = encode(tile, tile_format)
    back = cv2.cvtColor(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    with np.errstate(divide="ignore"):
        assert psnr(back, tile[..., :3]) > least_db
