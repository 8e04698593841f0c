"""One photo: its facts, its pixels, and every way in which a file can be broken."""

import contextlib
from dataclasses import replace

import cv2
import numpy as np
import pytest

from photomap_gis.core.errors import FrameReadError
from photomap_gis.core.frame import FrameRef
from photomap_gis.ingest.profiles import CameraRole
from photomap_gis.ingest.stills import MAX_PIXELS, read_photo, read_still

from .conftest import xmp_packet


def ref_of(path, width=0, height=0):
    return FrameRef(0, path.name, str(path), width, height)


def test_pixels_are_as_stored_whatever_the_orientation(make_photo):
    path = make_photo(size=(64, 48), main={0x112: 8})
    still = read_still(path)
    assert (still.width_px, still.height_px) == (64, 48)
    frame = read_photo(ref_of(path, 64, 48))
    assert frame.image.shape == (48, 64, 3)
    assert not frame.image.flags.writeable


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif", "bmp"])
@pytest.mark.parametrize("mode, shape", [("RGB", (48, 64, 3)), ("L", (48, 64))])
def test_colour_and_grey_in_every_format(make_photo, suffix, mode, shape):
    path = make_photo(f"a.{suffix}", mode=mode)
    image = read_photo(ref_of(path, 64, 48)).image
    assert image.shape == shape
    assert abs(int(image[10, 20].max()) - 30) <= 3


def test_bgr_order(tmp_path):
    path = tmp_path / "red.png"
    cv2.imwrite(str(path), np.full((8, 8, 3), (1, 2, 250), np.uint8))
    assert read_photo(ref_of(path)).image[0, 0].tolist() == [1, 2, 250]


def test_alpha_is_dropped(make_photo):
    assert read_photo(ref_of(make_photo("a.png", mode="RGBA"))).image.shape == (48, 64, 3)
    assert read_photo(ref_of(make_photo("b.png", mode="LA"))).image.ndim in (2, 3)


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_sixteen_bits_are_stretched(tmp_path, rng, suffix):
    """A thermal picture uses a small part of its range."""
    path = tmp_path / f"t.{suffix}"
    cv2.imwrite(str(path), (29_000 + 300 * rng.random((48, 64))).astype(np.uint16))
    image = read_photo(ref_of(path, 64, 48)).image
    assert image.dtype == np.uint8
    assert image.ndim == 2
    assert image.min() < 5
    assert image.max() > 250


def test_float_with_holes_is_stretched(tmp_path, rng):
    path = tmp_path / "t.tif"
    values = (20 + 5 * rng.random((48, 64))).astype(np.float32)
    values[:4] = np.nan
    cv2.imwrite(str(path), values)
    assert read_photo(ref_of(path)).image[10:].std() > 1


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif"])
@pytest.mark.parametrize("part", [0.0, 0.02, 0.3, 0.7, 0.97])
def test_cut_off_files_are_named(make_photo, rng, suffix, part):
    path = make_photo(f"cut.{suffix}", size=(200, 150))
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    still = read_still(path)
    with pytest.raises(FrameReadError, match=rf"^cut\.{suffix}: [^\n]+$"):
        read_photo(ref_of(path, 200, 150))
    assert still.problem is not None
    assert still.problem.startswith("unreadable: ")


def test_damaged_inside_never_raises_anything_else(make_photo, rng):
    path = make_photo("d.jpg", size=(200, 150))
    data = bytearray(path.read_bytes())
    for _ in range(30):
        broken = bytearray(data)
        for at in rng.integers(2, len(data), 20):
            broken[at] = int(rng.integers(0, 256))
        path.write_bytes(bytes(broken))
        read_still(path)
        with contextlib.suppress(FrameReadError):
            read_photo(ref_of(path))


def test_missing_and_changed_files_are_named(tmp_path, make_photo):
    with pytest.raises(FrameReadError, match=r"gone\.jpg: No such file"):
        read_photo(ref_of(tmp_path / "gone.jpg"))
    with pytest.raises(FrameReadError, match="it has changed"):
        read_photo(ref_of(make_photo(), 640, 480))


def test_absurd_sizes_are_refused_before_they_are_decoded(make_photo):
    path = make_photo()
    side = int(MAX_PIXELS**0.5) + 1
    with pytest.raises(FrameReadError, match="too many"):
        read_photo(ref_of(path, side, side))
    data = bytearray(path.read_bytes())
    at = data.index(b"\xff\xc0") + 5
    data[at : at + 4] = b"\xff\xff\xff\xff"
    path.write_bytes(bytes(data))
    assert "too many" in read_still(path).problem


def test_a_known_problem_is_not_tried_again(make_photo):
    with pytest.raises(FrameReadError, match="unreadable: cut"):
        read_photo(replace(ref_of(make_photo()), problem="unreadable: cut"))


@pytest.mark.parametrize(
    "name, role",
    [
        ("DJI_20240101120000_0001_W.JPG", CameraRole.WIDE),
        ("DJI_20240101120000_0001_Z.JPG", CameraRole.ZOOM),
        ("DJI_20240101120000_0001_T.JPG", CameraRole.THERMAL),
        ("DJI_20240101120000_0001_V.JPG", CameraRole.VISIBLE),
        ("DJI_0001_WIDE.jpg", CameraRole.WIDE),
        ("DJI_0001_ZOOM.jpg", CameraRole.ZOOM),
        ("DJI_0001_THRM.jpg", CameraRole.THERMAL),
        ("DJI_20240101120000_0001_MS_NIR.TIF", CameraRole.BAND),
        ("IRX_0001.jpg", CameraRole.THERMAL),
        ("MAX_0001.jpg", CameraRole.VISIBLE),
        ("DJI_0001.JPG", CameraRole.VISIBLE),
        ("DJI_0002_t.jpg", CameraRole.THERMAL),
        ("START.jpg", CameraRole.VISIBLE),
    ],
)
def test_role_by_name(make_photo, name, role):
    assert read_still(make_photo(name)).role is role


def test_a_letter_says_nothing_in_other_makers_names(make_photo):
    assert read_still(make_photo("survey_T.jpg", make="Canon", model="X")).role is CameraRole.VISIBLE


def test_role_by_the_makers_word(make_photo):
    for word, role in (("WideCamera", "wide"), ("ZoomCamera", "zoom"), ("InfraredCamera", "thermal")):
        path = make_photo(f"{role}.jpg", xmp=xmp_packet({"drone-dji:ImageSource": word}))
        assert read_still(path).role.value == role
