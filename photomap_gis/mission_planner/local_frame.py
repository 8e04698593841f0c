"""Metres about a place: where plans are drawn, right across the antimeridian and at the poles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyproj import Transformer


@dataclass(frozen=True, slots=True, eq=False)
class LocalFrame:
    """Metres x east, y north about an origin on the WGS84 ellipsoid: azimuthal equidistant.

    Lengths are true from the origin; elsewhere they err by about (d / R)^2 / 6, 0.4 mm/km at 10 km.
    """

    lat_deg: float
    lon_deg: float
    _project: Transformer
    _unproject: Transformer

    @classmethod
    def about(cls, lat_deg: float, lon_deg: float) -> LocalFrame:
        """Return the frame about a place in degrees."""
        local = f"+proj=aeqd +lat_0={lat_deg!r} +lon_0={lon_deg!r} +datum=WGS84 +units=m +no_defs"
        geographic = "+proj=longlat +datum=WGS84 +no_defs"
        return cls(
            lat_deg,
            lon_deg,
            Transformer.from_crs(geographic, local, always_xy=True),
            Transformer.from_crs(local, geographic, always_xy=True),
        )

    def to_xy(self, lat_lon_deg: ArrayLike) -> NDArray[np.float64]:
        """Return ``(N, 2)`` metres of ``(N, 2)`` latitudes and longitudes in degrees."""
        points = np.atleast_2d(np.asarray(lat_lon_deg, np.float64))
        return np.column_stack(self._project.transform(points[:, 1], points[:, 0]))

    def to_lat_lon(self, xy_m: ArrayLike) -> NDArray[np.float64]:
        """Return ``(N, 2)`` latitudes and longitudes in degrees of ``(N, 2)`` metres."""
        points = np.atleast_2d(np.asarray(xy_m, np.float64))
        lon, lat = self._unproject.transform(points[:, 0], points[:, 1])
        return np.column_stack((lat, lon))
