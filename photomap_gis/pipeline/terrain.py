"""The ground under a map from an elevation model, in the map's own frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt

from photomap_gis.core.errors import DataError
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.ground import HeightField
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.elevation import open_dem
from photomap_gis.georef import map_to_lonlat

NODES = 160
"""Of the lattice along the map's longer side: closer ones would show what no frame's pose can."""
MARGIN = 0.1
LEAST_KNOWN = 0.5
"""So much of the ground under the map must be in the model."""
HARDLY_HOLES = 0.99


def terrain_under(path: Path, trajectory: Trajectory, map_frame: MapFrame) -> tuple[HeightField, list[str]]:
    """Return the elevation model's ground under the frames, and what a user should know of holes in it.

    Only its shape is used, its middle level becomes 0: vertical datums do not matter. Holes take the height of what is
    nearest, never 0. Raises ``DataError`` where the model cannot be read or has too little of the ground.
    """
    outlines = np.concatenate([p.outline_xy_map_m() for p in trajectory.placements])
    outlines = outlines[np.isfinite(outlines).all(axis=1)]
    low, high = outlines.min(axis=0), outlines.max(axis=0)
    margin = MARGIN * float((high - low).max())
    low, high = low - margin, high + margin
    cell = float((high - low).max()) / (NODES - 1)
    columns, rows = (int(np.ceil(s / cell)) + 1 for s in (high - low).tolist())
    x, y = np.meshgrid(low[0] + cell * np.arange(columns), low[1] + cell * np.arange(rows))
    lattice = np.stack([x.ravel(), y.ravel()], axis=1)
    up = open_dem(path).elevation_m(map_to_lonlat(map_frame, lattice)[:, ::-1]).reshape(rows, columns)
    if not np.isfinite(up).any():
        raise DataError(f"{path} does not reach the flight: give the elevation model of the same place")
    inside = (x >= low[0] + margin) & (x <= high[0] - margin) & (y >= low[1] + margin) & (y <= high[1] - margin)
    known = float(np.isfinite(up[inside]).mean())
    if known < LEAST_KNOWN:
        raise DataError(
            f"{path.name} has heights for {known:.0%} of the ground under the map: give a model that covers the whole "
            "flight, or leave --dem away"
        )
    words = f"--dem: {path.name} has heights for {known:.0%} of the ground under the map; the rest goes on as its edges"
    warnings = [words] if known < HARDLY_HOLES else []
    return HeightField((float(low[0]), float(low[1])), cell, _filled(up) - float(np.nanmedian(up[inside]))), warnings


def _filled(up: np.ndarray) -> np.ndarray:
    """Return the lattice with each hole as high as the nearest node that is known."""
    holes = ~np.isfinite(up)
    if not holes.any():
        return up
    nearest = distance_transform_edt(holes, return_distances=False, return_indices=True)
    return np.asarray(up[tuple(nearest)])
