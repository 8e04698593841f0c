"""Photos to footage: cameras chosen, clocks set, flights parted, fixes judged."""

import itertools
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.frame import GpsFix
from photomap_gis.ingest.exif import ExifFacts
from photomap_gis.ingest.options import IngestOptions, LensChoice
from photomap_gis.ingest.photo_clock import read_clock
from photomap_gis.ingest.photo_fixes import judge_fixes
from photomap_gis.ingest.photo_flights import Shot, natural_key, split_flights
from photomap_gis.ingest.photos import photo_footage
from photomap_gis.ingest.stills import Still

from .conftest import dms, xmp_packet

T0 = datetime(2024, 5, 6, 10, 0, 0, tzinfo=UTC).timestamp()


def stamp(seconds: float) -> str:
    return datetime.fromtimestamp(T0 + seconds, UTC).strftime("%Y:%m:%d %H:%M:%S")


def still(local=None, gps=None, offset=None, subsec=False, name="a.jpg"):
    facts = ExifFacts(local_s=local, gps_s=gps, utc_offset_s=offset, has_subsec=subsec)
    return Still(Path(name), 100, 100, facts)


# --- cameras -------------------------------------------------------------------------------------------------------


def matrice(make_photo, shots=4):
    paths = []
    for i in range(shots):
        for letter, size, focal, taken in (
            ("W", (100, 75), 4.5, i),
            ("Z", (200, 150), 21.0, i),
            ("T", (64, 51), 9.1, i),
        ):
            name = f"DCIM/DJI_2024_000{i}_{letter}.JPG"
            paths.append(make_photo(name, model="M30T", size=size, focal_mm=focal, taken=stamp(2 * taken)))
    return paths


@pytest.mark.parametrize(
    "choice, letters", [("widest", "W"), ("wide", "W"), ("zoom", "Z"), ("thermal", "T"), ("all", "TWZ")]
)
def test_one_camera_of_several_is_used(make_photo, choice, letters):
    footage = photo_footage(matrice(make_photo), IngestOptions(lens=LensChoice(choice)))
    assert sorted({f.name[-5] for f in footage.frames}) == sorted(letters)
    assert len(footage.frames) == 4 * len(letters)
    assert len(footage.flights) == len(letters)
    assert sum("not used: 4 photos of DJI Matrice" in w for w in footage.warnings) == 3 - len(letters)


def test_a_lens_that_took_nothing_is_refused(make_photo):
    paths = [make_photo(f"{i}.jpg") for i in range(3)]
    with pytest.raises(UsageError, match="no thermal photos among DJI Phantom 4 Pro"):
        photo_footage(paths, IngestOptions(lens=LensChoice.THERMAL))


def test_a_stated_lens_does_not_mix_cameras(make_photo):
    footage = photo_footage(matrice(make_photo), IngestOptions(hfov_deg=70.0))
    assert {f.name[-5] for f in footage.frames} == {"W"}
    assert {f.camera.origin for f in footage.frames} == {"option"}


def test_odd_sizes_do_not_part_a_camera(make_photo):
    """One photo at another size, one turned, one cut to 16:9: all the same camera at the same focal length."""
    sizes = [(200, 150)] * 6 + [(180, 135), (150, 200), (200, 112)]
    paths = [make_photo(f"{i}.jpg", model="FC330", size=s, focal_mm=3.61) for i, s in enumerate(sizes)]
    footage = photo_footage(paths, IngestOptions())
    assert len(footage.frames) == len(sizes)
    assert len(footage.flights) == 1
    assert not footage.warnings or "time zone" not in footage.warnings[0]
    for frame in footage.frames:
        assert frame.camera.width_px == frame.width_px
        assert frame.camera.focal_px / max(frame.width_px, frame.height_px) == pytest.approx(3.61 / 6.2, rel=0.01)


def test_a_few_wide_photos_do_not_win(make_photo):
    """Forty photos zoomed in and one by accident at the wide end: the map is of the forty."""
    zoomed = [make_photo(f"{i}.jpg", model="FC2204", focal_mm=8.6, taken=stamp(i)) for i in range(12)]
    slip = make_photo("z.jpg", model="FC2204", focal_mm=4.386, taken=stamp(20))
    footage = photo_footage([*zoomed, slip], IngestOptions())
    assert len(footage.frames) == 12
    assert any("1 photo of DJI Mavic 2 Zoom" in w for w in footage.warnings)


def test_drones_that_flew_apart_are_all_used(make_photo):
    one = [make_photo(f"one/{i}.jpg", model="FC6310", focal_mm=8.8, taken=stamp(i)) for i in range(3)]
    two = [make_photo(f"two/{i}.jpg", model="FC7203", focal_mm=4.49, taken=stamp(i + 0)) for i in range(3)]
    footage = photo_footage(one + two, IngestOptions())
    assert len(footage.frames) == 6
    assert [f.name for f in footage.flights] == ["one", "two"]


def test_photos_without_exif_join_their_like(make_photo):
    known = [make_photo(f"{i}.jpg", focal_mm=8.8) for i in range(4)]
    lost = make_photo("4.jpg", make=None, model=None)
    footage = photo_footage([*known, lost], IngestOptions())
    assert len({f.camera for f in footage.frames}) == 1


def test_one_band_of_a_multispectral_camera(make_photo):
    paths = [
        make_photo(f"DJI_2024_000{i}_{band}.TIF", model="M3M", taken=stamp(2 * i))
        for i in range(3)
        for band in ("MS_G", "MS_R", "MS_RE", "MS_NIR")
    ]
    footage = photo_footage(paths, IngestOptions())
    assert [f.name[-8:-4] for f in footage.frames] == ["MS_G"] * 3
    colour = [make_photo(f"DJI_2024_000{i}_D.JPG", model="M3M", taken=stamp(2 * i)) for i in range(3)]
    footage = photo_footage([*paths, *colour], IngestOptions())
    assert {f.name[-6:] for f in footage.frames} == {"_D.JPG"}


# --- clocks --------------------------------------------------------------------------------------------------------


def test_the_gps_clock_sets_the_cameras(rng):
    """Local time six hours ahead and 7 s off; GPS whole seconds, some stale: the camera's intervals, GPS's UTC."""
    local = [T0 + 6 * 3600 + 7 + 2.25 * i for i in range(20)]
    gps = [float(int(T0 + 2.25 * i)) for i in range(20)]
    gps[7] = gps[6]
    times = read_clock([still(a, b, subsec=True) for a, b in zip(local, gps, strict=True)]).times_s
    assert all(abs(t - (T0 + 2.25 * i)) < 1.0 for i, t in enumerate(times))
    assert all(b - a == pytest.approx(2.25) for a, b in itertools.pairwise(times))


def test_offset_time_sets_the_clock_where_no_gps_does():
    clock = read_clock([still(T0 + 7200 + i, offset=7200.0) for i in range(3)])
    assert clock.times_s == (T0, T0 + 1, T0 + 2)
    assert clock.warnings == ()


def test_local_time_alone_is_taken_as_utc_and_said_so():
    clock = read_clock([still(T0 + i) for i in range(3)])
    assert clock.times_s == (T0, T0 + 1, T0 + 2)
    assert "no time zone" in clock.warnings[0]


def test_a_clock_that_stands_still_gives_way_to_gps():
    clock = read_clock([still(T0 + 99, T0 + 2 * i) for i in range(8)])
    assert clock.times_s == tuple(T0 + 2.0 * i for i in range(8))


def test_photos_without_a_stamp_of_gps_follow_the_others():
    stills = [still(T0 + 3600 + i, T0 + i if i % 2 else None) for i in range(8)]
    assert read_clock(stills).times_s == tuple(T0 + i for i in range(8))


def test_bursts_within_a_second_are_laid_out():
    clock = read_clock([still(T0), still(T0), still(T0 + 1), still(T0 + 1)])
    assert clock.times_s == (T0, T0 + 0.5, T0 + 1, T0 + 1.5)


def test_no_clock_at_all():
    assert read_clock([still(), still()]).times_s == (None, None)


# --- flights -------------------------------------------------------------------------------------------------------


def shots(*parts):
    out = []
    for folder, times in parts:
        out += [Shot(len(out) + i, Path(folder) / f"IMG_{i}.jpg", t) for i, t in enumerate(times)]
    return out


def lengths(*parts):
    return [len(f) for f in split_flights(shots(*parts))]


def test_flights():
    seconds = [float(i) for i in range(0, 100, 5)]
    later = [t + 2000 for t in seconds]
    assert lengths(("a", seconds)) == [20]
    assert lengths(("a", seconds + later)) == [20, 20]  # a new battery
    assert lengths(("a", [*seconds, 100 + 73.0])) == [21]  # a turn
    assert lengths(("100MEDIA", seconds), ("101MEDIA", [t + 101 for t in seconds])) == [40]  # the card's next folder
    assert lengths(("a", seconds), ("b", [t + 300 for t in seconds])) == [20, 20]
    assert lengths(("a", seconds), ("b", seconds)) == [20, 20]  # two drones at a time
    assert lengths(("a", [None] * 4)) == [4]
    assert lengths(("a", [None, 1.0, None, 2000.0, None])) == [3, 2]
    assert lengths(("slow", [900.0 * i for i in range(10)])) == [10]  # a kite's timer


@given(st.lists(st.floats(0, 1e5) | st.none(), min_size=1, max_size=40), st.integers(1, 3))
def test_flights_keep_every_photo_once_and_in_order(times, folders):
    given_shots = [Shot(i, Path(f"f{i % folders}") / f"{i}.jpg", t) for i, t in enumerate(times)]
    flights = split_flights(given_shots)
    assert sorted(s.at for f in flights for s in f) == list(range(len(times)))
    for flight in flights:
        known = [s.time_s for s in flight if s.time_s is not None]
        assert known == sorted(known)


def test_natural_order():
    names = ["IMG_10.jpg", "img_9.jpg", "IMG_100.jpg", "a2b10.jpg", "a2b9.jpg"]
    assert sorted(names, key=natural_key) == ["a2b9.jpg", "a2b10.jpg", "img_9.jpg", "IMG_10.jpg", "IMG_100.jpg"]


def test_two_drones_of_one_model_in_one_folder(make_photo):
    paths = [make_photo(f"{i}.jpg", taken=stamp(i), exif={0xA431: f"DRONE{i % 2}"}) for i in range(8)]
    footage = photo_footage(paths, IngestOptions())
    assert [sum(f.flight == k for f in footage.frames) for k in (0, 1)] == [4, 4]


# --- fixes ---------------------------------------------------------------------------------------------------------


def test_xmp_has_more_digits_than_exif(make_photo):
    packet = xmp_packet({"drone-dji:GpsLatitude": "52.22967560", "drone-dji:GpsLongtitude": "21.01222870"})
    (frame,) = photo_footage([make_photo(lat=52.2, lon=21.0, xmp=packet)], IngestOptions()).frames
    assert (frame.fix.lat_deg, frame.fix.lon_deg) == (52.2296756, 21.0122287)


def test_coarse_steps_widen_the_sigma():
    """Four decimals of a degree are steps of 11 m: 3.2 m on top of the receiver's own error."""
    coarse = [GpsFix(round(52 + 3.1e-4 * i, 4), round(21 + 2.3e-4 * i, 4)) for i in range(12)]
    judged = judge_fixes(coarse, [float(i) for i in range(12)], [0.0] * 12)
    assert all(3.2 < f.sigma_m < 4.5 for f in judged)
    fine = [GpsFix(52 + 3.1234567e-4 * i, 21 + 2.3456789e-4 * i) for i in range(12)]
    assert all(f.sigma_m is None for f in judge_fixes(fine, [None] * 12, [1e-7] * 12))


def test_whole_numbers_among_fine_ones_are_not_coarse(make_photo):
    """Fifteen seconds exactly is written 15/1, while all its neighbours have decimals."""
    gps = [{1: "N", 2: dms(52 + i / 3600 / 7), 3: "E", 4: dms(21 + i / 3600 / 7)} for i in range(15)]
    paths = [make_photo(f"{i}.jpg", gps=g, taken=stamp(i)) for i, g in enumerate(gps)]
    frames = photo_footage(paths, IngestOptions()).frames
    assert all(f.fix.sigma_m is None for f in frames)


def test_a_repeated_fix_is_as_old_as_it_is():
    """10 m/s, a photo a second, the receiver silent for three of them."""
    north = [0.0, 10.0, 20.0, 20.0, 20.0, 50.0]
    fixes = [GpsFix(52 + n / 111_320, 21.0) for n in north]
    judged = judge_fixes(fixes, [float(i) for i in range(6)], [0.0] * 6)
    sigmas = [f.sigma_m or 0.0 for f in judged]
    assert sigmas[:3] == [0.0, 0.0, 0.0]
    assert sigmas[3] == pytest.approx((4 + 10**2) ** 0.5, rel=0.02)
    assert sigmas[4] == pytest.approx((4 + 20**2) ** 0.5, rel=0.02)
    assert sigmas[5] == 0.0


def test_one_position_for_all_is_none(make_photo):
    paths = [make_photo(f"{i}.jpg", lat=52.0, lon=21.0, taken=stamp(i)) for i in range(5)]
    footage = photo_footage(paths, IngestOptions())
    assert all(f.fix is None for f in footage.frames)
    assert any("carry the same position" in w for w in footage.warnings)


def test_reported_sigmas_stay():
    fixes = [GpsFix(52.0, 21.0, sigma_m=0.02)] * 3
    assert [f.sigma_m for f in judge_fixes(fixes, [0.0, 1.0, 2.0], [1e-4] * 3)] == [0.02] * 3


# --- the whole -----------------------------------------------------------------------------------------------------


def test_unreadable_photos_keep_their_place_and_are_named(make_photo):
    paths = [make_photo(f"IMG_{i}.jpg", taken=stamp(i), lat=52 + i * 1e-4, lon=21.0) for i in range(5)]
    paths[2].write_bytes(b"")
    footage = photo_footage(paths, IngestOptions())
    assert [f.name for f in footage.frames] == [f"IMG_{i}.jpg" for i in range(5)]
    assert footage.frames[2].problem == "unreadable: the file is empty: copy it again"
    assert any(w.startswith("IMG_2.jpg: unreadable") for w in footage.warnings)
    assert all(f.problem is None for f in footage.frames if f.index != 2)


def test_unreadable_photos_of_another_camera_are_left_out(make_photo):
    paths = matrice(make_photo)
    for path in paths[:3]:
        path.write_bytes(b"")
    footage = photo_footage(paths, IngestOptions())
    assert [f.name[-5] for f in footage.frames] == ["W"] * 4
    assert footage.frames[0].problem is not None


def test_nothing_readable_is_an_error(make_photo):
    path = make_photo()
    path.write_bytes(b"\xff\xd8\xff")
    with pytest.raises(DataError, match="none of the 1 photos can be used"):
        photo_footage([path], IngestOptions())


def test_maps_are_no_photos(make_photo, tmp_path):
    import rasterio
    from rasterio import Affine

    photo = make_photo()
    chart = tmp_path / "map.tif"
    profile = {"driver": "GTiff", "width": 8, "height": 8, "count": 1, "dtype": "uint8", "crs": "EPSG:32634"}
    with rasterio.open(chart, "w", transform=Affine(1, 0, 5e5, 0, -1, 5.8e6), **profile):
        pass
    footage = photo_footage([photo, chart], IngestOptions())
    assert [f.name for f in footage.frames] == ["IMG_0001.jpg"]
    assert any("GeoTIFF" in w and "map.tif" in w for w in footage.warnings)


def test_names_are_told_apart(make_photo):
    paths = [make_photo(f"{d}/DJI_0001.JPG", taken=stamp(n)) for n, d in enumerate(("100MEDIA", "101MEDIA"))]
    assert [f.name for f in photo_footage(paths, IngestOptions()).frames] == [
        "100MEDIA/DJI_0001.JPG",
        "101MEDIA/DJI_0001.JPG",
    ]
