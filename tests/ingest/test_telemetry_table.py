"""Tables: exports of known programs, and what people type themselves."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from photomap_gis.core.errors import DataError
from photomap_gis.ingest.telemetry import Clock, read_track
from photomap_gis.ingest.telemetry.columns import Quantity, understand

T0 = 1714558830.0  # 2024-05-01T10:20:30Z


def _write(tmp_path: Path, text: str, name: str = "log.csv") -> Path:
    path = tmp_path / name
    path.write_text(text)
    return path


def test_airdata(tmp_path: Path) -> None:
    header = (
        "time(millisecond),datetime(utc),latitude,longitude,height_above_takeoff(feet),"
        "height_above_ground_at_drone_location(feet),altitude_above_seaLevel(feet),speed(mph),"
        " compass_heading(degrees), pitch(degrees), roll(degrees),isPhoto,isVideo,"
        "gimbal_heading(degrees),gimbal_pitch(degrees),message\n"
    )
    rows = "".join(
        f"{i * 100 + 40},2024-05-01 10:20:{30 + (i * 100 + 700) // 1000:02d},52.{100000 + i},9.6,"
        f"100.0,90.0,400.0,3.5,90.0,-4.0,2.0,{int(i in (5, 6, 20))},1,91.0,-90.0,\n"
        for i in range(40)
    )
    track = read_track(_write(tmp_path, header + rows))
    assert track.clock is Clock.UTC
    p = track.points[0]
    assert p.height_m == pytest.approx(30.48)
    assert p.alt_m == pytest.approx(121.92)
    # The whole-second stamps and the milliseconds agree on a start of 10:20:30.7 +- 0.1.
    assert p.time_s == pytest.approx(T0 + 0.7, abs=0.1)
    assert track.points[10].time_s - p.time_s == pytest.approx(1.0)
    assert p.attitude is not None
    assert math.degrees(p.attitude.heading_rad) == pytest.approx(91.0)
    assert [t.index for t in track.triggers] == [0, 1]
    assert track.triggers[0].time_s == pytest.approx(track.points[5].time_s)


def test_dji_record_export(tmp_path: Path) -> None:
    text = (
        "sep=,\nCUSTOM.date [local],CUSTOM.updateTime [local],OSD.flyTime [s],OSD.latitude,OSD.longitude,"
        "OSD.height [ft],OSD.altitude [ft],OSD.pitch,OSD.roll,OSD.yaw,GIMBAL.pitch,GIMBAL.roll,GIMBAL.yaw\n"
        "9/30/2022,1:37:23.45 PM,0.1,28.1,-81.9,10.0,100.0,1,2,3,-89.9,0,12\n"
        "9/30/2022,1:37:23.55 PM,0.2,28.1,-81.9,10.0,100.0,1,2,3,-89.9,0,12\n"
    )
    track = read_track(_write(tmp_path, text))
    assert track.clock is Clock.LOCAL
    assert track.points[0].time_s == pytest.approx(1664545043.45)
    assert track.points[0].height_m == pytest.approx(3.048)
    assert track.points[0].attitude is not None
    assert math.degrees(track.points[0].attitude.pitch_rad) == pytest.approx(-89.9)


def test_flytrex_and_litchi(tmp_path: Path) -> None:
    text = (
        "latitude,longitude,altitude(feet),ascent(feet),speed(mph),time(millisecond),datetime(utc),datetime(local)\n"
        "52.1,9.6,300,100,1,0,2024-05-01 10:20:30,2024-05-01 12:20:30\n"
    )
    p = read_track(_write(tmp_path, text)).points[0]
    assert (p.alt_m, p.height_m) == (pytest.approx(91.44), pytest.approx(30.48))
    assert p.time_s == T0


@pytest.mark.parametrize(
    ("stamp", "clock"),
    [
        ("2024-05-01T10:20:30Z", Clock.UTC),
        ("2024-05-01T12:20:30+02:00", Clock.UTC),
        ("2024-05-01 10:20:30", Clock.LOCAL),
        ("2024/05/01 10:20:30.000", Clock.LOCAL),
        ("1714558830", Clock.UTC),
        ("1714558830000", Clock.UTC),
        ("1714558830000000", Clock.UTC),
    ],
)
def test_time_stamps(tmp_path: Path, stamp: str, clock: Clock) -> None:
    track = read_track(_write(tmp_path, f"timestamp,lat,lon\n{stamp},52.1,9.6\n"))
    assert (track.clock, track.points[0].time_s) == (clock, T0)


def test_seconds_of_the_video(tmp_path: Path) -> None:
    track = read_track(_write(tmp_path, "time,lat,lng,height\n0.0,52.1,9.6,40\n0.5,52.2,9.6,41\n"))
    assert track.clock is Clock.VIDEO
    assert [p.time_s for p in track.points] == [0.0, 0.5]
    assert track.points[1].height_m == 41.0


def test_semicolons_and_decimal_commas(tmp_path: Path) -> None:
    track = read_track(_write(tmp_path, "time;lat;lon;alt\n0,5;52,123456;9,6;100,5\n", "deutsch.txt"))
    assert (track.points[0].time_s, track.points[0].lat_deg, track.points[0].alt_m) == (0.5, 52.123456, 100.5)


def test_tabs_comments_and_quotes(tmp_path: Path) -> None:
    text = '# made by hand\n"time_s"\t"lat"\t"lon"\n0\t"52.1"\t9.6\n# pause\n1\t52.2\t9.6\n'
    assert len(read_track(_write(tmp_path, text)).points) == 2


def test_vehicle_or_camera_angles(tmp_path: Path) -> None:
    flying = "time,lat,lon,yaw,pitch,roll\n0,52.1,9.6,90,5,-3\n1,52.1,9.6,90,5,-3\n"
    vehicle = read_track(_write(tmp_path, flying)).points[0].attitude
    camera = read_track(_write(tmp_path, flying.replace("90,5,-3", "90,-88,0"), "b.csv")).points[0].attitude
    assert vehicle is not None
    assert camera is not None
    assert math.degrees(vehicle.off_nadir_rad) == pytest.approx(math.hypot(5, 3), abs=0.05)
    assert math.degrees(camera.off_nadir_rad) == pytest.approx(2.0)
    assert math.degrees(vehicle.heading_rad) == pytest.approx(90.0, abs=0.5)


def test_damaged_rows_are_left_out(tmp_path: Path) -> None:
    text = "time,lat,lon\n0,52.1,9.6\n1,,\nnot a row\n2,nan,9.6\n3,0,0\n4,952.1,9.6\n5,52.1,9.6\n6,52."
    track = read_track(_write(tmp_path, text))
    assert [p.time_s for p in track.points] == [0.0, 5.0]
    assert track.warnings


def test_a_single_glitch_is_left_out(tmp_path: Path) -> None:
    rows = "".join(f"{i},{52.1 + i * 1e-5 + (5.0 if i == 7 else 0.0)},9.6\n" for i in range(20))
    track = read_track(_write(tmp_path, "time,lat,lon\n" + rows))
    assert len(track.points) == 19
    assert "jump" in track.warnings[0]


def test_a_table_of_something_else(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="latitude and longitude"):
        read_track(_write(tmp_path, "name,price\napple,3\n"))
    with pytest.raises(DataError, match="time"):
        read_track(_write(tmp_path, "lat,lon,name\n52.1,9.6,a\n"))


def test_units_in_headers() -> None:
    columns = understand(["Latitude (deg)", "Lon", "Relative Altitude [ft]", "elapsed_ms", "Heading [rad]"])
    assert columns[Quantity.HEIGHT].factor == pytest.approx(0.3048)
    assert columns[Quantity.ELAPSED].factor == pytest.approx(1e-3)
    assert columns[Quantity.YAW].factor == 1.0
