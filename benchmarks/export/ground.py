"""The raster that is tiled: photographic ground with a ragged border, in UTM, as large as asked for."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import rasterio
from rasterio.enums import ColorInterp

ORTHO = Path(__file__).resolve().parents[3] / "shared/data/ortho_yellowstone/2019_YELL_2_528000_4978000_image_crop2.png"
GSD_M = 0.1


def write_ground(path: Path, side_px: int, *, compress: str = "DEFLATE") -> Path:
    """Write a square RGBA GeoTIFF, seen within a rough ellipse, and return its path."""
    picture = cv2.imread(str(ORTHO)) if ORTHO.is_file() else _textured()
    tile = np.hstack([np.vstack([picture, picture[::-1]]), np.vstack([picture[:, ::-1], picture[::-1, ::-1]])])
    repeats = [-(-side_px // n) for n in tile.shape[:2]]
    rgb = np.tile(tile, (*repeats, 1))[:side_px, :side_px, ::-1]
    y, x = np.mgrid[:side_px, :side_px].astype(np.float32) / side_px * 2 - 1
    seen = np.hypot(x, y) + 0.05 * np.sin(9 * np.arctan2(y, x)) < 0.98
    profile = {
        "driver": "GTiff", "width": side_px, "height": side_px, "count": 4, "dtype": "uint8", "crs": "EPSG:32612",
        "transform": rasterio.Affine(GSD_M, 0, 528_000, 0, -GSD_M, 4_978_000), "tiled": True, "blockxsize": 512,
        "blockysize": 512, "compress": compress, "predictor": 2, "photometric": "RGB", "alpha": "UNSPECIFIED",
        "num_threads": "ALL_CPUS", "zlevel": 1,
    }  # fmt: skip
    with rasterio.open(path, "w", **profile) as out:
        out.colorinterp = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
        out.write((rgb * seen[..., None]).transpose(2, 0, 1), indexes=[1, 2, 3])
        out.write((seen * 255).astype(np.uint8), 4)
    return path


def _textured() -> np.ndarray:
    """Return noise of the spectrum of photos, where the orthophoto is absent."""
    rng = np.random.default_rng(7)
    layers = [cv2.resize(rng.random((2048 >> k, 2048 >> k, 3)), (2048, 2048)) * 0.6**-k for k in range(2, 9)]
    mixed = np.sum(layers, axis=0)
    return (255 * (mixed - mixed.min()) / np.ptp(mixed)).astype(np.uint8)
