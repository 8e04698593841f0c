"""The camera profiles: consistent with themselves, and found by what photos say."""

import math

import pytest

from photomap_gis.ingest.profiles import DIAGONAL_35MM_MM, CameraRole, all_profiles, find_profile


def ids(profile):
    return profile.name


def test_there_are_many_and_each_names_its_source():
    profiles = all_profiles()
    assert len(profiles) >= 40
    assert all(len(p.source) > 20 for p in profiles)
    names = [p.name for p in profiles]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("profile", all_profiles(), ids=ids)
def test_numbers_agree_with_each_other(profile):
    pitch_um = 1e3 * profile.sensor_width_mm / profile.width_px
    assert 0.7 <= pitch_um <= (20.0 if profile.role in (CameraRole.THERMAL,) else 8.0)
    shape = profile.sensor_width_mm / profile.sensor_height_mm
    assert shape == pytest.approx(profile.width_px / profile.height_px, rel=0.025)
    assert (profile.focal_mm is None) == (profile.focal_35mm is None)
    if profile.focal_mm is not None and profile.focal_35mm is not None:
        crop = DIAGONAL_35MM_MM / math.hypot(profile.sensor_width_mm, profile.sensor_height_mm)
        assert profile.focal_mm * crop == pytest.approx(profile.focal_35mm, rel=0.05)


@pytest.mark.parametrize("profile", all_profiles(), ids=ids)
def test_every_profile_is_found_by_its_own_words(profile):
    for model in profile.models:
        found = find_profile(profile.make, model, profile.width_px, profile.height_px, role=profile.role)
        assert found == profile


@pytest.mark.parametrize(
    "make, model, size, name",
    [
        ("DJI", "FC6310", (5472, 3648), "DJI Phantom 4 Pro / Advanced"),
        ("", "fc6310 ", (1368, 912), "DJI Phantom 4 Pro / Advanced"),
        ("Hasselblad", "L1D-20c", (5472, 3648), "DJI Mavic 2 Pro"),
        ("DJI", "L1D-20c", (5472, 3648), "DJI Mavic 2 Pro"),
        ("Canon", "Canon EOS 5D Mark II", (5616, 3744), "Canon EOS 5D Mark II"),
        ("Canon", "EOS 5D Mark II", (5616, 3744), "Canon EOS 5D Mark II"),
        ("Skydio", "2+", (4056, 3040), "Skydio 2 / 2+"),
        ("RICOH IMAGING COMPANY, LTD.", "GR II", (4928, 3264), "Ricoh GR / GR II"),
    ],
)
def test_found_by_what_photos_say(make, model, size, name):
    found = find_profile(make, model, *size)
    assert found is not None
    assert found.name == name


@pytest.mark.parametrize("make, model", [("", ""), ("Acme", "FC1"), ("Acme", "2"), ("", "GR"), ("Nokia", "FC6310X")])
def test_unknown_cameras(make, model):
    assert find_profile(make, model, 4000, 3000) is None


def test_cameras_of_one_body_are_told_apart_by_the_raster():
    assert find_profile("DJI", "M3T", 640, 512).role is CameraRole.THERMAL
    assert find_profile("DJI", "M3T", 8000, 6000).role is CameraRole.WIDE
    assert find_profile("DJI", "M3E", 5280, 3956).role is CameraRole.WIDE
    assert find_profile("DJI", "ZH20T", 5184, 3888).role is CameraRole.ZOOM
    assert find_profile("DJI", "ZH20T", 4056, 3040).role is CameraRole.WIDE
    assert find_profile("DJI", "M3T", 4000, 3000, role=CameraRole.ZOOM).role is CameraRole.ZOOM
    assert find_profile("DJI", "M3T", 4000, 3000).role is CameraRole.WIDE  # a quarter of its pixels
    assert find_profile("DJI", "M3T", 4000, 3000, focal_mm=29.9).role is CameraRole.ZOOM
    assert find_profile("DJI", "M30T", 4000, 3000, focal_mm=4.5).role is CameraRole.WIDE
    assert find_profile("DJI", "M30T", 4000, 3000, focal_mm=60.0).role is CameraRole.ZOOM


def test_pixel_density_of_crops_and_reductions():
    profile = find_profile("DJI", "FC6310", 5472, 3648)
    full = profile.px_per_mm(5472, 3648)
    assert full == pytest.approx(5472 / 13.2, rel=1e-3)
    assert profile.px_per_mm(2736, 1824) == pytest.approx(full / 2)
    assert profile.px_per_mm(3648, 5472) == pytest.approx(full)  # turned
    assert profile.px_per_mm(4864, 3648) == pytest.approx(full)  # 4:3 keeps the height
    assert profile.px_per_mm(5472, 3078) == pytest.approx(full)  # 16:9 keeps the width
