"""Streams that are no drone's usual one: grabbers' raw frames, sound without pictures, grey, HEVC."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest

from photomap_gis.core.live import GapKind, LiveFrame, StreamGap
from photomap_gis.ingest import IngestOptions
from photomap_gis.ingest.stream import open_stream
from photomap_gis.ingest.stream.addresses import Address
from photomap_gis.ingest.stream.black_box import BlackBox
from photomap_gis.ingest.stream.connect import Limits
from photomap_gis.ingest.stream.link_source import LinkSource
from tests.ingest.stream.made import FakeClock, picture, write_video


def _raw(path: Path, count: int = 12) -> Address:
    """A grabber without a codec of its own: YUV frames as they are."""
    frames = b"".join(b"FRAME\n" + picture(n)[..., 1].tobytes() + bytes([128]) * (2 * 48 * 32) for n in range(count))
    path.write_bytes(b"YUV4MPEG2 W96 H64 F10:1 Ip C420jpeg\n" + frames)
    return Address(str(path), "device:0", "device", container_format="yuv4mpegpipe")


def _lavfi(path: Path) -> Address:
    return Address("testsrc=size=96x64:rate=10:duration=1.2", "device:0", "device", container_format="lavfi")


@pytest.mark.parametrize("device", [_raw, _lavfi])
def test_a_capture_device_without_a_codec_flies_and_says_that_it_is_not_recorded(tmp_path: Path, device) -> None:
    clock = FakeClock()
    with BlackBox(tmp_path, clock, source="device:0") as box:
        source = LinkSource(device(tmp_path / "raw.y4m"), IngestOptions(), clock, realtime=False)
        source.record_into(box)
        events = []
        for event in source:
            events.append(event)
            if sum(isinstance(e, LiveFrame) for e in events) == 12:
                source.close()
    frames = [e for e in events if isinstance(e, LiveFrame)]
    assert len(frames) == 12 and frames[3].image.shape == (64, 96, 3)
    [gap] = [e for e in events if isinstance(e, StreamGap)]
    assert gap.kind is GapKind.RECORDING_STOPPED and "MJPEG" in gap.message
    assert not list(tmp_path.glob("piece-*"))


def test_sound_without_pictures_is_told_and_the_wait_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "sound.ts"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44_100)
        for n in range(20):
            frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
            frame.sample_rate, frame.pts = 44_100, n * 1024
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    clock = FakeClock()
    address = Address(str(path), "udp://0.0.0.0:5600", "udp", is_listener=True, container_format="mpegts")
    source = LinkSource(address, IngestOptions(), clock, limits=Limits(listen_s=1.0))
    events = []
    for event in source:
        events.append(event)
        if len(events) == 2:
            write_video(tmp_path / "pictures.ts", count=10)
            path.write_bytes((tmp_path / "pictures.ts").read_bytes())  # the sender was set right
        if isinstance(event, LiveFrame):
            source.close()
    assert [e.kind for e in events[:2]] == [GapKind.WAITING, GapKind.UNUSABLE] and "audio" in events[1].message
    assert isinstance(events[2], LiveFrame)


@pytest.mark.parametrize("codec", ["libx265", "mpeg4"])
def test_other_codecs_come_back_from_the_recording_as_they_were(tmp_path: Path, codec: str) -> None:
    video = write_video(tmp_path / "a.ts", count=12, codec=codec)
    clock = FakeClock()
    (tmp_path / "box").mkdir()
    with BlackBox(tmp_path / "box", clock, source="a") as box:
        source = LinkSource(Address(str(video), "a", "file"), IngestOptions(), clock, realtime=False)
        source.record_into(box)
        live = [e for e in source if isinstance(e, LiveFrame)]
    again = [e for e in open_stream(tmp_path / "box", realtime=False) if isinstance(e, LiveFrame)]
    assert len(live) == 12 and len(again) == 12
    assert all(np.array_equal(a.image, b.image) for a, b in zip(again, live, strict=True))
