"""Out of an atlas come the pixels that each frame alone would give, whatever lies beside it."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.mosaic.resample import Atlas, in_groups, patch_of


def coordinates(rng, image, size=(40, 30), margin=0.0):
    h, w = image.shape[:2]
    return rng.uniform((-0.5 - margin, -0.5 - margin), (w - 0.5 + margin, h - 0.5 + margin), (*size, 2))


def alone(image, xy):
    read = cv2.remap(image, xy.astype(np.float32), None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return cv2.cvtColor(read, cv2.COLOR_GRAY2BGR) if read.ndim == 2 else read


@pytest.mark.parametrize("channels", [(3, 3), (1, 3), (1, 1)])
def test_frames_in_one_atlas_are_read_as_each_alone(rng, channels):
    images = [rng.integers(0, 256, (60 + 20 * k, 90 - 30 * k, c)[: 2 + (c > 1)], dtype=np.uint8)
              for k, c in enumerate(channels)]  # fmt: skip
    wanted = [coordinates(rng, image) for image in images]
    wanted[1] = 10.0 + 0.3 * wanted[1]  # a part of it only
    atlas = Atlas([patch_of(image, xy) for image, xy in zip(images, wanted, strict=True)])
    for image, xy, shift in zip(images, wanted, atlas.shifts, strict=True):
        got = atlas.read((xy + shift).astype(np.float32))
        off = np.abs(got.astype(int) - alone(image, xy))
        assert np.mean(off > 0) < 0.2 and np.percentile(off, 99) <= 16  # to the 1/32 of a pixel that OpenCV rounds to
    if len(set(channels)) == 1 and channels[0] == 1:
        assert atlas.pixels.ndim == 2


def test_a_patch_is_no_larger_than_what_is_asked_for(rng):
    image = rng.integers(0, 256, (500, 700, 3), dtype=np.uint8)
    xy = np.array([[100.2, 50.0], [140.7, 90.9]])
    patch = patch_of(image, xy)
    assert patch.pixels.shape == (46, 46, 3) and np.shares_memory(patch.pixels, image)
    assert (patch.shift_x, patch.shift_y) == (-98.0, -48.0)


def test_beyond_a_frames_edge_its_edge_goes_on(rng):
    image = rng.integers(0, 256, (20, 20, 3), dtype=np.uint8)
    patch = patch_of(image, np.array([[-40.0, 3.0], [60.0, 9.0], [np.nan, np.nan]]))
    assert (patch.pixels[:, :3] == patch.pixels[:, 3:4]).all() and (
        patch.pixels[:, -3:] == patch.pixels[:, -4:-3]
    ).all()


@given(st.lists(st.integers(1, 900), max_size=40), st.integers(1, 1000))
def test_groups_hold_every_patch_once_and_fit(heights, limit):
    runs = list(in_groups(heights, limit))
    assert [h for run in runs for h in heights[run]] == heights
    assert all(sum(heights[run]) <= limit or run.stop - run.start == 1 for run in runs)
