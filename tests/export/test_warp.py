"""The one transform path."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import CRS, Transformer

from photomap_gis.core.errors import NotGeoreferencedError, UsageError
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.export import overview, target_grid, warped
from photomap_gis.export.pixel_grid import AffineGrid
from photomap_gis.export.warp import Resampler, lattice

UTM33 = CRS.from_epsg(32633).to_wkt()


def whole(source):
    return source.read(Window(0, 0, source.grid.width, source.grid.height))


def test_the_same_grid_is_the_same_source(scene):
    source = scene.source()
    assert warped(source, source.grid) is source


def test_whole_pixels_are_moved_not_resampled(scene):
    source = scene.source()
    g = source.grid
    moved = MapGrid(g.crs_wkt, g.west - 3 * g.pixel_size, g.north - 5 * g.pixel_size, g.pixel_size, 100, 90)
    out = whole(warped(source, moved))
    np.testing.assert_array_equal(out[:, 3:], source.rgba[5:95, :97])
    assert not out[:, :3].any()


def test_windows_join_without_seams(scene, rng):
    source = scene.source()
    out = warped(source, target_grid(source.grid, "EPSG:3857"))
    full = whole(out)
    for _ in range(8):
        c, r = int(rng.integers(0, 300)), int(rng.integers(0, 300))
        w, h = (int(v) for v in rng.integers(1, 120, 2))
        part = out.read(Window(c, r, w, h))
        expected = np.zeros((h, w, 4), np.uint8)
        piece = full[r : r + h, c : c + w]
        expected[: piece.shape[0], : piece.shape[1]] = piece
        assert np.abs(part.astype(int) - expected).max() <= 3  # cv2's coordinates are true to 1/32 pixel


def test_beyond_the_grid_is_transparent(scene):
    source = scene.source()
    g = target_grid(source.grid, "EPSG:3857")
    small = MapGrid(g.crs_wkt, g.west, g.north, g.pixel_size, 50, 40)
    out = warped(source, small).read(Window(-10, -10, 80, 80))
    assert not out[:10].any()
    assert not out[50:].any()
    assert not out[:, 60:].any()
    assert out[20, 30, 3] == 255


def test_black_stays_black_and_opaque(scene):
    source = scene.source()
    out = whole(warped(source, target_grid(source.grid, "EPSG:4326")))
    black = (out[..., :3].max(axis=-1) == 0) & (out[..., 3] == 255)
    assert black.sum() > 500


def test_hidden_colour_never_shows(scene):
    source = scene.source()
    for crs, size in (("EPSG:3857", None), ("EPSG:4326", None), ("EPSG:32633", 0.13), ("EPSG:32633", 0.7)):
        out = whole(warped(source, target_grid(source.grid, crs, size)))
        shown = out[out[..., 3] >= 16][:, :3].astype(int)
        purple = np.minimum(shown[:, 0], shown[:, 2]) - shown[:, 1]
        assert purple.max() < 60  # the scene's own colours stay below, the hidden one has 255


@given(
    st.sampled_from(["EPSG:3857", "EPSG:4326", "EPSG:3035", "EPSG:32634", "EPSG:25833"]),
    st.floats(380_000, 620_000),
    st.floats(5_000_000, 6_500_000),
    st.floats(0.01, 2.0),
)
@settings(max_examples=25, deadline=None)
def test_target_grids_hold_the_whole_map_and_no_more(crs, west, north, size):
    source = MapGrid(UTM33, west, north, size, 400, 300)
    target = target_grid(source, crs)
    to = Transformer.from_crs(UTM33, crs, always_xy=True)
    t = np.linspace(0, 1, 21)
    w, s, e, n = source.bounds
    ring = np.concatenate(
        [[(w + u * (e - w), v) for u in t for v in (s, n)], [(v, s + u * (n - s)) for u in t for v in (w, e)]]
    )
    px = target.to_px(np.stack(to.transform(*ring.T), axis=-1))
    assert px.min() >= -0.5 - 1e-3
    assert px[:, 0].max() <= target.width - 0.5 + 1e-3
    assert px[:, 1].max() <= target.height - 0.5 + 1e-3
    # tight, and no detail lost: a source pixel is at least one target pixel long
    assert px[:, 0].min() < 0.6
    assert px[:, 1].min() < 0.6
    step = np.hypot(
        *np.diff(target.to_px(np.stack(to.transform(*source.to_crs([[50, 50], [51, 50]]).T), axis=-1)), axis=0)[0]
    )
    assert step > 0.98


def test_pixel_size_survives_a_neighbouring_crs():
    source = MapGrid(UTM33, 391_000, 5_820_000, 0.05, 400, 300)
    assert target_grid(source, "EPSG:25833").pixel_size == 0.05
    assert target_grid(source, "EPSG:32633") == source
    assert target_grid(source, "EPSG:32633", 0.1).width == 200


@pytest.mark.parametrize("crs", ["EPSG:999999", "nonsense", "EPSG:5773", "EPSG:4978"])
def test_wrong_crs_says_what_to_do(scene, crs):
    with pytest.raises(UsageError, match="EPSG:25833"):
        target_grid(scene.source().grid, crs)


def test_a_crs_of_the_other_side_of_the_earth_is_refused(scene):
    with pytest.raises(UsageError, match="choose"):
        target_grid(scene.source().grid, "EPSG:2193", -1)


def test_local_maps_have_no_other_crs(scene):
    with pytest.raises(NotGeoreferencedError, match="--track"):
        target_grid(scene.source(None).grid, "EPSG:3857")


def test_local_maps_can_be_scaled(scene):
    source = scene.source(None, 0.0, 0.0, 1.0)
    half = warped(source, MapGrid(None, 0.0, 0.0, 2.0, 210, 190))
    assert scene.errors_px(scene.source(), whole(half), scene.source().grid.crs_wkt, lambda p: to_scene(scene, p)) < 0.2


def to_scene(scene, xy_px):
    return scene.source().grid.to_crs((np.asarray(xy_px) + 0.5) * 2 - 0.5)


def test_lattice_is_exact_where_the_map_bends():
    def bent(xy):
        x, y = np.asarray(xy).T
        return np.stack([x + 2e-4 * x * y, y + 30 * np.sin(x / 90)], axis=-1)

    x, y = lattice(bent, Window(10, 20, 333, 217))
    yy, xx = np.mgrid[20:237, 10:343].astype(float)
    exact = bent(np.stack([xx.ravel(), yy.ravel()], axis=-1)).reshape(217, 333, 2)
    assert np.hypot(x - exact[..., 0], y - exact[..., 1]).max() < 0.03


def test_lattice_of_one_pixel():
    x, y = lattice(lambda xy: np.asarray(xy) * 2.0, Window(7, 9, 1, 1))
    assert (x, y) == (14.0, 18.0)


def test_far_points_that_cannot_be_mapped_are_transparent(scene):
    source = scene.source()
    world = AffineGrid(CRS.from_epsg(4326).to_wkt(), (1.0, 0, -180, 0, -1.0, 90), 360, 180)
    out = Resampler(source, world).read(Window(0, 0, 360, 180))
    assert out.shape == (180, 360, 4)
    assert (out[..., 3] > 0).sum() <= 4


def test_reading_from_afar_is_bounded_and_true(scene):
    big = np.zeros((3000, 5000, 4), np.uint8)
    big[..., 3] = 255
    big[:, ::2, :3] = 200  # stripes that only a true mean turns grey
    source = scene.of_array(big, MapGrid(UTM33, 391_000, 5_820_000, 0.1, 5000, 3000))
    out = overview(source, 50)
    rgba = whole(out)
    assert rgba.shape == (60, 100, 4)
    np.testing.assert_allclose(rgba[..., 0], 100, atol=1)
    assert max(w.width * w.height for w in source.windows) <= 2100 * 2100
    coarse = whole(warped(source, target_grid(source.grid, "EPSG:3857", 9.0)))
    inner = coarse[5:-5, 5:-5]
    np.testing.assert_allclose(inner[..., 0].astype(int), 100, atol=2)
    assert (inner[..., 3] == 255).all()


def test_overview_of_a_part_pixel_is_part_transparent(scene):
    rgba = np.full((10, 10, 4), 255, np.uint8)
    out = whole(overview(scene.of_array(rgba, MapGrid(None, 0, 0, 1.0, 10, 10)), 4))
    assert out.shape == (3, 3, 4)
    assert out[0, 0, 3] == 255
    assert out[2, 2, 3] == 64
    assert (out[..., :3] == 255).all()


def test_turned_grids(scene):
    source = scene.source()
    g = source.grid
    angle, size = np.radians(30), 0.25
    c, s = np.cos(angle) * size, np.sin(angle) * size
    x, y = (g.bounds[0] + g.bounds[2]) / 2, (g.bounds[1] + g.bounds[3]) / 2
    turned = AffineGrid(g.crs_wkt, (c, -s, x - 350 * (c - s), -s, -c, y + 350 * (s + c)), 700, 700)
    out = Resampler(source, turned).read(Window(0, 0, 700, 700))
    assert scene.errors_px(source, out, g.crs_wkt, turned.to_crs) < 0.1


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 3), st.floats(-500, 500), st.floats(-500, 500))
def test_affine_grids_round_trip(b, d, a, x, y):
    grid = AffineGrid(None, (a, b * a, 100.0, d * a, -2 * a, 50.0), 10, 10)
    np.testing.assert_allclose(grid.to_px(grid.to_crs([[x, y]])), [[x, y]], atol=1e-6)
    np.testing.assert_allclose(grid.grown(7).to_crs([[x + 7, y + 7]]), grid.to_crs([[x, y]]), atol=1e-6)
