"""Where the live map's pixels lie: a lattice without edges, chosen once the map's ground sampling distance is known.

On the Earth it is that of web tiles (EPSG:3857) at the zoom next to the pictures' own resolution, so that a tile that a
page asks for is cut out and not resampled; without a place it is the map's own units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.errors import DataError
from photomap_gis.core.grid import CrsFrame, MapFrame, MapGrid, TileIndex, ground_per_unit
from photomap_gis.core.placement import FramePlacement
from photomap_gis.export.crs import WEB_MERCATOR
from photomap_gis.pipeline.master import master_frame

TILE_PX = 256
_HALF_WORLD_M = math.pi * 6378137.0
_NOMINAL_PX = 1 << 20
_LOCAL_TILE = 1 << 14
"""Tile numbers of a local map on disk count from here, so that none is negative."""
_FINEST_ZOOM = 24


@dataclass(frozen=True, slots=True, eq=False)
class LiveLattice:
    """``grid``: corner, pixel size and CRS (its size says nothing); ``frame`` leads from the map to that CRS.

    ``first_tile`` is the number of tile (0, 0) on disk: of web tiles their row and column.
    """

    grid: MapGrid
    frame: CrsFrame
    map_frame: MapFrame
    first_tile: TileIndex

    @property
    def georeferenced(self) -> bool:
        """Whether it has a place on Earth."""
        return self.grid.crs_wkt is not None


def choose_lattice(map_frame: MapFrame, placement: FramePlacement) -> LiveLattice:
    """Return the lattice for a map whose first frame is placed so; ``DataError`` where web tiles end (85 degrees)."""
    gsd = placement.gsd_m_per_px
    if map_frame.crs_wkt is None:
        grid = MapGrid(None, 0.0, 0.0, max(gsd, 1e-6), _NOMINAL_PX, _NOMINAL_PX, TILE_PX)
        return LiveLattice(grid, map_frame, map_frame, TileIndex(_LOCAL_TILE, _LOCAL_TILE))
    frame = master_frame(map_frame, WEB_MERCATOR)
    en = frame.to_crs(placement.centre_xy_map_m[None])[0]
    if not np.isfinite(en).all() or abs(float(en[1])) > _HALF_WORLD_M:
        raise DataError("a live map ends at 85 degrees of latitude, where web maps do; map the recording instead")
    zoom = round(math.log2(2.0 * _HALF_WORLD_M / TILE_PX * ground_per_unit(en, frame) / gsd))
    zoom = min(max(zoom, 0), _FINEST_ZOOM)
    size = 2.0 * _HALF_WORLD_M / (TILE_PX << zoom)
    col = math.floor((float(en[0]) + _HALF_WORLD_M) / (size * TILE_PX))
    row = math.floor((_HALF_WORLD_M - float(en[1])) / (size * TILE_PX))
    west, north = -_HALF_WORLD_M + col * TILE_PX * size, _HALF_WORLD_M - row * TILE_PX * size
    grid = MapGrid(frame.crs_wkt, west, north, size, _NOMINAL_PX, _NOMINAL_PX, TILE_PX)
    return LiveLattice(grid, frame, map_frame, TileIndex(row, col))
