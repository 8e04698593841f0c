"""Pairs of frames with known truth, by class: what a drone's camera would see of a ground, twice.

Truth is the similarity closest, by least squares over the true overlap, to the true mapping. A camera that leans, and
ground that is not flat, cannot be followed by any similarity: what is then left over is ``residual_px``.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np

from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity

from .camera import Lens, Pose, Relief, attitude, render_flat, transfer
from .nuisance import Nuisance, spoil
from .pictures import (
    Grey,
    Part,
    Picture,
    Sources,
    find_sources,
    read_calm,
    read_grey,
    read_scene,
    show_different_places,
)
from .textures import repetitive_ground

GRID = 32
RELIEF_GRID = 96
"""The true mapping is told at GRID x GRID pixels of b; at more where it is rugged, or they would sway the truth."""
LARGEST_PX_PER_PX = 2.2
LEAST_CONTRAST = 4.0
"""Scatter in grey levels of what is finer than some 10 pixels: grounds with less are for the class ``low-texture``."""
REPETITIVE_SEEDS = 240
BORDER_PX = 3.0

Kind = Literal["flat", "relief", "repetitive", "wrong"]


@dataclass(frozen=True, slots=True)
class PairClass:
    """What pairs of a class are like. Lengths are shares of the frame's width; ``rotation_deg`` is the largest."""

    kind: Kind = "flat"
    translation: tuple[float, float] = (0.0, 0.25)
    rotation_deg: float = 30.0
    scale: tuple[float, float] = (0.9, 1.1)
    tilt_deg: float = 3.0
    nuisance: Nuisance = field(default_factory=Nuisance)
    relief: float = 0.0
    low_texture: bool = False


def _moved(share: float) -> PairClass:
    return PairClass(translation=(share, share), rotation_deg=10.0, scale=(0.95, 1.05))


CLASSES: dict[str, PairClass] = {
    "nominal": PairClass(),
    **{f"translation-{t}": _moved(t / 100.0) for t in (10, 20, 30, 40, 50, 60)},
    "rotation": PairClass(rotation_deg=180.0),
    "scale-1.4": PairClass(scale=(0.75, 1.4)),
    "scale-1.6": PairClass(scale=(0.6, 1.6)),
    "noise-10": PairClass(nuisance=Nuisance(noise=10.0)),
    "noise-20": PairClass(nuisance=Nuisance(noise=20.0)),
    "blur": PairClass(nuisance=Nuisance(blur_px=3.0)),
    "motion-blur": PairClass(nuisance=Nuisance(motion_blur_px=16.0)),
    "illumination": PairClass(nuisance=Nuisance(illumination=True)),
    "vignetting": PairClass(nuisance=Nuisance(vignetting=True)),
    "tilt-0": PairClass(tilt_deg=0.0, nuisance=Nuisance(noise=1.0)),
    "tilt-5": PairClass(tilt_deg=5.0),
    "tilt-10": PairClass(tilt_deg=10.0),
    "tilt-15": PairClass(tilt_deg=15.0),
    "relief-5": PairClass(kind="relief", relief=0.05),
    "relief-10": PairClass(kind="relief", relief=0.10),
    "moving-objects": PairClass(nuisance=Nuisance(moving_objects=True)),
    "jpeg-10": PairClass(nuisance=Nuisance(jpeg_quality=10)),
    "corrupt-rows": PairClass(nuisance=Nuisance(corrupt_share=0.25)),
    "low-contrast": PairClass(nuisance=Nuisance(contrast=0.12)),
    "low-texture": PairClass(low_texture=True, nuisance=Nuisance(contrast=0.5)),
    "repetitive": PairClass(kind="repetitive", translation=(0.0, 0.45)),
    "wrong": PairClass(kind="wrong", rotation_deg=180.0),
}
SUCCESS_CLASSES = tuple(name for name, c in CLASSES.items() if c.kind in ("flat", "relief"))
"""Classes whose pairs show the same ground and say so."""


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """Two frames and the truth about them.

    ``a``, ``b`` are uint8 grey. ``T_a_b`` is the closest similarity over the true overlap, ``None`` where there is
    none; ``residual_px`` the RMS distance (2-D, in a's pixels) that it leaves. ``points_b`` ``(N, 2)`` lie on an even
    grid over the part of b that a sees too, and are truly at ``points_a``. ``overlap`` is that part's share of b.
    """

    cls: str
    picture: str
    a: Grey
    b: Grey
    T_a_b: Similarity2D | None
    residual_px: float
    overlap: float
    points_a: FloatArray
    points_b: FloatArray
    tilt_deg: tuple[float, float]

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.b.shape[1], self.b.shape[0]


def pairs(
    cls: str,
    count: int,
    seed: int,
    part: Part = "reporting",
    *,
    first: int = 0,
    size: tuple[int, int] = (256, 256),
    hfov_deg: float = 60.0,
    sources: Sources | None = None,
    change: PairClass | None = None,
) -> Iterator[Pair]:
    """Yield pairs ``first`` to ``first + count`` of a class: the k-th is the same whichever others are asked for.

    ``change`` replaces the class's definition (its name then only labels and seeds).
    """
    sources = sources or find_sources(part)
    for k in range(first, first + count):
        rng = np.random.default_rng([seed, zlib.crc32(cls.encode()), part == "tuning", k])
        yield make_pair(cls, rng, sources, size=size, hfov_deg=hfov_deg, change=change)


def make_pair(
    cls: str,
    rng: np.random.Generator,
    sources: Sources,
    *,
    size: tuple[int, int] = (256, 256),
    hfov_deg: float = 60.0,
    change: PairClass | None = None,
) -> Pair:
    """Return a pair of a class; the same ``rng`` state gives the same pair."""
    spec = change or CLASSES[cls]
    lens = Lens.of(size, hfov_deg)
    if spec.kind == "wrong":
        return _wrong_pair(cls, spec, rng, sources, lens)
    if spec.kind == "relief":
        return _relief_pair(cls, spec, rng, sources, lens)
    return _flat_pair(cls, spec, rng, sources, lens)


@dataclass(frozen=True, slots=True, eq=False)
class _Shot:
    """Two cameras over a picture, and the box (x0, y0, x1, y1) that both together see."""

    a: Pose
    b: Pose
    box: FloatArray
    tilt_deg: tuple[float, float]


def _flat_pair(cls: str, spec: PairClass, rng: np.random.Generator, sources: Sources, lens: Lens) -> Pair:
    name, grey, shot = _choose(spec, rng, sources, lens)
    m = spec.nuisance.margin_px
    H_a_b = np.linalg.inv(shot.a.to_ground(lens)) @ shot.b.to_ground(lens)
    grid = grid_of(lens)
    there = transfer(H_a_b, grid)
    T, pair = _judged(cls, name, grid, there, np.ones(len(grid), bool), lens, shot)
    a, b = spoil(spec.nuisance, rng, render_flat(grey, shot.a, lens, m), render_flat(grey, shot.b, lens, m), T)
    return replace(pair, a=a, b=b)


def _relief_pair(cls: str, spec: PairClass, rng: np.random.Generator, sources: Sources, lens: Lens) -> Pair:
    if not sources.scenes:
        raise ValueError("a pair with relief needs a scene among its sources")
    m = spec.nuisance.margin_px
    for _ in range(60):
        picture = sources.scenes[int(rng.integers(len(sources.scenes)))]
        scene = read_scene(picture)
        shot = _aim(spec, rng, lens, scene.grey.shape, picture.least_px, reach=1.0 + 2.0 * spec.relief)
        if shot is None:
            continue
        x0, y0, x1, y1 = (int(v) for v in (*np.floor(shot.box[:2]), *np.ceil(shot.box[2:])))
        seen = scene.height_px[y0:y1:4, x0:x1:4]
        typical, high = np.percentile(seen, (50.0, 98.0))
        growth = spec.relief * shot.a.height / max(float(high - typical), 1e-6)
        if growth > 2.5:
            continue  # hardly anything stands here
        relief = Relief(scene, (x0, y0, x1, y1), growth)
        grid = grid_of(lens, RELIEF_GRID)
        square = grid.reshape(RELIEF_GRID, RELIEF_GRID, 2)
        there, visible = relief.correspond(shot.a, shot.b, lens, square)
        T, pair = _judged(cls, picture.name, grid, there.reshape(-1, 2), visible.ravel(), lens, shot)
        a, b = spoil(spec.nuisance, rng, relief.render(shot.a, lens, m), relief.render(shot.b, lens, m), T)
        return replace(pair, a=a, b=b)
    raise RuntimeError(f"no scene has room for a pair of class {cls}")


def _wrong_pair(cls: str, spec: PairClass, rng: np.random.Generator, sources: Sources, lens: Lens) -> Pair:
    """Return two views with nothing in common: of two pictures, or of two places of one picture."""
    single = replace(spec, translation=(0.0, 0.0))
    for _ in range(60):
        group = _draw_group(rng, sources)
        p, way = _draw_from(rng, group), rng.random()
        # two places of a picture; two pictures of a kind (fields of one flight, scenes); any two
        q = p if way < 0.5 else _draw_from(rng, group) if way < 0.75 else _draw_from(rng, _draw_group(rng, sources))
        if q is not p and not show_different_places(p, q):
            continue
        grey_p, grey_q = read_grey(p), read_grey(q)
        shots = _aim_apart(single, rng, lens, (p, q), (grey_p.shape, grey_q.shape))
        if shots is None:
            continue
        first, second = shots
        if min(_contrast(grey_p, first.box), _contrast(grey_q, second.box)) < LEAST_CONTRAST / 2.0:
            continue
        m = spec.nuisance.margin_px
        a, b = render_flat(grey_p, first.a, lens, m), render_flat(grey_q, second.b, lens, m)
        a8, b8 = spoil(spec.nuisance, rng, a, b, None)
        name = p.name if p is q else f"{p.name} | {q.name}"
        nothing = np.zeros((0, 2))
        return Pair(cls, name, a8, b8, None, 0.0, 0.0, nothing, nothing, (first.tilt_deg[0], second.tilt_deg[1]))
    raise RuntimeError(f"no two places found for a pair of class {cls}")


def _aim_apart(
    spec: PairClass,
    rng: np.random.Generator,
    lens: Lens,
    of: tuple[Picture, Picture],
    shapes: tuple[tuple[int, ...], ...],
) -> tuple[_Shot, _Shot] | None:
    """Place one camera over each of two pictures; over one and the same, where they see nothing in common."""
    for _ in range(12):  # the places of a photo that lie apart are few
        first, second = (
            _aim(spec, rng, lens, shape, p.least_px, alone=True) for p, shape in zip(of, shapes, strict=True)
        )
        if first is None or second is None:
            continue
        if of[0] != of[1] or _apart(first.box, second.box):
            return first, second
    return None


def _apart(first: FloatArray, second: FloatArray) -> bool:
    return bool((first[:2] > second[2:] + 2).any() or (second[:2] > first[2:] + 2).any())


def _choose(spec: PairClass, rng: np.random.Generator, sources: Sources, lens: Lens) -> tuple[str, Grey, _Shot]:
    """Draw a picture and two cameras over it, with enough (or, for low texture, little) contrast in view."""
    calmest: tuple[float, str, Grey, _Shot] | None = None
    tried = 0
    for _ in range(200):
        if spec.kind == "repetitive":
            seed = int(rng.integers(REPETITIVE_SEEDS)) * 2 + (sources.part == "reporting")
            name, grey, least = f"repetitive-{seed}", repetitive_ground(seed), 1.0
        else:
            picture = _draw_from(rng, _draw_group(rng, sources))
            name, least = picture.name, picture.least_px
            grey = read_calm(picture) if spec.low_texture else read_grey(picture)
        shot = _aim(spec, rng, lens, grey.shape, least)
        if shot is None:
            continue
        contrast = _contrast(grey, shot.box)
        if spec.low_texture:
            if contrast > LEAST_CONTRAST / 4.0 and (calmest is None or contrast < calmest[0]):
                calmest = contrast, name, grey, shot
            tried += 1
            if tried >= 10 and calmest is not None:
                return calmest[1:]
        elif spec.kind == "repetitive" or contrast >= LEAST_CONTRAST:
            return name, grey, shot
    raise RuntimeError("no picture has room for such a pair: frames too large or moved too far")


def _draw_group(rng: np.random.Generator, sources: Sources) -> tuple[Picture, ...]:
    return sources.groups[int(rng.integers(len(sources.groups)))]


def _draw_from(rng: np.random.Generator, group: tuple[Picture, ...]) -> Picture:
    return group[int(rng.integers(len(group)))]


def _contrast(grey: Grey, box: FloatArray) -> float:
    """Scatter, in grey levels, of what is finer than some ten pixels within a box."""
    x0, y0, x1, y1 = (int(v) for v in box)
    part = cv2.resize(grey[y0:y1, x0:x1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).astype(np.float32)
    return float(np.std(part - cv2.blur(part, (11, 11))))


def _aim(
    spec: PairClass,
    rng: np.random.Generator,
    lens: Lens,
    shape: tuple[int, ...],
    least_px: float,
    *,
    alone: bool = False,
    reach: float = 1.0,
) -> _Shot | None:
    """Place two cameras over a picture of ``shape`` as a class wants them, ``None`` where they find no room.

    ``alone`` places only one (both of the shot are the same); ``reach`` widens the box of what must be there.
    """
    yaw = rng.uniform(0.0, 2.0 * math.pi)
    turn = math.radians(rng.uniform(-spec.rotation_deg, spec.rotation_deg))
    scale = math.exp(rng.uniform(math.log(spec.scale[0]), math.log(spec.scale[1])))
    tilts = rng.uniform(0.0, spec.tilt_deg, 2)
    leans = rng.uniform(0.0, 2.0 * math.pi, 2)
    way, share = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(*spec.translation)
    spread, place = rng.random(), rng.random(2)
    if alone:
        scale, turn = 1.0, 0.0
    R = [attitude(y, math.radians(t), lean) for y, t, lean in zip((yaw, yaw + turn), tilts, leans, strict=True)]
    # Both cameras first over one spot, heights for one ground pixel a frame pixel of a; then b goes to where its
    # centre shows what a shows ``share`` of its width away from its own.
    a, b = Pose(0.0, 0.0, lens.focal_px, R[0]), Pose(0.0, 0.0, lens.focal_px * scale, R[1])
    if alone:
        b = a
    else:
        aim = lens.centre + share * lens.width_px * np.array([math.cos(way), math.sin(way)])
        gap = transfer(a.to_ground(lens), aim[None])[0] - transfer(b.to_ground(lens), lens.centre[None])[0]
        b = b.moved(float(gap[0]), float(gap[1]))
    rim = lens.rim(spec.nuisance.margin_px + 1.0)
    outline = np.concatenate([transfer(p.to_ground(lens), rim) for p in (a, b)])
    low, high = outline.min(axis=0), outline.max(axis=0)
    middle, half = (low + high) / 2.0, (high - low) / 2.0 * reach
    room = (np.array([shape[1], shape[0]]) - 1.0) / 2.0 - BORDER_PX
    least, largest = least_px / min(1.0, scale), min(LARGEST_PX_PER_PX, float((room / half).min()))
    if largest < least:
        return None
    k = least + (largest - least) * spread
    centre = BORDER_PX + k * half + place * 2.0 * (room - k * half)
    dx, dy = centre - k * middle
    poses = [Pose(p.x * k + dx, p.y * k + dy, p.height * k, p.R) for p in (a, b)]
    box = np.concatenate([centre - k * half, centre + k * half])
    return _Shot(poses[0], poses[1], box, (float(tilts[0]), float(tilts[1])))


def grid_of(lens: Lens, count: int = GRID) -> FloatArray:
    """``(count * count, 2)`` pixels evenly over a frame."""
    x, y = ((np.arange(count) + 0.5) * n / count - 0.5 for n in (lens.width_px, lens.height_px))
    return np.stack([v.ravel() for v in np.meshgrid(x, y)], axis=1)


def _judged(
    cls: str, name: str, grid: FloatArray, there: FloatArray, visible: np.ndarray, lens: Lens, shot: _Shot
) -> tuple[Similarity2D, Pair]:
    """Return the closest similarity, and the pair but for its pictures."""
    inside = visible & (there >= -0.5).all(axis=1) & (there <= 2.0 * lens.centre + 0.5).all(axis=1)
    p_a, p_b = there[inside], grid[inside]
    T = fit_similarity(p_a, p_b)
    residual = float(np.sqrt(np.mean(np.sum((T.apply(p_b) - p_a) ** 2, axis=1))))
    empty: Grey = np.zeros((lens.height_px, lens.width_px), np.uint8)
    return T, Pair(cls, name, empty, empty, T, residual, float(inside.mean()), p_a, p_b, shot.tilt_deg)
