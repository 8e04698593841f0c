"""Sources: what may be named, what is found, and how frames are read again."""

import os
from pathlib import Path

import pytest

from photomap_gis.core.errors import DataError, FrameReadError
from photomap_gis.ingest import open_sources, read_frame, read_frames
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.sources import find_files

from .test_photos import stamp


def names(found):
    return [p.name for p in found.photos]


@pytest.fixture
def card(make_photo, tmp_path):
    """A drone's card: two folders of photos, a hidden one, a thumbnail, a log."""
    for i in range(3):
        make_photo(f"DCIM/100MEDIA/DJI_{i}.JPG", taken=stamp(i), lat=52 + 1e-4 * i, lon=21.0)
    make_photo("DCIM/101MEDIA/DJI_10.JPG", taken=stamp(4), lat=52.001, lon=21.0)
    make_photo("DCIM/.Trashes/DJI_99.JPG")
    (tmp_path / "DCIM/100MEDIA/._DJI_0.JPG").write_bytes(b"\0\5\x16\7")
    (tmp_path / "DCIM/100MEDIA/notes.txt").write_text("windy")
    return tmp_path / "DCIM"


def test_a_folder_with_its_subfolders(card):
    assert names(find_files([card])) == ["DJI_0.JPG", "DJI_1.JPG", "DJI_2.JPG", "DJI_10.JPG"]
    assert names(find_files([str(card / "100MEDIA") + os.sep])) == ["DJI_0.JPG", "DJI_1.JPG", "DJI_2.JPG"]


def test_globs_files_and_repetitions(card):
    found = find_files([card / "*" / "DJI_?.JPG", str(card / "100MEDIA" / "DJI_1.JPG"), f"{card}/**/DJI_10.JPG"])
    assert names(found) == ["DJI_0.JPG", "DJI_1.JPG", "DJI_2.JPG", "DJI_10.JPG"]
    assert found.warnings == ("1 file was named more than once: each is used once",)
    assert names(find_files([card / "1*MEDIA"])) == ["DJI_0.JPG", "DJI_1.JPG", "DJI_2.JPG", "DJI_10.JPG"]


def test_brackets_in_a_true_name_are_no_pattern(make_photo):
    path = make_photo("flight [1]/a.jpg")
    assert names(find_files([path])) == ["a.jpg"]
    assert names(find_files([path.parent])) == ["a.jpg"]


@pytest.mark.parametrize(
    "name, words",
    [
        ("nowhere", "no such file or folder: .*nowhere"),
        ("*.jpg", "nothing matches"),
        ("empty", "holds no photos or videos"),
        ("raw", "raw photos only.*export them"),
        ("mission", "is a mission, not a source"),
        ("notes.txt", "is no photo or video"),
        ("raw/a.dng", "raw photos are not read"),
    ],
)
def test_what_cannot_be_used_says_what_to_do(tmp_path, name, words):
    for folder in ("empty", "raw", "mission"):
        (tmp_path / folder).mkdir()
    (tmp_path / "raw/a.dng").write_bytes(b"II*\0")
    (tmp_path / "mission/mission.json").write_text("{}")
    (tmp_path / "notes.txt").write_text("words")
    with pytest.raises(DataError, match=words) as caught:
        open_sources([tmp_path / name])
    assert "\n" not in str(caught.value)


def test_no_source_is_an_error():
    with pytest.raises(DataError, match="no source"):
        open_sources([])


def test_a_missions_own_pictures_are_no_photos(card, make_photo):
    make_photo("DCIM/out/tiles/0.png")
    (card / "out/mission.json").write_text("{}")
    assert "0.png" not in names(find_files([card]))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
def test_a_pipe_is_no_photo(card):
    os.mkfifo(card / "100MEDIA" / "DJI_50.JPG")
    assert len(find_files([card]).photos) == 4


def test_links_do_not_go_round(card):
    (card / "100MEDIA" / "again").symlink_to(card, target_is_directory=True)
    assert len(find_files([card]).photos) == 4


def test_photos_and_videos_in_one_folder(card):
    (card / "100MEDIA" / "DJI_20.MP4").write_bytes(b"x")
    found = find_files([card])
    assert len(found.photos) == 4
    assert found.videos == ()
    assert "not used: 1 video" in found.warnings[0]
    found = find_files([card, card / "100MEDIA" / "DJI_20.MP4"])
    assert [v.name for v in found.videos] == ["DJI_20.MP4"]


def test_a_video_with_a_stray_photo(make_photo, tmp_path):
    make_photo("d/a.jpg")
    (tmp_path / "d/b.mp4").write_bytes(b"x")
    found = find_files([tmp_path / "d"])
    assert found.photos == ()
    assert [v.name for v in found.videos] == ["b.mp4"]


def test_frames_are_numbered_and_in_order(card):
    footage = open_sources([card / "101MEDIA", card / "100MEDIA"], first_index=7, first_flight=3)
    assert [f.index for f in footage.frames] == [7, 8, 9, 10]
    assert [f.name for f in footage.frames] == ["DJI_0.JPG", "DJI_1.JPG", "DJI_2.JPG", "DJI_10.JPG"]
    assert {f.flight for f in footage.frames} == {3}
    assert [f.id for f in footage.flights] == [3]
    assert all(a.time_s < b.time_s for a, b in zip(footage.frames, footage.frames[1:], strict=False))


def test_progress_is_told(card):
    told = []
    open_sources([card], IngestOptions(), on_progress=lambda done, total: told.append((done, total)))
    assert told[-1] == (4, 4)


def test_frames_are_read_again(card):
    footage = open_sources([card])
    assert read_frame(footage.frames[0]).image.shape == (48, 64, 3)
    Path(footage.frames[1].source).unlink()
    got = list(read_frames(footage.frames))
    assert [ref.index for ref, _ in got] == [0, 1, 2, 3]
    assert isinstance(got[1][1], FrameReadError)
    assert got[2][1].ref == footage.frames[2]


def test_a_log_beside_photos_without_positions_is_named(make_photo):
    photo = make_photo("p/a.jpg")
    (photo.parent / "flight.tlog").write_bytes(b"x")
    warnings = open_sources([photo.parent]).warnings
    assert any("flight.tlog" in w and "--track" in w for w in warnings)


def test_sources_are_absolute(card, monkeypatch):
    monkeypatch.chdir(card)
    footage = open_sources(["."])
    assert all(Path(f.source).is_absolute() for f in footage.frames)


def test_photos_take_their_places_from_a_track(make_photo, tmp_path):
    """A GPX log in UTC, photos in local time two hours ahead without any position."""
    paths = [make_photo(f"p/{i}.jpg", taken=stamp(7200 + 2 * i)) for i in range(10)]
    points = "".join(
        f'<trkpt lat="{52 + 1e-5 * s:.7f}" lon="21.0"><ele>150</ele><time>2024-05-06T10:00:{s:02d}Z</time></trkpt>'
        for s in range(0, 40)
    )
    log = tmp_path / "log.gpx"
    log.write_text(
        f'<?xml version="1.0"?><gpx xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>{points}</trkseg></trk></gpx>'
    )
    footage = open_sources([paths[0].parent], IngestOptions(track=log))
    for i, frame in enumerate(footage.frames):
        assert frame.fix is not None
        assert frame.fix.lat_deg == pytest.approx(52 + 2e-5 * i, abs=2e-7)
    assert footage.flights[0].track_source is not None
    assert footage.flights[0].track_offset_s == pytest.approx(7200)


@pytest.mark.parametrize(
    "name, count, fixes, hfov_deg", [("caliterra", 75, 75, 69.1), ("seneca", 167, 167, 71.6), ("boruszyn", 28, 0, 63.4)]
)
def test_real_sets_are_whole(shared_data, name, count, fixes, hfov_deg):
    footage = open_sources([shared_data / name])
    assert len(footage.frames) == count
    assert len(footage.flights) == 1
    assert all(f.problem is None for f in footage.frames)
    assert sum(f.fix is not None for f in footage.frames) == fixes
    times = [f.time_s for f in footage.frames]
    assert times == sorted(set(times))
    assert [f.name for f in footage.frames] == sorted(f.name for f in footage.frames)
    for frame in footage.frames:
        assert frame.height_m is None  # EXIF altitude is no height
        assert frame.camera.hfov_rad * 57.29578 == pytest.approx(hfov_deg, abs=0.2)


def test_caliterra_in_detail(shared_data):
    footage = open_sources([shared_data / "caliterra"])
    first = footage.frames[0]
    assert (first.fix.lat_deg, first.fix.lon_deg) == pytest.approx((30.1712233, -98.0899917), abs=1e-7)
    assert first.time_s == pytest.approx(1413742851, abs=2)  # 18:20:51 UTC, though the camera shows 13:20:51
    stale = {f.name for f in footage.frames if f.fix.sigma_m is not None}
    assert "IMG_9371.jpg" in stale
    assert len(stale) < 6
    assert read_frame(first).image.shape == (1200, 1600, 3)
