"""A virtual camera over a real picture: short takes as a drone's camera gives them, before and after the codec."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from benchmarks.registration.pictures import Origin, Part, Picture, Sources, find_sources, read_grey, read_scene

Grey = npt.NDArray[np.uint8]
Matrix = npt.NDArray[np.float64]

SIZES_WH = ((256, 256), (256, 192), (320, 240), (480, 360), (640, 480), (640, 360), (512, 512), (960, 540))


class Motion(StrEnum):
    """How far the camera goes from frame to frame."""

    VIDEO = "video"
    HOVER = "hover"
    PHOTOS = "photos"


@dataclass(frozen=True, slots=True)
class Look:
    """What the camera does to light; sigmas in grey levels and pixels of its own raster."""

    noise: float
    softness_px: float
    vignetting: float
    drift: float
    contrast: float = 1.0

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Look:
        """Return an ordinary camera."""
        return cls(
            float(rng.uniform(0.5, 3.0)),
            float(rng.uniform(0.3, 0.9)),
            float(rng.uniform(0, 0.3)),
            float(rng.uniform(0, 0.02)),
        )


@lru_cache(maxsize=2)
def sources(part: Part) -> Sources:
    """Return the part's pictures, looked up once."""
    return find_sources(part)


def draw_picture(rng: np.random.Generator, part: Part, *, scene: bool = False) -> Picture:
    """Return a picture of a part, group by group, so that no flight outweighs the others."""
    found = sources(part)
    if scene:
        return found.scenes[int(rng.integers(len(found.scenes)))]
    group = found.groups[int(rng.integers(len(found.groups)))]
    return group[int(rng.integers(len(group)))]


def draw_size(rng: np.random.Generator, ground: tuple[int, int]) -> tuple[int, int]:
    """Return a frame's width and height that leave room to move on a ground ``(H, W)``."""
    fitting = [s for s in SIZES_WH if 1.5 * s[0] <= ground[1] and 1.5 * s[1] <= ground[0]]
    return fitting[int(rng.integers(len(fitting)))] if fitting else (256, 192)


def fly(
    rng: np.random.Generator,
    picture: Picture,
    motion: Motion,
    count: int,
    *,
    tilt_deg: float = 2.0,
    relief: float = 0.0,
    size_wh: tuple[int, int] | None = None,
    ground: Grey | None = None,
) -> list[Grey]:
    """Return the light of ``count`` frames over a picture, or over a given ``ground``.

    ``relief`` is the ground's height range as a share of the camera's height (scenes only).
    """
    return fly_placed(rng, picture, motion, count, tilt_deg=tilt_deg, relief=relief, size_wh=size_wh, ground=ground)[0]


def fly_placed(
    rng: np.random.Generator,
    picture: Picture,
    motion: Motion,
    count: int,
    *,
    tilt_deg: float = 2.0,
    relief: float = 0.0,
    size_wh: tuple[int, int] | None = None,
    ground: Grey | None = None,
) -> tuple[list[Grey], list[Matrix]]:
    """Return the light of ``fly`` and each frame's ``(3, 3)`` homography from its pixels to the ground's."""
    scene = read_scene(picture) if relief > 0.0 and picture.origin is Origin.SCENE else None
    g = ground if ground is not None else (scene.grey if scene else read_grey(picture))
    w, h = size_wh or draw_size(rng, g.shape)
    room = min(g.shape[1] / w, g.shape[0] / h)
    zoom = float(rng.uniform(min(0.9, 0.8 * room), max(min(2.2, 0.7 * room), min(0.9, 0.8 * room) + 0.01)))
    blurred = g if zoom < 1.2 else cv2.GaussianBlur(g, (0, 0), 0.45 * zoom)
    heights = None
    if scene is not None:
        spread = float(np.percentile(scene.height_px, 99) - np.percentile(scene.height_px, 1))
        heights = ((scene.height_px - np.median(scene.height_px)) * (relief / max(spread, 1e-6))).astype(np.float32)
    path = _path(rng, g.shape, (w, h), zoom, motion, count, tilt_deg)
    places = [_place(pose, (w, h), tilt) for pose, tilt in path]
    return [_see(blurred, H, (w, h), pose[:, 2], heights) for H, (pose, _) in zip(places, path, strict=True)], places


def _path(
    rng: np.random.Generator,
    ground: tuple[int, ...],
    size_wh: tuple[int, int],
    zoom: float,
    motion: Motion,
    count: int,
    tilt_deg: float,
) -> list[tuple[Matrix, tuple[float, float]]]:
    """Return for each frame the affine ``(2, 3)`` from centred frame pixels to the ground, and its tilt (radians)."""
    w = size_wh[0]
    step, turn, grow, shake = {
        Motion.VIDEO: (w * min(0.12, float(np.exp(rng.normal(math.log(0.025), 0.8)))), 0.6, 0.004, 0.003),
        Motion.HOVER: (0.0, 0.0, 0.0, float(np.exp(rng.normal(math.log(0.0012), 0.5)))),
        Motion.PHOTOS: (w * float(rng.uniform(0.15, 0.45)), 12.0, 0.03, 0.01),
    }[motion]
    reach = 0.5 * math.hypot(*size_wh) * zoom
    low, high = np.array([reach, reach]), np.array([ground[1] - reach, ground[0] - reach])
    middle = np.array([ground[1] / 2.0, ground[0] / 2.0])
    low, high = np.minimum(low, middle), np.maximum(high, middle)
    at = rng.uniform(low, high)
    heading = float(rng.uniform(0, 2 * math.pi))
    angle = float(rng.uniform(0, 2 * math.pi)) if rng.uniform() < 0.5 else float(rng.integers(4)) * math.pi / 2
    scale = zoom
    spin = math.radians(float(rng.normal(0, turn)))
    climb = float(rng.normal(0, grow))
    sway = np.radians(rng.uniform(-tilt_deg, tilt_deg, 2))
    out = []
    for _ in range(count):
        jitter = rng.normal(0, shake * w * zoom, 2)
        x, y = at + jitter
        a = angle + float(rng.normal(0, shake))
        c, s = math.cos(a) * scale, math.sin(a) * scale
        out.append((np.array([[c, -s, x], [s, c, y]]), (float(sway[0]), float(sway[1]))))
        ahead = at + step * zoom * np.array([math.cos(heading), math.sin(heading)])
        if (ahead < low).any() or (ahead > high).any():  # towards the middle, or the frame would leave the picture
            heading = math.atan2(middle[1] - at[1], middle[0] - at[0]) + float(rng.normal(0, 0.2))
            ahead = at + step * zoom * np.array([math.cos(heading), math.sin(heading)])
        at = np.clip(ahead, low - 0.1 * reach, high + 0.1 * reach)
        angle += spin + (math.radians(float(rng.normal(0, turn))) if motion is Motion.PHOTOS else 0.0)
        scale *= math.exp(climb)
        change = np.radians(rng.normal(0, 0.1 if motion is Motion.HOVER else 0.15 * max(tilt_deg, 0.1), 2))
        sway = np.clip(sway + change, -math.radians(tilt_deg), math.radians(tilt_deg))
    return out


def _place(pose: Matrix, size_wh: tuple[int, int], tilt: tuple[float, float]) -> Matrix:
    """``(3, 3)`` homography from a frame's pixels to the ground's."""
    w, h = size_wh
    focal = w / 2.0 / math.tan(math.radians(30.0))
    centre = np.array([[1.0, 0.0, -(w - 1) / 2.0], [0.0, 1.0, -(h - 1) / 2.0], [0.0, 0.0, 1.0]])
    roll, pitch = tilt
    # a plane seen by a camera that leans: x' = x / (1 + (roll x + pitch y) / f), to first order in the tilt
    lean = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [math.tan(roll) / focal, math.tan(pitch) / focal, 1.0]])
    return np.asarray(np.vstack([pose, [0.0, 0.0, 1.0]]) @ lean @ centre)


def _see(
    ground: Grey, H: Matrix, size_wh: tuple[int, int], nadir: Matrix, heights: npt.NDArray[np.float32] | None
) -> Grey:
    w, h = size_wh
    if heights is None:
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return np.asarray(
            cv2.warpPerspective(ground, H, (w, h), flags=flags, borderMode=cv2.BORDER_REFLECT_101), np.uint8
        )
    u, v = np.meshgrid(np.arange(w, dtype=np.float64), np.arange(h, dtype=np.float64))
    p = np.stack([u, v, np.ones_like(u)], -1) @ H.T
    x, y = (p[..., 0] / p[..., 2]).astype(np.float32), (p[..., 1] / p[..., 2]).astype(np.float32)
    gx, gy = x, y
    for _ in range(4):  # where the ray meets the surface: what is high lies nearer to the nadir than its picture
        z = cv2.remap(heights, gx, gy, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        gx = ((1.0 - z) * (x - nadir[0]) + nadir[0]).astype(np.float32)
        gy = ((1.0 - z) * (y - nadir[1]) + nadir[1]).astype(np.float32)
    return np.asarray(cv2.remap(ground, gx, gy, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101), np.uint8)


def expose(rng: np.random.Generator, light: list[Grey], look: Look) -> list[Grey]:
    """Return frames as a camera stores them: soft, dark towards the corners, drifting in brightness, noisy."""
    h, w = light[0].shape
    y, x = np.mgrid[-1 : 1 : h * 1j, -1 : 1 : w * 1j]
    shade = (1.0 - look.vignetting * (x * x + y * y) / 2.0).astype(np.float32)
    gain = 1.0 + float(rng.normal(0, look.drift))
    out = []
    for frame in light:
        gain += float(rng.normal(0, look.drift))
        f = frame.astype(np.float32)
        if look.contrast != 1.0:
            f = (f - 128.0) * look.contrast + 110.0
        if look.softness_px > 0.3:
            f = cv2.GaussianBlur(f, (0, 0), look.softness_px)
        f = f * (shade * gain) + look.noise * rng.standard_normal((h, w), dtype=np.float32)
        out.append(cv2.convertScaleAbs(np.maximum(f, 0.0)))
    return out
