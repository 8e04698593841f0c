"""What people put on the land: houses with roofs, vehicles and crates, and what is left when a house falls."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray
from photomap_gis.simulate.canvas import Canvas, Patch, box_corners
from photomap_gis.simulate.noise import fractal_noise

ROOFS_BGR = (
    (62, 74, 150), (70, 88, 168), (58, 62, 118), (92, 92, 96), (128, 126, 122), (156, 158, 160),
    (84, 104, 132), (112, 96, 78), (188, 190, 190), (66, 70, 74),
)  # fmt: skip
CARS_BGR = (
    (200, 200, 202), (32, 32, 34), (60, 50, 160), (140, 90, 40), (110, 112, 114), (46, 110, 60), (60, 170, 200),
)  # fmt: skip


def build_houses(canvas: Canvas, count: int) -> int:
    """Put up to ``count`` houses, sheds and halls, 3-12 m high, on free land; return how many found room."""
    rng = canvas.rng
    built = 0
    for _ in range(count * 12):
        if built >= count:
            break
        # many low sheds and houses, few high blocks: as in a village, and as rubble leaves them
        height = 3.0 + 9.0 * float(rng.beta(1.0, 2.6))
        length = float(rng.uniform(7.0, 15.0)) * (1.0 + 0.4 * (height > 7))
        width = length * float(rng.uniform(0.45, 0.9))
        reach = float(np.hypot(length, width)) / 2.0 + 1.5
        centre = canvas.random_point()
        if not canvas.is_free(centre, reach):
            continue
        angle = float(rng.uniform(0, np.pi))
        _build_block(canvas, centre, (length, width), angle, height)
        if rng.uniform() < 0.35:  # an annexe makes an L
            offset = np.array([np.cos(angle), np.sin(angle)]) * length * 0.35
            side = np.array([-np.sin(angle), np.cos(angle)]) * width * 0.6
            _build_block(canvas, centre + offset + side, (length * 0.4, width * 0.7), angle, height * 0.72)
        canvas.take_polygon(box_corners(centre, length + 3, width + 3, angle))
        built += 1
    return built


def _build_block(
    canvas: Canvas, centre: FloatArray, size_m: tuple[float, float], angle_rad: float, height_m: float
) -> None:
    """Set one block with a flat, gabled or single-pitch roof; ``height_m`` is that of its highest line."""
    rng, g = canvas.rng, canvas.gsd_m
    length, width = size_m
    patch = canvas.patch(centre, float(np.hypot(length, width)) / 2.0 + 1.0)
    if patch is None:
        return
    u, v = patch.turned(angle_rad)
    mask = (np.abs(u) <= length / 2) & (np.abs(v) <= width / 2)
    if not mask.any():
        return
    base = float(np.median(patch.height_m))
    colour = np.array(ROOFS_BGR[rng.integers(len(ROOFS_BGR))], np.float32) * rng.uniform(0.85, 1.15)
    weather = 1.0 + 0.06 * fractal_noise(mask.shape, rng, wavelength_px=5.0 / g, octaves=5, gain=0.75)
    kind = rng.choice(("flat", "gable", "gable", "pitch"))
    rise = 0.0 if kind == "flat" else min(0.35 * width, 0.4 * height_m)
    eaves = base + height_m - rise
    if kind == "gable":
        roof: npt.NDArray[np.floating] = eaves + rise * (1.0 - np.abs(v) / (width / 2))
        ridge = np.abs(v) < max(0.12, 0.6 * g)
    elif kind == "pitch":
        roof = eaves + rise * (v / width + 0.5)
        ridge = np.zeros_like(mask)
    else:
        roof = np.full(mask.shape, eaves, np.float32)
        ridge = (np.abs(u) > length / 2 - 0.35) | (np.abs(v) > width / 2 - 0.35)  # parapet
        roof = roof + 0.4 * ridge
    patch.raise_to(mask, roof)
    patch.paint(mask, colour, brightness=weather)
    patch.paint(mask & ridge, colour * 1.25, brightness=weather)
    _furnish_roof(canvas, patch, mask, (u, v), size_m, flat=kind == "flat")


def _furnish_roof(
    canvas: Canvas,
    patch: Patch,
    mask: npt.NDArray[np.bool_],
    uv: tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]],
    size_m: tuple[float, float],
    *,
    flat: bool,
) -> None:
    """Add roof windows, chimneys, machines and stains at random places."""
    rng = canvas.rng
    u, v = uv
    for _ in range(int(rng.integers(2, 7))):
        cu, cv = (rng.uniform(-0.42, 0.42) * s for s in size_m)
        du, dv = rng.uniform(0.25, 0.9 if not flat else 1.6, 2)
        spot = mask & (np.abs(u - cu) < du) & (np.abs(v - cv) < dv)
        tone = float(rng.choice((45.0, 70.0, 150.0, 205.0)))
        patch.paint(spot, (tone * 1.05, tone, tone * 0.95))
        if spot.any() and rng.uniform() < 0.6:
            patch.raise_to(spot, float(patch.height_m[spot].mean() + rng.uniform(0.2, 0.9 if flat else 0.6)))


def park_vehicles(canvas: Canvas, roads: list[FloatArray], count: int) -> None:
    """Leave cars, vans and containers on the roads and in the fields."""
    rng = canvas.rng
    for _ in range(count):
        if roads and rng.uniform() < 0.6:
            line = roads[rng.integers(len(roads))]
            k = int(rng.integers(1, len(line) - 1))
            step = line[k + 1] - line[k - 1]
            side = np.array([-step[1], step[0]]) / max(float(np.linalg.norm(step)), 1e-9)
            centre, angle = line[k] + side * rng.uniform(-2.2, 2.2), float(np.arctan2(step[1], step[0]))
        else:
            centre, angle = canvas.random_point(3.0), float(rng.uniform(0, np.pi))
            if not canvas.is_free(centre, 3.0):
                continue
        length, width, height = rng.choice(((4.3, 1.8, 1.4), (5.4, 2.1, 2.2), (6.1, 2.45, 2.6), (2.0, 1.2, 1.0)))
        patch = canvas.patch(centre, length)
        if patch is None:
            continue
        u, v = patch.turned(angle + float(rng.normal(0, 0.08)))
        body = (np.abs(u) < length / 2) & (np.abs(v) < width / 2)
        base = float(np.median(patch.height_m))
        patch.raise_to(body, base + np.where(np.abs(u + 0.2) < length * 0.3, height, height * 0.65))
        patch.paint(body, CARS_BGR[rng.integers(len(CARS_BGR))])
        glass = body & (np.abs(np.abs(u + 0.2) - length * 0.26) < 0.28) & (np.abs(v) < width * 0.4)
        patch.paint(glass, (44, 38, 34))


def drop_rubble(canvas: Canvas, count: int) -> None:
    """Heap up to ``count`` piles of broken slabs, bricks and beams, nowhere more than 5 m above the land."""
    rng = canvas.rng
    for _ in range(count * 10):
        radius = float(rng.uniform(8.0, 15.0))
        centre = canvas.random_point(radius)
        if count <= 0:
            return
        if canvas.is_free(centre, radius):
            _heap(canvas, centre, radius)
            canvas.take_polygon(box_corners(centre, 2 * radius, 2 * radius, 0.0))
            count -= 1


def _heap(canvas: Canvas, centre: FloatArray, radius_m: float) -> None:
    """Build one pile: a mound of debris under a hundred or so tilted slabs."""
    rng, g = canvas.rng, canvas.gsd_m
    patch = canvas.patch(centre, radius_m)
    if patch is None:
        return
    shape = patch.height_m.shape
    base = patch.height_m.copy()
    bumps = fractal_noise(shape, rng, wavelength_px=7.0 / g, octaves=5, gain=0.65)
    distance = np.hypot(patch.x_m, patch.y_m) / radius_m
    mound = np.clip(0.8 - distance + 0.12 * np.clip(bumps, -1.5, 1.5), 0, 1) ** 1.2 * 3.4
    inside = mound > 0.12
    patch.raise_to(inside, base + mound)
    dust = np.array((118, 132, 142), np.float32)
    patch.paint(inside, dust, brightness=1.0 + 0.16 * bumps)
    for _ in range(int(radius_m**2 * 0.9)):
        at = rng.normal(0, radius_m * 0.38, 2)
        length, width = rng.uniform(0.5, 3.4), rng.uniform(0.25, 1.6)
        angle, tilt = rng.uniform(0, np.pi), rng.uniform(-0.5, 0.5, 2)
        half = int(np.hypot(length, width) / 2 / g) + 2
        cx, cy = (round(float((a - p.flat[0]) / g)) for a, p in zip(at, (patch.x_m, patch.y_m), strict=True))
        part = np.s_[max(cy - half, 0) : max(cy + half, 0), max(cx - half, 0) : max(cx + half, 0)]
        sub = Patch(patch.colour[part], patch.height_m[part], patch.leafy[part],
                    patch.x_m[:, part[1]] - np.float32(at[0]), patch.y_m[part[0]] - np.float32(at[1]))  # fmt: skip
        if min(sub.height_m.shape) < 2 or not inside[part].any():
            continue
        u, v = sub.turned(float(angle))
        slab = (np.abs(u) < length / 2) & (np.abs(v) < width / 2)
        if not slab.any():
            continue
        level = float(np.mean(sub.height_m[slab])) + rng.uniform(0.05, 0.7)
        top = np.minimum(level + tilt[0] * u + tilt[1] * v, base[part] + 5.0)
        lifted = slab & (top > sub.height_m)
        sub.raise_to(lifted, top)
        tone = rng.choice(((150, 152, 154), (108, 112, 116), (70, 86, 148), (176, 178, 176), (74, 96, 122)))
        sub.paint(lifted, np.asarray(tone) * rng.uniform(0.7, 1.15))
