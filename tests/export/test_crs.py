"""What users may call a CRS, and the way from one to another."""

import numpy as np
import pytest
from pyproj import CRS

from photomap_gis.core.errors import NotGeoreferencedError, UsageError
from photomap_gis.export.crs import bounds_in, crs_label, needs_place, parse_crs, point_map, same_crs, world_period

UTM33 = CRS.from_epsg(32633).to_wkt()


@pytest.mark.parametrize(
    "text", ["EPSG:32633", "epsg:32633", UTM33, "+proj=utm +zone=33 +datum=WGS84", "EPSG:32633+5773"]
)
def test_names_of_one_crs(text):
    assert same_crs(parse_crs(text).to_wkt(), UTM33)


def test_web_mercator_keeps_its_code():
    assert crs_label(parse_crs("EPSG:3857").to_wkt()) == "EPSG:3857"
    assert crs_label(UTM33) == "EPSG:32633"
    assert crs_label(None) == "local"
    assert crs_label(CRS.from_proj4("+proj=tmerc +lat_0=52 +lon_0=13.4 +datum=WGS84").to_wkt()) == "unknown"


def test_axis_order_and_local_frames():
    assert same_crs("EPSG:4326", "OGC:CRS84")
    assert not same_crs("EPSG:4326", "EPSG:3857")
    assert same_crs(None, None)
    assert not same_crs(None, UTM33)
    assert needs_place(UTM33, "x") == UTM33
    with pytest.raises(NotGeoreferencedError, match=r"KML needs a place .* --track"):
        needs_place(None, "KML")


def test_points_are_east_first_in_north_first_systems():
    to_poland = point_map("EPSG:4326", "EPSG:2180")
    east, north = to_poland([[21.0, 52.2]])[0]
    assert (east, north) == pytest.approx((636_700, 483_400), abs=1000)
    np.testing.assert_allclose(point_map("EPSG:2180", "EPSG:4326")([[east, north]]), [[21.0, 52.2]], atol=1e-8)


def test_no_ballpark():
    """PROJ would silently return OSGB36 coordinates some 100 m off for a place outside Britain."""
    with pytest.raises(UsageError, match="made for the map's region"):
        point_map(UTM33, "EPSG:27700", around_xy=[[391_000, 5_820_000], [392_000, 5_821_000]])


def test_worlds_that_wrap():
    assert world_period("EPSG:4326") == 360.0
    assert world_period("EPSG:3857") == pytest.approx(40_075_016.686, abs=0.01)
    assert world_period(UTM33) is None
    utm60 = CRS.from_epsg(32660).to_wkt()
    west, _, east, _ = bounds_in((832_660.0, 553_400.0, 832_760.0, 553_460.0), utm60, "EPSG:4326")
    assert 0 < east - west < 0.002
    assert west < 180 < east or west < -180 < east


def test_boxes_are_not_cut_at_their_corners():
    """The northern edge of a UTM box bulges in degrees: corners alone would lose its middle."""
    box = (300_000.0, 6_000_000.0, 700_000.0, 6_100_000.0)
    _, south, _, north = bounds_in(box, UTM33, "EPSG:4326")
    middle = point_map(UTM33, "EPSG:4326")([[500_000.0, 6_100_000.0], [300_000.0, 6_000_000.0]])
    assert north >= middle[0, 1] - 1e-6
    assert south <= middle[1, 1] + 1e-6
