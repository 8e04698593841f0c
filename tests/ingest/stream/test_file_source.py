"""A file as a live source: its rate, its numbers, its pixels, its metadata, damage."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from photomap_gis.core.errors import DataError
from photomap_gis.core.live import EndReason, FrameSource, GapKind, LiveFrame, StreamEnd, StreamFix, StreamGap
from photomap_gis.ingest.decode import read_video_frames
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.stream import open_stream
from tests.ingest.stream.made import FakeClock, write_video


def test_frames_are_those_that_the_map_reads(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", count=12)
    source = open_stream(video, realtime=False, options=IngestOptions(hfov_deg=60.0), clock=FakeClock())
    assert isinstance(source, FrameSource) and not source.is_live
    *frames, end = list(source)
    assert isinstance(end, StreamEnd) and end.reason is EndReason.END_OF_FILE
    assert [f.index for f in frames] == list(range(12)) == [f.ref.frame_number for f in frames]
    assert np.allclose([f.stream_time_s for f in frames], np.arange(12) / 10)
    for frame, (_, pixels) in zip(frames, read_video_frames(video, range(12)), strict=True):
        assert np.array_equal(frame.image, pixels) and not frame.image.flags.writeable
        assert frame.grey.shape == pixels.shape[:2]
        assert frame.ref.camera is not None and round(np.degrees(frame.ref.camera.hfov_rad)) == 60


def test_grey_is_the_brightness_of_the_picture(tmp_path: Path) -> None:
    frame = next(iter(open_stream(write_video(tmp_path / "a.mp4", count=2), realtime=False)))
    b, g, r = np.moveaxis(frame.image.astype(float), -1, 0)
    assert np.abs(frame.grey - (0.114 * b + 0.587 * g + 0.299 * r)).mean() < 2.0


def test_played_at_its_rate_it_waits_for_each_frame(tmp_path: Path) -> None:
    clock = FakeClock()
    video = write_video(tmp_path / "a.mp4", count=4, pts=[0, 100, 700, 800])
    frames = [e for e in open_stream(video, clock=clock) if isinstance(e, LiveFrame)]
    assert np.allclose([f.arrival_s - 1000.0 for f in frames], [0.0, 0.1, 0.7, 0.8])
    assert np.allclose([f.stream_time_s for f in frames], [0.0, 0.1, 0.7, 0.8])
    assert max(clock.naps) <= 0.2  # a long wait can be broken off


def test_closing_ends_it(tmp_path: Path) -> None:
    source = open_stream(write_video(tmp_path / "a.mp4"), realtime=False)
    events = iter(source)
    next(events)
    source.close()
    rest = list(events)
    assert rest[-1].reason is EndReason.CLOSED and len(rest) <= 3


def test_damage_is_told_and_the_others_come(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.ts", count=40, codec="libx264")
    data = bytearray(video.read_bytes())
    for at in range(len(data) // 3, len(data) // 2, 188):
        data[at + 20 : at + 180] = bytes(160)
    video.write_bytes(bytes(data))
    events = list(open_stream(video, realtime=False))
    assert sum(isinstance(e, LiveFrame) for e in events) > 15
    lost = sum(e.frames_lost for e in events if isinstance(e, StreamGap) and e.kind is GapKind.DAMAGED)
    frames = [e for e in events if isinstance(e, LiveFrame)]
    assert lost + len(frames) <= 40
    assert all(b.stream_time_s > a.stream_time_s for a, b in itertools.pairwise(frames))


@pytest.mark.parametrize("content", [b"", b"no video at all" * 50, b"\x00\x00\x00\x20ftypisom" + bytes(100)])
def test_what_is_no_video_is_told_before_the_first_frame(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.mp4"
    path.write_bytes(content)
    with pytest.raises(DataError):
        open_stream(path)
    with pytest.raises(DataError, match="no such file"):
        open_stream(tmp_path / "b.mp4")


@pytest.mark.shared
def test_misb_metadata_comes_between_the_frames(shared_data: Path) -> None:
    events = list(open_stream(shared_data / "misb_video" / "sample-stream.ts", realtime=False))
    fixes = [e for e in events if isinstance(e, StreamFix)]
    frames = [e for e in events if isinstance(e, LiveFrame)]
    assert len(fixes) > 200 and len(frames) > 200
    assert abs(fixes[0].fix.lat_deg - 34.72) < 0.01 and fixes[0].attitude is not None
    assert abs((fixes[-1].utc_s - fixes[0].utc_s) - (fixes[-1].stream_time_s - fixes[0].stream_time_s)) < 0.1


def test_frames_that_are_stored_out_of_order_come_in_theirs(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", count=23, b_frames=2, gop=8)
    frames = [e for e in open_stream(video, realtime=False) if isinstance(e, LiveFrame)]
    assert [f.ref.frame_number for f in frames] == list(range(23))
    assert np.allclose([f.stream_time_s for f in frames], np.arange(23) / 10)
