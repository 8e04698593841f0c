"""Pairs of pictures of one ground whose changes are known: other season, light, sensor and place, and objects."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.simulate import Ground, procedural_scene
from photomap_gis.simulate.changes import Change, mask_of, with_objects
from photomap_gis.simulate.noise import fractal_noise
from photomap_gis.simulate.season import Season, another_season

SIZE_M = (150.0, 130.0)
PIXEL_M = 0.16


@dataclass(frozen=True, slots=True)
class Nuisance:
    """What differs between the pictures of a pair without being a change.

    ``season`` 0 to 1 is how far the old picture is from the new one's season; ``other_sun`` gives it another
    hour's shadows; ``warp_px`` is the size of the drift between them, ``blur_px`` how much softer the old one is.
    ``lean`` is the tangent of the angle from which each sees what stands, in a direction of its own.
    """

    season: float = 0.0
    other_sun: bool = False
    warp_px: float = 0.0
    blur_px: float = 0.0
    noise: float = 2.0
    grey: bool = False
    lean: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class KnownPair:
    """Old and new ground, and what changed: objects that came or went, as masks of the new ground's pixels."""

    old: Ground
    new: Ground
    changes: tuple[Change, ...]
    name: str

    @property
    def truth(self) -> npt.NDArray[np.bool_]:
        """``(H, W)`` where something changed."""
        return mask_of(self.changes, self.new.colour.shape[:2])


def known_pair(
    seed: int, nuisance: Nuisance, *, objects: int = 12, colour: ImageArray | None = None, name: str = ""
) -> KnownPair:
    """Return a pair over a made scene, or over a picture's ``colour`` (BGR); half of the objects came, half went."""
    rng = np.random.default_rng([seed, 0xC0])
    if colour is None:
        sun = float(rng.uniform(110, 250))
        now = procedural_scene(SIZE_M, PIXEL_M, seed, sun_azimuth_deg=sun)
        then = now
        if nuisance.other_sun:
            then = procedural_scene(SIZE_M, PIXEL_M, seed, sun_azimuth_deg=(sun + 70.0) % 360.0)
    else:
        from photomap_gis.simulate.ground import placed_ground

        now = then = placed_ground(colour, None, pixel_size_m=PIXEL_M)
    new, came = with_objects(now, objects - objects // 2, seed)
    old, went = with_objects(then, objects // 2, seed + 1000, taken=mask_of(came, new.colour.shape[:2]))
    if nuisance.season > 0.0:
        old = another_season(
            old,
            Season(
                inversion=nuisance.season, moisture=0.25 * nuisance.season, wash=0.25 * nuisance.season,
                vanished_share=0.0, new_share=0.0, seed=seed,
            ),
        )  # fmt: skip
    if nuisance.lean:
        old, new = (
            replace(g, colour=leaning(g, nuisance.lean * rng.uniform(0.4, 1.0), float(rng.uniform(0, 6.28))))
            for g in (old, new)
        )
    picture = old.colour
    if nuisance.blur_px:
        picture = cv2.GaussianBlur(picture, (0, 0), nuisance.blur_px)
    if nuisance.warp_px:
        picture = warped(picture, nuisance.warp_px, rng)
    if nuisance.grey:
        picture = cv2.cvtColor(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
    old = replace(old, colour=_noisy(picture, nuisance.noise, rng))
    new = replace(new, colour=_noisy(_lit(new.colour, rng), nuisance.noise, rng))
    return KnownPair(old, new, (*came, *went), name or f"scene {seed}")


def leaning(ground: Ground, tangent: float, direction_rad: float) -> ImageArray:
    """Return a ground's picture as seen from the side: what stands above the land is moved by its height."""
    if ground.height_m is None:
        return ground.colour
    h, w = ground.height_m.shape
    land = cv2.morphologyEx(cv2.blur(ground.height_m, (5, 5)), cv2.MORPH_OPEN, np.ones((161, 161), np.uint8))
    above = np.maximum(ground.height_m - land, 0.0)
    above[above < 0.3] = 0.0
    shift = above * (tangent / ground.pixel_size_m)
    y, x = np.indices((h, w))
    tx = np.clip(np.rint(x + shift * np.cos(direction_rad)), 0, w - 1).astype(np.intp)
    ty = np.clip(np.rint(y + shift * np.sin(direction_rad)), 0, h - 1).astype(np.intp)
    order = np.argsort(above, axis=None, kind="stable")  # what is higher hides what is lower
    out, filled = np.zeros_like(ground.colour), np.zeros((h, w), bool)
    out[ty.ravel()[order], tx.ravel()[order]] = ground.colour.reshape(-1, 3)[order]
    filled[ty, tx] = True
    while not filled.all():  # walls: the colours beside, darker
        near = cv2.dilate(np.where(filled[..., None], out, np.uint8(0)), np.ones((3, 3), np.uint8))
        grown = cv2.dilate(filled.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        fresh = grown & ~filled
        out[fresh] = (near[fresh] * 0.85).astype(np.uint8)
        filled |= grown
    return out


def warped(picture: ImageArray, size_px: float, rng: np.random.Generator) -> ImageArray:
    """Return a picture drifted smoothly by ``size_px`` (one sigma an axis) over some tens of metres."""
    h, w = picture.shape[:2]
    d = [size_px * fractal_noise((h, w), rng, wavelength_px=260.0, octaves=2) for _ in range(2)]
    x, y = np.meshgrid(np.arange(w, dtype=np.float32), np.arange(h, dtype=np.float32))
    return np.asarray(cv2.remap(picture, x + d[0], y + d[1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT))


def _lit(picture: ImageArray, rng: np.random.Generator) -> ImageArray:
    """Return a picture with uneven light, as a mosaic of frames keeps some of."""
    light = np.exp(0.06 * fractal_noise(picture.shape[:2], rng, wavelength_px=300.0, octaves=2))[..., None]
    return np.clip(picture * light * rng.uniform(0.85, 1.15, 3), 0, 255).astype(np.uint8)


def _noisy(picture: ImageArray, sigma: float, rng: np.random.Generator) -> ImageArray:
    return np.clip(picture + rng.normal(0.0, sigma, picture.shape), 0, 255).astype(np.uint8)


MIX = (
    Nuisance(),
    Nuisance(warp_px=2.0, lean=0.25),
    Nuisance(season=0.3, warp_px=1.0, lean=0.15),
    Nuisance(season=0.6, warp_px=2.0, blur_px=0.8, lean=0.15),
    Nuisance(season=1.0, warp_px=2.0, blur_px=0.8, noise=4.0),
    Nuisance(other_sun=True, warp_px=1.0, lean=0.25),
    Nuisance(season=0.5, other_sun=True, warp_px=2.0, noise=4.0),
    Nuisance(season=0.3, warp_px=2.0, grey=True),
)
"""What a calibration and a benchmark mix: from the same day to another season at another hour."""
