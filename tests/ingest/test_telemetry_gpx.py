"""GPX: plain, damaged, hostile."""

from __future__ import annotations

from pathlib import Path

import pytest

from photomap_gis.core.errors import DataError
from photomap_gis.ingest.telemetry import Clock, read_track

GPX = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="test" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>
{points}
</trkseg></trk></gpx>
"""
POINT = '<trkpt lat="{lat}" lon="{lon}"><ele>{ele}</ele><time>2024-05-01T10:20:{s:02d}Z</time></trkpt>\n'


def _write(path: Path, points: str) -> Path:
    path.write_text(GPX.format(points=points))
    return path


def test_plain(tmp_path: Path) -> None:
    body = "".join(POINT.format(lat=52.1 + i * 1e-5, lon=9.6, ele=100 + i, s=i) for i in range(5))
    track = read_track(_write(tmp_path / "a.gpx", body))
    assert track.clock is Clock.UTC
    assert [p.time_s for p in track.points] == [1714558800.0 + i for i in range(5)]
    assert track.points[2].alt_m == 102.0
    assert track.points[2].height_m is None  # an altitude is no height
    assert track.warnings == ()


def test_content_decides_not_the_name(tmp_path: Path) -> None:
    assert len(read_track(_write(tmp_path / "a.csv", POINT.format(lat=1, lon=2, ele=3, s=4))).points) == 1


def test_cut_short_gives_what_it_holds(tmp_path: Path) -> None:
    body = "".join(POINT.format(lat=52.1, lon=9.6 + i * 1e-5, ele=0, s=i) for i in range(50))
    path = _write(tmp_path / "a.gpx", body)
    path.write_bytes(path.read_bytes()[:-700])
    track = read_track(path)
    assert 30 < len(track.points) < 50
    assert "cut short" in track.warnings[0]


def test_nonsense_points_are_left_out(tmp_path: Path) -> None:
    body = POINT.format(lat=52.1, lon=9.6, ele="nan", s=1)
    body += POINT.format(lat="north", lon=9.6, ele=1, s=2) + POINT.format(lat=152.1, lon=9.6, ele=1, s=3)
    body += POINT.format(lat=0, lon=0, ele=1, s=4) + '<trkpt lat="52.1" lon="9.7"></trkpt>'
    track = read_track(_write(tmp_path / "a.gpx", body))
    assert len(track.points) == 1
    assert track.points[0].alt_m is None
    assert len(track.warnings) == 2


def test_without_times(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="carry no time"):
        read_track(_write(tmp_path / "a.gpx", '<trkpt lat="52.1" lon="9.7"></trkpt>'))


def test_a_bomb_is_refused(tmp_path: Path) -> None:
    bomb = '<?xml version="1.0"?><!DOCTYPE gpx [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><gpx>&b;</gpx>'
    path = tmp_path / "a.gpx"
    path.write_text(bomb)
    with pytest.raises(DataError, match="entities"):
        read_track(path)


def test_not_xml(tmp_path: Path) -> None:
    path = tmp_path / "a.gpx"
    path.write_text("<gpx><trk>")
    with pytest.raises(DataError, match="not a readable GPX"):
        read_track(path)
