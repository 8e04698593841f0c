"""Small videos and a clock that never waits, for tests of live sources."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np


class FakeClock:
    """Time goes by only when somebody sleeps; what was slept is kept."""

    def __init__(self) -> None:
        self.time_s = 1000.0
        self.naps: list[float] = []

    def now_s(self) -> float:
        return self.time_s

    def utc_s(self) -> float:
        return 1_750_000_000.0 + self.time_s

    def sleep(self, seconds: float) -> None:
        self.naps.append(seconds)
        self.time_s += seconds


def picture(number: int, size: tuple[int, int] = (96, 64)) -> np.ndarray:
    """A picture that tells its number: a bright column moves over a texture."""
    width, height = size
    rng = np.random.default_rng(7)
    base = rng.integers(60, 120, (height // 8, width // 8, 3)).repeat(8, 0).repeat(8, 1).astype(np.uint8)
    at = (number * 2) % (width - 4)
    base[:, at : at + 4] = 230
    return base


def write_video(
    path: Path, *, count: int = 30, rate: int = 10, size: tuple[int, int] = (96, 64), gop: int = 5,
    pts: list[int] | None = None, codec: str = "libx264", first: int = 0,
    b_frames: int = 0,
) -> Path:  # fmt: skip
    """Write a video of ``picture``s; ``pts`` are in milliseconds."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate)
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        stream.codec_context.gop_size = gop
        stream.codec_context.max_b_frames = b_frames
        stream.codec_context.time_base = Fraction(1, 1000)
        for i in range(count):
            frame = av.VideoFrame.from_ndarray(picture(first + i, size), format="bgr24")
            frame.pts = round(i * 1000 / rate) if pts is None else pts[i]
            frame.time_base = Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path
