"""Zones, round trips, and the two norths."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS, Proj

from photomap_gis.simulate.geodesy import GeoFrame, utm_wkt


@pytest.mark.parametrize(
    ("lat", "lon", "epsg"), [(53.168, 8.649, 32632), (-33.9, 18.4, 32734), (44.9, -110.5, 32612), (0.0, 180.0, 32660)]
)
def test_the_zone_is_that_of_the_place(lat: float, lon: float, epsg: int) -> None:
    assert CRS.from_wkt(utm_wkt(lat, lon)).to_epsg() == epsg


def test_a_place_without_utm_is_refused() -> None:
    with pytest.raises(ValueError, match="latitude within"):
        utm_wkt(89.0, 0.0)


@given(st.floats(-80, 80), st.floats(-179, 179))
def test_there_and_back(lat: float, lon: float) -> None:
    frame = GeoFrame(utm_wkt(lat, lon))
    assert np.allclose(frame.to_lon_lat(frame.from_lon_lat([[lon, lat]])), [[lon, lat]], atol=1e-8)


@pytest.mark.parametrize(("lat", "lon"), [(53.168, 8.649), (60.0, 11.5), (-33.9, 18.4), (-45.0, 170.0)])
def test_convergence_agrees_with_proj(lat: float, lon: float) -> None:
    # PROJ's meridian convergence is the heading of grid north, clockwise from true north
    wkt = utm_wkt(lat, lon)
    frame = GeoFrame(wkt)
    easting, northing = frame.from_lon_lat([[lon, lat]])[0]
    expected = Proj(CRS.from_wkt(wkt)).get_factors(lon, lat).meridian_convergence
    assert math.degrees(frame.convergence_rad(easting, northing)) == pytest.approx(expected, abs=1e-4)
