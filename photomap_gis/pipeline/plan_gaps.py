"""What a mission's map does not show: the areas of a second flight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from rasterio import features
from rasterio.transform import Affine
from rasterio.warp import transform_geom

from photomap_gis.core.errors import DataError
from photomap_gis.core.grid import Window
from photomap_gis.core.plan import GeoPolygon
from photomap_gis.mosaic import TileStore
from photomap_gis.pipeline.solved import Solved
from photomap_gis.store import Mission

_GAP_CELLS = 1500


def gaps_of(
    folder: Path, *, area: Sequence[GeoPolygon], gsd_m: float | None = None, before_s: float | None = None
) -> tuple[GeoPolygon, ...]:
    """Return what a mission's map does not show of ``area`` (of the map's hull where none is given).

    Ground counts as shown where the map has pixels and a frame that is fine enough (``gsd_m``, metres a pixel) and not
    older than ``before_s`` (seconds since 1970) lies over it. Raises ``DataError`` where nothing is left to fly.
    """
    with Mission.open(folder) as mission:
        solved = Solved.load(mission)
        if not solved.georeferenced:
            raise DataError(f"{folder} has no place on Earth: a flight over its gaps cannot be planned")
        crs = solved.map_frame.crs_wkt
        shown = _shown(TileStore(mission.mosaic_folder()))
        if gsd_m is not None or before_s is not None:
            times = {f.index: f.time_s for f in solved.frames}
            good = [
                shapely.Polygon(solved.map_frame.to_crs(p.outline_xy_map_m())).buffer(0)
                for p in solved.trajectory.placements
                if (gsd_m is None or p.gsd_m_per_px <= 1.05 * gsd_m)
                and (before_s is None or (times.get(p.frame) or 0.0) >= before_s)
            ]
            shown = shown.intersection(shapely.union_all(good)) if good else shapely.Polygon()
        cell = TileStore(mission.mosaic_folder()).grid
        grain = max(cell.width, cell.height) * cell.pixel_size / _GAP_CELLS
        if area:
            shapes = [
                shapely.geometry.shape(transform_geom("EPSG:4326", crs, {"type": "Polygon", "coordinates": p.rings}))
                for p in area
            ]
            whole = shapely.union_all([shapely.make_valid(g) for g in shapes])
        else:
            whole = shapely.convex_hull(_shown(TileStore(mission.mosaic_folder())))
    gap = whole.difference(shown.buffer(-2.0 * grain)).buffer(-grain).buffer(3.0 * grain, join_style="mitre")
    gap = gap.intersection(whole).simplify(grain)
    parts = [p for p in shapely.get_parts(gap) if isinstance(p, shapely.Polygon) and p.area > 1.0]
    if not parts:
        raise DataError(f"{folder} shows all of the area already: there is no gap to fly")
    return tuple(
        GeoPolygon(tuple(tuple((float(x), float(y)) for x, y in ring) for ring in g["coordinates"]))
        for g in (transform_geom(crs, "EPSG:4326", shapely.geometry.mapping(p)) for p in parts)
    )


def _shown(store: TileStore) -> Any:
    """The ground that has pixels in the map, in its CRS, a cell a ``_GAP_CELLS``-th of its longer side."""
    grid = store.grid
    skip = max(1, math.ceil(max(grid.width, grid.height) / _GAP_CELLS))
    rows = [
        store.read(Window(0, top, grid.width, min(skip, grid.height - top)))[0, ::skip, 3] > 0
        for top in range(0, grid.height, skip)
    ]
    alpha = np.array(rows, np.uint8)
    size = grid.pixel_size * skip
    place = Affine(size, 0.0, grid.west, 0.0, -size, grid.north)
    found = [shapely.geometry.shape(g) for g, v in features.shapes(alpha, mask=alpha > 0, transform=place) if v]
    return shapely.union_all(found) if found else shapely.Polygon()
