"""Where a simulated flight lies on the Earth: UTM zones, longitude and latitude, the turn between the two norths."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from pyproj import CRS, Proj, Transformer

from photomap_gis.core.similarity import FloatArray

DEFAULT_ORIGIN_LAT_LON = (53.168, 8.649)
"""Where a ground without a place of its own is laid: flat land beside Bremen, UTM zone 32 north."""


def utm_wkt(lat_deg: float, lon_deg: float) -> str:
    """Return the WKT of the UTM zone (WGS84) of a place."""
    if not (abs(lat_deg) <= 84.0 and abs(lon_deg) <= 180.0):
        raise ValueError(
            f"UTM needs a latitude within ±84 and a longitude within ±180 degrees, got {lat_deg}, {lon_deg}"
        )
    zone = min(60, int((lon_deg + 180.0) // 6.0) + 1)
    return CRS.from_epsg((32600 if lat_deg >= 0 else 32700) + zone).to_wkt()


class GeoFrame:
    """The two-way road between a projected CRS in metres and WGS84 (a plan: precomputed transformers, no other memory).

    >>> GeoFrame(utm_wkt(53.0, 9.0)).to_lon_lat([[500000.0, 5872000.0]]).round(3).tolist()
    [[9.0, 52.998]]
    """

    def __init__(self, crs_wkt: str) -> None:
        crs = CRS.from_wkt(crs_wkt)
        if not crs.is_projected:
            raise ValueError("crs_wkt must be a projected CRS in metres")
        self._to_wgs84 = Transformer.from_crs(crs, 4326, always_xy=True)
        self._proj = Proj(crs)

    def to_lon_lat(self, en_m: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` eastings, northings to longitude, latitude in degrees."""
        p = np.atleast_2d(np.asarray(en_m, dtype=np.float64))
        return np.stack(self._to_wgs84.transform(p[:, 0], p[:, 1]), axis=-1)

    def from_lon_lat(self, lon_lat_deg: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` longitudes, latitudes in degrees to easting, northing."""
        p = np.atleast_2d(np.asarray(lon_lat_deg, dtype=np.float64))
        return np.stack(self._to_wgs84.transform(p[:, 0], p[:, 1], direction="INVERSE"), axis=-1)

    def convergence_rad(self, easting_m: float, northing_m: float) -> float:
        """Return the heading of grid north, clockwise from true north: true heading = grid heading + convergence."""
        lon, lat = self.to_lon_lat([[easting_m, northing_m]])[0]
        # measured, not looked up: a short step towards the pole, seen in the grid; the sign can be no convention's
        step = self.from_lon_lat([[lon, lat - 1e-4], [lon, lat + 1e-4]])
        de, dn = step[1] - step[0]
        return -math.atan2(float(de), float(dn))
