"""The light of the live map: steps of an exposure vanish, vignetting does not add up, a replay has the same gains."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from photomap_gis.core.grid import Window
from photomap_gis.live.canvas import LiveCanvas
from photomap_gis.live.light import Light
from photomap_gis.live.painter import Painter
from tests.live.test_canvas import H, W, lattice, placement_at

STEP = 40
"""Pixels from one frame to the next."""


def ground(rng: np.random.Generator, length: int) -> np.ndarray:
    coarse = rng.integers(70, 150, (H // 8 + 1, length // 8 + 1, 3), np.uint8)
    return cv2.resize(coarse, (length, H), interpolation=cv2.INTER_CUBIC)


def strip(rng: np.random.Generator, gains: list[float], vignetting: float = 0.0) -> tuple[np.ndarray, list[np.ndarray]]:
    """Frames of a straight flight to the east, each ``STEP`` further, and the ground under all of them."""
    scene = ground(rng, W + STEP * len(gains))
    x, y = np.meshgrid(np.arange(W) - (W - 1) / 2, np.arange(H) - (H - 1) / 2)
    dim = 1.0 - vignetting * (x**2 + y**2) / (W**2 + H**2) * 4.0
    frames = [
        np.clip(scene[:, n * STEP : n * STEP + W] * (g * dim)[..., None], 0, 255).astype(np.uint8)
        for n, g in enumerate(gains)
    ]
    return scene, frames


def flown(folder: Path, frames: list[np.ndarray]) -> tuple[Painter, Light]:
    light = Light()
    painter = Painter(LiveCanvas(lattice(), folder), lambda k: frames[k], light=light)
    for n, image in enumerate(frames):
        painter.paste(n, placement_at(W / 2 + n * STEP, H / 2, frame=n), image, 0.5 * n)
    return painter, light


def shown(painter: Painter, count: int) -> np.ndarray:
    return painter.canvas.read(Window(0, 0, W + STEP * (count - 1), H), lambda t: t.rgba(), 0)[..., 2::-1]


def test_a_step_of_the_exposure_is_not_seen(tmp_path: Path, rng: np.random.Generator) -> None:
    gains = [1.0] * 8 + [1.35] * 8 + [0.75] * 8
    scene, frames = strip(rng, gains)
    painter, _ = flown(tmp_path, frames)
    ratio = shown(painter, len(gains))[20:-20, 40:-40] / scene[20:-20, 40 : W + STEP * 23 - 40]
    columns = np.median(ratio, axis=(0, 2))
    raw = np.repeat(gains, STEP)
    assert columns.max() - columns.min() < 0.25 * (raw.max() - raw.min())  # what is left is given back little by little
    assert np.abs(np.diff(columns)).max() < 0.03


def test_vignetting_does_not_add_up(tmp_path: Path, rng: np.random.Generator) -> None:
    _, frames = strip(rng, [1.0] * 60, vignetting=0.35)
    _, light = flown(tmp_path, frames)
    assert [light.of(n) for n in range(60)] == pytest.approx([1.0] * 60, abs=0.05)


def test_what_is_given_back_brings_the_map_to_the_cameras_brightness(tmp_path: Path, rng: np.random.Generator) -> None:
    _, frames = strip(rng, [1.0] * 3 + [1.3] * 120)
    _, light = flown(tmp_path, frames)
    assert light.of(3) == pytest.approx(1 / 1.3, rel=0.03) and light.of(122) == pytest.approx(1.0, abs=0.05)


def test_a_frame_too_unlike_is_left_and_misleads_no_other(tmp_path: Path, rng: np.random.Generator) -> None:
    """A frame in the dark, or another palette: no camera's exposure does that."""
    _, frames = strip(rng, [1.0, 1.0, 0.12, 1.0, 1.0])
    _, light = flown(tmp_path, frames)
    assert [light.of(n) for n in range(5)] == pytest.approx([1.0] * 5, abs=0.05)


def test_frames_keep_their_gains_on_another_canvas(tmp_path: Path, rng: np.random.Generator) -> None:
    _, frames = strip(rng, [1.0, 1.3, 0.8])
    _, light = flown(tmp_path / "a", frames)
    before = [light.of(n) for n in range(3)]
    again = Painter(LiveCanvas(lattice(), tmp_path / "b"), lambda k: frames[k], light=light)
    for n in (2, 1, 0):
        again.paste(n, placement_at(W / 2 + n * STEP, H / 2, frame=n), None, 0.5 * n)
    assert [light.of(n) for n in range(3)] == before and len(set(before)) == 3
