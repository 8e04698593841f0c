"""The black box: what a cut, a full disk, changed sizes and jumping clocks leave of it."""

from __future__ import annotations

import itertools
import signal
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest

from photomap_gis.core.errors import DataError, LinkError
from photomap_gis.core.live import EndReason, GapKind, LiveFrame, StreamEvent, StreamFix, StreamGap
from photomap_gis.ingest.decode import read_video_frame
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.sources import open_sources
from photomap_gis.ingest.stream import open_stream
from photomap_gis.ingest.stream.addresses import Address
from photomap_gis.ingest.stream.black_box import BlackBox
from photomap_gis.ingest.stream.connect import Connection, Limits
from photomap_gis.ingest.stream.link_source import LinkSource
from tests.ingest.stream.made import FakeClock, write_video
from tests.ingest.stream.test_links import free_port, sending

PLENTY = 1 << 40


class Tapes:
    """A connector whose link is one file after the other; then nobody answers."""

    def __init__(self, *paths: Path) -> None:
        self._paths = list(paths)

    def connect(self, address: Address, limits: Limits) -> Connection:
        if not self._paths:
            raise LinkError("refused")
        container = av.open(str(self._paths.pop(0)))
        data = tuple(s for s in container.streams if s.type == "data")
        return Connection(container, container.streams.video[0], data)

    def close(self) -> None:
        pass


def fly(clock: FakeClock, *tapes: Path, box: BlackBox | None = None) -> list[StreamEvent]:
    source = LinkSource(
        Address("rtsp://drone/x", "rtsp://drone/x", "rtsp"), IngestOptions(), clock, limits=Limits(give_up_s=5.0),
        connector=Tapes(*tapes),
    )  # fmt: skip
    if box is not None:
        source.record_into(box)
    return list(source)


def frames_of(events: list[StreamEvent]) -> list[LiveFrame]:
    return [e for e in events if isinstance(e, LiveFrame)]


def same(a: list[LiveFrame], b: list[LiveFrame]) -> bool:
    return [(f.index, f.stream_time_s, f.arrival_s) for f in a] == [
        (f.index, f.stream_time_s, f.arrival_s) for f in b
    ] and all(np.array_equal(x.image, y.image) for x, y in zip(a, b, strict=True))


def test_reconnections_sizes_and_jumps_come_back_as_they_were(tmp_path: Path) -> None:
    first = write_video(tmp_path / "a.ts", count=20)
    other = write_video(tmp_path / "b.ts", count=20, size=(128, 96), first=20)
    joined = tmp_path / "joined.ts"
    joined.write_bytes(first.read_bytes() + first.read_bytes() + other.read_bytes())
    clock = FakeClock()
    with BlackBox(tmp_path / "box", clock, source="x", free_bytes=lambda _: PLENTY) as box:
        events = fly(clock, first, joined, box=box)
    frames = frames_of(events)
    assert len(frames) == 80 and events[-1].reason is EndReason.GAVE_UP
    gaps = [e.kind for e in events if isinstance(e, StreamGap)]
    assert gaps.count(GapKind.LINK_LOST) == 2 and gaps.count(GapKind.RECONNECTED) == 1
    assert GapKind.SIZE_CHANGED in gaps and GapKind.TIME_JUMP in gaps
    assert all(b.stream_time_s > a.stream_time_s for a, b in itertools.pairwise(frames))
    read = list(open_stream(tmp_path / "box", realtime=False, clock=FakeClock()))
    assert same(frames_of(read), frames)
    assert [e.kind for e in read if isinstance(e, StreamGap)].count(GapKind.LINK_LOST) == 2
    for frame in frames[::9]:
        if frame.image.shape[1] == 96:  # in the piece in which the size changes, no more
            assert np.array_equal(read_video_frame(Path(frame.ref.source), frame.ref.frame_number), frame.image)


@pytest.mark.parametrize("suffix", [".ts", ".mp4"])
def test_frames_that_were_sent_out_of_order(tmp_path: Path, suffix: str) -> None:
    tapes = [write_video(tmp_path / f"{n}{suffix}", count=23, first=23 * n, b_frames=2, gop=8) for n in range(2)]
    clock = FakeClock()
    with BlackBox(tmp_path / "box", clock, source="x", free_bytes=lambda _: PLENTY) as box:
        frames = frames_of(fly(clock, *tapes, box=box))
    assert len(frames) == 46
    assert same(frames_of(list(open_stream(tmp_path / "box", realtime=False))), frames)
    for frame in frames[:40:7]:
        assert np.array_equal(read_video_frame(Path(frame.ref.source), frame.ref.frame_number), frame.image)


def test_a_damaged_stream_is_recorded_with_its_damage(tmp_path: Path) -> None:
    tape = write_video(tmp_path / "a.ts", count=60, size=(320, 240), gop=12)
    data = bytearray(tape.read_bytes())
    rng = np.random.default_rng(4)
    for at in rng.integers(2000, len(data) - 2000, 12).tolist():
        data[at : at + 400] = rng.bytes(400)
    tape.write_bytes(bytes(data))
    clock = FakeClock()
    with BlackBox(tmp_path / "box", clock, source="x", free_bytes=lambda _: PLENTY) as box:
        frames = frames_of(fly(clock, tape, box=box))
    assert len(frames) > 30
    assert same(frames_of(list(open_stream(tmp_path / "box", realtime=False))), frames)


def test_a_full_disk_ends_the_recording_and_not_the_flight(tmp_path: Path) -> None:
    clock = FakeClock()
    tape = write_video(tmp_path / "a.ts", count=30)
    free = itertools.chain([PLENTY], itertools.repeat(1000))
    box = BlackBox(tmp_path / "box", clock, source="x", free_bytes=lambda _: next(free))
    source = LinkSource(Address("rtsp://d/x", "rtsp://d/x", "rtsp"), IngestOptions(), clock,
                        limits=Limits(first_retry_s=2.0, give_up_s=8.0), connector=Tapes(tape, tape, tape))  # fmt: skip
    source.record_into(box)
    events = list(source)
    box.close()
    assert len(frames_of(events)) == 90
    assert box.problem is not None and "full" in box.problem


def test_what_cannot_be_kept_in_a_transport_stream_goes_into_matroska(tmp_path: Path) -> None:
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        stream = container.add_stream("mjpeg", rate=10)
        stream.width, stream.height, stream.pix_fmt = 96, 64, "yuvj420p"
        for i in range(12):
            frame = av.VideoFrame.from_ndarray(np.full((64, 96, 3), 20 * i, np.uint8), format="bgr24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    clock = FakeClock()
    with BlackBox(tmp_path / "box", clock, source="x", free_bytes=lambda _: PLENTY) as box:
        frames = frames_of(fly(clock, tmp_path / "a.mkv", box=box))
    assert [p.name for p in (tmp_path / "box").glob("piece*")] == ["piece-00001.mkv"]
    assert len(frames) == 12 and same(frames_of(list(open_stream(tmp_path / "box", realtime=False))), frames)


@pytest.mark.shared
def test_metadata_is_kept_with_the_pictures(tmp_path: Path, shared_data: Path) -> None:
    clock = FakeClock()
    with BlackBox(tmp_path / "box", clock, source="x", free_bytes=lambda _: PLENTY) as box:
        events = fly(clock, shared_data / "misb_video" / "sample-stream.ts", box=box)
    fixes = [e.fix for e in events if isinstance(e, StreamFix)]
    again = list(open_stream(tmp_path / "box", realtime=False))
    kept = [e.fix for e in again if isinstance(e, StreamFix)]
    assert len(kept) > 200 and len(fixes) - len(kept) <= 2  # but for those before the first key frame
    assert kept == fixes[-len(kept) :]
    assert same(frames_of(again), frames_of(events))


CHILD = """
import sys
from pathlib import Path
from photomap_gis.ingest.sources import open_sources
from photomap_gis.ingest.stream import open_stream
for event in open_stream(sys.argv[1], recording=Path(sys.argv[2])):
    if hasattr(event, "picture"):
        print(event.index, repr(event.stream_time_s), int(event.image.sum()), flush=True)
"""


def test_killed_at_any_moment_it_plays_but_for_the_last_second(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", count=40, gop=10)
    port = free_port()
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, f"udp://127.0.0.1:{port}", str(tmp_path / "box")], stdout=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    told = []
    try:
        with sending(video, f"udp://127.0.0.1:{port}?pkt_size=1316", "mpegts", rate=50.0):
            assert child.stdout is not None
            for line in child.stdout:
                told.append(line.split())
                if len(told) == 150:
                    break
            child.send_signal(signal.SIGKILL)
    finally:
        child.kill()
        child.communicate()
    again = frames_of(list(open_stream(tmp_path / "box", realtime=False)))
    assert len(again) >= 150 - 60  # 50 frames a second
    for frame, (index, time_s, total) in zip(again[:90], told, strict=False):
        assert (str(frame.index), repr(frame.stream_time_s), str(int(frame.image.sum()))) == (index, time_s, total)


@pytest.mark.parametrize(
    "index",
    [
        b"", b"{}\n", b'{"kind": "recording"}\n', b"\xff" * 1000, b"[" * 100_000,
        b'{"kind": "recording"}\n{"kind": "piece", "file": "../../etc/passwd", "connection": 1}\n',
    ],
)  # fmt: skip
def test_a_damaged_index_is_no_crash(tmp_path: Path, index: bytes) -> None:
    (tmp_path / "index.jsonl").write_bytes(index)
    (tmp_path / "frames.idx").write_bytes(b"x" * 77)
    try:
        events = list(open_stream(tmp_path, realtime=False))
    except DataError:
        return
    assert not frames_of(events)


def test_a_played_file_is_noted_by_name(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", count=12)
    frames = frames_of(list(open_stream(video, realtime=False, recording=tmp_path / "box", clock=FakeClock())))
    assert same(frames_of(list(open_stream(tmp_path / "box", realtime=False))), frames)
    assert not list((tmp_path / "box").glob("piece*"))


def test_a_session_that_was_cut_off_and_resumed_is_one_recording(tmp_path: Path) -> None:
    box = tmp_path / "box"
    clock = FakeClock()
    flown: list[LiveFrame] = []
    starts = []
    for n in range(2):
        tape = write_video(tmp_path / f"{n}.ts", count=20, first=20 * n)
        with BlackBox(box, clock, source="x", free_bytes=lambda _: PLENTY) as recorder:
            starts.append(clock.now_s())
            flown += frames_of(fly(clock, tape, box=recorder))
        if n == 0:  # cut: the last record is half written, the last line too
            with (box / "frames.idx").open("ab") as file:
                file.write(b"half")
            with (box / "index.jsonl").open("ab") as file:
                file.write(b'{"kind": "ga')
        clock.sleep(40.0)
    again = frames_of(list(open_stream(box, realtime=False)))
    assert [f.index for f in again] == list(range(40))
    assert all(np.array_equal(a.image, b.image) for a, b in zip(again, flown, strict=True))
    later_s = starts[1] - starts[0]
    assert np.allclose([f.stream_time_s for f in again[20:]], [later_s + f.stream_time_s for f in flown[20:]])
    footage = open_sources([box], IngestOptions(frame_rate_hz=10.0))
    assert len(footage.flights) == 1
    times_s = [f.time_s for f in footage.frames]
    assert times_s[-1] - times_s[0] == pytest.approx(again[-1].stream_time_s, abs=0.2)
