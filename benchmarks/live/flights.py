"""Simulated videos with relief for the live benchmark, made once and kept."""

from __future__ import annotations

from pathlib import Path

from photomap_gis.simulate import FlightSpec, procedural_scene
from photomap_gis.simulate.flight import required_size_m
from photomap_gis.simulate.write import simulate_video

RATE_HZ = 30.0


def video_of(
    folder: Path, seconds: int, *, width_px: int = 1280, height_px: int = 720, rate_hz: float = RATE_HZ
) -> Path:
    """Return a video of so many seconds; the truth lies beside its folder."""
    rate = "" if rate_hz == RATE_HZ else f"-{rate_hz:g}hz"
    home = folder / f"video-{seconds}s-{width_px}x{height_px}{rate}"
    video = home / "video" / "DJI_0001.MP4"
    if not video.is_file():
        spec = FlightSpec(
            frames=round(seconds * rate_hz), altitude_m=60.0, speed_m_s=8.0, width_px=width_px, height_px=height_px,
            video_rate_hz=rate_hz, side_overlap=0.5, bitrate_bit_s=6_000_000, seed=1,
        )  # fmt: skip
        size = required_size_m(spec, video=True)
        ground = procedural_scene((size[0] + 4.0, size[1] + 4.0), max(0.07, (size[0] * size[1] / 60e6) ** 0.5), 1)
        simulate_video(ground, spec, home)
    return video
