"""Outlines of what a map shows."""

import json

import numpy as np
import pytest
import shapely
from pyproj import Geod
from shapely.geometry import Point, shape

from photomap_gis.core.errors import NotGeoreferencedError
from photomap_gis.core.grid import MapGrid
from photomap_gis.export import footprint
from photomap_gis.export.footprint import feature_collection, outline_of, to_wgs84, write_geojson


def test_outline_with_a_hole(scene):
    source = scene.source()
    source.rgba[100:140, 200:260] = 0
    outline = footprint(source)
    assert outline.is_valid
    assert len(outline.geoms) == 1
    seen = (source.rgba[..., 3] > 0).sum() * source.grid.pixel_size**2
    assert abs(outline.area - seen) < 0.01 * seen
    for xy, inside in (((210, 190), True), ((230, 120), False), ((5, 375), False), ((400, 20), True)):
        assert outline.contains(Point(*source.grid.to_crs([xy])[0])) == inside


def test_coarse_outlines_stay_true(scene):
    source = scene.source()
    fine, coarse = footprint(source), footprint(source, max_px=60)
    assert coarse.symmetric_difference(fine).area < 0.06 * fine.area
    assert max(w.width * w.height for w in source.windows) <= 2100 * 2100


def test_nothing_seen(scene):
    empty = scene.of_array(np.zeros((40, 30, 4), np.uint8), MapGrid(None, 0, 0, 1.0, 30, 40))
    assert footprint(empty).is_empty
    assert to_wgs84(footprint(empty), scene.source().grid.crs_wkt).is_empty


def test_touching_corners_are_valid():
    seen = np.zeros((60, 60), bool)
    seen[:30, :30] = seen[30:, 30:] = True
    outline = outline_of(seen, (1.0, 0, 0, 0, -1.0, 0))
    assert outline.is_valid
    assert outline.area == pytest.approx(1800, rel=0.02)


def test_noise_is_valid(rng):
    assert outline_of(rng.random((80, 90)) < 0.5, (1.0, 0, 0, 0, -1.0, 0)).is_valid


def test_degrees_hold_the_same_ground(placed, tmp_path):
    outline = footprint(placed)
    degrees = to_wgs84(outline, placed.grid.crs_wkt)
    area = abs(Geod(ellps="WGS84").geometry_area_perimeter(degrees)[0])
    assert area == pytest.approx(outline.area, rel=2e-2)
    document = feature_collection(degrees, {"date": "2026-11-22", "ce90_m": None})
    write_geojson(document, tmp_path / "f.geojson")
    read = json.loads((tmp_path / "f.geojson").read_text())
    polygon = shape(read["features"][0]["geometry"])
    assert polygon.is_valid
    assert all(p.exterior.is_ccw for p in polygon.geoms)
    assert all(abs(x) <= 180 and abs(y) <= 90 for x, y in shapely.get_coordinates(polygon))
    assert read["features"][0]["properties"] == {"date": "2026-11-22", "ce90_m": None}


def test_local_outlines_have_no_degrees(scene):
    with pytest.raises(NotGeoreferencedError):
        to_wgs84(footprint(scene.source(None)), None)
