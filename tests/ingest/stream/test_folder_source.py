"""A folder being filled: photos in order, each once, never half of one."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.live import EndReason, GapKind, LiveFrame, StreamEnd, StreamGap, StreamRenamed
from photomap_gis.ingest.stream import open_stream
from tests.ingest.stream.made import FakeClock, picture


def jpeg(number: int, second: int | None = None) -> bytes:
    image = Image.fromarray(picture(number, (320, 240))[..., ::-1])
    exif = Image.Exif()
    if second is not None:
        exif.get_ifd(0x8769)[0x9003] = f"2026:05:01 10:00:{second:02d}"
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=95, exif=exif)
    return buffer.getvalue()


class Camera(FakeClock):
    """A clock during whose naps somebody fills the folder: what to do at which second."""

    def __init__(self) -> None:
        super().__init__()
        self.plan: list[tuple[float, object]] = []

    def at(self, second: float, action: object) -> None:
        self.plan.append((1000.0 + second, action))

    def sleep(self, seconds: float) -> None:
        super().sleep(seconds)
        while self.plan and self.plan[0][0] <= self.time_s:
            self.plan.pop(0)[1]()


def test_photos_come_in_the_order_in_which_they_were_taken(tmp_path: Path) -> None:
    for name, second in [("c.jpg", 1), ("a.jpg", 3), ("b.jpg", 2)]:
        (tmp_path / name).write_bytes(jpeg(second, second))
    *frames, end = open_stream(tmp_path, realtime=False, clock=FakeClock())
    assert [f.ref.name for f in frames] == ["c.jpg", "b.jpg", "a.jpg"] and [f.index for f in frames] == [0, 1, 2]
    assert np.allclose([f.stream_time_s for f in frames], [0.0, 1.0, 2.0])
    assert isinstance(end, StreamEnd) and end.reason is EndReason.END_OF_FILE


def test_a_photo_is_read_once_and_only_when_it_is_whole(tmp_path: Path) -> None:
    camera = Camera()
    source = open_stream(tmp_path, clock=camera)
    whole = jpeg(7, 9)
    late = tmp_path / "late.jpg"
    camera.at(1.0, lambda: (tmp_path / "first.jpg").write_bytes(jpeg(1, 1)))
    camera.at(3.0, lambda: late.write_bytes(whole[: len(whole) // 2]))  # then the link stands still for a while
    camera.at(9.0, lambda: late.write_bytes(whole))
    camera.at(12.0, lambda: (tmp_path / ".hidden.jpg").write_bytes(whole))
    camera.at(12.0, lambda: (tmp_path / "empty.jpg").touch())
    camera.at(20.0, source.close)
    events = list(source)
    frames = [e for e in events if isinstance(e, LiveFrame)]
    assert [f.ref.name for f in frames] == ["first.jpg", "late.jpg"]
    assert frames[1].arrival_s > 1009.0 and frames[1].stream_time_s == pytest.approx(8.0)
    assert np.array_equal(frames[1].image, frames[1].frame.image) and frames[1].image[-1].std() > 1.0
    assert [e.kind for e in events if isinstance(e, StreamGap)] == [GapKind.WAITING]
    assert events[-1].reason is EndReason.CLOSED


def test_a_file_that_stays_broken_is_named(tmp_path: Path) -> None:
    camera = Camera()
    (tmp_path / "bad.jpg").write_bytes(jpeg(1)[:500])
    (tmp_path / "good.jpg").write_bytes(jpeg(2))
    source = open_stream(tmp_path, clock=camera)
    camera.at(60.0, source.close)
    events = list(source)
    (gap,) = [e for e in events if isinstance(e, StreamGap)]
    assert gap.kind is GapKind.FILE_LEFT_OUT and "bad.jpg" in gap.message
    once = open_stream(tmp_path, realtime=False, clock=FakeClock())
    assert [type(e).__name__ for e in once].count("LiveFrame") == 1


def test_its_recording_holds_names(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    for n in range(3):
        (folder / f"{n}.jpg").write_bytes(jpeg(n, n))
    box = tmp_path / "mission" / "recording"
    frames = [e for e in open_stream(folder, realtime=False, recording=box) if isinstance(e, LiveFrame)]
    again = [e for e in open_stream(box, realtime=False) if isinstance(e, LiveFrame)]
    assert [(f.index, f.stream_time_s, f.arrival_s) for f in again] == [
        (f.index, f.stream_time_s, f.arrival_s) for f in frames
    ]
    assert all(np.array_equal(a.image, b.image) and a.ref == b.ref for a, b in zip(again, frames, strict=True))
    with pytest.raises(UsageError, match="own recording"):
        open_stream(folder, recording=folder / "mission" / "recording")


def test_an_empty_folder_is_an_error_unless_it_is_watched(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="holds no photos"):
        open_stream(tmp_path, realtime=False)


@pytest.mark.shared
def test_real_photos_bring_their_positions(shared_data: Path) -> None:
    source = open_stream(shared_data / "caliterra" / "images", realtime=False)
    first = next(iter(source))
    assert isinstance(first, LiveFrame) and first.ref.fix is not None and first.ref.camera.focal_px is not None


def test_a_photo_that_comes_under_a_second_name_is_one_photo(tmp_path: Path) -> None:
    folder, box = tmp_path / "photos", tmp_path / "mission" / "recording"
    folder.mkdir()
    camera = Camera()
    source = open_stream(folder, clock=camera, recording=box)
    camera.at(0.5, lambda: (folder / "tmp_a.jpg").write_bytes(jpeg(1, 1)))  # a program that writes, then renames
    camera.at(3.0, lambda: (folder / "tmp_a.jpg").rename(folder / "a.jpg"))
    camera.at(5.0, lambda: (folder / "b.jpg").write_bytes(jpeg(2, 2)))
    camera.at(7.0, lambda: (folder / "copy of b.jpg").write_bytes(jpeg(2, 2)))
    camera.at(10.0, source.close)
    events = list(source)
    assert [e.ref.name for e in events if isinstance(e, LiveFrame)] == ["tmp_a.jpg", "b.jpg"]
    [renamed] = [e for e in events if isinstance(e, StreamRenamed)]
    assert (Path(renamed.path).name, Path(renamed.to).name) == ("tmp_a.jpg", "a.jpg")
    left_out = [e.message for e in events if isinstance(e, StreamGap) and e.kind is GapKind.FILE_LEFT_OUT]
    assert left_out == ["copy of b.jpg: the same picture as b.jpg, left out"]
    again = [e for e in open_stream(box, realtime=False) if isinstance(e, LiveFrame)]
    assert [e.ref.name for e in again] == ["a.jpg", "b.jpg"]
    assert np.array_equal(again[0].image, next(e for e in events if isinstance(e, LiveFrame)).image)
