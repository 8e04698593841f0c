"""Grounds that repeat themselves: parking rows, roofs, crop rows, tiles, solar panels, orchards.

Each is drawn with irregularity from almost none (two places then truly look the same) to enough to tell them apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np

from .nuisance import Image32
from .pictures import Grey

SIDE_PX = 1100
KINDS = ("parking", "roofs", "crops", "tiles", "panels", "orchard")


@lru_cache(maxsize=64)
def repetitive_ground(seed: int) -> Grey:
    """``(SIDE_PX, SIDE_PX)`` repetitive ground; the seed chooses its kind, period, irregularity and direction."""
    rng = np.random.default_rng([seed, 0x7E7])
    kind = KINDS[seed % len(KINDS)]
    # log-uniform: from cells that are copies of each other to cells of which each is its own
    irregular = math.exp(rng.uniform(math.log(0.02), math.log(0.5)))
    drawn = _DRAWERS[kind](rng, irregular)
    grain = math.exp(rng.uniform(math.log(0.3), math.log(5.0)))  # what tells one spot of asphalt from the next
    drawn = drawn + _noise(rng, drawn.shape, 1.0) * grain + _noise(rng, drawn.shape, 25.0) * (14.0 * irregular)
    drawn = cv2.GaussianBlur(drawn, (0, 0), 0.7)
    h, w = drawn.shape
    turn = cv2.getRotationMatrix2D(((w - 1) / 2, (h - 1) / 2), rng.uniform(0, 360), 1.0)
    turned = cv2.warpAffine(drawn, turn, (w, h), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
    cut = (h - SIDE_PX) // 2
    return np.clip(np.rint(turned[cut : cut + SIDE_PX, cut : cut + SIDE_PX]), 0, 255).astype(np.uint8)


def _canvas(value: float) -> Image32:
    side = math.ceil(SIDE_PX * 1.45)
    return np.full((side, side), value, np.float32)


def _noise(rng: np.random.Generator, shape: tuple[int, ...], size: float) -> Image32:
    """Noise of unit scatter and a grain of ``size`` pixels."""
    h, w = (math.ceil(s / size) + 1 for s in shape)
    grain = rng.standard_normal((h, w), dtype=np.float32)
    if size == 1.0:
        return grain[: shape[0], : shape[1]]
    noise: Image32 = cv2.resize(grain, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
    return noise / noise.std()


def _rectangle(g: Image32, x: float, y: float, w: float, h: float, value: float) -> None:
    cv2.rectangle(g, (round(x), round(y)), (round(x + w), round(y + h)), float(value), -1)


def _cells(g: Image32, dx: float, dy: float) -> list[tuple[float, float]]:
    return [(x, y) for y in np.arange(0, g.shape[0], dy) for x in np.arange(0, g.shape[1], dx)]


def _parking(rng: np.random.Generator, irregular: float) -> Image32:
    g = _canvas(rng.uniform(80, 115))
    slot, length = rng.uniform(22, 34), rng.uniform(46, 64)
    aisle = rng.uniform(50, 75)
    free, white = min(0.85, 2.5 * irregular), rng.uniform(190, 240)
    shades = np.array([30, 60, 120, 170, 225]) if irregular > 0.1 else np.array([rng.uniform(20, 240)])
    for row, y in enumerate(np.arange(0, g.shape[0], 2 * length + aisle)):
        for x in np.arange(0, g.shape[1], slot):
            for side in (0, 1):
                top = y + side * length
                _rectangle(g, x, top, 2, length, white)
                if rng.random() >= free:
                    jitter = rng.normal(0, 4.0 * irregular, 2)
                    cx, cy = x + 0.18 * slot + jitter[0], top + 0.12 * length + jitter[1]
                    shade = float(rng.choice(shades)) + rng.normal(0, 20 * irregular)
                    _rectangle(g, cx, cy, 0.66 * slot, 0.76 * length, shade)
                    _rectangle(g, cx + 0.08 * slot, cy + 0.24 * length, 0.5 * slot, 0.12 * length, 35)
                    _rectangle(g, cx + 0.08 * slot, cy + 0.58 * length, 0.5 * slot, 0.08 * length, 35)
        _rectangle(g, 0, y + length, g.shape[1], 2, white)
        if row % 2 and irregular > 0.2:
            _rectangle(g, float(rng.uniform(0, g.shape[1])), y + 2 * length + aisle / 3, 60, 12, white)
    return g


def _roofs(rng: np.random.Generator, irregular: float) -> Image32:
    g = _canvas(rng.uniform(90, 130))
    dx, dy = rng.uniform(70, 130), rng.uniform(80, 150)
    light, dark = rng.uniform(140, 200), rng.uniform(70, 110)
    w, h = dx * rng.uniform(0.55, 0.8), dy * rng.uniform(0.4, 0.65)
    for x, y in _cells(g, dx, dy):
        jx, jy, js = rng.normal(0, 6.0 * irregular, 3)
        shade = rng.normal(0, 45.0 * irregular)
        _rectangle(g, x + 6 + jx, y + 8 + jy, w + js, h + js, 45)  # its shadow
        _rectangle(g, x + jx, y + jy, w + js, h / 2, light + shade)
        _rectangle(g, x + jx, y + jy + h / 2, w + js, h / 2 + js, dark + shade)
        _rectangle(g, x + jx + 0.2 * w, y + jy + 0.15 * h, 7, 8, 210)
        if rng.random() < irregular:
            cv2.circle(g, (round(x + 0.85 * dx), round(y + rng.uniform(0, dy))), 12, 50.0, -1)
    return g


def _crops(rng: np.random.Generator, irregular: float) -> Image32:
    g = _canvas(0.0)
    period = rng.uniform(9, 34)
    y = np.arange(g.shape[0], dtype=np.float32)[:, None]
    bend = _noise(rng, g.shape, 220.0) * (3.0 * irregular)
    rows = np.sin(2 * math.pi * (y + bend) / period)
    plants = 1.0 + irregular * _noise(rng, g.shape, 6.0)
    tramline = 30.0 * (np.mod(y, period * rng.integers(9, 16)) < 0.7 * period)
    return (rng.uniform(95, 135) + rng.uniform(22, 45) * np.tanh(1.8 * rows) * plants - tramline).astype(np.float32)


def _tiles(rng: np.random.Generator, irregular: float) -> Image32:
    g = _canvas(rng.uniform(40, 80))
    dx, dy = rng.uniform(20, 60), rng.uniform(18, 50)
    joint, shift = rng.uniform(2, 4), float(rng.choice([0.0, 0.5]))
    base = rng.uniform(120, 180)
    for row, y in enumerate(np.arange(0, g.shape[0], dy)):
        for x in np.arange(-dx, g.shape[1], dx):
            _rectangle(g, x + (row % 2) * shift * dx, y, dx - joint, dy - joint, base + rng.normal(0, 60 * irregular))
    return g


def _panels(rng: np.random.Generator, irregular: float) -> Image32:
    g = _canvas(rng.uniform(110, 160))
    g += 14.0 * irregular * _noise(rng, g.shape, 9.0)
    dx, dy, gap = rng.uniform(14, 24), rng.uniform(26, 40), rng.uniform(24, 60)
    blue = rng.uniform(35, 60)
    y = 0.0
    while y < g.shape[0]:
        for band in range(2):
            for x in np.arange(0, g.shape[1], dx):
                _rectangle(g, x, y + band * dy, dx - 2, dy - 2, blue + rng.normal(0, 25 * irregular))
        y += 2 * dy + gap
    return g


def _orchard(rng: np.random.Generator, irregular: float) -> Image32:
    g = _canvas(rng.uniform(130, 165))
    g += 10.0 * irregular * _noise(rng, g.shape, 12.0)
    dx, dy = rng.uniform(26, 52), rng.uniform(30, 64)
    radius = 0.36 * min(dx, dy)
    for x, y in _cells(g, dx, dy):
        jx, jy, jr = rng.normal(0, 1, 3) * irregular * (0.12 * dx, 0.12 * dy, 0.4 * radius)
        if rng.random() < 0.25 * irregular:
            continue
        cv2.circle(g, (round(x + jx + 4), round(y + jy + 5)), max(2, round(radius + jr)), 55.0, -1)
        cv2.circle(
            g, (round(x + jx), round(y + jy)), max(2, round(radius + jr)), float(85 + rng.normal(0, 18 * irregular)), -1
        )
    return g


_DRAWERS: dict[str, Callable[[np.random.Generator, float], Image32]] = {
    "parking": _parking, "roofs": _roofs, "crops": _crops, "tiles": _tiles, "panels": _panels, "orchard": _orchard,
}  # fmt: skip
