"""Streams over loopback: they come, break, come again, and are recorded as they came."""

from __future__ import annotations

import contextlib
import itertools
import re
import select
import shutil
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest

from photomap_gis.core.errors import LinkError, MissingExtraError, PhotomapError, UsageError
from photomap_gis.core.live import EndReason, GapKind, LiveFrame, StreamEnd, StreamEvent, StreamGap
from photomap_gis.ingest.decode import read_video_frame
from photomap_gis.ingest.stream import open_stream
from photomap_gis.ingest.stream.connect import Limits
from photomap_gis.ingest.stream.own_address import as_typed_elsewhere
from tests.ingest.stream.made import FakeClock, write_video

SENDER = Path(__file__).with_name("sender.py")
QUICK = Limits(open_s=5.0, listen_s=20.0, stall_s=0.5, first_retry_s=0.01, last_retry_s=0.1, give_up_s=20.0)


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


@contextlib.contextmanager
def sending(video: Path, url: str, kind: str, rate: float = 100.0, turns: int = 1000) -> Iterator[subprocess.Popen]:
    process = subprocess.Popen([sys.executable, str(SENDER), str(video), url, kind, str(rate), str(turns)])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def take(events: Iterator[StreamEvent], frames: int) -> list[StreamEvent]:
    taken: list[StreamEvent] = []
    count = 0
    for event in events:
        taken.append(event)
        count += isinstance(event, LiveFrame)
        if count >= frames or isinstance(event, StreamEnd):
            break
    return taken


def frames_of(events: list[StreamEvent]) -> list[LiveFrame]:
    return [e for e in events if isinstance(e, LiveFrame)]


def gaps_of(events: list[StreamEvent]) -> list[GapKind]:
    return [e.kind for e in events if isinstance(e, StreamGap)]


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_video(tmp_path_factory.mktemp("videos") / "a.mp4", count=40, gop=10)


@pytest.mark.parametrize("scheme", ["udp", "rtmp", "tcp"])
def test_a_stream_is_recorded_as_it_came_and_read_back_the_same(tmp_path: Path, video: Path, scheme: str) -> None:
    port = free_port(socket.SOCK_DGRAM if scheme == "udp" else socket.SOCK_STREAM)
    ours, theirs, kind = {
        "udp": (f"udp://127.0.0.1:{port}", f"udp://127.0.0.1:{port}?pkt_size=1316", "mpegts"),
        "rtmp": (f"rtmp://127.0.0.1:{port}/live/drone?listen=1", f"rtmp://127.0.0.1:{port}/live/drone", "flv"),
        "tcp": (f"tcp://127.0.0.1:{port}?listen=1", f"tcp://127.0.0.1:{port}", "mpegts"),
    }[scheme]
    source = open_stream(ours, limits=QUICK, recording=tmp_path / "recording")
    with sending(video, theirs, kind):
        events = iter(source)
        live = take(events, 60)
        source.close()
        live += list(events)
    frames = frames_of(live)
    assert gaps_of(live)[0] is GapKind.WAITING and str(port) in live[0].message
    assert isinstance(live[-1], StreamEnd) and live[-1].reason is EndReason.CLOSED
    assert [f.index for f in frames] == list(range(len(frames))) and len(frames) >= 60
    assert all(b.stream_time_s > a.stream_time_s for a, b in itertools.pairwise(frames))
    again = frames_of(list(open_stream(tmp_path / "recording", realtime=False)))
    assert [(f.index, f.stream_time_s, f.arrival_s) for f in again] == [
        (f.index, f.stream_time_s, f.arrival_s) for f in frames
    ]
    assert all(np.array_equal(a.image, b.image) for a, b in zip(again, frames, strict=True))
    assert [(a.ref.source, a.ref.frame_number) for a in again] == [(f.ref.source, f.ref.frame_number) for f in frames]
    # what the map reads from a frame's place in the recording is that frame
    one = frames[25]
    assert np.array_equal(read_video_frame(Path(one.ref.source), one.ref.frame_number), one.image)


def test_a_lost_link_is_told_and_the_stream_goes_on(video: Path) -> None:
    port = free_port(socket.SOCK_DGRAM)
    source = open_stream(f"udp://127.0.0.1:{port}", limits=QUICK)
    target = f"udp://127.0.0.1:{port}?pkt_size=1316"
    events = iter(source)
    with sending(video, target, "mpegts"):
        before = take(events, 30)
    lost = next(e for e in events if isinstance(e, StreamGap) and e.kind is GapKind.LINK_LOST)
    with sending(video, target, "mpegts"):
        after = take(events, 30)
        source.close()
    assert GapKind.RECONNECTED in gaps_of(after)
    back = next(e for e in after if isinstance(e, StreamGap) and e.kind is GapKind.RECONNECTED)
    assert back.duration_s is not None and back.duration_s > 0.0 and back.arrival_s > lost.arrival_s
    every = frames_of(before) + frames_of(after)
    assert all(b.stream_time_s > a.stream_time_s for a, b in itertools.pairwise(every))
    first = frames_of(after)[0]
    last = frames_of(before)[-1]
    assert first.stream_time_s - last.stream_time_s <= first.arrival_s - lost.arrival_s + QUICK.stall_s + 5.0
    list(events)


def test_a_source_that_stays_away_ends(video: Path) -> None:
    port = free_port()
    limits = Limits(open_s=1.0, listen_s=0.2, stall_s=0.3, first_retry_s=0.01, last_retry_s=0.05, give_up_s=0.5)
    source = open_stream(f"rtmp://127.0.0.1:{port}/live/x?listen=1", limits=limits)
    with sending(video, f"rtmp://127.0.0.1:{port}/live/x", "flv", turns=1, rate=1000.0):
        events = list(source)
    assert isinstance(events[-1], StreamEnd) and events[-1].reason is EndReason.GAVE_UP
    assert len(frames_of(events)) == 40


def test_nobody_there_is_told_at_once() -> None:
    port = free_port()
    for url, words in [
        (f"rtsp://127.0.0.1:{port}/x", "refused"),
        (f"http://127.0.0.1:{port}/x.m3u8", "refused"),
        (f"rtmp://user:secret@127.0.0.1:{port}/live/x", "refused"),
        ("rtsp://no.such.host.invalid/x", "no host no.such.host.invalid"),
    ]:
        with pytest.raises(LinkError, match=words) as error:
            open_stream(url, limits=QUICK)
        assert "secret" not in str(error.value)


def test_the_address_to_type_into_the_app() -> None:
    assert as_typed_elsewhere("rtmp://0.0.0.0:1935/live/x", "10.0.0.7") == "rtmp://10.0.0.7:1935/live/x"
    assert as_typed_elsewhere("rtmp://127.0.0.1:1935/live/x", "10.0.0.7") == "rtmp://127.0.0.1:1935/live/x"
    assert as_typed_elsewhere("udp://0.0.0.0:5600", None) == "udp://0.0.0.0:5600"


@pytest.mark.parametrize("text", ["gopher://x/y", "udp://127.0.0.1", "rtmp://:x/y", "device:"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(UsageError):
        open_stream(text)


def test_a_web_server_that_is_no_camera(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            for body in (b"404 Not Found", b"200 OK"):
                connection, _ = server.accept()
                connection.recv(4096)
                connection.sendall(b"HTTP/1.0 " + body + b"\r\nContent-Length: 400\r\n\r\n" + b"<html>" + b"a" * 394)
                connection.close()

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        url = f"http://127.0.0.1:{server.getsockname()[1]}/video"
        with pytest.raises(LinkError, match="no such stream"):
            open_stream(url, limits=QUICK)
        with pytest.raises(PhotomapError, match="no video"):
            open_stream(url, limits=QUICK)
        thread.join()


def test_a_playlist_is_played_at_its_rate_to_its_end(tmp_path: Path, video: Path) -> None:
    with av.open(str(video)) as source, av.open(str(tmp_path / "a.m3u8"), "w", format="hls",
                                                options={"hls_time": "1", "hls_list_size": "0"}) as target:  # fmt: skip
        stream = source.streams.video[0]
        out = target.add_stream_from_template(stream)
        for packet in source.demux(stream):
            if packet.size:
                packet.stream = out
                target.mux(packet)
    clock = FakeClock()
    events = list(open_stream(tmp_path / "a.m3u8", clock=clock, limits=QUICK))
    frames = frames_of(events)
    assert events[-1].reason is EndReason.END_OF_FILE and len(frames) >= 20
    assert np.allclose(np.diff([f.arrival_s for f in frames]), 0.1, atol=0.02)


def test_srt_by_the_systems_relay(video: Path) -> None:
    relay = shutil.which("srt-live-transmit")
    if relay is None:
        pytest.skip("srt-live-transmit is not installed (package srt-tools)")
    udp, srt = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM)
    source = open_stream(f"srt://127.0.0.1:{srt}?mode=listener", limits=QUICK)
    with sending(video, f"udp://127.0.0.1:{udp}?pkt_size=1316", "mpegts"):
        drone = subprocess.Popen(
            [relay, "-q", f"udp://127.0.0.1:{udp}", f"srt://127.0.0.1:{srt}?mode=caller"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            events = iter(source)
            live = take(events, 20)
            source.close()
            list(events)
        finally:
            drone.kill()
            drone.wait()
    assert len(frames_of(live)) == 20


def test_srt_without_a_relay_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(MissingExtraError, match="srt-tools"):
        open_stream("srt://192.0.2.1:9000")


class RtspServer:
    """One client at a time: H.264 by RTP, within the conversation (TCP) or as datagrams where ``udp_only``."""

    def __init__(self, video: Path, *, udp_only: bool = False) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._udp_only = udp_only
        with av.open(str(video)) as container:
            stream = container.streams.video[0]
            bits = av.BitStreamFilterContext("h264_mp4toannexb", stream)
            packets = [q for p in container.demux(stream) if p.size for q in bits.filter(p)]
            self._units = [(float(p.pts * p.time_base), bytes(p)) for p in packets]
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            with connection, contextlib.suppress(OSError):
                self._talk(connection)

    def _talk(self, connection: socket.socket) -> None:
        reader = connection.makefile("rb")
        target = None
        while True:
            lines = []
            while (line := reader.readline().strip()) or not lines:
                if not line:
                    return
                lines.append(line.decode())
            fields = {k.lower(): v for k, _, v in (x.partition(": ") for x in lines[1:])}
            method, sequence = lines[0].split()[0], fields["cseq"]
            extra, body = "", ""
            status = "200 OK"
            if method == "OPTIONS":
                extra = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
            elif method == "DESCRIBE":
                body = (
                    "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=drone\r\nt=0 0\r\nm=video 0 RTP/AVP 96\r\n"
                    "a=rtpmap:96 H264/90000\r\na=fmtp:96 packetization-mode=1\r\na=control:track1\r\n"
                )
                extra = "Content-Type: application/sdp\r\n"
            elif method == "SETUP":
                transport = fields["transport"]
                if "TCP" in transport and self._udp_only:
                    status = "461 Unsupported transport"
                else:
                    port = re.search(r"client_port=(\d+)", transport)
                    target = ("127.0.0.1", int(port.group(1))) if port else None
                    more = ";server_port=50000-50001" if port else ""
                    extra = f"Transport: {transport.split(',')[0]}{more}\r\nSession: 1\r\n"
            head = f"RTSP/1.0 {status}\r\nCSeq: {sequence}\r\n{extra}Content-Length: {len(body)}\r\n\r\n"
            connection.sendall((head + body).encode())
            if method == "PLAY":
                self._play(connection, target)
                return

    def _play(self, connection: socket.socket, target: tuple[str, int] | None) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as datagrams:
            number = 0
            for turn in range(30):
                for time_s, unit in self._units:
                    payloads = list(_payloads(unit))
                    for k, payload in enumerate(payloads):
                        number = (number + 1) % 65_536
                        ticks = round((time_s + 4.0 * turn) * 90_000)
                        marker = 0x80 if k == len(payloads) - 1 else 0
                        packet = struct.pack(">BBHII", 0x80, 96 | marker, number, ticks, 77) + payload
                        if target is None:
                            connection.sendall(b"$\x00" + struct.pack(">H", len(packet)) + packet)
                        else:
                            datagrams.sendto(packet, target)
                            select.select([], [], [], 0.002)

    def close(self) -> None:
        self._listener.close()


def _payloads(unit: bytes) -> Iterator[bytes]:
    """An access unit as RTP payloads: small NAL units whole, large ones in fragments (FU-A)."""
    for nal in re.split(b"\x00\x00\x00\x01|\x00\x00\x01", unit):
        if not nal:
            continue
        if len(nal) <= 1200:
            yield nal
            continue
        kind = nal[0] & 0x1F
        pieces = [nal[1 + k : 1 + k + 1200] for k in range(0, len(nal) - 1, 1200)]
        for k, piece in enumerate(pieces):
            flags = (0x80 if k == 0 else 0) | (0x40 if k == len(pieces) - 1 else 0)
            yield bytes([nal[0] & 0xE0 | 28, flags | kind]) + piece


@pytest.mark.parametrize("udp_only", [False, True])
def test_rtsp_by_tcp_first_and_by_udp_where_it_must(video: Path, tmp_path: Path, udp_only: bool) -> None:
    server = RtspServer(video, udp_only=udp_only)
    source = open_stream(f"rtsp://user:pass@127.0.0.1:{server.port}/x", limits=QUICK, recording=tmp_path / "box")
    assert source.name == f"rtsp://127.0.0.1:{server.port}/x"
    events = iter(source)
    live = take(events, 25)
    source.close()
    live += list(events)
    server.close()
    frames = frames_of(live)
    assert len(frames) >= 25
    steps = np.diff([f.stream_time_s for f in frames])
    assert np.median(steps) == pytest.approx(0.1, abs=0.02)
    again = frames_of(list(open_stream(tmp_path / "box", realtime=False)))
    assert all(np.array_equal(a.image, b.image) for a, b in zip(again, frames, strict=True))
