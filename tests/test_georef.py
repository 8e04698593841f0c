"""CRS and map frame, planes, observations, predicted accuracy."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis import georef
from photomap_gis.core.camera import Camera
from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.frame import Attitude, FrameRef, GpsFix
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.posegraph import Pose, PoseGraph, PositionObservation, Solution
from photomap_gis.core.similarity import Similarity2D

CAMERA = Camera(1600, 1200, 1200.0, origin="exif")


def frame(index=0, **known) -> FrameRef:
    return FrameRef(index, f"{index}.jpg", f"{index}.jpg", 1600, 1200, **known)


def name(map_frame: MapFrame) -> str:
    return map_frame.crs_wkt.split('"')[1]


@pytest.mark.parametrize(
    ("lat", "lon", "zone"),
    [
        (52.0, 13.0, "WGS 84 / UTM zone 33N"),
        (-33.9, 18.4, "WGS 84 / UTM zone 34S"),
        (60.4, 5.3, "WGS 84 / UTM zone 32N"),  # Bergen: Norway's exception
        (78.2, 15.6, "WGS 84 / UTM zone 33N"),  # Svalbard
        (78.2, 8.9, "WGS 84 / UTM zone 31N"),
        (64.0, 5.3, "WGS 84 / UTM zone 31N"),
        (0.0, -0.001, "WGS 84 / UTM zone 30N"),
        (10.0, 180.0, "WGS 84 / UTM zone 1N"),
        (10.0, -180.0, "WGS 84 / UTM zone 1N"),
        (88.0, 10.0, "WGS 84 / UPS North (E,N)"),
        (-85.0, 10.0, "WGS 84 / UPS South (E,N)"),
    ],
)
def test_the_zone_of_a_place(lat, lon, zone):
    assert name(georef.choose_map_frame([GpsFix(lat, lon)])) == zone


@given(lat=st.floats(-88.0, 89.0), lon=st.floats(-180.0, 180.0))
def test_places_come_back(lat, lon):
    map_frame = georef.choose_map_frame([GpsFix(lat, lon)])
    xy = georef.fix_to_map(map_frame, [lat], [lon])
    assert np.abs(xy).max() <= 51.0  # the origin is rounded to 100 m
    back = georef.map_to_lonlat(map_frame, xy)[0]
    assert abs(back[1] - lat) < 1e-8
    assert abs(math.remainder(back[0] - lon, 360.0)) * math.cos(math.radians(lat)) < 1e-8


def test_the_map_frame_is_east_and_south():
    map_frame = georef.choose_map_frame([GpsFix(48.0, 9.0)])
    here, north, east = georef.fix_to_map(map_frame, [48.0, 48.001, 48.0], [9.0, 9.0, 9.001])
    assert (north - here)[1] == pytest.approx(-111.2, abs=0.3)
    assert (east - here)[0] == pytest.approx(74.6, abs=0.3)


def test_outliers_and_nulls_do_not_choose_the_zone():
    fixes = [GpsFix(52.0, 13.0)] * 6 + [GpsFix(0.0, 0.0)] * 5 + [GpsFix(-20.0, 100.0)] * 2
    assert name(georef.choose_map_frame(fixes)) == "WGS 84 / UTM zone 33N"


def test_a_flight_across_the_antimeridian_is_one_place():
    fixes = [GpsFix(10.0, 179.999), GpsFix(10.0, -179.999), GpsFix(10.0, -179.998)]
    map_frame = georef.choose_map_frame(fixes)
    xy = georef.fix_to_map(map_frame, [f.lat_deg for f in fixes], [f.lon_deg for f in fixes])
    assert np.ptp(xy[:, 0]) < 400.0


def test_no_fix_no_place():
    with pytest.raises(DataError, match="--track"):
        georef.choose_map_frame([])


@pytest.mark.parametrize("crs", ["EPSG:2180", "EPSG:25834", "EPSG:32634+5773", " epsg:32634 "])
def test_a_fit_crs_is_worked_in(crs):
    map_frame = georef.choose_map_frame([GpsFix(52.2, 21.0)], crs)
    assert name(map_frame) != "WGS 84 / UTM zone 34N" or "32634" in crs


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:3857", "EPSG:4258", "EPSG:2053"])
def test_an_unfit_crs_is_left_to_export(crs):
    place = GpsFix(-30.0, 29.0) if crs == "EPSG:2053" else GpsFix(52.2, 21.0)
    assert name(georef.choose_map_frame([place], crs)).startswith("WGS 84 / UTM")


def test_feet_are_not_metres():
    assert name(georef.choose_map_frame([GpsFix(30.0, -97.0)], "EPSG:2277")) == "WGS 84 / UTM zone 14N"


@pytest.mark.parametrize("text", ["", "nonsense", "EPSG:1", "EPSG:5773", "EPSG:4978", "33N", "[" * 500])
def test_nonsense_is_named_and_an_example_given(text):
    with pytest.raises(UsageError, match="EPSG:32633") as caught:
        georef.resolve_crs(text)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 250


@pytest.mark.parametrize("crs", ["EPSG:32633", "EPSG:2180", "EPSG:27700"])
def test_a_crs_of_another_part_of_the_world_is_refused(crs):
    with pytest.raises(UsageError, match="EPSG:32614"):
        georef.choose_map_frame([GpsFix(30.0, -97.0)], crs)


@given(lat=st.floats(-79.0, 83.0), lon=st.floats(-179.0, 179.0))
def test_convergence_is_that_of_transverse_mercator(lat, lon):
    code = int(georef.utm_code(lat, lon).removeprefix("EPSG:")) % 100
    d = math.radians(lon - (6.0 * code - 183.0))
    map_frame = georef.choose_map_frame([GpsFix(lat, lon)])
    # grid north lies east of true north where true north lies west of grid north: hence the minus
    expected = -math.atan(math.tan(d) * math.sin(math.radians(lat)))
    assert georef.grid_convergence_rad(map_frame, lat, lon) == pytest.approx(expected, abs=2e-3)


def test_a_frame_without_camera_has_a_flat_plane():
    view = georef.plane_view(frame())
    np.testing.assert_allclose(view.to_plane([[799.5, 599.5], [0.0, 0.0]]), [[0.0, 0.0], [-799.5, -599.5]])


def test_nadir_needs_no_levelling():
    view = georef.plane_view(frame(camera=CAMERA, attitude=Attitude(1.0, -math.pi / 2)))
    np.testing.assert_allclose(view.to_plane([[10.0, 20.0]]), [[10.0 - 799.5, 20.0 - 599.5]], atol=1e-6)


def test_a_tilted_camera_is_levelled_about_the_plumb_point():
    tilt = math.radians(10.0)
    ref = frame(camera=CAMERA, attitude=Attitude(0.0, -math.pi / 2 + tilt))
    centre = georef.plane_view(ref).to_plane([[799.5, 599.5]])[0]
    # the optical axis leans to the image's top (north): the centre lies above the plumb point
    np.testing.assert_allclose(centre, [0.0, -1200.0 * math.tan(tilt)], atol=1e-6)


@pytest.mark.parametrize(
    "known",
    [
        {"attitude": Attitude(0.0, math.radians(-20.0)), "camera": CAMERA},
        {"attitude": Attitude(0.0, math.radians(90.0)), "camera": CAMERA},
        {"attitude": Attitude(0.0, math.radians(-80.0))},
    ],
)
def test_what_cannot_be_levelled_stays_flat(known):
    assert georef.plane_view(frame(**known)).is_rigid


def test_a_camera_of_another_size_is_resized():
    view = georef.plane_view(frame(camera=Camera(3200, 2400, 2400.0, 1600.0, 1190.0)))
    assert view.camera.focal_px == pytest.approx(1200.0)
    assert view.camera.cx_px == pytest.approx(799.75)


MAP = georef.choose_map_frame([GpsFix(52.0, 13.0)])


def test_a_plain_fix_is_a_position_with_drift():
    seen = georef.observe([frame(7, fix=GpsFix(52.0, 13.0, alt_m=900.0), time_s=5.0, flight=2)], MAP)
    (position,) = seen.positions
    np.testing.assert_allclose(position.xy_map_m, georef.fix_to_map(MAP, [52.0], [13.0])[0])
    assert (position.frame, position.flight, position.time_s) == (7, 2, 5.0)
    assert position.correlated_sigma_m == 2.0 and position.bias_sigma_m == 1.0
    # no attitude: two or three degrees from some 80 m, and the altitude is no height
    assert 4.0 < math.sqrt(position.covariance_m2[0, 0]) < 5.5
    assert seen.scales == () and seen.headings == ()


def test_a_better_receiver_is_better_in_all_its_parts():
    known = {"camera": CAMERA, "attitude": Attitude(0.0, -math.pi / 2, sigma_tilt_rad=0.0), "height_m": 50.0}
    (position,) = georef.observe([frame(fix=GpsFix(52.0, 13.0, sigma_m=0.02), **known)], MAP).positions
    assert math.sqrt(position.covariance_m2[0, 0]) == pytest.approx(0.02)
    assert position.correlated_sigma_m < 0.02 and position.bias_sigma_m < 0.02


def test_rounded_digits_are_white_noise():
    known = {"camera": CAMERA, "attitude": Attitude(0.0, -math.pi / 2, sigma_tilt_rad=0.0), "height_m": 50.0}
    (position,) = georef.observe([frame(fix=GpsFix(52.0, 13.0, sigma_m=6.0), **known)], MAP).positions
    assert math.sqrt(position.covariance_m2[0, 0]) == pytest.approx(6.0)
    assert position.correlated_sigma_m == 2.0


def test_height_and_lens_give_the_scale():
    (scale,) = georef.observe([frame(height_m=60.0, camera=CAMERA)], MAP).scales
    assert scale.gsd_m_per_px == pytest.approx(0.05)
    assert 0.1 < scale.sigma_log < 0.15


@pytest.mark.parametrize("height", [0.0, -3.0, math.nan, None])
def test_heights_of_nothing_say_nothing(height):
    assert georef.observe([frame(height_m=height, camera=CAMERA)], MAP).scales == ()


def test_yaw_becomes_a_heading_from_grid_north():
    place = GpsFix(52.0, 13.0)
    (heading,) = georef.observe([frame(fix=place, attitude=Attitude(1.0, -math.pi / 2))], MAP).headings
    expected = 1.0 + georef.grid_convergence_rad(MAP, 52.0, 13.0)
    assert heading.heading_rad == pytest.approx(expected, abs=1e-5)
    assert georef.grid_convergence_rad(MAP, 52.0, 13.0) == pytest.approx(math.radians(1.576), abs=1e-4)


def test_frames_without_a_clock_keep_their_order():
    seen = georef.observe([frame(k, fix=GpsFix(52.0, 13.0)) for k in range(3)], MAP)
    times = [p.time_s for p in seen.positions]
    assert times == sorted(times) and times[0] != times[1]


def test_null_island_is_no_fix():
    assert georef.observe([frame(fix=GpsFix(0.0, 0.0))], MAP).positions == ()


def test_accuracy_is_ce90_of_the_covariances():
    pose = Pose(0, Similarity2D(0.0, 0.0, 0.7, math.log(0.1)), np.diag([400.0, 400.0, 0.0, 0.0]), 0)
    graph = PoseGraph((0,), (), (PositionObservation(0, np.zeros(2), np.eye(2)),))
    stated = georef.accuracy(Solution((pose,), 0.0), graph)
    assert stated.sigma_e_m == pytest.approx(2.0) and stated.sigma_n_m == pytest.approx(2.0)
    assert stated.predicted_ce90_m == pytest.approx(1.5175 * math.hypot(2.0, 2.0))
    assert georef.accuracy(Solution((pose,), 0.0), PoseGraph((0,), ())) is None
    assert georef.accuracy(Solution((), 0.0), graph) is None


@given(lat=st.floats(50.0, 54.0), lon=st.floats(6.5, 11.5))
def test_points_of_a_crs_come_back_from_degrees(lat, lon):
    frame = georef.choose_map_frame([GpsFix(lat, lon)])
    en = frame.to_crs(georef.fix_to_map(frame, [lat], [lon]))
    np.testing.assert_allclose(georef.crs_to_lonlat(frame.crs_wkt, en), [[lon, lat]], atol=1e-8)
    np.testing.assert_allclose(georef.crs_to_lonlat("EPSG:4326", [[lon, lat]]), [[lon, lat]], atol=1e-12)


def test_points_that_a_crs_cannot_hold_are_told():
    with pytest.raises(UsageError, match="no coordinate reference system"):
        georef.crs_to_lonlat("EPSG:99999", [[0.0, 0.0]])
    with pytest.raises(UsageError, match="made for"):
        georef.crs_to_lonlat("EPSG:25832", [[500_000.0, 1_000_000.0]])  # Africa
    with pytest.raises(UsageError, match="cannot hold the point"):
        georef.crs_to_lonlat("EPSG:3035", [[9e8, 9e8]])
