"""Frames in memory: made once, bounded, errors passed on; prepared without aliasing or shift."""

import threading
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from photomap_gis.core.errors import FrameReadError
from photomap_gis.mosaic.lowband import LONG_SIDE_PX, LowBandStore, low_band_of
from photomap_gis.mosaic.pixels import LruCache, SourceImage, check_pixels, prepare
from tests.mosaic.flight import place


def test_a_value_is_made_once_for_all_threads():
    made = []
    gate = threading.Barrier(4, timeout=20)

    def make(key):
        made.append(key)
        return key * 2

    cache = LruCache(make, lambda _: 1, 10)

    def ask(_):
        gate.wait()
        return cache.get(21)

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(ask, range(4))) == [42] * 4
    assert made == [21]


def test_what_was_not_used_lately_goes_first():
    made = []
    cache = LruCache(lambda k: made.append(k) or k, lambda _: 4, 12)
    for key in (1, 2, 3, 1, 4, 1, 2):
        cache.get(key)
    assert made == [1, 2, 3, 4, 2] and cache.held_bytes <= 12


def test_a_value_larger_than_the_cache_is_still_given():
    cache = LruCache(lambda k: k, lambda _: 100, 10)
    assert [cache.get(k) for k in (1, 2, 2)] == [1, 2, 2] and cache.held_bytes == 100


def test_a_failure_is_raised_and_forgotten():
    outcomes = iter([FrameReadError("gone"), 5])

    def make(_):
        outcome = next(outcomes)
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    cache = LruCache(make, lambda _: 1, 10)
    with pytest.raises(FrameReadError):
        cache.get(0)
    assert cache.get(0) == 5


def test_odd_shapes_are_brought_to_two_or_three_dimensions():
    placement = place(0, 0, 0, size=(8, 6))
    assert check_pixels(np.zeros((6, 8, 1), np.uint8), placement).shape == (6, 8)
    assert check_pixels(np.zeros((6, 8, 4), np.uint8), placement).shape == (6, 8, 3)


@pytest.mark.parametrize(
    "image", [np.zeros((8, 6, 3), np.uint8), np.zeros((6, 8, 3), np.uint16), np.zeros((6, 8, 2), np.uint8)]
)
def test_pixels_that_are_not_the_frame_s_are_a_read_error(image):
    with pytest.raises(FrameReadError, match="frame 4"):
        check_pixels(image, place(4, 0, 0, size=(8, 6)))


@pytest.mark.parametrize(("ratio", "scale"), [(1.0, 1.0), (1.9, 1.0), (2.5, 0.5), (4.0, 0.25), (100.0, 1 / 32)])
@pytest.mark.parametrize("shape", [(120, 161, 3), (121, 160)])
def test_whole_octaves_leave_the_raster(rng, ratio, scale, shape):
    image = rng.integers(0, 256, shape, dtype=np.uint8)
    source = prepare(image, ratio)
    assert source.scale == scale
    assert abs(source.image.shape[0] - shape[0] * scale) <= 2


@pytest.mark.parametrize("ratio", [1.5, 2.0, 3.0, 4.0])
def test_preparing_shifts_nothing(ratio):
    y, x = np.mgrid[:128, :128]
    image = np.clip(255 * np.exp(-((x - 60.0) ** 2 + (y - 70.0) ** 2) / 200), 0, 255).astype(np.uint8)
    small, scale = prepare(image, ratio)
    m = cv2.moments(small.astype(np.float32))
    centre = (np.array([m["m10"], m["m01"]]) / m["m00"] + 0.5) / scale - 0.5
    assert centre == pytest.approx([60.0, 70.0], abs=0.05)


def test_detail_too_fine_for_the_map_does_not_alias():
    stripes = np.where(np.arange(240)[None, :] // 1 % 2 == 0, 0, 255).astype(np.uint8).repeat(180, axis=0)
    for ratio in (1.6, 2.0, 3.1):
        assert prepare(stripes, ratio).image.std() < 0.35 * stripes.std()


@pytest.mark.parametrize("shape", [(1200, 1600, 3), (37, 50), (2000, 90, 3), (2, 3)])
def test_low_frequencies_lie_where_they_belong(shape):
    y, x = np.mgrid[: shape[0], : shape[1]]
    ramp = 40.0 + 80.0 * x / shape[1] + 60.0 * y / shape[0]
    image = np.rint(ramp if len(shape) == 2 else ramp[..., None].repeat(3, -1)).astype(np.uint8)
    low = low_band_of(SourceImage(image, 1.0))
    assert max(low.thumbnail.shape[:2]) <= LONG_SIDE_PX
    at_x = np.linspace(0.3, 0.7, 5)[None].repeat(4, 0) * (shape[1] - 1)
    at_y = np.linspace(0.3, 0.7, 4)[:, None].repeat(5, 1) * (shape[0] - 1)
    got = low.sample(at_x.astype(np.float32), at_y.astype(np.float32))
    expected = 40.0 + 80.0 * at_x / shape[1] + 60.0 * at_y / shape[0]
    assert got == pytest.approx(
        np.repeat(expected[..., None], 3, -1), abs=1.5 if min(low.thumbnail.shape[:2]) > 10 else 8
    )


def test_thumbnails_survive_on_disk_and_damage_is_mended(tmp_path, rng):
    opened = []
    image = rng.integers(0, 256, (60, 80, 3), dtype=np.uint8)

    def open_image(frame):
        opened.append(frame)
        return SourceImage(image, 0.5)

    first = LowBandStore(tmp_path, open_image, limit_bytes=1 << 20).get(3)
    again = LowBandStore(tmp_path, open_image, limit_bytes=1 << 20).get(3)
    assert opened == [3] and np.array_equal(first.thumbnail, again.thumbnail)
    assert (again.width_px, again.height_px) == (160, 120)
    (tmp_path / "000003.low").write_bytes(b"short")
    LowBandStore(tmp_path, open_image, limit_bytes=1 << 20).get(3)
    assert opened == [3, 3]


def test_a_cache_that_is_cleared_makes_its_values_anew():
    made = []
    cache = LruCache(lambda key: made.append(key) or np.zeros(100, np.uint8), lambda a: a.nbytes, 10_000)
    cache.get(1)
    cache.clear()
    assert cache.held_bytes == 0
    cache.get(1)
    assert made == [1, 1] and cache.held_bytes == 100
