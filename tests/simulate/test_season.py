"""Another season changes how the ground looks, never where it lies."""

import cv2
import numpy as np
import pytest
import rasterio

from photomap_gis.pipeline.reference import register_patches
from photomap_gis.reference import Expected, Patch
from photomap_gis.reference.pictures import Look, seen_as
from photomap_gis.simulate import procedural_scene
from photomap_gis.simulate.season import Season, another_season, write_reference


@pytest.fixture(scope="module")
def grounds():
    now, then = (procedural_scene((80.0, 80.0), 0.25, 4, sun_azimuth_deg=sun) for sun in (None, 90.0))
    return now, another_season(then, Season(seed=4))


def grey(ground):
    return np.ascontiguousarray(ground.colour.mean(axis=2).astype(np.uint8))


def test_contrast_of_what_grows_turns_and_places_stay(grounds):
    now, old = grounds
    assert old.grid == now.grid
    b, g, r = (now.colour[..., k].astype(float) for k in range(3))
    green = 2 * g - r - b > 30
    assert 0.2 < green.mean() < 0.95
    detail = [grey(x) - np.mean(grey(x)[green]) for x in (now, old)]
    fine = [d - _smooth(d) for d in detail]
    assert np.corrcoef(fine[0][green], fine[1][green])[0, 1] < -0.1
    assert np.abs(grey(now).astype(int) - grey(old)).mean() > 15
    everywhere = [np.ones(x.colour.shape[:2], bool) for x in grounds]
    a, d = (seen_as(Patch(grey(x), m), Look.GRADIENT) for x, m in zip((old, now), everywhere, strict=True))
    found = register_patches(a, d, Expected(6.0, 0.02, 0.02))
    assert found.accepted
    centre = np.array([160.0, 160.0])
    assert np.hypot(*(found.T_a_b.apply(centre) - centre)) < 0.5


def _smooth(values):
    return cv2.GaussianBlur(values, (0, 0), 12.0)


def test_the_same_seed_is_the_same_season(grounds):
    now, _ = grounds
    one, two, other = (another_season(now, Season(seed=s)).colour for s in (1, 1, 2))
    np.testing.assert_array_equal(one, two)
    assert (one != other).mean() > 0.5


def test_objects_come_and_go(grounds):
    now, _ = grounds
    still = Season(inversion=0.0, moisture=0.0, vanished_share=0.0, new_share=0.0)
    plain = another_season(now, still).colour.astype(int)
    built = another_season(now, Season(inversion=0.0, moisture=0.0, vanished_share=0.0, new_share=0.1)).colour
    changed = np.abs(built - plain).max(axis=2) > 40
    assert 0.02 < changed.mean() < 0.25


@pytest.mark.parametrize("gsd_m", [0.6, 1.0])
def test_the_written_reference_shows_each_place_where_it_is(grounds, tmp_path, gsd_m):
    now, _ = grounds
    write_reference(now, tmp_path / "r.tif", gsd_m=gsd_m, offset_m=(2.0, -1.0))
    with rasterio.open(tmp_path / "r.tif") as image:
        assert image.res == pytest.approx((gsd_m, gsd_m))
        assert image.crs.to_epsg() == 32632
        pixels, nodata = image.read(2), image.nodata
        rows, cols = np.nonzero(pixels != nodata)
        x, y = rasterio.transform.xy(image.transform, rows, cols)
    at = now.grid.to_px(np.stack([np.asarray(x) - 2.0, np.asarray(y) + 1.0], axis=1))
    inside = ((at > 4) & (at < 315)).all(axis=1)
    near = np.round(at[inside]).astype(int)
    soft = cv2.blur(now.colour[..., 1], (round(gsd_m / 0.25),) * 2)
    assert np.corrcoef(soft[near[:, 1], near[:, 0]], pixels[rows[inside], cols[inside]])[0, 1] > 0.95
