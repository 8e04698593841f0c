"""Videos: made on the spot, with known pictures, times and telemetry; and the real transport stream."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.ingest.decode import frame_index, probe, read_video_frame, read_video_frames
from photomap_gis.ingest.options import IngestOptions, LensChoice
from photomap_gis.ingest.sampling import choose_frames, sampling_rates
from photomap_gis.ingest.telemetry.track import TrackPoint
from photomap_gis.ingest.video import video_footage

SIZE = (128, 96)
M_PER_DEG = 111_195.0


def _picture(i: int) -> np.ndarray:
    """The planes of a grey picture of mean brightness 40 + i, with a gradient so that it is not flat."""
    width, height = SIZE
    planes = np.full((height * 3 // 2, width), 128, dtype=np.uint8)
    planes[:height] = np.round(16 + (40 + i + np.linspace(-20, 20, width)) * 219 / 255).astype(np.uint8)
    return planes


def make_video(
    path: Path,
    count: int = 90,
    *,
    rate: int = 30,
    pts: Sequence[int] | None = None,
    options: dict[str, str] | None = None,
    metadata: dict[str, str] | None = None,
    subtitles: Sequence[str] = (),
    **container_options: str,
) -> Path:
    """Write a video whose frame i has brightness 40 + i; ``pts`` in 1 / (1000 rate) s."""
    with av.open(str(path), "w", options=container_options) as out:
        out.metadata.update(metadata or {})
        stream = out.add_stream("libx264", rate=rate)
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuv420p"
        stream.codec_context.time_base = Fraction(1, rate * 1000)
        stream.options = {"preset": "ultrafast", "crf": "10", "g": "30", **(options or {})}
        text = out.add_stream("mov_text") if subtitles else None
        if text is not None:
            text.time_base = Fraction(1, 1000)
            text.codec_context.subtitle_header = b"[Script Info]\n[V4+ Styles]\n[Events]\n"
        for i in range(count):
            frame = av.VideoFrame.from_ndarray(_picture(i), format="yuv420p")
            frame.pts = i * 1000 if pts is None else pts[i]
            frame.time_base = Fraction(1, rate * 1000)
            out.mux(stream.encode(frame))
        out.mux(stream.encode())
        for i, line in enumerate(subtitles):
            packet = av.Packet(len(line.encode()).to_bytes(2, "big") + line.encode())
            packet.stream, packet.time_base = text, Fraction(1, 1000)
            packet.pts = packet.dts = i * 1000
            packet.duration = 1000
            out.mux(packet)
    return path


def _number_seen(image: np.ndarray | None) -> float:
    assert image is not None
    return float(image.astype(float).mean()) - 39.5  # the scaler cuts half a level off


B_FRAMES = {"bf": "3", "preset": "veryfast"}


@pytest.mark.parametrize(
    ("suffix", "coding"),
    [(s, c) for s in ("mp4", "mkv", "mov", "ts") for c in ({}, B_FRAMES)] + [("avi", {})],  # AVI knows no B-frames
)
def test_each_frame_is_the_one_that_was_asked_for(tmp_path: Path, suffix: str, coding: dict[str, str]) -> None:
    path = make_video(tmp_path / f"v.{suffix}", options=coding)
    assert len(frame_index(path).pts) == 90
    wanted = [0, 1, 2, 17, 18, 30, 59, 60, 61, 88, 89]
    got = list(read_video_frames(path, wanted))
    assert [n for n, _ in got] == wanted
    for n, image in got:
        assert _number_seen(image) == pytest.approx(n, abs=0.45)
        assert image is not None
        assert image.shape == (96, 128, 3)
        assert image.dtype == np.uint8
    assert _number_seen(read_video_frame(path, 75)) == pytest.approx(75, abs=0.45)


def test_order_and_repeats_do_not_matter(tmp_path: Path) -> None:
    path = make_video(tmp_path / "v.mp4")
    assert [n for n, _ in read_video_frames(path, [50, 3, 50, 3])] == [3, 50]
    assert list(read_video_frames(path, [])) == []
    with pytest.raises(ValueError, match="negative"):
        list(read_video_frames(path, [-1]))


def test_a_frame_that_is_not_there(tmp_path: Path) -> None:
    path = make_video(tmp_path / "v.mp4", 10)
    got = dict(read_video_frames(path, [9, 10, 5000]))
    assert _number_seen(got[9]) == pytest.approx(9, abs=0.45)
    assert got[10] is None
    assert got[5000] is None


def test_variable_rate_and_late_start(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    pts = (5000 + np.cumsum(rng.integers(200, 3000, 60))).tolist()
    path = make_video(tmp_path / "v.mp4", 60, pts=pts, options=B_FRAMES)
    index = frame_index(path)
    np.testing.assert_allclose(index.times_s, (np.array(pts) - pts[0]) / 30_000, atol=1e-4)
    for n, image in read_video_frames(path, [0, 13, 59]):
        assert _number_seen(image) == pytest.approx(n, abs=0.45)


def test_what_the_header_tells(tmp_path: Path) -> None:
    tags = {"creation_time": "2024-05-01T10:20:30.000000Z", "make": "DJI", "model": "FC3582"}
    path = make_video(tmp_path / "v.mov", metadata=tags, movflags="use_metadata_tags")
    info = probe(path)
    assert (info.width_px, info.height_px, info.rate_hz, info.frame_count) == (128, 96, 30.0, 90)
    assert info.duration_s == pytest.approx(3.0)
    assert info.start_utc_s == 1_714_558_830.0
    assert (info.make, info.model) == ("DJI", "FC3582")
    assert info.size_bytes == path.stat().st_size


def test_a_clock_that_was_never_set_is_no_start(tmp_path: Path) -> None:
    path = make_video(tmp_path / "v.mp4", 5, metadata={"creation_time": "1970-01-01T00:00:00.000000Z"})
    assert probe(path).start_utc_s is None


def test_damage_costs_the_damaged_frames_only(tmp_path: Path) -> None:
    path = make_video(tmp_path / "v.ts", options={"g": "10"})
    data = bytearray(path.read_bytes())
    data[len(data) // 3 : len(data) // 3 + 3000] = bytes(3000)
    path.write_bytes(bytes(data))
    got = list(read_video_frames(path, range(len(frame_index(path).pts))))
    good = [(n, image) for n, image in got if image is not None]
    assert len(got) > len(good) > 50
    assert _number_seen(good[0][1]) == pytest.approx(0, abs=0.45)
    assert _number_seen(good[-1][1]) == pytest.approx(89, abs=0.45)


def test_a_file_cut_short(tmp_path: Path) -> None:
    path = make_video(tmp_path / "v.mkv")
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    count = len(frame_index(path).pts)
    assert 20 < count < 90
    got = dict(read_video_frames(path, [0, count - 5, 89]))
    assert _number_seen(got[count - 5]) == pytest.approx(count - 5, abs=0.45)
    assert got[89] is None


def test_no_video(tmp_path: Path) -> None:
    unfinished = make_video(tmp_path / "v.mp4")
    unfinished.write_bytes(unfinished.read_bytes()[:3000])
    noise = tmp_path / "noise.mp4"
    noise.write_bytes(b"hello" * 1000)
    empty = tmp_path / "empty.mp4"
    empty.touch()
    for path, words in ((unfinished, "not closed"), (noise, "no video"), (empty, "no video")):
        with pytest.raises(DataError, match=words):
            video_footage([path])
    with pytest.raises(DataError, match="no such file"):
        probe(tmp_path / "none.mp4")


def _srt(seconds: int, *, speed_m_per_s: float = 5.0, height_m: float = 50.0) -> str:
    return "".join(
        f"{i + 1}\n00:00:{i:02d},000 --> 00:00:{i + 1:02d},000\n2024-05-01 10:20:{30 + i:02d}.000\n"
        f"[focal_len: 24.00] [latitude: {52.0 + i * speed_m_per_s / M_PER_DEG:.7f}] [longitude: 9.6000000] "
        f"[rel_alt: {height_m:.3f} abs_alt: 150.000] [gb_yaw: 0.0 gb_pitch: -90.0 gb_roll: 0.0]\n\n"
        for i in range(seconds)
    )


def test_footage_with_subtitles_beside(tmp_path: Path) -> None:
    path = make_video(tmp_path / "DJI_0001.MP4")
    (tmp_path / "DJI_0001.srt").write_text(_srt(4))
    footage = video_footage([path])
    assert footage.warnings == ("DJI_0001.MP4: its times are local without a zone; they are taken for UTC",)
    assert [f.index for f in footage.frames] == list(range(len(footage.frames)))
    frame = footage.frames[1]
    assert frame.name == f"DJI_0001#{frame.frame_number:06d}"
    assert frame.source == str(path)
    assert frame.fix is not None
    assert frame.pts_s is not None
    assert frame.fix.lat_deg == pytest.approx(52.0 + 5.0 * frame.pts_s / M_PER_DEG, abs=1e-6)
    assert frame.height_m == 50.0
    assert frame.attitude is not None
    assert frame.time_s == pytest.approx(1_714_558_830.0 + frame.pts_s)
    assert frame.camera is not None
    assert frame.camera.origin == "telemetry 35 mm equivalent"
    flight = footage.flights[0]
    assert (flight.kind, flight.name) == ("video", "DJI_0001")
    assert flight.track_source == str(tmp_path / "DJI_0001.srt")


def test_rate_follows_the_wish_and_the_flight(tmp_path: Path) -> None:
    path = make_video(tmp_path / "a.mp4")
    log = tmp_path / "a.SRT"
    log.write_text(_srt(4, speed_m_per_s=0.5, height_m=100.0))
    slow = len(video_footage([path]).frames)
    log.write_text(_srt(4, speed_m_per_s=20.0, height_m=10.0))
    fast = len(video_footage([path]).frames)
    log.unlink()
    unknown = len(video_footage([path]).frames)
    assert (slow, unknown, fast) == (6, 8, 15)
    assert len(video_footage([path], IngestOptions(frame_rate_hz=10.0)).frames) == 30


def test_footage_without_telemetry_has_no_fixes(tmp_path: Path) -> None:
    footage = video_footage([make_video(tmp_path / "a.mp4")])
    assert all(f.fix is None for f in footage.frames)
    assert "--track FILE" in footage.warnings[0]
    assert footage.flights[0].track_source is None
    assert footage.frames[0].camera is not None
    assert footage.frames[0].camera.focal_px is None


def test_the_users_lens_wins(tmp_path: Path) -> None:
    path = make_video(tmp_path / "a.mp4")
    (tmp_path / "a.SRT").write_text(_srt(4))
    camera = video_footage([path], IngestOptions(hfov_deg=60.0)).frames[0].camera
    assert camera is not None
    assert camera.hfov_rad == pytest.approx(np.radians(60.0))
    assert camera.origin == "option"


def test_subtitles_inside(tmp_path: Path) -> None:
    lines = [f"[latitude: {52.0 + i * 1e-4:.6f}] [longitude: 9.600000] [rel_alt: 40.0 abs_alt: 90.0]" for i in range(3)]
    footage = video_footage([make_video(tmp_path / "a.mp4", subtitles=lines)])
    assert footage.flights[0].track_source == str(tmp_path / "a.mp4")
    first = footage.frames[0]
    assert first.fix is not None
    assert first.fix.lat_deg == pytest.approx(52.0, abs=1e-6)
    assert first.height_m == 40.0


def test_real_transport_stream_with_klv(shared_data: Path) -> None:
    footage = video_footage([shared_data / "misb_video" / "sample-stream.ts"], IngestOptions(frame_rate_hz=5.0))
    assert len(footage.frames) == 47
    assert footage.warnings == ()
    assert all(f.fix and f.attitude and f.height_m for f in footage.frames)
    assert footage.frames[0].time_s == pytest.approx(1340980354.1, abs=0.01)
    camera = footage.frames[0].camera
    assert camera is not None
    assert camera.hfov_rad == pytest.approx(np.radians(13.0), rel=2e-3)


def test_split_files_are_one_flight_on_one_log(tmp_path: Path) -> None:
    for i in (1, 2):
        make_video(tmp_path / f"DJI_000{i}.MP4", metadata={"creation_time": f"2024-05-01T12:20:{27 + 3 * i}.000000Z"})
    rows = "".join(f"2024-05-01T10:20:{28 + i:02d}Z,{52.0 + i * 5.0 / M_PER_DEG:.7f},9.6,50\n" for i in range(12))
    track = tmp_path / "log.csv"
    track.write_text("time,lat,lon,rel_alt\n" + rows)
    footage = video_footage(sorted(tmp_path.glob("*.MP4")), IngestOptions(track=track))
    assert len(footage.flights) == 1
    assert footage.flights[0].track_offset_s == 7200.0  # the camera's clock is local
    assert any("+2 h" in w for w in footage.warnings)
    for frame in footage.frames:
        assert frame.fix is not None
        assert frame.time_s is not None
        since = frame.time_s - 1_714_558_830.0  # 10:20:30, the first frame in UTC
        assert 0.0 <= since <= 6.0
        assert frame.fix.lat_deg == pytest.approx(52.0 + (since + 2.0) * 5.0 / M_PER_DEG, abs=2e-7)
    times = [f.time_s for f in footage.frames]
    assert times == sorted(times)  # type: ignore[type-var]


def test_one_bad_file_among_good_ones(tmp_path: Path) -> None:
    good = make_video(tmp_path / "a.mp4")
    bad = tmp_path / "b.mp4"
    bad.write_bytes(b"junk" * 100)
    footage = video_footage([good, bad])
    assert len(footage.flights) == 1
    assert any("b.mp4" in w and "left out" in w for w in footage.warnings)


def test_a_log_of_another_day(tmp_path: Path) -> None:
    path = make_video(tmp_path / "a.mp4", metadata={"creation_time": "2024-05-01T12:20:30.000000Z"})
    (tmp_path / "a.csv").write_text("time,lat,lon\n2023-01-01T00:00:00Z,52,9\n2023-01-01T00:10:00Z,52,9\n")
    with pytest.raises(DataError, match="--track-offset"):
        video_footage([path])


def test_progress(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    paths = [make_video(tmp_path / f"{n}.mp4", 5) for n in ("one", "two")]
    video_footage(paths, on_progress=lambda done, total: seen.append((done, total)))
    assert seen == [(1, 2), (2, 2)]


def test_frames_are_spread_evenly() -> None:
    times = np.arange(0, 10, 1 / 29.97)
    chosen = choose_frames(times, 2.5)
    assert chosen[0] == 0
    assert len(chosen) == 25
    steps = np.diff(times[chosen])
    assert steps.min() > 0.36
    assert steps.max() < 0.44
    assert choose_frames(np.empty(0), 2.5) == []
    assert choose_frames(np.array([0.0]), 2.5) == [0]
    assert choose_frames(times, 1000.0) == list(range(len(times)))


def test_a_hole_in_the_recording_does_not_flood() -> None:
    times = np.concatenate([np.arange(0, 2, 0.1), np.arange(100, 102, 0.1)])
    assert len(choose_frames(times, 2.0)) <= 10


def test_rates_follow_speed_over_height() -> None:
    times = np.arange(0, 900, 0.5)
    points = [TrackPoint(t, 52 + 8 * t / M_PER_DEG, 9.6, height_m=60.0) for t in times.tolist()]
    rates = sampling_rates(points, times, hfov_rad=np.radians(70.0), aspect=16 / 9)
    # 84 m wide, 47 m high: 15 % of that at 8 m/s takes 0.89 s.
    np.testing.assert_allclose(rates, 8 / (0.15 * 2 * 60 * np.tan(np.radians(35)) * 9 / 16), rtol=0.02)
    assert (sampling_rates([None] * 1800, times, hfov_rad=None, aspect=1.5) == 2.5).all()
    short = sampling_rates(points[:60], times[:60], hfov_rad=np.radians(70.0), aspect=16 / 9)
    np.testing.assert_allclose(short, 2.0 * rates[:60], rtol=0.02)


def test_a_piece_beyond_its_log_is_kept_without_fixes(tmp_path: Path) -> None:
    for i in (1, 2):
        make_video(tmp_path / f"DJI_000{i}.MP4", metadata={"creation_time": f"2024-05-01T12:20:{27 + 3 * i}.000000Z"})
    (tmp_path / "DJI_0001.SRT").write_text(_srt(3))
    footage = video_footage(sorted(tmp_path.glob("*.MP4")))
    assert len(footage.flights) == 1
    logged = [f for f in footage.frames if "DJI_0001" in f.source or f.pts_s > 0.5]
    assert all((f.fix is not None) == ("DJI_0001" in f.source) for f in logged)
    assert any("no moment in common" in w or "outside the track" in w for w in footage.warnings)


def test_table_of_contents_and_packets_tell_the_same(tmp_path: Path) -> None:
    plain = make_video(tmp_path / "plain.mp4", 150)  # the index comes from the table
    fragments = make_video(tmp_path / "fragments.mp4", 150, movflags="frag_keyframe+empty_moov")  # from the packets
    a, b = frame_index(plain), frame_index(fragments)
    np.testing.assert_allclose(a.times_s, b.times_s, atol=1e-4)
    assert a.keys.tolist() == b.keys.tolist() == [0, 30, 60, 90, 120]


def test_the_cameras_of_one_drone(tmp_path: Path) -> None:
    for name in ("DJI_20240501102030_0012_W", "DJI_20240501102030_0012_Z", "DJI_20240501102030_0012_T"):
        make_video(tmp_path / f"{name}.MP4", 5)
    paths = sorted(tmp_path.glob("*.MP4"))

    def used(lens: LensChoice) -> list[str]:
        return [f.name[-1] for f in video_footage(paths, IngestOptions(lens=lens)).flights]

    assert used(LensChoice.WIDEST) == ["W"]
    assert used(LensChoice.ZOOM) == ["Z"]
    assert used(LensChoice.THERMAL) == ["T"]
    assert sorted(used(LensChoice.ALL)) == ["T", "W", "Z"]
    assert sum("--lens" in w for w in video_footage(paths).warnings) == 2
    with pytest.raises(UsageError, match="thermal"):
        video_footage(paths[1:], IngestOptions(lens=LensChoice.THERMAL))
    assert [f.name[-1] for f in video_footage(paths[:1]).flights] == ["T"]  # what is there is used


@pytest.mark.parametrize(("codec", "suffix"), [("libx265", "mp4"), ("mpeg4", "avi"), ("libvpx-vp9", "webm")])
def test_other_codecs(tmp_path: Path, codec: str, suffix: str) -> None:
    path = tmp_path / f"v.{suffix}"
    try:
        stream_options = {"x265-params": "log-level=none:bframes=3:keyint=20"} if codec == "libx265" else {}
        with av.open(str(path), "w") as out:
            stream = out.add_stream(codec, rate=30, options=stream_options)
            stream.width, stream.height = SIZE
            stream.pix_fmt = "yuv420p"
            stream.bit_rate = 3_000_000
            for i in range(50):
                frame = av.VideoFrame.from_ndarray(_picture(i), format="yuv420p")
                frame.pts, frame.time_base = i, Fraction(1, 30)
                out.mux(stream.encode(frame))
            out.mux(stream.encode())
    except (ValueError, av.error.FFmpegError):
        pytest.skip(f"this FFmpeg cannot write {codec}")
    for n, image in read_video_frames(path, [0, 1, 19, 20, 33, 49]):
        assert _number_seen(image) == pytest.approx(n, abs=1.0)


def test_a_table_that_promises_more_than_the_file_holds(tmp_path: Path) -> None:
    path = make_video(tmp_path / "v.mp4", movflags="faststart")
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 4])
    count = len(frame_index(path).pts)
    assert 30 < count < 90
    footage = video_footage([path])
    assert any("cut short" in w for w in footage.warnings)
    assert all(f.frame_number is not None and f.frame_number < count for f in footage.frames)


def test_few_frames_without_a_table(tmp_path: Path) -> None:
    """B-frames forbid the short way; nothing may be lost on the long one."""
    path = make_video(tmp_path / "v.mp4", 100, options=B_FRAMES)
    assert len(frame_index(path).pts) == 100
    assert frame_index(path).keys[0] == 0
