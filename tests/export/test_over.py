"""The new map laid over old imagery of every kind."""

import json
from datetime import date

import numpy as np
import pytest
import rasterio
from rasterio.enums import ColorInterp
from rio_cogeo.cogeo import cog_validate
from shapely.geometry import Point, shape

from photomap_gis.core.errors import DataError, NotGeoreferencedError, OutputError, UsageError
from photomap_gis.export import write_over

RGB = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)
RGBA = (*RGB, ColorInterp.alpha)
UTM = "EPSG:32633"
WEST, NORTH = 391_000.0, 5_820_000.0  # the scene spans 105 m x 95 m from here


def write_old(path, bands, *, crs=UTM, transform=None, interp=None, nodata=None, mask=None, tags=None, **profile):
    bands = np.asarray(bands)
    count, height, width = bands.shape
    transform = transform or rasterio.Affine(0.5, 0, WEST - 40, 0, -0.5, NORTH + 30)
    options = {"photometric": "RGB" if count >= 3 and interp in (None, RGB, RGBA) else "MINISBLACK", **profile}
    if interp and ColorInterp.alpha in interp:
        options["alpha"] = "UNSPECIFIED"
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open(
        path, "w", driver="GTiff", width=width, height=height, count=count, dtype=bands.dtype, crs=crs,
        transform=transform, nodata=nodata, **options,
    ) as out:  # fmt: skip
        if interp:
            out.colorinterp = interp
        out.write(bands)
        if mask is not None:
            out.write_mask(mask)
        out.update_tags(**(tags or {}))
    return path


def old_rgb(rng, width=400, height=350, dtype=np.uint8, low=20, high=60):
    return rng.integers(low, high, (3, height, width)).astype(dtype)


def read(path):
    with rasterio.open(path) as dataset:
        return dataset.read(), dataset.dataset_mask(), dataset.profile, dataset.colorinterp, dataset.tags()


def to_crs_of(path):
    with rasterio.open(path) as dataset:
        a, b, c, d, e, f = tuple(dataset.transform)[:6]

    def to_crs(xy):
        x, y = (np.asarray(xy) + 0.5).T
        return np.stack([a * x + b * y + c, d * x + e * y + f], axis=-1)

    return to_crs


def test_rgb(scene, rng, tmp_path):
    old = write_old(
        tmp_path / "old.tif", old_rgb(rng), tags={"OWNER": "city", "TIFFTAG_DATETIME": "2019:01:01 00:00:00"}
    )
    before = old.read_bytes()
    source = scene.source()
    done = write_over(source, old, tmp_path / "new.tif", feather_px=4, date=date(2026, 11, 22), ce90_m=1.5)
    assert old.read_bytes() == before
    assert cog_validate(tmp_path / "new.tif", strict=True, quiet=True)[0]
    was, _, old_profile, _, _ = read(old)
    now, _, profile, interp, tags = read(tmp_path / "new.tif")
    for key in ("width", "height", "count", "dtype", "crs", "transform", "nodata"):
        assert profile[key] == old_profile[key], key
    assert interp == RGB
    assert tags["OWNER"] == "city"
    assert tags["PHOTOMAP_REPLACED_DATE"] == "2026-11-22"
    # outside the map nothing changed, not by one grey level
    np.testing.assert_array_equal(now[:, :58], was[:, :58])
    np.testing.assert_array_equal(now[:, :, :78], was[:, :, :78])
    np.testing.assert_array_equal(now[:, :, 292:], was[:, :, 292:])
    changed = (now != was).any(axis=0)
    assert 0.8 * done.replaced_px < changed.sum() <= done.replaced_px
    # inside it is the map
    rgba = np.dstack([*now, np.full(now.shape[1:], 255)])
    assert scene.errors_px(source, rgba, UTM, to_crs_of(tmp_path / "new.tif")) < 0.3
    assert (now[:, 150, 200] == scene.background).all()
    document = json.loads(done.footprint_path.read_text())
    assert done.footprint_path.name == "new-footprint.geojson"
    feature = document["features"][0]
    assert feature["properties"]["date"] == "2026-11-22"
    assert feature["properties"]["ce90_m"] == 1.5
    assert feature["properties"]["replaces"] == "old.tif"
    seen = (source.rgba[..., 3] > 0).sum() * 0.0625
    assert feature["properties"]["area_m2"] == pytest.approx(seen, rel=0.03)
    assert shape(feature["geometry"]).is_valid
    assert done.outline.contains(Point(WEST + 50, NORTH - 50))
    assert not done.outline.contains(Point(WEST + 2, NORTH - 93))


def test_the_edge_fades(scene, rng, tmp_path):
    old = write_old(tmp_path / "old.tif", np.full((3, 350, 400), 200, np.uint8))
    write_over(scene.source(), old, tmp_path / "new.tif", feather_px=10)
    row = read(tmp_path / "new.tif")[0][0, 150, 70:110].astype(int)
    assert row[0] == 200
    assert row[-1] == scene.background[0]
    assert (np.diff(row) <= 0).all()
    assert ((row < 200) & (row > scene.background[0])).sum() in (9, 10, 11)
    write_over(scene.source(), old, tmp_path / "hard.tif", feather_px=0)
    row = read(tmp_path / "hard.tif")[0][0, 150, 70:110].astype(int)
    assert ((row < 195) & (row > scene.background[0] + 5)).sum() <= 1


def test_no_fading_at_the_old_rasters_own_edge(scene, rng, tmp_path):
    """The old raster ends within the map: the map does not, so there is nothing to fade into."""
    transform = rasterio.Affine(0.5, 0, WEST + 30, 0, -0.5, NORTH - 8)
    old = write_old(tmp_path / "old.tif", np.full((3, 80, 90), 200, np.uint8), transform=transform)
    write_over(scene.source(), old, tmp_path / "new.tif", feather_px=12)
    now = read(tmp_path / "new.tif")[0]
    assert (now[:, 0, 0] == scene.background).all()
    assert (scene.background == now[:, :, -1].T).all(axis=-1).mean() > 0.5


def test_rgba_and_where_the_old_was_empty(scene, rng, tmp_path):
    bands = np.concatenate([old_rgb(rng), np.full((1, 350, 400), 255, np.uint8)])
    bands[:, :, :180] = 0  # nothing known in the west
    old = write_old(tmp_path / "old.tif", bands, interp=RGBA)
    write_over(scene.source(), old, tmp_path / "new.tif", feather_px=12)
    now, mask, _, interp, _ = read(tmp_path / "new.tif")
    assert interp == RGBA
    assert not now[:, :, :78].any()
    column = now[:3, 150, 80:120].T.astype(int)
    assert np.abs(column - scene.background).max() <= 2  # full colour up to the map's edge: nothing to fade into
    assert mask[150, 100] == 255


def test_grey(scene, rng, tmp_path):
    old = write_old(tmp_path / "old.tif", old_rgb(rng)[:1])
    write_over(scene.source(), old, tmp_path / "new.tif")
    now, _, profile, interp, _ = read(tmp_path / "new.tif")
    assert profile["count"] == 1
    assert interp == (ColorInterp.gray,)
    assert now[0, 150, 200] == round(0.299 * 96 + 0.587 * 110 + 0.114 * 84)


def test_bands_in_another_order(scene, rng, tmp_path):
    old = write_old(tmp_path / "old.tif", old_rgb(rng), interp=RGB[::-1])
    write_over(scene.source(), old, tmp_path / "new.tif")
    now, _, _, interp, _ = read(tmp_path / "new.tif")
    assert interp == RGB[::-1]
    assert tuple(now[:, 150, 200]) == tuple(scene.background[::-1])


def test_black_is_not_no_data(scene, rng, tmp_path):
    old = write_old(tmp_path / "old.tif", old_rgb(rng), nodata=0)
    write_over(scene.source(), old, tmp_path / "new.tif")
    now, mask, profile, _, _ = read(tmp_path / "new.tif")
    assert profile["nodata"] == 0
    x, y = 80 + 196 // 2, 60 + 190 // 2  # within the black letter
    assert (now[:, y, x] == 1).all()
    assert (mask == 255).all()


def test_internal_mask(scene, rng, tmp_path):
    mask = np.zeros((350, 400), np.uint8)
    mask[:, 200:] = 255
    old = write_old(tmp_path / "old.tif", old_rgb(rng), mask=mask)
    write_over(scene.source(), old, tmp_path / "new.tif")
    _, now, profile, _, _ = read(tmp_path / "new.tif")
    assert profile["count"] == 3
    assert now[150, 100] == 255
    assert now[150, 300] == 255
    assert now[150, 20] == 0


@pytest.mark.parametrize("dtype", [np.uint16, np.int16, np.float32])
def test_wider_numbers_take_the_old_ones_range(scene, rng, tmp_path, dtype):
    bands = old_rgb(rng, dtype=dtype, low=300, high=1900)
    old = write_old(tmp_path / "old.tif", bands)
    write_over(scene.source(), old, tmp_path / "new.tif")
    now = read(tmp_path / "new.tif")[0]
    assert now.dtype == dtype
    np.testing.assert_array_equal(now[:, :50], bands[:, :50])
    patch = now[:, 140:200, 150:260]
    assert np.isfinite(patch).all()
    assert 250 < np.percentile(patch, 50) < 1950
    assert np.percentile(patch, 99.9) > np.percentile(patch, 50) + 200


def test_wider_numbers_over_nothing_take_the_whole_range(scene, tmp_path):
    old = write_old(tmp_path / "old.tif", np.zeros((3, 350, 400), np.uint16), nodata=0)
    write_over(scene.source(), old, tmp_path / "new.tif")
    assert tuple(read(tmp_path / "new.tif")[0][:, 150, 200]) == tuple(scene.background * 257)


def test_nan_under_the_feather(scene, tmp_path):
    old = write_old(tmp_path / "old.tif", np.full((1, 350, 400), np.nan, np.float32), nodata=float("nan"))
    write_over(scene.source(), old, tmp_path / "new.tif")
    now, mask, _, _, _ = read(tmp_path / "new.tif")
    assert np.isfinite(now[0][mask > 0]).all()
    assert (mask > 0).sum() > 30_000


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:3857", "EPSG:3035", "EPSG:25834"])
def test_old_in_another_crs(scene, rng, tmp_path, crs):
    from rasterio.warp import transform_bounds

    w, s, e, n = transform_bounds(UTM, crs, WEST - 20, NORTH - 120, WEST + 130, NORTH + 30)
    transform = rasterio.Affine((e - w) / 500, 0, w, 0, (s - n) / 520, n)
    old = write_old(tmp_path / "old.tif", old_rgb(rng, 500, 520), crs=crs, transform=transform)
    source = scene.source()
    write_over(source, old, tmp_path / "new.tif")
    now, _, profile, _, _ = read(tmp_path / "new.tif")
    assert profile["transform"].almost_equals(transform)
    rgba = np.dstack([*now, np.full(now.shape[1:], 255)])
    assert scene.errors_px(source, rgba, crs, to_crs_of(tmp_path / "new.tif")) < 0.3


def test_turned_old_raster(scene, rng, tmp_path):
    turn = rasterio.Affine.translation(WEST + 50, NORTH - 48) @ rasterio.Affine.rotation(25)
    transform = turn @ rasterio.Affine.scale(0.5, -0.5) @ rasterio.Affine.translation(-250, -250)
    old = write_old(tmp_path / "old.tif", old_rgb(rng, 500, 500), transform=transform)
    source = scene.source()
    done = write_over(source, old, tmp_path / "new.tif")
    rgba = np.dstack([*read(tmp_path / "new.tif")[0], np.full((500, 500), 255)])
    assert scene.errors_px(source, rgba, UTM, to_crs_of(tmp_path / "new.tif")) < 0.3
    assert done.outline.contains(Point(WEST + 50, NORTH - 50))
    assert not done.outline.contains(Point(WEST + 2, NORTH - 93))


def test_larger_than_a_window(scene, rng, tmp_path):
    bands = np.full((3, 1500, 2600), 30, np.uint8)
    transform = rasterio.Affine(0.05, 0, WEST - 10, 0, -0.05, NORTH + 5)
    old = write_old(tmp_path / "old.tif", bands, transform=transform, tiled=True, compress="deflate")
    seen = []
    source = scene.source()
    write_over(source, old, tmp_path / "new.tif", feather_px=40, on_progress=lambda d, t: seen.append((d, t)))
    now = read(tmp_path / "new.tif")[0]
    x, y = source.grid.to_crs([[210, 120]])[0]
    np.testing.assert_allclose(
        now[:, round((NORTH + 5 - y) / 0.05), round((x - WEST + 10) / 0.05)], scene.background, atol=1
    )
    # no seam where windows meet: the fade is a smooth ramp along the map's left edge
    ramp = now[0, 110:1400, 200:245].astype(int)
    assert np.abs(np.diff(ramp, axis=0)).max() <= 3
    assert seen[-1][0] == seen[-1][1]


def test_refusals(scene, rng, tmp_path):
    source, out = scene.source(), tmp_path / "new.tif"
    old = write_old(tmp_path / "old.tif", old_rgb(rng))
    (tmp_path / "x").mkdir()
    with pytest.raises(UsageError, match="never changed in place"):
        write_over(source, old, tmp_path / "x" / ".." / "old.tif")
    with pytest.raises(NotGeoreferencedError):
        write_over(scene.source(None), old, out)
    with pytest.raises(DataError, match="no such file"):
        write_over(source, tmp_path / "missing.tif", out)
    (tmp_path / "text.tif").write_text("hello")
    with pytest.raises(DataError, match="no raster"):
        write_over(source, tmp_path / "text.tif", out)
    with pytest.raises(UsageError, match="feather"):
        write_over(source, old, out, feather_px=-1)
    far = write_old(tmp_path / "far.tif", old_rgb(rng), transform=rasterio.Affine(0.5, 0, WEST + 5000, 0, -0.5, NORTH))
    with pytest.raises(DataError, match="does not overlap"):
        write_over(source, far, out)
    corner = rasterio.Affine(0.5, 0, WEST - 10, 0, -0.5, NORTH - 90)  # only where the map saw nothing
    blind = write_old(tmp_path / "blind.tif", old_rgb(rng, 30, 30), transform=corner)
    with pytest.raises(DataError, match="does not overlap"):
        write_over(source, blind, out)
    five = write_old(tmp_path / "five.tif", np.concatenate([old_rgb(rng), old_rgb(rng)[:2]]))
    with pytest.raises(DataError, match="-b 1 -b 2 -b 3"):
        write_over(source, five, out)
    with pytest.raises(OutputError, match="does not exist"):
        write_over(source, old, tmp_path / "nowhere" / "new.tif")
    nowhere = write_old(tmp_path / "nocrs.tif", old_rgb(rng), crs=None)
    with pytest.raises(DataError, match="no georeference"):
        write_over(source, nowhere, out)
    assert not out.exists()
    assert not [p for p in tmp_path.iterdir() if "footprint" in p.name or p.name.startswith(".photomap")]


def test_palette_is_refused_with_the_way_out(scene, tmp_path):
    old = write_old(tmp_path / "old.tif", np.zeros((1, 350, 400), np.uint8))
    with rasterio.open(old, "r+") as dataset:
        dataset.write_colormap(1, {0: (255, 0, 0, 255), 1: (0, 0, 255, 255)})
    with pytest.raises(DataError, match="-expand rgb"):
        write_over(scene.source(), old, tmp_path / "new.tif")


def test_a_damaged_old_raster(scene, rng, tmp_path):
    old = write_old(tmp_path / "old.tif", rng.integers(0, 255, (3, 350, 400)).astype(np.uint8), compress="deflate")
    data = bytearray(old.read_bytes())
    data[len(data) // 3 : len(data) // 3 + 30000] = bytes(30000)
    old.write_bytes(data)
    with pytest.raises(DataError, match="damaged"):
        write_over(scene.source(), old, tmp_path / "new.tif")
    assert not (tmp_path / "new.tif").exists()


def test_footprint_where_it_was_asked_for(scene, rng, tmp_path):
    old = write_old(tmp_path / "old.tif", old_rgb(rng))
    done = write_over(scene.source(), old, tmp_path / "new.tif", footprint_path=tmp_path / "f.geojson", date="2026-11")
    assert done.footprint_path == tmp_path / "f.geojson"
    assert json.loads((tmp_path / "f.geojson").read_text())["features"][0]["properties"]["date"] == "2026-11"
