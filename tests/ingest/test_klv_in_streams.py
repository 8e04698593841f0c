"""MISB metadata in transport streams, with time stamps and without: it is of the picture that it came with."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.live import StreamFix
from photomap_gis.ingest import IngestOptions
from photomap_gis.ingest.stream.addresses import Address
from photomap_gis.ingest.stream.link_source import LinkSource
from photomap_gis.ingest.telemetry import Clock, read_track
from photomap_gis.ingest.telemetry.beside import BesidePictures
from tests.ingest.klv_ts import with_metadata
from tests.ingest.stream.made import FakeClock, write_video
from tests.ingest.test_telemetry_klv import _flight_packet

RATE_HZ, FIRST, COUNT = 10, 12, 40


def lat_of(second: float) -> float:
    return 52.1 + second * 1e-4


@pytest.fixture(params=["sync", "async"])
def stream(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Four seconds of video whose metadata begins after 1.2: at second s it tells the latitude of s."""
    video = write_video(tmp_path / "plain.ts", count=COUNT, rate=RATE_HZ)
    packets = {n: _flight_packet(n / RATE_HZ) for n in range(FIRST, COUNT - 3)}
    return with_metadata(video, tmp_path / "a.ts", packets, rate_hz=RATE_HZ, sync=request.param == "sync")


def test_a_file_tells_when_its_metadata_was(stream: Path) -> None:
    track = read_track(stream)
    assert track.clock is Clock.VIDEO and len(track.points) == COUNT - 3 - FIRST
    for p in track.points:  # asynchronous metadata lies between two pictures: half a picture is not known
        assert math.isclose((p.lat_deg - 52.1) / 1e-4, p.time_s, abs_tol=0.5 / RATE_HZ + 1e-3)
    assert track.epoch_utc_s == pytest.approx(1_714_558_830.0, abs=0.5 / RATE_HZ + 1e-3)


def test_a_live_stream_tells_it_too(stream: Path) -> None:
    source = LinkSource(Address(str(stream), "a", "file"), IngestOptions(), FakeClock(), realtime=False)
    fixes = [e for e in source if isinstance(e, StreamFix)]
    assert len(fixes) == COUNT - 3 - FIRST
    for f in fixes:
        assert math.isclose((f.fix.lat_deg - 52.1) / 1e-4, f.stream_time_s, abs_tol=0.5 / RATE_HZ + 1e-3)


@given(late=st.integers(0, 5), per_picture=st.integers(1, 3))
def test_however_late_pictures_come_out_metadata_is_between_its_neighbours(late: int, per_picture: int) -> None:
    beside: BesidePictures[tuple[int, int]] = BesidePictures()
    events = [(1000 * n, "picture", n) for n in range(30)]
    events += [(1000 * n - 100 * (k + 1), "untimed", (n, k)) for n in range(30) for k in range(per_picture)]
    order = sorted(events, key=lambda e: (e[0] + (1000 * late if e[1] == "picture" else 0), e[0]))
    told = []
    for place, kind, what in order:
        told += beside.picture(place, what / 10.0) if kind == "picture" else beside.untimed(place + 1000, what)
    told += beside.rest()
    assert len(told) == 30 * per_picture
    for (n, _), second in told:
        assert second == pytest.approx(min(n + 0.5, 29.0) / 10.0) or second == pytest.approx((n + 0.5) / 10.0)


def test_where_no_place_is_known_it_is_of_the_last_picture() -> None:
    beside: BesidePictures[str] = BesidePictures()
    assert beside.untimed(None, "a") == [("a", None)]
    assert beside.picture(100, 1.0) == [] and beside.untimed(-1, "b") == [("b", 1.0)]
