"""The bare land of a scene: slope, parcels of grass, meadow and soil, tracks and roads."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray
from photomap_gis.simulate.canvas import Canvas
from photomap_gis.simulate.noise import FloatImage, fractal_noise

SOILS_BGR = np.array(
    [
        (66, 104, 96), (72, 118, 104), (60, 92, 80), (88, 128, 128), (98, 140, 150),
        (92, 120, 142), (84, 106, 124), (70, 110, 88), (108, 146, 160), (78, 98, 106),
    ],
    np.float32,
)  # fmt: skip
"""Grass, meadow, stubble, soil as a drone's camera sees them from above."""


def lay_land(canvas: Canvas, *, slope: float = 0.005, relief_m: float = 0.25) -> None:
    """Give the canvas a sloping, gently waving surface and a patchwork of parcels, nowhere the same twice."""
    rng, g = canvas.rng, canvas.gsd_m
    h, w = canvas.height_m.shape
    direction = rng.uniform(0, 2 * np.pi)
    x = (np.arange(w, dtype=np.float32) + 0.5) * np.float32(g)
    y = (np.arange(h, dtype=np.float32) + 0.5) * np.float32(g)
    tilt = np.float32(slope) * (np.float32(np.cos(direction)) * x[None, :] + np.float32(np.sin(direction)) * y[:, None])
    waves = fractal_noise((h, w), rng, wavelength_px=110.0 / g, octaves=2)
    canvas.height_m[:] = tilt - tilt.mean() + np.float32(relief_m) * waves
    brightness = 1.0 + 0.10 * fractal_noise((h, w), rng, wavelength_px=24.0 / g, octaves=5, gain=0.62)
    brightness += 0.085 * fractal_noise((h, w), rng, wavelength_px=1.4 / g, octaves=4, gain=0.85)
    dryness = fractal_noise((h, w), rng, wavelength_px=35.0 / g, octaves=4, gain=0.6)
    soil = SOILS_BGR[_parcels(canvas)]
    # dry spots: warmer and paler, by their own field, so that parcels are never one flat hue
    dry = np.clip(0.35 * dryness, -0.6, 0.9)[..., None]
    soil += dry * np.array([14.0, 20.0, 34.0], np.float32)
    canvas.colour[:] = np.clip(soil * brightness[..., None], 0, 255).astype(np.uint8)
    _scatter_stones(canvas)


def _parcels(canvas: Canvas) -> npt.NDArray[np.intp]:
    """``(H, W)`` which soil lies where: nearest of random seeds, borders bent by noise."""
    rng, g = canvas.rng, canvas.gsd_m
    h, w = canvas.height_m.shape
    coarse_m = 0.25
    shape = (int(h * g / coarse_m) + 2, int(w * g / coarse_m) + 2)
    count = max(4, int(shape[0] * shape[1] * coarse_m**2 / 1800.0))
    seeds = np.ones(shape, np.uint8)
    seeds[rng.integers(0, shape[0], count), rng.integers(0, shape[1], count)] = 0
    _, labels = cv2.distanceTransformWithLabels(seeds, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    kinds = rng.integers(0, len(SOILS_BGR), labels.max() + 1)[labels].astype(np.float32)
    bend = [6.0 * fractal_noise((h, w), rng, wavelength_px=14.0 / g, octaves=4) / coarse_m / 4.0 for _ in range(2)]
    x = np.arange(w, dtype=np.float32)[None, :] * np.float32(g / coarse_m) + bend[0]
    y = np.arange(h, dtype=np.float32)[:, None] * np.float32(g / coarse_m) + bend[1]
    return np.asarray(cv2.remap(kinds, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE).astype(np.intp))


def _scatter_stones(canvas: Canvas) -> None:
    """Strew small stones, tufts and litter: what makes a lawn recognisable from the air."""
    rng, g = canvas.rng, canvas.gsd_m
    w_m, h_m = canvas.size_m
    for _ in range(int(w_m * h_m / 12.0)):
        x, y = canvas.px(canvas.random_point())
        radius = max(1, round(rng.uniform(0.08, 0.45) / g))
        y0, x0 = max(y - radius, 0), max(x - radius, 0)
        under = canvas.colour[y0 : y + radius + 1, x0 : x + radius + 1]
        shade = rng.choice((0.62, 0.78, 1.22, 1.4)) * under.reshape(-1, 3).mean(axis=0)
        axes = (radius, max(1, round(radius * rng.uniform(0.4, 1.0))))
        cv2.ellipse(
            canvas.colour, (int(x), int(y)), axes, float(rng.uniform(0, 180)), 0, 360,
            tuple(float(min(v, 235.0)) for v in shade), -1,
        )  # fmt: skip


def lay_roads(canvas: Canvas) -> list[FloatArray]:
    """Draw winding roads and tracks across the scene; return their middle lines as ``(N, 2)`` metres."""
    rng = canvas.rng
    w, h = canvas.size_m
    lines = []
    count = max(2, round(np.sqrt(w * h) / 110.0) + 1)
    for k in range(count):
        paved = k % 2 == 0
        line = _winding_line(canvas, across=k % 2 == 0)
        width_m = rng.uniform(5.0, 7.5) if paved else rng.uniform(2.6, 3.6)
        _draw_road(canvas, line, width_m, paved=paved)
        lines.append(line)
    return lines


def _winding_line(canvas: Canvas, *, across: bool) -> FloatArray:
    """``(N, 2)`` a smooth line from one side of the scene to the other."""
    rng = canvas.rng
    w, h = canvas.size_m
    t = np.linspace(-0.05, 1.05, 220)
    length, breadth = (w, h) if across else (h, w)
    middle, lean = rng.uniform(0.15, 0.85), rng.uniform(-0.35, 0.35)
    bend = sum(
        rng.uniform(-0.09, 0.09) * np.sin(2 * np.pi * (f * t + rng.uniform())) for f in (0.6, 1.1, 1.9)
    )  # three waves without a common period
    side = breadth * (middle + lean * (t - 0.5) + bend)
    return np.stack([t * length, side] if across else [side, t * length], axis=1)


def _draw_road(canvas: Canvas, line_m: FloatArray, width_m: float, *, paved: bool) -> None:
    """Paint one road: worn surface, verge, marks, cracks and patches; the land is levelled across it."""
    rng, g = canvas.rng, canvas.gsd_m
    h, w = canvas.height_m.shape
    mask = np.zeros((h, w), np.uint8)
    px = canvas.px(line_m).reshape(-1, 1, 2)
    cv2.polylines(mask, [px], False, 255, max(1, round(width_m / g)), cv2.LINE_AA)
    x0, y0, bw, bh = cv2.boundingRect(px)
    x0, y0 = max(x0 - int(8 / g), 0), max(y0 - int(8 / g), 0)
    part = np.s_[y0 : min(h, y0 + bh + int(16 / g)), x0 : min(w, x0 + bw + int(16 / g))]
    base = np.array((112, 112, 110) if paved else (122, 152, 168), np.float32) * rng.uniform(0.85, 1.1)
    local = mask[part]
    texture: FloatImage = 1.0 + 0.07 * fractal_noise(local.shape, rng, wavelength_px=9.0 / g, octaves=5, gain=0.7)
    texture += 0.05 * fractal_noise(local.shape, rng, wavelength_px=0.6 / g, octaves=3, gain=0.9)
    alpha = (local.astype(np.float32) / 255.0)[..., None]
    if not paved:  # grass between the ruts shines through
        alpha *= np.clip(0.7 + 0.35 * fractal_noise(local.shape, rng, wavelength_px=2.5 / g, octaves=3), 0, 1)[
            ..., None
        ]
    surface = base * texture[..., None]
    canvas.colour[part] = np.clip(canvas.colour[part] * (1 - alpha) + surface * alpha, 0, 255).astype(np.uint8)
    if paved:
        _mark_road(canvas, line_m, width_m)
    canvas.taken |= cv2.resize(
        (cv2.dilate(mask, np.ones((3, 3), np.uint8), iterations=max(1, round(0.7 / g))) > 0).astype(np.uint8),
        canvas.taken.shape[::-1], interpolation=cv2.INTER_AREA,
    )  # fmt: skip


def _mark_road(canvas: Canvas, line_m: FloatArray, width_m: float) -> None:
    """Paint edge lines, worn dashes of uneven length, cracks and mended patches."""
    rng, g = canvas.rng, canvas.gsd_m
    direction = np.gradient(line_m, axis=0)
    normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    thin = max(1, round(0.14 / g))
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line_m, axis=0), axis=1))])

    def at(s: npt.ArrayLike, offset_m: float | FloatArray) -> FloatArray:
        s = np.atleast_1d(np.asarray(s))
        p = np.stack([np.interp(s, along, line_m[:, i]) for i in (0, 1)], axis=1)
        n = np.stack([np.interp(s, along, normal[:, i]) for i in (0, 1)], axis=1)
        return np.asarray(p + n * np.reshape(offset_m, (-1, 1)))

    s = 0.0
    while s < along[-1]:
        length, gap = rng.uniform(2.0, 5.0), rng.uniform(2.0, 7.0)
        pale = int(rng.uniform(150, 215))
        for offset in (0.0, width_m / 2 - 0.25, -width_m / 2 + 0.25):
            if rng.uniform() < 0.8:
                reach = length if offset == 0.0 else length + gap
                dash = canvas.px(at(np.linspace(s, s + reach, 4), offset))
                cv2.polylines(canvas.colour, [dash], False, (pale, pale, pale), thin, cv2.LINE_AA)
        if rng.uniform() < 0.25:  # a crack wanders across
            steps = at(s + rng.uniform(-1.5, 1.5, 5), np.linspace(-width_m / 2, width_m / 2, 5) * rng.uniform(0.4, 1))
            cv2.polylines(canvas.colour, [canvas.px(steps)], False, (48, 48, 50), max(1, thin // 2), cv2.LINE_AA)
        if rng.uniform() < 0.12:  # a mended patch
            box = at(s + np.array([0, 0, 1, 1]) * rng.uniform(1, 4), np.array([-1, 1, 1, -1]) * width_m * 0.2)
            tone = int(rng.uniform(60, 95))
            shift = rng.uniform(-width_m / 5, width_m / 5)
            cv2.fillPoly(canvas.colour, [canvas.px(box + shift)], (tone, tone, tone), cv2.LINE_AA)
        s += length + gap
