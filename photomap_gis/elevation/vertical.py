"""What heights of an elevation model are counted from, and how they become heights above the sea.

An autopilot's AMSL is above the geoid (EGM96; EGM2008 and national levels lie within about a metre of it). Heights
above the ellipsoid differ from it by up to 107 m: never taken for each other, never shifted by a guess.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from photomap_gis.core.errors import DataError

FloatArray = NDArray[np.float64]


class VerticalDatum(StrEnum):
    """The zero of an elevation model's heights."""

    EGM96 = "egm96"
    EGM2008 = "egm2008"
    MSL = "msl"
    """A national level near mean sea level."""
    ELLIPSOID = "ellipsoid"
    """The WGS84 ellipsoid, as GPS counts by itself."""


def datum_of(crs: CRS) -> VerticalDatum | None:
    """Return what a file's CRS says of its heights, None where it says nothing."""
    if crs.is_compound:
        vertical = crs.sub_crs_list[-1]
        name = vertical.name.lower()
        if "egm96" in name.replace(" ", "") or vertical.to_epsg() == 5773:
            return VerticalDatum.EGM96
        if "egm2008" in name.replace(" ", "") or vertical.to_epsg() == 3855:
            return VerticalDatum.EGM2008
        return VerticalDatum.ELLIPSOID if "ellipsoid" in name else VerticalDatum.MSL
    if crs.is_geographic and len(crs.axis_info) == 3:
        return VerticalDatum.ELLIPSOID
    return None


def geoid_m(lat_lon_deg: FloatArray) -> FloatArray:
    """Return the geoid's heights above the ellipsoid (EGM96) at ``(N, 2)`` latitudes and longitudes.

    Raises ``DataError`` where PROJ's grid is not on this machine: nothing is downloaded, and nothing is taken as 0.
    """
    lat, lon = lat_lon_deg[:, 0], lat_lon_deg[:, 1]
    try:
        transformer = Transformer.from_crs("EPSG:4979", "EPSG:4326+5773", always_xy=True, allow_ballpark=False)
        above_geoid = np.asarray(transformer.transform(lon, lat, np.zeros(len(lat)))[2], np.float64)
    except ProjError:
        above_geoid = np.full(len(lat), np.nan)
    if not np.all(np.isfinite(above_geoid)):
        raise DataError(
            "heights above the ellipsoid need the geoid's grid, which is not on this machine: run "
            "`projsync --file us_nga_egm96_15` once while online, or give the geoid's height at the place "
            "(--geoid-m), or an elevation model above EGM96 or sea level, or plan with --altitude-frame relative"
        )
    return -above_geoid
