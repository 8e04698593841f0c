"""What lies across 180 degrees of longitude is cut there, and never spans the world."""

import json

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS, Transformer
from shapely.geometry import LineString, Point, Polygon, box

from photomap_gis.export import VectorLayer, write_tiles, write_vectors
from photomap_gis.export.antimeridian import bounds, cut, near

UTM_1S = CRS.from_epsg(32701).to_wkt()


@given(
    lon=st.floats(-180, 180), lat=st.floats(-80, 80), width=st.floats(1e-4, 20.0), height=st.floats(1e-4, 5.0),
    closed=st.booleans(),
)  # fmt: skip
def test_what_is_cut_keeps_its_size_and_place(lon, lat, width, height, closed):
    corner = np.array([lon, lat])
    corners = corner + np.array([(0, 0), (width, 0), (width, height), (0, height), (0, 0)])
    wrapped = near(corners, 0.0)  # as PROJ gives it: each longitude within ±180
    whole = Polygon(corners) if closed else LineString(corners[:3])
    parts = cut(Polygon(wrapped) if closed else LineString(wrapped[:3]))
    west, _, east, _ = parts.bounds
    assert west >= -180.0 and east <= 180.0
    for part in shapely.get_parts(parts):
        assert part.bounds[2] - part.bounds[0] <= width + 1e-9
    size = (lambda g: g.area) if closed else (lambda g: g.length)
    assert size(parts) == pytest.approx(size(whole), rel=1e-6, abs=1e-9)
    w, _, e, _ = bounds(parts)
    assert (e - w) % 360.0 == pytest.approx(width, abs=1e-6)


def test_points_and_what_is_empty():
    assert cut(Point(190.0, 5.0)) == Point(-170.0, 5.0)
    assert cut(Polygon()).is_empty
    assert cut(box(10, 10, 11, 11)).equals(box(10, 10, 11, 11))
    assert bounds(box(10, 10, 11, 11)) == (10, 10, 11, 11)


def test_vectors_of_a_flight_across_it(tmp_path):
    to_utm = Transformer.from_crs(4326, 32701, always_xy=True)
    (west, south), (east, north) = to_utm.transform(179.999, -17.001), to_utm.transform(-179.999, -16.999)
    ring = box(west, south, east, north)
    layers = [
        VectorLayer("footprints", (ring,), ({"frame": 1},)),
        VectorLayer("track", (LineString([(west, south), (east, north)]),), ({"name": "t"},)),
    ]
    write_vectors(layers, tmp_path / "v.geojson", crs_wkt=UTM_1S)
    footprint, track = json.loads((tmp_path / "v.geojson").read_text())["features"]
    assert (footprint["geometry"]["type"], track["geometry"]["type"]) == ("MultiPolygon", "MultiLineString")
    for feature in (footprint, track):
        for part in shapely.get_parts(shapely.geometry.shape(feature["geometry"])):
            assert part.bounds[2] - part.bounds[0] < 0.0015
    write_vectors(layers, tmp_path / "v.kml", crs_wkt=UTM_1S)
    assert "<MultiGeometry>" in (tmp_path / "v.kml").read_text()


def test_tiles_open_where_the_map_is(scene, tmp_path):
    west, north = Transformer.from_crs(4326, 32701, always_xy=True).transform(179.9997, -17.0)
    write_tiles(scene.source("EPSG:32701", west, north), tmp_path / "t")
    document = json.loads((tmp_path / "t" / "tiles.json").read_text())
    assert document["bounds"][0] == -180.0 and document["bounds"][2] == 180.0
    assert abs(document["center"][0]) > 179.99
    page = (tmp_path / "t" / "index.html").read_text()
    west, _, east, _ = json.loads(page.split("const doc = ")[1].split(";\n")[0])["bounds"]
    assert 0 < east - west < 0.01  # the viewer's first look is of the map and not of the world
