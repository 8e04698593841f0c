"""The shape of the ground under a map: heights on a regular lattice of the internal map frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class HeightField:
    """Heights ``up`` ``(rows, columns)`` at ``origin + cell * (column, row)``, linear between them, in map units.

    x is east and y south as everywhere in the map frame, and so are columns and rows; heights count upwards from the
    ground's middle level. Beyond the lattice the border goes on level. ``sigma`` is how far the ground may lie off this
    surface: what stands on it, and what is not known of it.
    """

    origin_xy: tuple[float, float]
    cell: float
    up: FloatArray
    sigma: float = 0.0

    def __post_init__(self) -> None:
        up = np.array(self.up, dtype=np.float64)
        if up.ndim != 2 or min(up.shape) < 1 or not self.cell > 0.0:
            raise ValueError(f"heights must be a lattice of cells > 0, got {up.shape} of {self.cell}")
        up.setflags(write=False)
        object.__setattr__(self, "up", up)

    @classmethod
    def level(cls, sigma: float = 0.0) -> HeightField:
        """Return level ground."""
        return cls((0.0, 0.0), 1.0, np.zeros((1, 1)), sigma)

    @property
    def is_level(self) -> bool:
        """Whether all of it has one height."""
        return bool(np.ptp(self.up) == 0.0)

    def at(self, xy_map: npt.ArrayLike) -> FloatArray:
        """``(...)`` heights at ``(..., 2)`` map points."""
        xy = np.asarray(xy_map, dtype=np.float64)
        rows, columns = self.up.shape
        if rows == columns == 1:
            return np.full(xy.shape[:-1], self.up[0, 0])
        u = np.clip((xy[..., 0] - self.origin_xy[0]) / self.cell, 0.0, columns - 1.0)
        v = np.clip((xy[..., 1] - self.origin_xy[1]) / self.cell, 0.0, rows - 1.0)
        nowhere = np.isnan(u + v)
        if nowhere.any():
            u, v = np.where(nowhere, 0.0, u), np.where(nowhere, 0.0, v)
        i = np.minimum(u, max(columns - 2, 0)).astype(np.intp)
        j = np.minimum(v, max(rows - 2, 0)).astype(np.intp)
        p, q = u - i, v - j
        first = j * columns + i  # of the four about the point, in the flat array: half the time of two indices
        right, below = min(1, columns - 1), columns * min(1, rows - 1)
        up = self.up.reshape(-1)
        top = up.take(first) * (1.0 - p) + up.take(first + right) * p
        bottom = up.take(first + below) * (1.0 - p) + up.take(first + (below + right)) * p
        height = top * (1.0 - q) + bottom * q
        return np.asarray(np.where(nowhere, np.nan, height) if nowhere.any() else height, np.float64)
