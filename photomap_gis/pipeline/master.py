"""The CRS of the master grid: frames are resampled into it once, so it is the one that the user asked for where it can.

What is measured and solved lies in a plane that is true to scale. A projected CRS that is not (Web Mercator, feet) can
still be what the map is drawn in; degrees cannot, their pixels are no squares on the ground: those are warped to.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from photomap_gis.core.grid import CrsFrame, MapFrame, MapGrid
from photomap_gis.core.similarity import FloatArray
from photomap_gis.export.crs import PointMap, parse_crs, point_map, same_crs


@dataclass(frozen=True, slots=True)
class ProjectedFrame:
    """A map frame seen from another projected CRS; ``core.grid.CrsFrame``."""

    map_frame: MapFrame
    crs_wkt: str
    _there: PointMap = field(init=False, repr=False, compare=False)
    _back: PointMap = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        own, origin = str(self.map_frame.crs_wkt), self.map_frame.to_crs(np.zeros((1, 2)))
        there = point_map(own, self.crs_wkt, around_xy=origin)
        object.__setattr__(self, "_there", there)
        object.__setattr__(self, "_back", point_map(self.crs_wkt, own, around_xy=there(origin)))

    def to_crs(self, xy_map_m: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` internal points to the CRS, east before north."""
        return self._there(self.map_frame.to_crs(xy_map_m))

    def from_crs(self, en: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` points of the CRS to internal points."""
        return self.map_frame.from_crs(self._back(en))


def master_frame(map_frame: MapFrame, crs: str | None) -> CrsFrame:
    """Return the frame to draw in: that of ``crs`` as the user wrote it where it is projected, else the map's own."""
    if crs is None or map_frame.crs_wkt is None:
        return map_frame
    asked = parse_crs(crs)
    if not asked.is_projected or same_crs(asked.to_wkt(), map_frame.crs_wkt):
        return map_frame
    return ProjectedFrame(map_frame, asked.to_wkt())


def frame_of_grid(map_frame: MapFrame, grid: MapGrid) -> CrsFrame:
    """Return the frame that a map on this grid was drawn in."""
    if same_crs(grid.crs_wkt, map_frame.crs_wkt):
        return map_frame
    return ProjectedFrame(map_frame, str(grid.crs_wkt))
