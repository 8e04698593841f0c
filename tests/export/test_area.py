"""Parts of the map: boxes, outlines of any CRS, and what cannot be meant."""

import json

import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from pyproj import Transformer

from photomap_gis.core.errors import DataError, NotGeoreferencedError, UsageError
from photomap_gis.core.grid import Window
from photomap_gis.export import write_geopackage, write_geotiff, write_kmz, write_tiles
from photomap_gis.export.area import Area, clipped, cut_grid, parse_bbox
from photomap_gis.export.crs import parse_crs
from photomap_gis.export.cutline import read_cutline

from .test_positions import read_raster

CUT_PX = [(60.0, 40.0), (380.0, 30.0), (390.0, 330.0), (70.0, 340.0)]  # holds every landmark


def in_crs(source, xy_px, crs):
    to = Transformer.from_crs(source.grid.crs_wkt, crs, always_xy=True)
    return np.stack(to.transform(*source.grid.to_crs(xy_px).T), axis=-1)


def test_a_box_in_degrees_in_the_maps_crs_and_in_another(scene, tmp_path):
    source = scene.source()
    west, north = source.grid.to_crs([[59.5, 39.5]])[0]
    east, south = source.grid.to_crs([[359.5, 329.5]])[0]
    own = parse_bbox(f"{west},{south},{east},{north}", None, source.grid.crs_wkt)
    write_geotiff(source, tmp_path / "own.tif", area=own)
    with rasterio.open(tmp_path / "own.tif") as d:
        np.testing.assert_allclose(tuple(d.bounds), (west, south, east, north), atol=1e-6)
        np.testing.assert_array_equal(d.read().transpose(1, 2, 0)[..., :3], source.rgba[40:330, 60:360, :3])
    degrees = in_crs(source, [[60, 40], [360, 330]], "EPSG:4326")
    text = f"{degrees[0, 0]},{degrees[1, 1]},{degrees[1, 0]},{degrees[0, 1]}"
    area = parse_bbox(text, None, source.grid.crs_wkt)
    write_geotiff(source, tmp_path / "degrees.tif", crs="EPSG:4326", area=area)
    with rasterio.open(tmp_path / "degrees.tif") as d:
        size = d.transform.a
        np.testing.assert_allclose(tuple(d.bounds), [float(v) for v in text.split(",")], atol=1.01 * size)
        assert scene.errors_px(source, *read_raster(tmp_path / "degrees.tif")) < 0.1
    mercator = in_crs(source, [[60, 40], [360, 330]], "EPSG:3857")
    text = f"{mercator[0, 0]},{mercator[1, 1]},{mercator[1, 0]},{mercator[0, 1]}"
    other = parse_bbox(text, "EPSG:3857", source.grid.crs_wkt)
    np.testing.assert_allclose(other.geometry_in("EPSG:4326").bounds, area.geometry_in("EPSG:4326").bounds, atol=1e-9)


def test_a_box_cuts_tiles_at_its_edge(scene, tmp_path):
    source = scene.source()
    degrees = in_crs(source, [[60, 40], [380, 340]], "EPSG:4326")
    area = parse_bbox(f"{degrees[0, 0]},{degrees[1, 1]},{degrees[1, 0]},{degrees[0, 1]}", None, source.grid.crs_wkt)
    write_tiles(source, tmp_path / "t", area=area)
    west, south, east, north = json.loads((tmp_path / "t" / "tiles.json").read_text())["bounds"]
    np.testing.assert_allclose([west, north], degrees[0], atol=1e-5)
    np.testing.assert_allclose([east, south], degrees[1], atol=1e-5)
    whole = write_tiles(source, tmp_path / "whole")
    assert write_tiles(source, tmp_path / "t", area=area) <= whole
    write_kmz(source, tmp_path / "m.kmz", area=area)
    assert scene.errors_px(source, *read_raster(tmp_path / "m.kmz")) < 0.15  # JPEG's colours are half as fine


@pytest.mark.parametrize(
    ("suffix", "crs"),
    [(s, c) for s in (".gpkg", ".shp") for c in ("EPSG:4326", "EPSG:32633", "EPSG:3035")]
    + [(".geojson", "EPSG:4326"), (".kml", "EPSG:4326")],
)
def test_a_cutline_of_any_crs_falls_on_the_same_ground(scene, tmp_path, suffix, crs):
    source = scene.source()
    ring = in_crs(source, np.array(CUT_PX), crs)
    path = tmp_path / f"cut{suffix}"
    driver = {".geojson": "GeoJSON", ".gpkg": "GPKG", ".kml": "KML", ".shp": "ESRI Shapefile"}[suffix]
    wkb = np.array([shapely.to_wkb(shapely.Polygon(ring))], dtype=object)
    pyogrio.raw.write(path, wkb, [np.array(["x"], dtype=object)], ["name"], driver=driver, crs=crs,
                      geometry_type="Polygon")  # fmt: skip
    area = read_cutline(path)
    write_geotiff(source, tmp_path / "map.tif", area=area)
    rgba, wkt, to_crs = read_raster(tmp_path / "map.tif")
    assert scene.errors_px(source, rgba, wkt, to_crs) < 0.02
    # independent: which pixel centres lie in the polygon, one by one
    polygon = shapely.Polygon(np.array(CUT_PX))
    y, x = np.mgrid[: rgba.shape[0], : rgba.shape[1]]
    px = source.grid.to_px(to_crs(np.stack([x.ravel(), y.ravel()], axis=-1)))
    inside = shapely.contains_xy(polygon, px).reshape(x.shape)
    near = shapely.distance(polygon.boundary, shapely.points(px)).reshape(x.shape) < 0.1
    seen = rgba[..., 3] > 0
    rows, cols = (np.rint(px[:, i]).astype(int).reshape(x.shape) for i in (1, 0))
    expected = inside & (source.rgba[rows, cols, 3] > 0)
    np.testing.assert_array_equal(seen[~near], expected[~near])


def test_holes_and_windows_of_an_outline(scene):
    source = scene.source()
    g = source.grid
    outer, hole = shapely.box(*g.bounds), shapely.box(g.west + 40, g.north - 60, g.west + 60, g.north - 40)
    masked = clipped(source, Area(g.crs_wkt, outer.difference(hole), masks=True))
    whole = masked.read(Window(0, 0, g.width, g.height))
    assert not whole[160:240, 160:240, 3].any()
    assert whole[100:159, 160:240, 3].all()
    pieces = [masked.read(Window(c, r, 70, 95)) for r in range(0, 380, 95) for c in range(0, 420, 70)]
    again = np.vstack([np.hstack(pieces[i : i + 6]) for i in range(0, 24, 6)])
    np.testing.assert_array_equal(again, whole)
    assert not masked.read(Window(-500, -500, 100, 100)).any()


@pytest.mark.parametrize(
    "text", ["1,2,3", "a,b,c,d", "5,50,6,49", "1,2,1,3", "nan,1,2,3", "391090,5819000,391050,5819100"]
)
def test_boxes_that_cannot_be_meant(scene, text):
    with pytest.raises(UsageError, match="--bbox"):
        parse_bbox(text, None, scene.source().grid.crs_wkt)


def test_an_area_off_the_map_says_where_the_map_is(scene, tmp_path):
    source = scene.source()
    area = parse_bbox("1,50,2,51", None, source.grid.crs_wkt)
    for write, name in ((write_geotiff, "m.tif"), (write_tiles, "t"), (write_kmz, "m.kmz")):
        with pytest.raises(UsageError, match=r"longitude 13\.39"):
            write(source, tmp_path / name, area=area)
    assert list(tmp_path.iterdir()) == []


def test_local_maps(scene, tmp_path):
    source = scene.source(None, 0.0, 0.0, 1.0)
    write_geotiff(source, tmp_path / "m.tif", area=parse_bbox("10,-110,90,-30", None, None))
    with rasterio.open(tmp_path / "m.tif") as d:
        assert tuple(d.bounds) == (10, -110, 90, -30)
    with pytest.raises(NotGeoreferencedError):
        parse_bbox("10,-110,90,-30", "EPSG:4326", None)
    square = Area(parse_crs("EPSG:4326").to_wkt(), shapely.box(0, 0, 1, 1), masks=True)
    with pytest.raises(NotGeoreferencedError):
        write_geotiff(source, tmp_path / "n.tif", area=square)


def test_cut_grids_keep_the_lattice(scene):
    g = scene.source().grid
    part = cut_grid(g, (g.west + 10.1, g.north - 50.2, g.west + 30.3, g.north - 20.4))
    for a, b in ((part.west, g.west), (part.north, g.north)):
        assert (a - b) / g.pixel_size == pytest.approx(round((a - b) / g.pixel_size), abs=1e-6)


HOSTILE = {
    "none.geojson": b'{"type":"FeatureCollection","features":[]}',
    "broken.geojson": b'{"type":"FeatureColl',
    "points.geojson": b'{"type":"Feature","properties":{},"geometry":{"type":"Point","coordinates":[1,2]}}',
    "flat.geojson": b'{"type":"Feature","properties":{},"geometry":{"type":"Polygon",'
    b'"coordinates":[[[1,2],[2,2],[1,2]]]}}',
    "far.geojson": b'{"type":"Feature","properties":{},"geometry":{"type":"Polygon",'
    b'"coordinates":[[[500000,1],[500001,1],[500001,2],[500000,1]]]}}',
    "empty.gpkg": b"",
    "text.shp": b"hello",
    "refers.vrt": b'<OGRVRTDataSource><OGRVRTLayer name="x"><SrcDataSource>http://127.0.0.1:9/</SrcDataSource>',
    "bomb.kml": b'<?xml version="1.0"?><!DOCTYPE k [<!ENTITY a "aaaaaaaaaa">'
    + b"".join(b'<!ENTITY %c "%s">' % (98 + i, b"&%c;" % (97 + i) * 10) for i in range(9))
    + b"]><kml><Document><Placemark><name>&j;</name></Placemark></Document></kml>",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_files_that_hold_no_outline(tmp_path, name):
    (tmp_path / name).write_bytes(HOSTILE[name])
    with pytest.raises((DataError, UsageError)):
        area = read_cutline(tmp_path / name)
        area.cut((0.0, 0.0, 1.0, 1.0), parse_crs("EPSG:32633").to_wkt())
    with pytest.raises(DataError, match="no such file"):
        read_cutline(tmp_path / "missing.geojson")


@pytest.mark.parametrize("write", [write_geotiff, write_tiles, write_kmz, write_geopackage])
def test_a_pixel_that_makes_up_a_gigapixel_of_nothing_is_refused(scene, tmp_path, write):
    finer = {write_geotiff: {"pixel_size": 1e-3}, write_geopackage: {"pixel_size": 1e-3}}.get(write, {"gsd_m": 1e-3})
    with pytest.raises(UsageError, match="no more detail"):
        write(scene.source(), tmp_path / ("m" if write is write_tiles else "m.kmz"), **finer)
