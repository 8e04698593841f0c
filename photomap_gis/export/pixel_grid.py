"""Rasters that are no ``MapGrid``: pixels that are not square (KML in degrees) or not north-up (a user's old
GeoTIFF)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray


class PixelGrid(Protocol):
    """What the transform path needs to know of a raster; ``MapGrid`` and ``AffineGrid`` both fit."""

    @property
    def crs_wkt(self) -> str | None:
        """The CRS, ``None`` for a local map."""
        ...

    @property
    def width(self) -> int:
        """Columns."""
        ...

    @property
    def height(self) -> int:
        """Rows."""
        ...

    def to_crs(self, xy_px: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` pixel-centre coordinates to the CRS."""
        ...

    def to_px(self, xy_crs: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` points of the CRS to pixel-centre coordinates."""
        ...


@dataclass(frozen=True, slots=True)
class AffineGrid:
    """A raster placed by any affine: ``transform`` is (a, b, c, d, e, f) from pixel **corner** (col, row) to (x, y)."""

    crs_wkt: str | None
    transform: tuple[float, float, float, float, float, float]
    width: int
    height: int

    def __post_init__(self) -> None:
        a, b, _, d, e, _ = self.transform
        if a * e - b * d == 0 or self.width <= 0 or self.height <= 0:
            raise ValueError(f"transform must be invertible and size positive, got {self}")

    def to_crs(self, xy_px: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` pixel-centre coordinates to the CRS."""
        a, b, c, d, e, f = self.transform
        p = np.asarray(xy_px, dtype=np.float64) + 0.5
        x, y = p[..., 0], p[..., 1]
        return np.stack([a * x + b * y + c, d * x + e * y + f], axis=-1)

    def to_px(self, xy_crs: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` points of the CRS to pixel-centre coordinates."""
        a, b, c, d, e, f = self.transform
        p = np.asarray(xy_crs, dtype=np.float64)
        x, y = p[..., 0] - c, p[..., 1] - f
        det = a * e - b * d
        return np.stack([(e * x - b * y) / det, (a * y - d * x) / det], axis=-1) - 0.5

    def grown(self, margin_px: int) -> AffineGrid:
        """Return the same pixels with ``margin_px`` more on every side."""
        a, b, c, d, e, f = self.transform
        m = margin_px
        corner = (a, b, c - m * (a + b), d, e, f - m * (d + e))
        return AffineGrid(self.crs_wkt, corner, self.width + 2 * m, self.height + 2 * m)
