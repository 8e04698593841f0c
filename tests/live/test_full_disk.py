"""A disk that takes no more: the flight goes on on the screen, what was kept is whole, and it can be gone on with."""

from __future__ import annotations

import errno
import json
from pathlib import Path

import numpy as np
import pytest

from photomap_gis.cli import main
from photomap_gis.core.errors import OutputError
from photomap_gis.live import hand as hand_module
from photomap_gis.live.flight import FlightRequest, open_flight
from photomap_gis.live.flush import CanvasFolder
from photomap_gis.live.journal import LineLog, read_lines
from photomap_gis.simulate import FlightSpec, run_simulation
from photomap_gis.store import Journal, Mission
from tests.live.test_canvas import LiveCanvas, Painter, lattice, placement_at


class FullFile:
    """A file on a disk that is full after so many writes."""

    def __init__(self, file, left: int) -> None:
        self._file, self._left = file, left

    def write(self, data: bytes) -> int:
        self._left -= 1
        if self._left < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self._file.write(data)

    def flush(self) -> None:
        self._file.flush()

    def close(self) -> None:
        self._file.close()


def test_a_journal_ends_before_the_hole_and_tells_it_once(tmp_path: Path) -> None:
    told: list[OutputError] = []
    log = LineLog(tmp_path / "a.jsonl", told.append)
    log.write("frame", n=0)
    log._file = FullFile(log._file, 1)
    for n in range(1, 5):
        log.write("frame", n=n)
    log.close()
    assert len(told) == 1 and "No space left" in str(told[0])
    assert [line["n"] for line in read_lines(tmp_path / "a.jsonl")] == [0, 1]
    strict = LineLog(tmp_path / "b.jsonl")
    strict.write("frame", n=0)
    strict._file = FullFile(strict._file, 0)
    with pytest.raises(OutputError, match="No space left"):
        strict.write("frame", n=1)
    strict.close()


def test_tiles_that_could_not_be_written_are_written_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    painter = Painter(LiveCanvas(lattice(), tmp_path / "planes"), lambda k: image)
    image = np.full((200, 320, 3), 90, np.uint8)
    painter.paste(0, placement_at(250.0, 250.0), image, 0.0)
    folder = CanvasFolder(tmp_path / "mosaic", painter.canvas, "x")

    def full(path: Path, data: bytes) -> None:
        raise OutputError(f"{path}: cannot be written (No space left on device); free some space")

    with monkeypatch.context() as patch, pytest.raises(OutputError):
        patch.setattr("photomap_gis.live.flush.write_quickly", full)
        folder.flush(1)
    assert folder.flush(2) == len(painter.canvas.tiles()) > 0


def test_a_store_that_cannot_be_closed_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = Journal(tmp_path / "a.jsonl", dict[str, int])
    journal.append({"a": 1})

    def full(number: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch, pytest.raises(OutputError, match="No space left"):
        patch.setattr("photomap_gis.store.os.fsync", full)
        journal.close()
    journal.close()  # nothing is open any more


def test_the_flight_goes_on_and_can_be_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run_simulation("procedural", tmp_path / "sim", FlightSpec(
        frames=60, width_px=320, height_px=240, altitude_m=40.0, video_rate_hz=10.0, seed=4), video=True)  # fmt: skip
    video, mission = next((tmp_path / "sim" / "video").glob("*.MP4")), tmp_path / "mission"
    said: list[str] = []
    write = hand_module.write_quickly

    def until_full(path: Path, data: bytes) -> None:
        if path.suffix == ".jpg" and int(path.stem) >= 4:
            raise OutputError(f"{path}: cannot be written (No space left on device); free some space")
        write(path, data)

    with monkeypatch.context() as patch:
        patch.setattr(hand_module, "write_quickly", until_full)
        with open_flight(FlightRequest(str(video), mission)) as flight:
            flight.on_words = said.append
            flight.fly()
            tally, shown = flight.session.loop.tally, flight.session.hand.pasted
            kept, keys = len(list(flight._ready.mission.frames)), len(flight.session.loop.chart)
    assert tally.frames + tally.dropped == 60 and tally.tracked == tally.frames
    assert kept == 4 < keys == shown  # all of them are on the screen
    assert len(said) == 1 and "No space left" in said[0]
    assert "No space left" in " ".join(flight.summary(None).warnings)
    capsys.readouterr()
    assert main(["live", "--resume", str(mission), "--as-fast-as-possible", "--json", "-q"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["keyframes"] > 4 and document["map"]["frames"]["registered"] == document["keyframes"]


def test_a_session_that_never_saw_a_frame_is_begun_anew(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Somebody waited at the wrong port, gave up, and types the command again."""
    mission = tmp_path / "mission"
    for source in ("empty", "other"):
        (tmp_path / source).mkdir()
        with open_flight(FlightRequest(str(tmp_path / source), mission)) as flight:
            flight.stop()
            flight.fly()
            with pytest.raises(Exception, match="no frame came"):
                flight.land(lambda stage, done, total: None)
    with Mission.open(mission):
        pass
    run_simulation("procedural", tmp_path / "sim", FlightSpec(frames=6, width_px=320, height_px=240, seed=4))
    photos = str(tmp_path / "sim" / "photos")
    assert main(["live", photos, "-o", str(mission), "--as-fast-as-possible", "--no-finalise", "--json"]) == 0
    capsys.readouterr()
    assert main(["live", photos, "-o", str(mission), "--as-fast-as-possible"]) == 2
    assert "--resume" in capsys.readouterr().err
