"""Another season over the same ground: what old imagery of another sensor, hour and year shows of it.

Nothing moves: every pixel keeps its place, so a map tied to such imagery can be judged against the true ground.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import rasterio
from rasterio.enums import Resampling
from rasterio.warp import reproject

from photomap_gis.core.errors import OutputError
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.grid import MapFrame, MapGrid
from photomap_gis.simulate.ground import Ground
from photomap_gis.simulate.noise import fractal_noise

NOISE_GREY = 4.0


@dataclass(frozen=True, slots=True)
class Season:
    """How another season differs; shares are of the ground's area.

    ``inversion`` 1 turns the contrast of what grows upside down (0 leaves it). ``moisture`` is the sigma of a smooth
    field of brightness (log), ``wash`` how much of the contrast haze takes. ``vanished_share`` of the ground is grown
    over or levelled, ``new_share`` is built upon.
    """

    inversion: float = 1.0
    moisture: float = 0.25
    wash: float = 0.25
    vanished_share: float = 0.05
    new_share: float = 0.05
    object_m: float = 12.0
    seed: int = 0


def another_season(ground: Ground, season: Season | None = None) -> Ground:
    """Return the same ground as another season shows it: other colours, light and haze, new and missing objects."""
    s = season or Season()
    rng = np.random.default_rng([s.seed, 0x5EA])
    colour = _objects(ground.colour, ground.pixel_size_m, s, rng)
    b, g, r = (colour[..., k].astype(np.float32) for k in range(3))
    growing = cv2.GaussianBlur(np.clip((2.0 * g - r - b - 4.0) / 24.0, 0.0, 1.0), (0, 0), 1.5)
    grey = (b + g + r) / np.float32(3.0)
    mean = cv2.GaussianBlur(grey, (0, 0), max(1.0, 6.0 / ground.pixel_size_m))
    dead = mean - np.float32(s.inversion) * (grey - mean) + 15.0
    shape = (colour.shape[0], colour.shape[1])
    patches = fractal_noise(shape, rng, wavelength_px=max(8.0, 40.0 / ground.pixel_size_m), octaves=2)
    moist = np.exp(np.float32(s.moisture) * patches)
    out = np.empty_like(colour)
    # Straw where it was green, a warmer and lower sun elsewhere; no channel keeps its curve.
    for k, (band, straw, gain, gamma) in enumerate(((b, 0.62, 0.85, 1.25), (g, 0.92, 0.95, 0.9), (r, 1.1, 1.12, 0.8))):
        bare = 255.0 * gain * (np.clip(band, 0, 255) / 255.0) ** gamma
        mixed = ((1.0 - growing) * bare + growing * straw * dead) * moist
        mixed = (1.0 - s.wash) * mixed + s.wash * 150.0
        out[..., k] = np.clip(mixed + NOISE_GREY * rng.standard_normal(shape, dtype=np.float32), 0, 255)
    return Ground(out, ground.height_m, ground.pixel_size_m, ground.west, ground.north, ground.crs_wkt)


def write_reference(ground: Ground, path: Path, *, gsd_m: float, offset_m: tuple[float, float] = (0.0, 0.0)) -> None:
    """Write a ground as an RGB GeoTIFF of another pixel size; ``offset_m`` (east, north) is the imagery's own error."""
    west, south, east, north = ground.grid.bounds
    grid = MapGrid.covering(np.array([(west, south), (east, north)]), MapFrame(ground.crs_wkt), pixel_size=gsd_m)
    shift_east, shift_north = offset_m
    placed = rasterio.Affine(gsd_m, 0.0, grid.west + shift_east, 0.0, -gsd_m, grid.north + shift_north)
    try:
        with rasterio.open(
            path, "w", driver="GTiff", width=grid.width, height=grid.height, count=3, dtype="uint8",
            crs=ground.crs_wkt, transform=placed, tiled=True, compress="deflate", photometric="rgb", nodata=0,
        ) as out:  # fmt: skip
            for band in range(3):
                pixels = np.zeros((grid.height, grid.width), np.uint8)
                reproject(
                    np.maximum(ground.colour[..., 2 - band], 1), pixels, src_crs=ground.crs_wkt,
                    src_transform=rasterio.Affine(*ground.grid.transform), dst_crs=ground.crs_wkt,
                    dst_transform=rasterio.Affine(*grid.transform), resampling=Resampling.average, dst_nodata=0,
                )  # fmt: skip
                out.write(pixels, band + 1)
    except OSError as error:
        raise OutputError(f"cannot write the reference {path}: {error}") from error


def _objects(colour: ImageArray, pixel_size_m: float, s: Season, rng: np.random.Generator) -> ImageArray:
    """Return the colours with some patches grown over by their surroundings and some built upon."""
    out = colour.copy()
    h, w = colour.shape[:2]
    side = s.object_m / pixel_size_m
    for share, build in ((s.vanished_share, False), (s.new_share, True)):
        for _ in range(round(share * h * w / side**2)):
            size = side * rng.uniform(0.6, 1.5, 2)
            centre = rng.uniform((0, 0), (w, h))
            corners = cv2.boxPoints((centre.tolist(), size.tolist(), float(rng.uniform(0, 180))))
            x0, y0 = np.clip(np.floor(corners.min(axis=0)).astype(int), 0, (w - 1, h - 1))
            x1, y1 = np.clip(np.ceil(corners.max(axis=0)).astype(int) + 1, (x0 + 1, y0 + 1), (w, h))
            mask = np.zeros((y1 - y0, x1 - x0), np.uint8)
            cv2.fillPoly(mask, [np.round(corners - (x0, y0)).astype(np.int32)], 255)
            part = out[y0:y1, x0:x1]
            if build:
                shade = rng.uniform(60, 230, 3)
                ramp = np.linspace(0.85, 1.15, x1 - x0)[None, :, None]
                fresh = np.clip(shade * ramp + rng.normal(0, 6, part.shape), 0, 255)
            else:
                dx, dy = rng.integers(0, max(1, w - (x1 - x0))), rng.integers(0, max(1, h - (y1 - y0)))
                fresh = colour[dy : dy + y1 - y0, dx : dx + x1 - x0].astype(np.float64)
            soft = cv2.GaussianBlur(mask, (0, 0), 1.0)[..., None] / 255.0
            part[:] = np.clip(soft * fresh + (1.0 - soft) * part, 0, 255).astype(np.uint8)
    return out
