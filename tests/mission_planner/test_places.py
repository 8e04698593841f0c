"""Areas from files and words: every form, any CRS, and what is none."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from pyproj import Transformer

from photomap_gis.core.errors import DataError, PhotomapError, UsageError
from photomap_gis.mission_planner.places import read_places

RING = [(8.0, 47.0), (8.01, 47.0), (8.01, 47.01), (8.0, 47.0)]
HOLE = [(8.006, 47.002), (8.008, 47.002), (8.008, 47.004), (8.006, 47.002)]
KML = (
    '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><Polygon><outerBoundaryIs>'
    "<LinearRing><coordinates>{}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>"
).format(" ".join(f"{x},{y},30" for x, y in RING))


def rings(source: str) -> list[np.ndarray]:
    (polygon,) = read_places(source).polygons
    return [np.array(ring) for ring in polygon.rings]


def write(path: Path, driver: str, crs: str) -> str:
    move = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    polygon = shapely.Polygon([move.transform(*p) for p in RING], [[move.transform(*p) for p in HOLE]])
    wkb = np.array([shapely.to_wkb(polygon)], object)
    pyogrio.raw.write(
        path, wkb, [np.array(["a"], object)], ["name"], driver=driver, geometry_type="Polygon", crs=crs
    )  # fmt: skip
    return str(path)


@pytest.mark.parametrize(
    ("name", "driver", "crs"),
    [
        ("a.geojson", "GeoJSON", "EPSG:4326"),
        ("a.gpkg", "GPKG", "EPSG:32632"),
        ("a.gpkg", "GPKG", "EPSG:3035"),  # north first
        ("a.shp", "ESRI Shapefile", "EPSG:3857"),
    ],
)
def test_files_in_any_crs_with_holes(name: str, driver: str, crs: str, tmp_path: Path):
    shell, hole = rings(write(tmp_path / name, driver, crs))
    assert shapely.Polygon(shell).equals_exact(shapely.Polygon(RING), 1e-7) or shapely.Polygon(shell).equals_exact(
        shapely.Polygon(RING[::-1]), 1e-7
    )
    assert shapely.Polygon(hole).area == pytest.approx(shapely.Polygon(HOLE).area, rel=1e-4)


def test_kml_and_kmz(tmp_path: Path):
    (tmp_path / "a.kml").write_text(KML)
    with zipfile.ZipFile(tmp_path / "a.kmz", "w") as archive:
        archive.writestr("doc.kml", KML)
    for name in ("a.kml", "a.kmz"):
        assert np.allclose(rings(str(tmp_path / name))[0], RING)


def test_words():
    assert np.allclose(rings("47,8;47,8.01;47.01,8.01")[0], RING)
    assert np.allclose(rings("POLYGON ((8 47, 8.01 47, 8.01 47.01, 8 47))")[0], RING)
    assert len(read_places("MULTIPOLYGON (((0 0, 1 0, 1 1, 0 0)), ((5 5, 6 5, 6 6, 5 5)))").polygons) == 2
    assert read_places("47,8;47.5,8").line == ((8.0, 47.0), (8.0, 47.5))
    assert read_places("LINESTRING (8 47, 9 47)").line == ((8.0, 47.0), (9.0, 47.0))


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", DataError),
        ("nowhere.kml", DataError),
        ("47,8", DataError),
        ("47,8;x,9;48,9", UsageError),
        ("47;8;9", UsageError),
        ("POLYGON ((8 47, 9", UsageError),
        ("POINT (8 47)", DataError),
        ("POLYGON ((8 147, 9 147, 9 148, 8 147))", DataError),
        ("147,8;147,9;148,9", DataError),
    ],
)
def test_words_that_mean_no_area_say_so(text: str, error: type[PhotomapError]):
    with pytest.raises(error):
        read_places(text)


def test_files_that_hold_no_area_say_so(tmp_path: Path):
    entities = "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True))
    files = {
        "empty.geojson": json.dumps({"type": "FeatureCollection", "features": []}),
        "noise.geojson": "{]",
        "text.kml": "hello",
        "bomb.kml": f'<!DOCTYPE k [<!ENTITY a "aaaaaaaaaa">{entities}]><kml xmlns="http://www.opengis.net/kml/2.2">&i;</kml>',
        "zip.kmz": "PK no zip",
        "points.geojson": json.dumps({"type": "Point", "coordinates": [8, 47]}),
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
        with pytest.raises(DataError):
            read_places(str(tmp_path / name))
    turn = np.linspace(0, 2 * np.pi, 120_000)
    many = shapely.Polygon(np.column_stack((8 + 0.1 * np.cos(turn), 47 + 0.1 * np.sin(turn))))
    (tmp_path / "many.geojson").write_text(shapely.to_geojson(many))
    with pytest.raises(DataError, match="simplify"):
        read_places(str(tmp_path / "many.geojson"))
