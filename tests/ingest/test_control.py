"""Control files as people have them, and as nobody should."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.control import ControlPoint, Sighting
from photomap_gis.core.errors import DataError
from photomap_gis.ingest.control import parse_control, read_control

LIST = """WGS84 UTM 32N
# a comment
601000.5 5701000.25 95.1 320.5 240 IMG_1.JPG corner extra
601000.5 5701000.25 95.1 100 90 IMG_2.JPG corner
601050 5701020 94 10 20.5 photos\\IMG_2.JPG
601050 5701020 94 11 21 /data/IMG_3.JPG
"""


def test_odm_list():
    corner, unnamed = parse_control(LIST, "gcp_list.txt")
    assert corner == ControlPoint(
        "corner", "EPSG:32632", 601000.5, 5701000.25, 95.1,
        sightings=(Sighting("IMG_1.JPG", (320.5, 240.0)), Sighting("IMG_2.JPG", (100.0, 90.0))),
    )  # fmt: skip
    assert unnamed.name == "point-1"
    assert [s.image for s in unnamed.sightings] == ["photos/IMG_2.JPG", "/data/IMG_3.JPG"]


@pytest.mark.parametrize(
    ("line", "crs"),
    [
        ("EPSG:2180", "EPSG:2180"),
        ("wgs84 utm 5S", "EPSG:32705"),
        ("25832", "EPSG:25832"),
        ("WGS84", "EPSG:4326"),
        ("+proj=utm +zone=10 +ellps=WGS84 +units=m", "+proj=utm +zone=10 +ellps=WGS84 +units=m"),
    ],
)
def test_the_first_line_names_the_crs(line, crs):
    (point,) = parse_control(f"{line}\n10 20 0 1 2 a.jpg", "f")
    assert point.crs == crs


def test_csv_with_places_in_degrees():
    head = "Name;Lat;Lon;z;sigma_m;image;px;py;sigma_px"
    text = f"{head}\nA;51,5;7,25;;0,02;a.jpg;10,5;20;0,4\nA;51,5;7,25;;0,02;b.jpg;1;2\nB;51.6;7.3;90;;;;\n"
    a, b = parse_control(text, "points.csv")
    assert (a.crs, a.x, a.y, a.z_m, a.sigma_m) == ("EPSG:4326", 7.25, 51.5, None, 0.02)
    assert [s.sigma_px for s in a.sightings] == [0.4, 1.0]
    assert [s.xy_px for s in a.sightings] == [(10.5, 20.0), (1.0, 2.0)]
    assert (b.name, b.z_m, b.sightings) == ("B", 90.0, ())


def test_csv_in_a_crs_by_column_or_beside_the_file():
    with_column = parse_control("name,x,y,crs,image,px,py\nA,1,2,EPSG:25832,a.jpg,3,4\n", "f.csv")
    beside = parse_control('"name","x","y","image","px","py"\n"A",1,2,"a.jpg",3,4\n', "f.csv", crs="EPSG:25832")
    assert with_column == beside
    with pytest.raises(DataError, match=r"f\.csv, line 2: x and y need a CRS"):
        parse_control("name,x,y\nA,1,2\n", "f.csv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("EPSG:2180\n", "no control point"),
        ("1 2 3 4 5 a.jpg\n", "line 1: the first line must name the CRS"),
        ("EPSG:2180\n1 2 3 4 a.jpg\n", "line 2: expected"),
        ("EPSG:2180\n\n1 2 3 4 x a.jpg\n", "line 3: py is no number"),
        ("EPSG:2180\n1 nan 3 4 5 a.jpg\n", "line 2: y is no coordinate"),
        ("EPSG:2180\n1 inf 3 4 5 a.jpg\n", "line 2: y is no coordinate"),
        ("WGS84\n52 107 0 4 5 a.jpg\n", "line 2: x must be the longitude"),
        ("WGS84\n500 107 0 4 5 a.jpg\n", "no place on Earth"),
        ("EPSG:2180\n1 2 3 4 5 a.jpg p\n9 2 3 4 5 b.jpg p\n", "line 3: point p lies elsewhere than in line 2"),
        ("EPSG:2180\n1 2 3 4 5 a.jpg p\n1 2 3 7 5 a.jpg p\n", "line 3: point p is marked twice in a.jpg"),
        ("name,lat,lon\nA,51,x\n", "line 2: lon is no number"),
        ("name,lat,lon,image\nA,51,7,a.jpg\n", "line 2: an image needs px and py"),
        ("name,lat,lon,sigma\nA,51,7,-1\n", "line 2: sigma must be above 0"),
        ("name,lat,lon,image,px,py,sigma_px\nA,51,7,a.jpg,1,2,0\n", "line 2: sigma_px must be above 0"),
        ("name,lat,lon\nA\n", "line 2: lon is no number"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(text, message):
    with pytest.raises(DataError, match=message):
        parse_control(text, "f")


@given(st.text(max_size=300))
def test_no_text_is_an_internal_fault(text):
    try:
        points = parse_control(text, "f")
    except DataError:
        return
    assert points


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(DataError, match="cannot be read"):
        read_control(tmp_path / "none.txt")
    with pytest.raises(DataError, match="cannot be read"):
        read_control(tmp_path)
    path = tmp_path / "gcp_list.txt"
    path.write_bytes(LIST.replace("\n", "\r\n").encode("utf-16"))
    text, points = read_control(path)
    assert len(points) == 2
    assert parse_control(text, "again") == points


def test_the_real_list(shared_data):
    _, points = read_control(shared_data / "boruszyn" / "gcp_list.txt")
    assert {p.crs for p in points} == {"EPSG:2180"}
    assert len(points) > 2
    assert sum(len(p.sightings) for p in points) > 2 * len(points) - 2
