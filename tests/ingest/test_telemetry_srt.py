"""Subtitles: the eight real files, and dialects that nobody gave us a file of."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.errors import DataError
from photomap_gis.ingest.options import SrtOrder
from photomap_gis.ingest.telemetry import Clock, read_track
from photomap_gis.ingest.telemetry.srt import track_of_srt


@pytest.mark.parametrize(
    ("name", "count", "first", "last"),
    [
        ("air2s.srt", 17, (0.0, 41.424724, 2.234156), (0.533, 41.424730, 2.234102)),
        ("matrice_300.srt", 381, (0.0, 36.6146, -6.1120), (380.0, 36.6146, -6.1120)),
        ("mavic_2_style.SRT", 463, (0.0, -20.2533, 149.0251), (468.0, -20.2532, 149.0251)),
        ("mavic_mini.SRT", 117, (0.0, 48.0771, -121.7458), (116.0, 48.0775, -121.7476)),
        ("mavic_pro.SRT", 468, (1.0, -20.2533, 149.0251), (468.0, -20.2532, 149.0251)),
        ("p4_rtk.SRT", 55, (0.0, -34.237922, -58.851745), (54.0, -34.232349, -58.849196)),
        ("broken_incomplete.SRT", 19, (1.0, -34.7383, -58.4563), (19.0, -34.7383, -58.4563)),
    ],
)
def test_real_files(
    shared_data: Path, name: str, count: int, first: tuple[float, ...], last: tuple[float, ...]
) -> None:
    track = read_track(shared_data / "dji_srt" / name)
    assert track.clock is Clock.VIDEO
    assert len(track.points) == count
    for point, expected in ((track.points[0], first), (track.points[-1], last)):
        assert (point.time_s, point.lat_deg, point.lon_deg) == pytest.approx(expected, abs=1e-9)
    assert bool(track.warnings) == name.startswith("broken")


def test_what_real_files_tell_besides(shared_data: Path) -> None:
    folder = shared_data / "dji_srt"
    air = read_track(folder / "air2s.srt")
    assert air.points[0].focal_35mm == 24.0  # written as 240
    assert (air.points[0].alt_m, air.points[0].height_m) == (117.0, None)  # 'altitude' is no height
    assert air.epoch_local_s == pytest.approx(1659879640.775, abs=0.01)  # 2022-08-07 13:40:40.774
    rtk = read_track(folder / "p4_rtk.SRT").points[0]
    assert rtk.height_m == 85.8
    assert rtk.alt_m is None  # 15 are the satellites
    assert rtk.attitude is not None
    assert math.degrees(rtk.attitude.pitch_rad) == pytest.approx(-24.4)
    assert math.degrees(rtk.attitude.yaw_rad) == pytest.approx(110.4)
    matrice = read_track(folder / "matrice_300.srt")
    assert max(p.height_m or 0 for p in matrice.points) > 40.0
    assert read_track(folder / "mavic_mini.SRT").points[0].height_m == 200.7


def test_a_file_that_holds_nothing_warns_and_is_empty(shared_data: Path) -> None:
    track = read_track(shared_data / "dji_srt" / "broken_empty2.SRT")
    assert track.points == ()
    assert "--track" in track.warnings[-1]


def _srt(*bodies: str) -> str:
    return "".join(f"{i + 1}\n00:00:{i:02d},000 --> 00:00:{i + 1:02d},000\n{body}\n\n" for i, body in enumerate(bodies))


def test_recent_dialect_with_gimbal_and_both_altitudes() -> None:
    body = (
        '<font size="28">FrameCnt: 1, DiffTime: 33ms\n2024-05-01 10:20:30.397\n[iso: 100] [shutter: 1/640.0] '
        "[fnum: 1.7] [ev: 0] [ct: 5300] [color_md: default] [focal_len: 24.00] [dzoom_ratio: 1.00], "
        "[latitude: 52.123456] [longitude: 9.654321] [rel_alt: 50.300 abs_alt: 132.860] "
        "[gb_yaw: -57.8 gb_pitch: -90.0 gb_roll: 0.0]</font>"
    )
    track = track_of_srt(_srt(body, body), "x.srt")
    p = track.points[0]
    assert (p.lat_deg, p.lon_deg, p.alt_m, p.height_m, p.focal_35mm) == (52.123456, 9.654321, 132.86, 50.3, 24.0)
    assert p.attitude is not None
    assert math.degrees(p.attitude.heading_rad) == pytest.approx(-57.8)
    assert p.attitude.off_nadir_rad == pytest.approx(0.0, abs=1e-6)
    assert track.epoch_local_s == pytest.approx(1714558830.397 - 0.5, abs=0.51)
    assert track.warnings == ()


def test_digital_zoom_is_said_aloud() -> None:
    body = "[focal_len: 24.00] [dzoom_ratio: 20000, delta:0] [latitude: 52.1] [longitude: 9.6]"
    track = track_of_srt(_srt(body), "x.srt")
    assert track.points[0].focal_35mm == 48.0
    assert any("zoom" in w for w in track.warnings)


def test_letters_name_the_axes() -> None:
    body = "HOME(W: 91.620000, S: 42.130000) 2019-06-10 15:18:34\nGPS(W: 91.625000, S: 42.135000, 234.2)"
    p = track_of_srt(_srt(body), "autel.srt").points[0]
    assert (p.lat_deg, p.lon_deg, p.alt_m) == (-42.135, -91.625, 234.2)


@pytest.mark.parametrize(
    ("body", "lat", "lon", "warns"),
    [
        ("GPS(36.6146,-6.1120,10.0M) BAROMETER:0.3M", 36.6146, -6.1120, False),  # Matrice 300
        (
            "HOME(-58.45,-34.73) 2017.07.03 10:15:03\nGPS(-58.4563,-34.7383,19) BAROMETER:20.1",
            -34.7383,
            -58.4563,
            False,
        ),
        ("GPS(149.0251,-20.2533,16) BAROMETER:1.9", -20.2533, 149.0251, False),
        ("GPS(-20.2533,149.0251,16) BAROMETER:1.9", -20.2533, 149.0251, False),  # the second cannot be a latitude
        ("GPS(12.3456, 45.6789) BAROMETER:1.9", 45.6789, 12.3456, True),  # nobody knows
        ("GPS(0.0000, 11.5000, 16) BAROMETER:1.9", 11.5, 0.0, False),  # on Greenwich's meridian
    ],
)
def test_order_of_the_axes(body: str, lat: float, lon: float, warns: bool) -> None:
    track = track_of_srt(_srt(body, body), "x.srt")
    assert (track.points[0].lat_deg, track.points[0].lon_deg) == (lat, lon)
    assert any("--srt-order" in w for w in track.warnings) == warns


def test_order_by_the_distance_from_home() -> None:
    # 0.003 degrees of latitude are 334 m, of longitude at 60 north 167 m.
    north = "F/2.8, SS 80, ISO 100, GPS ({a}, {b}, 16), HOME ({c}, {d}, 1.0m), D 334.00m, H 40.00m"
    lon_first = track_of_srt(_srt(north.format(a=20.0, b=60.003, c=20.0, d=60.0)), "x.srt")
    lat_first = track_of_srt(_srt(north.format(a=60.003, b=20.0, c=60.0, d=20.0)), "x.srt")
    for track in (lon_first, lat_first):
        assert (track.points[0].lat_deg, track.points[0].lon_deg) == (60.003, 20.0)


def test_the_user_decides_the_order() -> None:
    text = _srt("GPS(12.3456, 45.6789) BAROMETER:1.9")
    track = track_of_srt(text, "x.srt", order=SrtOrder.LAT_LON)
    assert (track.points[0].lat_deg, track.points[0].lon_deg, track.warnings) == (12.3456, 45.6789, ())


def test_a_fix_that_stops_midway_ends_the_track() -> None:
    good = "[latitude: 52.1000] [longitude: 9.6000] [rel_alt: 10.0 abs_alt: 90.0]"
    lost = "[latitude: 0.000000] [longitude: 0.000000] [rel_alt: 10.0 abs_alt: 90.0]"
    track = track_of_srt(_srt(good, good, lost, lost), "x.srt")
    assert [p.time_s for p in track.points] == [0.0, 1.0]
    assert any("2 records without a valid position" in w for w in track.warnings)


def test_encodings_and_line_ends(tmp_path: Path) -> None:
    text = _srt("[latitude: 52.1] [longitude: 9.6] 20°")
    for i, data in enumerate(
        (text.encode("utf-8-sig"), text.encode("utf-16"), text.encode("latin-1"), text.replace("\n", "\r\n").encode())
    ):
        path = tmp_path / f"{i}.SRT"
        path.write_bytes(data)
        assert read_track(path).points[0].lat_deg == 52.1


def test_subtitles_of_a_film_are_no_track(tmp_path: Path) -> None:
    path = tmp_path / "film.srt"
    path.write_text(_srt("Hello.", "Goodbye."))
    track = read_track(path)
    assert track.points == ()
    assert track.warnings


@given(st.text(max_size=300))
def test_any_text_is_survived(noise: str) -> None:
    text = _srt(f"[latitude: 52.1] {noise} [longitude: 9.6]") + noise
    for p in track_of_srt(text, "x.srt").points:
        assert abs(p.lat_deg) <= 90.0
        assert abs(p.lon_deg) <= 180.0


def test_long_nonsense_is_no_trap() -> None:
    # Patterns that backtrack would take minutes here.
    track_of_srt(_srt("[" * 50_000 + " " * 50_000 + "GPS(" + "1" * 50_000, "latitude" + " " * 100_000), "x.srt")


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        read_track(tmp_path / "none.srt")
