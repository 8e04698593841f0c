"""The best photo map that flat-ground placement can make of a flight: true poses, nearest camera, no blending.

What the evaluation finds in it (walls and crowns that lean, slopes) is the method's own share of the error; what it
finds beyond that in a product's map is the product's.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import rasterio

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.grid import MapFrame, MapGrid
from photomap_gis.simulate.truth import TrueFrame, Truth


def write_ideal_map(
    truth: Truth, read_image: Callable[[TrueFrame], ImageArray], path: Path, *, pixel_size_m: float | None = None
) -> None:
    """Write the ideal map as RGBA GeoTIFF; ``read_image`` returns a frame's stored pixels."""
    frames = [f for f in truth.frames if f.breakage is None]
    outline = np.concatenate([f.footprint_en_m for f in frames])
    frame = MapFrame(truth.crs_wkt)
    grid = MapGrid.covering(outline, frame, pixel_size=pixel_size_m or truth.gsd_m_per_px)
    colour = np.zeros((grid.height, grid.width, 3), np.uint8)
    nearest = np.full((grid.height, grid.width), np.inf, np.float32)
    ground = truth.ground()
    for f in frames:
        # each frame on a plane of its own, at the land's usual height in the middle half of what it sees
        centre = f.footprint_en_m.mean(axis=0)
        inner = centre + (f.footprint_en_m - centre) * np.linspace(0.05, 0.5, 10)[:, None, None]
        level = float(np.median(ground.heights_at(inner.reshape(-1, 2))))
        _lay(f, truth, read_image(f), grid, level, colour, nearest)
    alpha = np.where(np.isfinite(nearest), 255, 0).astype(np.uint8)
    with rasterio.open(
        path, "w", driver="GTiff", width=grid.width, height=grid.height, count=4, dtype="uint8", crs=truth.crs_wkt,
        transform=rasterio.Affine(*grid.transform), tiled=True, compress="deflate", zlevel=1, photometric="rgb",
        alpha="yes",
    ) as out:  # fmt: skip
        out.write(np.concatenate([colour[..., ::-1], alpha[..., None]], axis=2).transpose(2, 0, 1))


def _lay(
    frame: TrueFrame,
    truth: Truth,
    image: ImageArray,
    grid: MapGrid,
    level_m: float,
    colour: ImageArray,
    nearest: np.ndarray,
) -> None:
    """Paint a frame wherever its camera is the nearest so far."""
    px = grid.to_px(frame.footprint_en_m)
    x0, y0 = np.maximum(np.floor(px.min(axis=0)).astype(int) - 1, 0)
    x1, y1 = np.minimum(np.ceil(px.max(axis=0)).astype(int) + 2, (grid.width, grid.height))
    if x1 <= x0 or y1 <= y0:
        return
    x, y = np.meshgrid(np.arange(x0, x1, dtype=np.float64), np.arange(y0, y1, dtype=np.float64))
    en = grid.to_crs(np.stack([x, y], axis=-1).reshape(-1, 2))
    enh = np.concatenate([en, np.full((len(en), 1), level_m)], axis=1)
    at = frame.pose.project(truth.camera, enh).astype(np.float32).reshape(*x.shape, 2)
    distance = np.hypot(*(en - (frame.pose.easting_m, frame.pose.northing_m)).T).astype(np.float32).reshape(x.shape)
    part = np.s_[y0:y1, x0:x1]
    h, w = image.shape[:2]
    inside = (at[..., 0] >= 0) & (at[..., 0] <= w - 1) & (at[..., 1] >= 0) & (at[..., 1] <= h - 1)
    take = inside & (distance < nearest[part])
    pixels = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    colour[part][take] = pixels[take] if pixels.ndim == 3 else pixels[take][:, None]
    nearest[part][take] = distance[take]
