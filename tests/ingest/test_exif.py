"""EXIF: the tag directories, the facts, and what hostile bytes do to them (nothing)."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL.TiffImagePlugin import IFDRational

from photomap_gis.core.errors import FrameReadError
from photomap_gis.ingest.exif import parse_date_time, read_exif
from photomap_gis.ingest.headers import read_header
from photomap_gis.ingest.tiff_tags import read_tags


def facts(path):
    return read_exif(read_header(path).tags)


def test_camera_lens_place_and_time(make_photo):
    found = facts(
        make_photo(
            taken="2024:05:06 12:13:14",
            focal_mm=8.8,
            lat=-33.8567844,
            lon=151.2152967,
            main={0x112: 6},
            exif={0x9291: "250", 0x9011: "-09:30", 0xA405: 24, 0xA002: 5472, 0xA003: 3648, 0xA431: "S123"},
            gps={5: b"\x01", 6: IFDRational(125, 10), 29: "2024:05:06", 7: (21, 43, 15)},
        )
    )
    assert (found.make, found.model, found.serial, found.orientation) == ("DJI", "FC6310", "S123", 6)
    assert (found.full_width_px, found.full_height_px) == (5472, 3648)
    assert (found.focal_mm, found.focal_35mm) == (8.8, 24.0)
    assert found.lat_deg == pytest.approx(-33.8567844, abs=1e-7)
    assert found.lon_deg == pytest.approx(151.2152967, abs=1e-7)
    assert found.alt_m == -12.5  # below sea level by its own tag
    assert 1 / 3600 / 10_000 <= found.step_deg < 1e-7
    assert found.local_s == 1714997594.25
    assert found.has_subsec
    assert found.utc_offset_s == -(9.5 * 3600)  # the sign holds for the minutes too
    assert found.gps_s == found.local_s - found.utc_offset_s + 0.75


@pytest.mark.parametrize(
    "gps",
    [
        {1: "N", 2: (IFDRational(0, 0),) * 3, 3: "E", 4: (IFDRational(0, 0),) * 3},
        {1: "N", 2: (0, 0, 0), 3: "E", 4: (0, 0, 0)},
        {1: "N", 2: (91, 0, 0), 3: "E", 4: (10, 0, 0)},
        {1: "N", 2: (52, 0, 0)},
        {1: "N", 2: (52, 0, 0), 3: "E", 4: (21, 0, 0), 9: "V"},
    ],
    ids=["zero denominators", "null island", "off the globe", "half a position", "receiver warns"],
)
def test_no_fix(make_photo, gps):
    found = facts(make_photo(gps=gps))
    assert found.lat_deg is None
    assert found.lon_deg is None


def test_missing_hemisphere_is_north_and_east(make_photo):
    found = facts(make_photo(gps={2: (52, 30, 0), 4: (21, 15, 0)}))
    assert (found.lat_deg, found.lon_deg) == (52.5, 21.25)


@pytest.mark.parametrize("tag, value", [(0x920A, IFDRational(0, 0)), (0xA405, 0), (0xA404, IFDRational(0, 1))])
def test_meaningless_lens_values_are_unknown(make_photo, tag, value):
    found = facts(make_photo(exif={tag: value}))
    assert found.focal_mm is None
    assert found.focal_35mm is None
    assert found.digital_zoom == 1.0


def test_focal_plane_resolution_in_every_unit(make_photo):
    for unit, density in ((2, 16393.4426), (3, 6454.1113), (4, 645.41113)):
        found = facts(make_photo(exif={0xA20E: IFDRational(round(density * 1e4), 10_000), 0xA210: unit}))
        assert found.focal_plane_px_per_mm == pytest.approx(645.411, abs=0.01)


@pytest.mark.parametrize(
    "words", ["", "0000:00:00 00:00:00", "2024:13:01 00:00:00", "yesterday", "2024:01:01 25:00:00"]
)
def test_dates_that_are_none(words):
    assert parse_date_time(words) is None


@pytest.mark.parametrize("words", ["2024:05:06 12:13:14", "2024-05-06T12:13:14+02:00", "2024-05-06 12:13:14Z"])
def test_dates_in_several_hands(words):
    assert parse_date_time(words) == (1714997594.0, False)


def test_tiff_carries_the_same_facts(make_photo):
    found = facts(make_photo("a.tif", lat=52.25, lon=21.0, focal_mm=5.7, taken="2024:05:06 12:13:14"))
    assert (found.model, found.lat_deg, found.focal_mm) == ("FC6310", 52.25, 5.7)


def test_png_carries_the_same_facts(make_photo):
    path = make_photo("a.png", lat=52.25, lon=21.0)
    assert facts(path).lat_deg == 52.25
    assert (read_header(path).width_px, read_header(path).height_px) == (64, 48)


@given(st.binary(max_size=400))
def test_any_bytes_are_survived(data):
    read_exif(read_tags(b"II*\0\x08\0\0\0" + data))
    read_exif(read_tags(b"MM\0*\0\0\0\x08" + data))


@given(st.data())
def test_any_directory_is_survived(data):
    """Entries of the tags that are read, with any type, count and value."""
    entry = st.tuples(
        st.sampled_from([0x10F, 0x110, 0x8769, 0x8825, 0x9003, 0x920A, 1, 2, 3, 4, 6, 7, 29, 0xA20E, 0xA405]),
        st.integers(0, 15),
        st.integers(0, 2**32 - 1),
        st.integers(0, 2**32 - 1),
    )
    entries = data.draw(st.lists(entry, max_size=12))
    body = struct.pack("<H", len(entries)) + b"".join(struct.pack("<HHII", *e) for e in entries)
    read_exif(read_tags(b"II*\0\x08\0\0\0" + body + data.draw(st.binary(max_size=100))))


def test_a_directory_that_points_at_itself_ends():
    body = struct.pack("<HHHII", 1, 0x8769, 4, 1, 8) + bytes(4)
    assert read_tags(b"II*\0\x08\0\0\0" + body).main[0x8769] == (8,)


@pytest.mark.parametrize("keep", [0, 1, 2, 10, 200, -2, -200])
def test_cut_off_photos_say_so(make_photo, keep):
    path = make_photo(lat=52.0, lon=21.0)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(FrameReadError, match=r"IMG_0001\.jpg: .*"):
        read_header(path)


def test_bytes_after_the_picture_are_no_harm(make_photo):
    path = make_photo()
    path.write_bytes(path.read_bytes() + bytes(200_000))
    assert read_header(path).width_px == 64


def test_no_photo_says_so(tmp_path):
    path = tmp_path / "notes.jpg"
    path.write_text("these are words")
    with pytest.raises(FrameReadError, match="not a photo"):
        read_header(path)
