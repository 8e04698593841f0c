"""The decoder's own word: what comes after lost data is suspect until the next key frame."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from photomap_gis.core.live import LiveFrame
from photomap_gis.ingest.decode import video_frames
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.sources import read_frames
from photomap_gis.ingest.stream.clock import SystemClock
from photomap_gis.ingest.stream.file_source import FileSource
from photomap_gis.ingest.trouble import LONGEST, Trouble
from photomap_gis.ingest.video import video_footage

KEY_EVERY, COUNT = 12, 60


@dataclass
class Decoded:
    """What a decoder says of a frame."""

    key_frame: bool = False
    is_corrupt: bool = False


def test_suspicion_lasts_from_lost_data_to_the_next_whole_key_frame():
    trouble = Trouble()
    assert [trouble.of(Decoded(key)) for key in (True, False, False)] == [False] * 3
    trouble.failed()
    told = [trouble.of(f) for f in (Decoded(), Decoded(), Decoded(True, True), Decoded(), Decoded(True), Decoded())]
    assert told == [True, True, True, True, False, False], "a key frame that is damaged itself ends nothing"


def test_without_key_frames_suspicion_ends_too():
    trouble = Trouble()
    assert trouble.of(Decoded(is_corrupt=True))
    told = [trouble.of(Decoded()) for _ in range(LONGEST + 5)]
    assert told.index(False) == LONGEST - 1 and not any(told[LONGEST:])


@pytest.fixture
def spoilt(tmp_path: Path, rng: np.random.Generator) -> Path:
    """A transport stream of moving ground with a key frame every 12 frames, damaged within its 26th frame or so."""
    ground = np.kron(rng.integers(40, 210, (60, 80)), np.ones((4, 4))).astype(np.uint8)
    path = tmp_path / "spoilt.ts"
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        stream.time_base = Fraction(1, 25)
        stream.options = {"preset": "ultrafast", "crf": "12", "x264-params": f"keyint={KEY_EVERY}:scenecut=0:bframes=0"}
        for k in range(COUNT):
            picture = np.ascontiguousarray(ground[k : k + 120, 2 * k % 100 : 2 * k % 100 + 160])
            out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "gray").reformat(format="yuv420p")))
        out.mux(stream.encode())
    data = bytearray(path.read_bytes())
    middle = len(data) * 26 // COUNT // 188 * 188
    del data[middle : middle + 6 * 188]
    path.write_bytes(bytes(data))
    return path


def test_a_map_is_told_which_frames_follow_lost_data(spoilt: Path):
    told = [(f.image is not None, f.is_suspect) for f in video_frames(spoilt, range(COUNT))]
    usable = [suspect for has_image, suspect in told if has_image]
    assert not any(usable[:20]) and not any(usable[-20:]) and any(usable[20:-20])
    footage = video_footage([spoilt], IngestOptions(frame_rate_hz=25.0))
    frames = [frame for _, frame in read_frames(footage.frames) if not isinstance(frame, Exception)]
    assert [f.is_suspect for f in frames] == usable


def test_the_live_loop_is_told_too(spoilt: Path):
    frames = [f for f in FileSource(spoilt, IngestOptions(), SystemClock(), realtime=False) if isinstance(f, LiveFrame)]
    told = [f.is_suspect for f in frames]
    assert not any(told[:20]) and not any(told[-20:]) and 1 <= sum(told) <= KEY_EVERY + 2
