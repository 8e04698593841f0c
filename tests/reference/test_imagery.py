"""Existing imagery is read where it lies: any grid, CRS, depth and transparency; what has no place is told so."""

import math

import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Transformer

from photomap_gis.core.errors import DataError
from photomap_gis.core.grid import MapGrid
from photomap_gis.reference import ReferenceImage

UTM = rasterio.crs.CRS.from_epsg(32632)
WKT = UTM.to_wkt()
WEST, NORTH = 500_000.0, 5_500_000.0


def brightness(east, north):
    """A smooth ground: what a picture shows at a place is known everywhere."""
    return 120 + 60 * np.sin((east - WEST) / 9.0) + 50 * np.cos((north - NORTH) / 7.0)


def write(path, transform, shape, *, crs=UTM, dtype="uint8", bands=1, gain=1.0, to_utm=None, **profile):
    """Write the ground as a raster with a geotransform sees it; ``to_utm`` maps its CRS to UTM."""
    col, row = np.meshgrid(np.arange(shape[1]) + 0.5, np.arange(shape[0]) + 0.5)
    x, y = transform.a * col + transform.b * row + transform.c, transform.d * col + transform.e * row + transform.f
    if to_utm is not None:
        x, y = to_utm.transform(x, y)
    values = (brightness(x, y) * gain).astype(dtype)
    with rasterio.open(path, "w", driver="GTiff", height=shape[0], width=shape[1], count=bands, dtype=dtype, crs=crs,
                       transform=transform, **profile) as out:  # fmt: skip
        out.write(np.stack([values] * bands))
    return path


def north_up(pixel=0.5, west=WEST - 50, north=NORTH + 50):
    return rasterio.Affine(pixel, 0, west, 0, -pixel, north)


def grid(pixel=0.5, side=80, west=WEST - 10.2, north=NORTH + 14.9):
    return MapGrid(WKT, west, north, pixel, side, side)


def expected(g):
    cols, rows = np.meshgrid(np.arange(g.width, dtype=float), np.arange(g.height, dtype=float))
    en = g.to_crs(np.stack([cols.ravel(), rows.ravel()], axis=1))
    return brightness(en[:, 0], en[:, 1]).reshape(g.height, g.width)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.3, 1.4), st.floats(-20, 20), st.floats(-20, 20))
def test_any_grid_shows_what_lies_there(tmp_path_factory, pixel, east, north):
    path = tmp_path_factory.getbasetemp() / "law.tif"
    if not path.exists():
        write(path, north_up(), (240, 240))
    g = grid(pixel, 24, WEST + east, NORTH + north)
    with ReferenceImage(path) as image:
        assert image.gsd_m_per_px(WKT) == pytest.approx(0.5, rel=1e-6)
        patch = image.read(g)
    assert patch.mask.all()
    np.testing.assert_allclose(patch.grey, expected(g), atol=4)


def test_a_turned_geotransform_is_read_where_it_lies(tmp_path):
    turn = math.radians(30)
    c, s = 0.5 * math.cos(turn), 0.5 * math.sin(turn)
    path = write(tmp_path / "turned.tif", rasterio.Affine(c, s, WEST - 70, s, -c, NORTH + 20), (300, 300))
    with ReferenceImage(path) as image:
        assert image.gsd_m_per_px(WKT) == pytest.approx(0.5, rel=1e-6)
        patch = image.read(grid())
        outside = image.read(grid(west=WEST + 900))
    assert patch.share_seen > 0.5
    assert outside.share_seen == 0.0
    np.testing.assert_allclose(patch.grey[patch.mask], expected(grid())[patch.mask], atol=6)


def test_degrees_are_warped_to_the_map(tmp_path):
    to_utm = Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    lon, lat = to_utm.transform(WEST - 50, NORTH + 50, direction="INVERSE")
    step = 0.5 / 111_000
    path = write(tmp_path / "lonlat.tif", rasterio.Affine(step, 0, lon, 0, -step, lat), (260, 400),
                 crs=rasterio.crs.CRS.from_epsg(4326), to_utm=to_utm)  # fmt: skip
    with ReferenceImage(path) as image:
        assert 0.35 < image.gsd_m_per_px(WKT) < 0.5
        assert image.shows(grid())
        assert not image.shows(grid(west=WEST + 5000))
        np.testing.assert_allclose(image.read(grid()).grey, expected(grid()), atol=5)


def test_deep_and_many_bands_look_as_shallow_ones(tmp_path):
    plain = write(tmp_path / "grey.tif", north_up(), (240, 240))
    deep = write(tmp_path / "deep.tif", north_up(), (240, 240), dtype="uint16", bands=4, gain=100.0)
    with ReferenceImage(plain) as a, ReferenceImage(deep) as b:
        grey, stretched = a.read(grid()), b.read(grid())
    # A fourth band without a word is near infrared or so: it hides nothing.
    assert stretched.mask.all()
    assert np.corrcoef(grey.grey.ravel(), stretched.grey.ravel())[0, 1] > 0.999
    assert stretched.grey.std() > grey.grey.std()


@pytest.mark.parametrize("how", ["nodata", "alpha"])
def test_what_is_transparent_is_not_ground(tmp_path, how):
    path = tmp_path / "holed.tif"
    write(path, north_up(), (240, 240), bands=4 if how == "alpha" else 3, photometric="rgb",
          **({"alpha": "yes"} if how == "alpha" else {"nodata": 0}))  # fmt: skip
    with rasterio.open(path, "r+") as image:
        pixels = image.read()
        if how == "alpha":
            pixels[3] = 255
        pixels[3 if how == "alpha" else slice(None), :, :100] = 0
        image.write(pixels)
    with ReferenceImage(path) as image:
        patch = image.read(grid())
    # Column 100 of the raster is 10.2 px into the grid.
    border = round((WEST - 50 + 100 * 0.5 - (WEST - 10.2)) / 0.5)
    assert not patch.mask[:, : border - 2].any()
    assert patch.mask[:, border + 2 :].all()


@pytest.mark.parametrize(
    ("crs", "transform", "words"),
    [(None, north_up(), "has no CRS"), (UTM, rasterio.Affine.identity(), "has no geotransform")],
)
def test_a_raster_without_a_place_says_what_to_do(tmp_path, crs, transform, words):
    path = write(tmp_path / "x.tif", transform, (20, 20), crs=crs)
    with pytest.raises(DataError, match=words):
        ReferenceImage(path)


def test_files_that_are_no_rasters_are_refused(tmp_path):
    with pytest.raises(DataError, match="no such reference"):
        ReferenceImage(tmp_path / "absent.tif")
    (tmp_path / "words.tif").write_text("words")
    with pytest.raises(DataError, match="cannot read"):
        ReferenceImage(tmp_path / "words.tif")


def test_windows_are_bounded(tmp_path):
    path = write(tmp_path / "grey.tif", north_up(), (24, 24))
    with ReferenceImage(path) as image, pytest.raises(ValueError, match="longer than"):
        image.read(grid(side=9000))
