"""One row per frame, as CSV and GeoJSON."""

import csv
import json
import math

import numpy as np
import pytest
from pyproj import CRS, Transformer

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.errors import NotGeoreferencedError, UsageError
from photomap_gis.core.frame import FrameRef, FrameStatus
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.placement import FramePlacement, PlanePlacement
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.export import PoseRow, pose_rows, write_poses
from photomap_gis.export.poses import COLUMNS, utc_text

FRAME = MapFrame(CRS.from_epsg(32633).to_wkt(), 391_000.0, 5_820_000.0)
HEADER = (
    "frame,source,time_utc,easting_m,northing_m,crs,heading_deg,gsd_m_per_px,sigma_e_m,sigma_n_m,"
    "status,reason,segment,method"
)


def placement(index, x, y, heading_deg, *, sigma=(0.3, 0.2), status=FrameStatus.REGISTERED, gsd=0.05):
    camera = Camera.of_hfov(1600, 1200, math.radians(70))
    # Covariance of a translation in the plane's pixels, turned so that east and north have the sigmas wanted.
    turn = Similarity2D(angle_rad=math.radians(heading_deg))
    cov = np.zeros((4, 4))
    cov[:2, :2] = turn.linear.T @ np.diag(np.square(sigma)) @ turn.linear / gsd**2
    pose = Similarity2D(x, y, math.radians(heading_deg), math.log(gsd))
    return FramePlacement(index, 1600, 1200, PlanePlacement(PlaneView.flat(camera), pose), cov, status, 2, "ifmi")


def frames():
    return [
        FrameRef(0, "A.JPG", "/f/A.JPG", 1600, 1200, time_s=1_700_000_000.25),
        FrameRef(1, 'B, "x".JPG', '/f/B, "x".JPG', 1600, 1200),
        FrameRef(2, "C.JPG", "/f/C.JPG", 0, 0, problem="cannot be\nread"),
        FrameRef(3, "D.JPG", "/f/D.JPG", 1600, 1200, time_s=math.nan),
    ]


def rows(map_frame=FRAME):
    trajectory = Trajectory(
        (placement(0, 12.0, 30.0, 350.0), placement(1, -5.0, 8.0, 90.0, status=FrameStatus.GPS_ONLY))
    )
    return pose_rows(frames(), trajectory, map_frame, {3: FrameStatus.OBLIQUE}, {3: "looks 40 degrees off nadir"})


def test_every_frame_has_its_row():
    a, b, c, d = rows()
    assert (a.frame, a.source, a.time_utc) == ("A.JPG", "/f/A.JPG", "2023-11-14T22:13:20.250Z")
    assert (a.easting_m, a.northing_m) == pytest.approx((391_012.0, 5_819_970.0), abs=0.05)
    assert a.crs == "EPSG:32633"
    assert a.heading_deg == pytest.approx(350.0)
    assert a.gsd_m_per_px == pytest.approx(0.05)
    assert (a.sigma_e_m, a.sigma_n_m) == pytest.approx((0.3, 0.2))
    assert (a.status, a.reason, a.segment, a.method) == ("registered", None, 2, "ifmi")
    assert b.status == "gps_only"
    assert b.heading_deg == pytest.approx(90.0)
    assert (c.status, c.reason, c.easting_m) == ("error_frame", "cannot be\nread", None)
    assert (d.status, d.reason, d.time_utc) == ("oblique", "looks 40 degrees off nadir", None)


def test_csv(tmp_path):
    write_poses(rows(), tmp_path / "poses.csv")
    text = (tmp_path / "poses.csv").read_text(encoding="utf-8")
    assert text.splitlines()[0] == HEADER == ",".join(COLUMNS)
    read = list(csv.DictReader(text.splitlines()))
    assert len(read) == 4
    assert read[0]["easting_m"] == "391012.0000"
    assert read[1]["frame"] == 'B, "x".JPG'
    assert read[2]["reason"] == "cannot be read"
    assert read[2]["easting_m"] == read[2]["crs"] == read[2]["segment"] == ""
    assert not any("nan" in v or "None" in v for row in read for v in row.values())


def test_geojson(tmp_path):
    write_poses(rows(), tmp_path / "poses.geojson")
    document = json.loads((tmp_path / "poses.geojson").read_text(encoding="utf-8"))
    features = document["features"]
    assert "crs" not in document
    assert [f["geometry"] is None for f in features] == [False, False, True, True]
    back = Transformer.from_crs(4326, 32633, always_xy=True).transform(*features[0]["geometry"]["coordinates"])
    assert back == pytest.approx((391_012.0, 5_819_970.0), abs=0.06)
    assert list(features[0]["properties"]) == list(COLUMNS)
    assert features[2]["properties"]["easting_m"] is None


def test_local_maps(tmp_path):
    local = rows(MapFrame(None))
    assert local[0].crs == "local"
    assert (local[0].easting_m, local[0].northing_m) == pytest.approx((12.0, -30.0), abs=0.05)
    write_poses(local, tmp_path / "poses.csv")
    with pytest.raises(NotGeoreferencedError, match="--track"):
        write_poses(local, tmp_path / "poses.geojson")
    assert [p.name for p in tmp_path.iterdir()] == ["poses.csv"]


def test_a_crs_without_a_code(tmp_path):
    wkt = CRS.from_proj4("+proj=tmerc +lat_0=52 +lon_0=13.4 +datum=WGS84").to_wkt()
    named = rows(MapFrame(wkt, 0.0, 0.0))
    write_poses(named, tmp_path / "poses.geojson", crs_wkt=wkt)
    coordinates = json.loads((tmp_path / "poses.geojson").read_text())["features"][0]["geometry"]["coordinates"]
    assert coordinates == pytest.approx((13.4, 52.0), abs=1e-3)


def test_no_rows_and_unplaced_only(tmp_path):
    write_poses([], tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text().strip() == HEADER
    write_poses([PoseRow("x", "y")], tmp_path / "a.json")
    assert json.loads((tmp_path / "a.json").read_text())["features"][0]["geometry"] is None


def test_other_suffixes_are_refused(tmp_path):
    with pytest.raises(UsageError, match=r"\.csv or \.geojson"):
        write_poses([], tmp_path / "poses.xlsx")


@pytest.mark.parametrize("time_s", [None, math.nan, math.inf, 1e30])
def test_no_time(time_s):
    assert utc_text(time_s) is None


def test_times_round_and_reach_back():
    assert utc_text(0.9996) == "1970-01-01T00:00:01.000Z"
    assert utc_text(-1.0) == "1969-12-31T23:59:59.000Z"
