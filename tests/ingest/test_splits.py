"""Which files are pieces of one recording."""

from __future__ import annotations

from pathlib import Path

import pytest

from photomap_gis.ingest.decode import VideoInfo
from photomap_gis.ingest.splits import group_splits

T0 = 1_714_558_830.0
FULL = int(2**32 * 0.985)


def _info(name: str, *, start: float | None = None, length: float = 300.0, size: int = 10**8, **more) -> VideoInfo:
    values = {"width_px": 3840, "height_px": 2160, "rate_hz": 29.97, "frame_count": 0} | more
    return VideoInfo(path=Path("/card") / name, duration_s=length, start_utc_s=start, size_bytes=size, **values)


def _names(infos: list[VideoInfo]) -> list[list[str]]:
    return [[i.path.name for i in group] for group in group_splits(infos)]


def test_clocks_that_meet() -> None:
    a = _info("DJI_0001.MP4", start=T0)
    b = _info("DJI_0002.MP4", start=T0 + 301.0)
    c = _info("DJI_0003.MP4", start=T0 + 900.0)
    assert _names([c, b, a]) == [["DJI_0001.MP4", "DJI_0002.MP4"], ["DJI_0003.MP4"]]


def test_without_clocks_a_full_file_goes_on() -> None:
    infos = [_info("DJI_0001.MP4", size=FULL), _info("DJI_0002.MP4", size=10**8), _info("DJI_0003.MP4")]
    assert _names(infos) == [["DJI_0001.MP4", "DJI_0002.MP4"], ["DJI_0003.MP4"]]


def test_clocks_that_do_not_meet_part_even_full_files() -> None:
    infos = [_info("DJI_0001.MP4", start=T0, size=FULL), _info("DJI_0002.MP4", start=T0 + 1000.0)]
    assert len(_names(infos)) == 2


@pytest.mark.parametrize("names", [("GX010123.MP4", "GX020123.MP4"), ("GOPR0042.MP4", "GP010042.MP4")])
def test_chapters(names: tuple[str, str]) -> None:
    infos = [_info(n, start=T0) for n in names] + [_info("GX010124.MP4", start=T0 + 5000)]
    assert _names(infos) == [list(names), ["GX010124.MP4"]]


@pytest.mark.parametrize(
    "names",
    [("DJI_20240501102030_0012_V.MP4", "DJI_20240501102531_0013_V.MP4"), ("flight_001.mp4", "flight_002.mp4")],
)
def test_other_names(names: tuple[str, str]) -> None:
    assert _names([_info(names[0], start=T0), _info(names[1], start=T0 + 300.5)]) == [list(names)]


def test_what_differs_is_not_joined() -> None:
    a = _info("DJI_0001.MP4", start=T0)
    assert len(_names([a, _info("DJI_0002.MP4", start=T0 + 300, width_px=1920)])) == 2
    assert len(_names([a, _info("DJI_0002.MP4", start=T0 + 300, rate_hz=59.94)])) == 2
    assert len(_names([a, _info("DJI_0003.MP4", start=T0 + 300)])) == 2
    assert len(_names([a, _info("hello.MP4", start=T0 + 300)])) == 2
    assert len(_names([a, _info("../other/DJI_0002.MP4", start=T0 + 300)])) == 2


def test_lenses_of_one_drone_are_not_joined() -> None:
    wide = _info("DJI_20240501102030_0012_W.MP4", start=T0)
    zoom = _info("DJI_20240501102530_0013_Z.MP4", start=T0 + 300)
    assert len(_names([wide, zoom])) == 2


def test_nothing() -> None:
    assert group_splits([]) == []
