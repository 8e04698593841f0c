"""A black box as a source of ``photomap map``: one flight, whatever its pieces; positions from the log beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from photomap_gis.core.errors import DataError
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.sources import open_sources, read_frame
from photomap_gis.ingest.stream import open_stream
from photomap_gis.ingest.stream.addresses import Address
from photomap_gis.ingest.stream.black_box import BlackBox
from photomap_gis.ingest.stream.link_source import LinkSource
from tests.ingest.stream.made import FakeClock, write_video
from tests.ingest.stream.test_black_box import PLENTY, Tapes, fly, frames_of


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


def test_the_autopilots_log_places_the_frames_by_the_recordings_clock(tmp_path: Path) -> None:
    from tests.ingest.stream.test_telemetry import Air, listening, metres, path_of

    box = tmp_path / "recording"
    clock = FakeClock()
    path = path_of()
    air = Air(clock, path)
    tape = write_video(tmp_path / "a.ts", count=60)
    telemetry = listening(clock, tlog=box / "telemetry.tlog")
    with BlackBox(box, clock, source="x", free_bytes=lambda _: PLENTY) as recorder:
        live = fly_quickly(clock, tape, recorder)
    for _ in range(100):  # its receiver's clock is a year off this machine's
        telemetry.take(air.step(0.1))
    telemetry.close()
    footage = open_sources([box], IngestOptions(frame_rate_hz=5.0))
    placed = [f for f in footage.frames if f.fix is not None]
    assert len(placed) >= len(footage.frames) - 2
    start_s = live[0].ref.time_s
    for frame in placed[2:]:
        at_s = frame.time_s - start_s
        lat, lon = (float(np.interp(at_s, path.times_s, c)) for c in (path.lat_deg, path.lon_deg))
        assert metres(frame.fix, lat, lon) < 1.0
    assert footage.frames[0].time_s == pytest.approx(start_s, abs=0.01)


def fly_quickly(clock: FakeClock, tape: Path, recorder: BlackBox) -> list:
    """All frames of a tape in no time: what they tell of themselves is their time stamps."""
    source = LinkSource(Address("rtsp://d/x", "rtsp://d/x", "rtsp"), IngestOptions(), clock, connector=Tapes(tape))
    source.record_into(recorder)
    frames = []
    for event in source:
        if hasattr(event, "picture"):
            frames.append(event)
        elif len(frames) == 60:
            break
    return frames


def test_a_live_mission_named_as_a_source_points_to_its_recording(tmp_path: Path) -> None:
    with BlackBox(tmp_path / "recording", FakeClock(), source="x"):
        pass
    (tmp_path / "mission.json").write_text("{}")
    with pytest.raises(DataError, match="name what it recorded"):
        open_sources([tmp_path])
