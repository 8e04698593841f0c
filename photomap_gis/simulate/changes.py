"""Known changes of the ground: objects that came, with where they stand, for judging maps of change.

Objects are painted flat with their shadows: what a camera straight above sees of them. What went is what came, looked
at the other way round.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.similarity import FloatArray
from photomap_gis.simulate.ground import Ground
from photomap_gis.simulate.noise import fractal_noise

BoolImage = npt.NDArray[np.bool_]

SHADE = 0.45
"""What a shadow leaves of the ground's brightness."""
_TRIES = 40


class ObjectKind(StrEnum):
    """What comes to the ground."""

    VEHICLE = "vehicle"
    TENT = "tent"
    HOUSE = "house"
    RUBBLE = "rubble"
    TREE = "tree"
    WATER = "water"
    TRENCH = "trench"


_SIZES_M: dict[ObjectKind, tuple[tuple[float, float], tuple[float, float]]] = {
    ObjectKind.VEHICLE: ((4.0, 8.0), (1.8, 2.6)),
    ObjectKind.TENT: ((4.0, 10.0), (3.0, 5.0)),
    ObjectKind.HOUSE: ((8.0, 16.0), (6.0, 11.0)),
    ObjectKind.RUBBLE: ((5.0, 14.0), (4.0, 9.0)),
    ObjectKind.TREE: ((4.0, 8.0), (4.0, 8.0)),
    ObjectKind.WATER: ((8.0, 25.0), (6.0, 16.0)),
    ObjectKind.TRENCH: ((10.0, 25.0), (1.8, 3.0)),
}
_HEIGHT_M = {
    ObjectKind.VEHICLE: 1.8, ObjectKind.TENT: 2.5, ObjectKind.HOUSE: 5.0, ObjectKind.RUBBLE: 1.5, ObjectKind.TREE: 6.0,
    ObjectKind.WATER: 0.0, ObjectKind.TRENCH: 0.0,
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """One object that came: its kind, and the pixels of the ground that show it or its shadow."""

    kind: ObjectKind
    mask: BoolImage
    top_left_px: tuple[int, int]


def with_objects(
    ground: Ground, count: int, seed: int, *, kinds: tuple[ObjectKind, ...] = tuple(ObjectKind),
    taken: BoolImage | None = None,
) -> tuple[Ground, tuple[Change, ...]]:  # fmt: skip
    """Return a ground with up to ``count`` new objects that do not touch each other, and where they are.

    Objects keep off the pixels of ``taken``, ``(H, W)``.
    """
    rng = np.random.default_rng([seed, 0xC4A])
    colour = ground.colour.copy()
    h, w = colour.shape[:2]
    occupied = np.zeros((h, w), bool) if taken is None else taken.copy()
    sun = rng.uniform(0.0, 2.0 * np.pi)
    found: list[Change] = []
    for n in range(count):
        kind = kinds[n % len(kinds)]
        for _ in range(_TRIES):
            placed = _place(kind, (h, w), ground.pixel_size_m, sun, rng)
            if placed is None:
                continue
            body, shadow, (x, y) = placed
            part = np.s_[y : y + body.shape[0], x : x + body.shape[1]]
            if occupied[part].any():
                continue
            occupied[part] = True
            _paint(colour[part], body, shadow, kind, ground.pixel_size_m, rng)
            found.append(Change(kind, (body | shadow), (x, y)))
            break
    return replace(ground, colour=colour), tuple(found)


def mask_of(changes: tuple[Change, ...], shape: tuple[int, int]) -> BoolImage:
    """``shape`` bool: where any of the changes is."""
    out = np.zeros(shape, bool)
    for c in changes:
        x, y = c.top_left_px
        out[y : y + c.mask.shape[0], x : x + c.mask.shape[1]] |= c.mask
    return out


def _place(
    kind: ObjectKind, shape: tuple[int, int], pixel_m: float, sun_rad: float, rng: np.random.Generator
) -> tuple[BoolImage, BoolImage, tuple[int, int]] | None:
    """Return an object's pixels, those of its shadow, and where their box lies; ``None`` where it does not fit in."""
    (l0, l1), (w0, w1) = _SIZES_M[kind]
    size = np.array([rng.uniform(l0, l1), rng.uniform(w0, w1)]) / pixel_m
    angle = float(rng.uniform(0.0, 180.0))
    cast = _HEIGHT_M[kind] * rng.uniform(0.6, 1.2) / pixel_m * np.array([np.cos(sun_rad), np.sin(sun_rad)])
    reach = int(np.hypot(*size) / 2.0 + np.hypot(*cast) + 3.0)
    side = 2 * reach + 1
    if side >= min(shape):
        return None
    centre = np.array([reach, reach], np.float64)
    body = _outline(kind, centre, size, angle, side, rng)
    if not body.any():
        return None
    shadow = np.zeros_like(body)
    for t in np.linspace(0.0, 1.0, max(2, int(np.hypot(*cast)))):  # the body dragged along the light
        moved = np.array([[1.0, 0.0, t * cast[0]], [0.0, 1.0, t * cast[1]]], np.float32)
        shadow |= cv2.warpAffine(body.astype(np.uint8), moved, (side, side), flags=cv2.INTER_NEAREST) > 0
    y = int(rng.integers(0, shape[0] - side))
    x = int(rng.integers(0, shape[1] - side))
    return body, shadow & ~body, (x, y)


def _outline(
    kind: ObjectKind, centre: FloatArray, size: FloatArray, angle_deg: float, side: int, rng: np.random.Generator
) -> BoolImage:
    mask = np.zeros((side, side), np.uint8)
    if kind in (ObjectKind.RUBBLE, ObjectKind.TREE, ObjectKind.WATER):
        t = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
        bumps = sum(rng.normal(0.0, 0.12 / k) * np.cos(k * t + rng.uniform(0.0, 6.3)) for k in (2, 3, 5, 8))
        r = 1.0 + bumps
        a = np.radians(angle_deg)
        u, v = r * np.cos(t) * size[0] / 2.0, r * np.sin(t) * size[1] / 2.0
        points = np.stack([u * np.cos(a) - v * np.sin(a), u * np.sin(a) + v * np.cos(a)], axis=1) + centre
    else:
        points = cv2.boxPoints((centre.tolist(), size.tolist(), angle_deg)).astype(np.float64)
    cv2.fillPoly(mask, [np.round(points).astype(np.int32)], 1)
    return mask > 0


def _paint(
    part: ImageArray, body: BoolImage, shadow: BoolImage, kind: ObjectKind, pixel_m: float, rng: np.random.Generator
) -> None:
    """Paint an object and its shadow into a part of a picture."""
    soft_shadow = cv2.GaussianBlur(shadow.astype(np.float32), (0, 0), max(0.6, 0.1 / pixel_m))[..., None]
    shaded = part * (1.0 - (1.0 - SHADE) * soft_shadow)
    look = _look(kind, (part.shape[0], part.shape[1]), pixel_m, rng, shaded, body)
    soft = cv2.GaussianBlur(body.astype(np.float32), (0, 0), 0.7)[..., None]
    part[:] = np.clip(soft * look + (1.0 - soft) * shaded, 0, 255).astype(np.uint8)


def _look(
    kind: ObjectKind, shape: tuple[int, int], pixel_m: float, rng: np.random.Generator, ground: FloatArray,
    body: BoolImage,
) -> FloatArray:  # fmt: skip
    """``(h, w, 3)`` BGR of an object's surface."""
    noise = np.stack(
        [fractal_noise(shape, rng, wavelength_px=max(4.0, 1.2 / pixel_m), octaves=3) for _ in range(1)], axis=-1
    )
    if kind is ObjectKind.WATER:
        return np.array([70.0, 72.0, 62.0]) * rng.uniform(0.6, 1.6) + 4.0 * noise
    if kind is ObjectKind.TREE:
        return np.array([38.0, 72.0, 48.0]) * rng.uniform(0.8, 1.5) + 22.0 * noise
    if kind is ObjectKind.RUBBLE:
        grain = np.stack([fractal_noise(shape, rng, wavelength_px=max(3.0, 0.7 / pixel_m), octaves=2)] * 3, axis=-1)
        return np.array([128.0, 132.0, 138.0]) * rng.uniform(0.8, 1.3) + 38.0 * grain
    if kind is ObjectKind.TRENCH:
        return np.array([52.0, 74.0, 98.0]) * rng.uniform(0.7, 1.3) + 12.0 * noise
    shade = rng.uniform(35.0, 235.0) + rng.uniform(-30.0, 30.0, 3)
    look = np.broadcast_to(shade, (*shape, 3)) + 5.0 * noise
    if kind in (ObjectKind.HOUSE, ObjectKind.TENT):  # two sides of a roof, one of them in the light
        rows, cols = np.nonzero(body)
        xy = np.stack([cols, rows], axis=1) - [cols.mean(), rows.mean()]
        _, _, axes = np.linalg.svd(np.cov(xy.T))
        yy, xx = np.mgrid[: shape[0], : shape[1]]
        lit = (xx - cols.mean()) * axes[1, 0] + (yy - rows.mean()) * axes[1, 1] > 0
        look = look * np.where(lit, 1.12, 0.82)[..., None]
    return np.asarray(look, dtype=np.float64)
