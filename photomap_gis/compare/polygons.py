"""Changed ground as polygons with an area and a score."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from rasterio import Affine
from rasterio.features import geometry_mask, shapes
from shapely.geometry import Polygon, shape

from photomap_gis.core.grid import MapGrid, Window

FloatImage = npt.NDArray[np.float32]
MOST_ZONE_PX = 4096


@dataclass(frozen=True, slots=True, eq=False)
class ChangedArea:
    """A piece of changed ground in the grid's CRS; ``score`` is the mean probability of its pixels, 0 to 1."""

    outline: Polygon
    score: float
    score_max: float
    area_m2: float


def outlines(band: Any, grid: MapGrid, *, min_area_m2: float) -> Iterator[Polygon]:
    """Yield the outlines of the ones in a mask, smoothed to a pixel, without what is smaller than an area.

    ``band`` is a ``(H, W)`` uint8 array or a band of an open raster, which is then read strip by strip.
    """
    for geometry, value in shapes(band, connectivity=8, transform=Affine(*grid.transform)):
        if value != 1:
            continue
        outline = shape(geometry)
        if outline.area < min_area_m2:
            continue
        smooth = shapely.make_valid(outline.simplify(0.9 * grid.pixel_size, preserve_topology=True))
        parts = getattr(smooth, "geoms", [smooth])
        yield from (p for p in parts if isinstance(p, Polygon) and p.area >= 0.5 * min_area_m2)


def scored(outline: Polygon, grid: MapGrid, read: Callable[[Window], FloatImage]) -> ChangedArea:
    """Return an outline with the scores of the pixels in it; ``read`` returns scores, negative where there is none."""
    west, south, east, north = outline.bounds
    size = grid.pixel_size
    left, top = int((west - grid.west) / size), int((grid.north - north) / size)
    right, bottom = int(np.ceil((east - grid.west) / size)), int(np.ceil((grid.north - south) / size))
    left, top, right, bottom = max(0, left), max(0, top), min(grid.width, right), min(grid.height, bottom)
    total, count, most = 0.0, 0, 0.0
    for row in range(top, bottom, MOST_ZONE_PX):
        for col in range(left, right, MOST_ZONE_PX):
            w = Window(col, row, min(MOST_ZONE_PX, right - col), min(MOST_ZONE_PX, bottom - row))
            place = Affine(size, 0.0, grid.west + col * size, 0.0, -size, grid.north - row * size)
            inside = geometry_mask([outline], (w.height, w.width), place, invert=True, all_touched=False)
            values = read(w)
            values = values[inside & (values >= 0.0)]
            if values.size:
                total, count = total + float(values.sum(dtype=np.float64)), count + values.size
                most = max(most, float(values.max()))
    mean = total / count if count else most
    return ChangedArea(outline, mean, max(most, mean), float(outline.area))
