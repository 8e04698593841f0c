"""A black box as a source of ``photomap map``: one flight, whatever its pieces; positions from the log beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from photomap_gis.core.errors import DataError
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.sources import open_sources, read_frame
from photomap_gis.ingest.stream import open_stream
from photomap_gis.ingest.stream.black_box import BlackBox
from tests.ingest.stream.made import FakeClock, write_video
from tests.ingest.stream.test_black_box import PLENTY, fly, frames_of


def test_pieces_are_one_flight_at_their_times(tmp_path: Path) -> None:
    tapes = [write_video(tmp_path / f"{n}.ts", count=20, first=20 * n) for n in range(3)]
    clock = FakeClock()
    box = tmp_path / "mission" / "recording"
    with BlackBox(box, clock, source="x", free_bytes=lambda _: PLENTY) as recorder:
        live = frames_of(fly(clock, *tapes, box=recorder))
    options = IngestOptions(frame_rate_hz=10.0)
    footage = open_sources([box], options)
    assert len(footage.flights) == 1 and len(list(box.glob("piece*"))) == 3
    by_place = {(f.ref.source, f.ref.frame_number): f for f in live}
    assert len(footage.frames) > 50
    start_s = footage.frames[0].time_s
    for ref in footage.frames:
        seen = by_place[(ref.source, ref.frame_number)]
        assert ref.time_s - start_s == pytest.approx(seen.stream_time_s, abs=1e-3)
        assert np.array_equal(read_frame(ref).image, seen.image)
    assert footage.frames[0].time_s == pytest.approx(live[0].ref.time_s, abs=1e-3)


def test_a_played_video_leads_to_the_video(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", count=12)
    list(open_stream(video, realtime=False, recording=tmp_path / "box", clock=FakeClock()))
    (named,) = {f.source for f in open_sources([tmp_path / "box"], IngestOptions(frame_rate_hz=10.0)).frames}
    assert named == str(video)


def test_a_recording_of_nothing_says_so(tmp_path: Path) -> None:
    with BlackBox(tmp_path / "box", FakeClock(), source="x"):
        pass
    with pytest.raises(DataError, match="no frame had come"):
        open_sources([tmp_path / "box"])
