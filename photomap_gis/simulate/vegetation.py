"""Trees, hedges and bushes: lumpy crowns, no two alike."""

from __future__ import annotations

import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.simulate.canvas import Canvas
from photomap_gis.simulate.noise import FloatImage, fractal_noise

GREENS_BGR = (
    (44, 84, 62), (38, 74, 50), (52, 100, 84), (40, 92, 76), (58, 96, 66), (46, 108, 104), (34, 62, 48),
)  # fmt: skip


def plant_trees(canvas: Canvas, *, trees: int, bushes: int) -> None:
    """Plant trees in groves and alone, then bushes; where something stands or a road runs they give way."""
    rng, g = canvas.rng, canvas.gsd_m
    # one field of lumps for all crowns, each cut from its own place
    lumps = fractal_noise((1024, 1024), rng, wavelength_px=max(4.0, 1.6 / g), octaves=4, gain=0.7)
    groves = [canvas.random_point() for _ in range(max(2, trees // 14))]
    planted = 0
    for _ in range(trees * 6):
        if planted >= trees:
            break
        in_grove = rng.uniform() < 0.7
        at = groves[rng.integers(len(groves))] + rng.normal(0, 9.0, 2) if in_grove else canvas.random_point()
        radius = float(rng.uniform(1.3, 3.6))
        if canvas.is_free(at, radius * 0.8):
            _grow(canvas, lumps, at, radius, float(min(radius * rng.uniform(1.6, 2.6), 8.0)))
            planted += 1
    for _ in range(bushes):
        at = canvas.random_point()
        radius = float(rng.uniform(0.35, 1.1))
        if canvas.is_free(at, radius):
            _grow(canvas, lumps, at, radius, radius * float(rng.uniform(0.7, 1.4)))


def _grow(canvas: Canvas, lumps: FloatImage, at_m: FloatArray, radius_m: float, height_m: float) -> None:
    """Grow one crown: a lumpy dome whose skirt hangs at a third of its height."""
    rng = canvas.rng
    patch = canvas.patch(at_m, radius_m * 1.25)
    if patch is None:
        return
    h, w = patch.height_m.shape
    oy, ox = rng.integers(0, max(1, lumps.shape[0] - h)), rng.integers(0, max(1, lumps.shape[1] - w))
    cut = lumps[oy : oy + h, ox : ox + w]
    if cut.shape != (h, w):
        cut = np.resize(lumps, (h, w))
    u, v = patch.turned(float(rng.uniform(0, np.pi)))
    distance = np.hypot(u, v * float(rng.uniform(1.0, 1.35))) / radius_m
    crown = distance < 1.0 + 0.16 * cut
    if not crown.any():
        return
    base = float(patch.height_m[h // 2, w // 2]) if height_m < 1.5 else float(np.percentile(patch.height_m, 20))
    dome = np.sqrt(np.clip(1.0 - 0.85 * distance**2, 0.02, 1.0))
    top = base + height_m * (0.3 + 0.7 * dome) + 0.12 * np.sqrt(height_m) * cut
    lifted = crown & (top > patch.height_m)
    patch.raise_to(lifted, top)
    patch.leafy[lifted] = True
    leaf = np.array(GREENS_BGR[rng.integers(len(GREENS_BGR))], np.float32) * rng.uniform(0.8, 1.3)
    patch.paint(lifted, leaf, brightness=0.72 + 0.4 * dome + 0.17 * cut)
