"""Points of the internal map frame as documents have them: degrees, or the map's own units; and the way back."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from photomap_gis.core.grid import MapFrame
from photomap_gis.core.similarity import FloatArray
from photomap_gis.export.crs import WGS84, point_map

_DEGREE_DIGITS, _LOCAL_DIGITS = 8, 2


class Placer:
    """Plan to bring points of the internal map frame into a document's coordinates, and back.

    ``around_xy_map`` ``(N, 2)`` points say where on Earth that will be.
    """

    def __init__(self, frame: MapFrame, around_xy_map: npt.ArrayLike = ((0.0, 0.0),)) -> None:
        self.frame = frame
        self.digits = _LOCAL_DIGITS if frame.crs_wkt is None else _DEGREE_DIGITS
        self._to = self._from = None
        self._lon_deg = 0.0
        if frame.crs_wkt is not None:
            p = np.asarray(around_xy_map, dtype=np.float64).reshape(-1, 2)
            p = p[np.isfinite(p).all(axis=1)]
            around = frame.to_crs(p if len(p) else [[0.0, 0.0]])
            self._to = point_map(frame.crs_wkt, WGS84, around_xy=around)
            here = self._to(around)
            self._lon_deg = float(here[0, 0])
            self._from = point_map(WGS84, frame.crs_wkt, around_xy=here)

    def __call__(self, xy_map: npt.ArrayLike) -> list[list[float]]:
        """Return ``(N, 2)`` points of the map frame, those that have a place, rounded."""
        xy = self.frame.to_crs(xy_map)
        if self._to is not None:
            xy = self._to(xy)
            # across the antimeridian outlines and tracks run on, all on the same side of the world
            xy = np.where(np.isfinite(xy), xy, np.nan)
            xy[:, 0] = self._lon_deg + (xy[:, 0] - self._lon_deg + 180.0) % 360.0 - 180.0
        return [
            [round(float(x), self.digits), round(float(y), self.digits)] for x, y in xy if np.isfinite([x, y]).all()
        ]

    def to_map(self, place: tuple[float, float]) -> tuple[float, float] | None:
        """Return a document's place in the map frame, ``None`` where it has none there."""
        x, y = place
        if not (math.isfinite(x) and math.isfinite(y) and abs(x) < 1e12 and abs(y) < 1e12):
            return None
        if self._from is not None:
            if not (abs(x) <= 360.0 and abs(y) <= 90.0):
                return None
            x, y = (float(v) for v in self._from([[x, y]])[0])
        xy: FloatArray = self.frame.from_crs([[x, y]])[0]
        return (float(xy[0]), float(xy[1])) if np.isfinite(xy).all() else None
