"""``photomap export`` as people type it: every format, options in all places, and what cannot be meant."""

import json
import shutil
import sqlite3
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pyogrio
import pytest
import rasterio

from photomap_gis.cli import main
from photomap_gis.pipeline import Format


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export")
    size = ["--frames", "6", "--width", "480", "--frame-height", "360", "--altitude", "80"]
    assert main(["simulate", "procedural", "-o", str(folder / "flight"), "-q", *size]) == 0
    assert main(["map", str(folder / "flight" / "photos"), "-o", str(folder / "mission"), "-q"]) == 0
    return folder / "mission"


@pytest.fixture(scope="module")
def relative(mission, tmp_path_factory):
    """The same without a place on Earth."""
    from PIL import Image

    photos = tmp_path_factory.mktemp("relative") / "photos"
    photos.mkdir()
    for photo in sorted((mission.parent / "flight" / "photos").glob("*.JPG")):
        with Image.open(photo) as picture:
            picture.save(photos / photo.name, quality=92)
    assert main(["map", str(photos), "-o", str(photos.parent / "mission"), "-q"]) == 0
    return photos.parent / "mission"


def middle_of(tif: Path) -> tuple[float, float, float, float]:
    with rasterio.open(tif) as d:
        w, s, e, n = d.bounds
    return (3 * w + e) / 4, (3 * s + n) / 4, (w + 3 * e) / 4, (s + 3 * n) / 4


def test_everything_at_once(mission, tmp_path, capsys):
    formats = [f"--{f.value}" for f in Format]
    assert (
        main(["export", str(mission), *formats, "-o", str(tmp_path), "--attribution", "Us & co", "--json", "-q"]) == 0
    )
    document = json.loads(capsys.readouterr().out)
    assert {f["format"] for f in document["files"]} == {str(f) for f in Format}
    for f in document["files"]:
        assert Path(f["path"]).exists()
        assert f["bytes"] > 0
    with rasterio.open(tmp_path / "map.tif") as d:
        assert d.tags()["ATTRIBUTION"] == "Us & co"
        provenance = json.loads(d.tags()["PROVENANCE"])
    assert provenance["inputs"]["files"] == provenance["inputs"]["hashed"] == 6
    assert provenance["settings"]["export"]["attribution"] == "Us & co"
    item = json.loads((tmp_path / "map.json").read_text())
    assert {a["href"] for a in item["assets"].values()} >= {"map.tif", "map.gpkg", "tiles/tiles.json", "vectors.gpkg"}
    layers = {n: pyogrio.read_info(tmp_path / "vectors.gpkg", layer=n)["features"]
              for n, _ in pyogrio.list_layers(tmp_path / "vectors.gpkg")}  # fmt: skip
    assert layers["cameras"] == layers["footprints"] == 6
    assert layers["track"] == layers["outline"] == 1
    assert layers["registrations"] >= 5


def test_the_digest_of_the_inputs_can_be_worked_out_by_anybody(mission, tmp_path):
    import hashlib

    assert main(["export", str(mission), "--geotiff", "-o", str(tmp_path / "m.tif"), "-q"]) == 0
    with rasterio.open(tmp_path / "m.tif") as d:
        told = json.loads(d.tags()["PROVENANCE"])["inputs"]["sha256"]
    photos = sorted((mission.parent / "flight" / "photos").glob("*.JPG"))
    tracks = [p for p in photos[0].parent.iterdir() if p.suffix != ".JPG"]
    assert tracks == []
    lines = sorted(f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.name}\n" for p in photos)
    assert told == hashlib.sha256("".join(lines).encode()).hexdigest()


@pytest.mark.parametrize("compress", ["jpeg", "WEBP", "zstd", "none"])
def test_compression(mission, tmp_path, compress):
    out = tmp_path / "m.tif"
    assert main(["export", str(mission), "--geotiff", "--compress", compress, "-o", str(out), "-q"]) == 0
    with rasterio.open(out) as d:
        found = d.tags(ns="IMAGE_STRUCTURE").get("COMPRESSION", "NONE")
    assert {"jpeg": "JPEG", "WEBP": "WEBP", "zstd": "ZSTD", "none": "NONE"}[compress] in found


def test_clipping_resolution_and_crs(mission, tmp_path):
    w, s, e, n = middle_of(mission / "map.tif")
    box = f"{w},{s},{e},{n}"
    out = tmp_path / "m.tif"
    assert main(["export", str(mission), "--geotiff", "--bbox", box, "--gsd", "0.5", "-o", str(out), "-q"]) == 0
    with rasterio.open(out) as d:
        assert d.res == (0.5, 0.5)
        assert d.bounds.left == pytest.approx(w, abs=0.5)
        assert d.bounds.top == pytest.approx(n, abs=0.5)
    square = {"type": "Polygon", "coordinates": [[[w, s], [e, s], [e, n], [w, n], [w, s]]]}
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}
    feature = {"type": "Feature", "properties": {}, "geometry": square}
    cut = {"type": "FeatureCollection", "crs": crs, "features": [feature]}
    (tmp_path / "cut.geojson").write_text(json.dumps(cut))
    line = ["export", str(mission), "--cutline", str(tmp_path / "cut.geojson"), "-o", str(tmp_path / "out"), "-q"]
    assert main([*line, "--geotiff", "--gpkg", "--tiles", "--vectors", "--crs", "EPSG:4326", "--gsd", "0.5"]) == 0
    with rasterio.open(tmp_path / "out" / "map.tif") as d:
        assert d.crs.to_epsg() == 4326
        assert d.res[0] * 111_320 * 0.6 == pytest.approx(0.5, rel=0.5)  # half a metre, not half a degree
    with sqlite3.connect(tmp_path / "out" / "map.gpkg") as db:
        assert db.execute("SELECT srs_id FROM gpkg_tile_matrix_set").fetchone() == (4326,)
    whole = tmp_path / "whole.mbtiles"
    assert main(["export", str(mission), "--mbtiles", "-o", str(whole), "--max-zoom", "19", "-q"]) == 0
    with sqlite3.connect(whole) as db:
        assert db.execute("SELECT max(zoom_level) FROM tiles").fetchone() == (19,)


def test_finds_of_the_mission_and_of_a_file(mission, tmp_path):
    with rasterio.open(mission / "map.tif") as d:
        from pyproj import Transformer

        to = Transformer.from_crs(d.crs, 4326, always_xy=True)
        lon, lat = to.transform(*d.xy(d.height // 2, d.width // 2))
    point = {"type": "Point", "coordinates": [lon, lat]}
    feature = {"type": "Feature", "properties": {"name": "person", "ce90_m": 3}, "geometry": point}
    (tmp_path / "f.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    copied = tmp_path / "mission"
    shutil.copytree(mission, copied)
    shutil.copy(tmp_path / "f.geojson", copied / "finds.geojson")
    for folder, more in ((mission, ["--finds", str(tmp_path / "f.geojson")]), (copied, [])):
        out = tmp_path / "package.zip"
        assert main(["export", str(folder), "--atak", *more, "-o", str(out), "-q"]) == 0
        with zipfile.ZipFile(out) as z:
            events = [ElementTree.fromstring(z.read(n)) for n in z.namelist() if n.endswith(".cot")]
        assert {e.find("detail/contact").get("callsign") for e in events} >= {"person"}


WRONG = [
    (["--geotiff", "--bbox", "1,2,3"], "west,south,east,north"),
    (["--geotiff", "--bbox", "1,2,3,4"], "off the map"),
    (["--geotiff", "--bbox", "1,2,3,4", "--cutline", "x.geojson"], "not by both"),
    (["--geotiff", "--bbox-crs", "EPSG:4326"], "give --bbox too"),
    (["--tiles", "--crs", "EPSG:25832"], "leave --crs away"),
    (["--geotiff", "--gsd", "-1"], "--gsd must be a positive"),
    (["--tiles", "--gsd", "inf"], "--gsd must be a positive"),
    (["--tiles", "--max-zoom", "26"], "no more detail"),
    (["--vectors", "--bbox", "1,2,3,4", "-o", "{tmp}/v.kml"], "nothing of the flight lies within"),
    (["--geotiff", "--crs", "EPSG:0"], "no coordinate reference system"),
    (["--mbtiles", "--tile-format", "mixed"], "tiles of one kind"),
    (["--tiles", "--min-zoom", "19", "--max-zoom", "12"], "widest zoom"),
    (["--layers", "--bbox", "1,2,3,4"], "whole map"),
    (["--geotiff", "--compress", "rar"], "rar"),
    (["--geotiff", "--quality", "0"], "1<=x<=100"),
    (["--vectors", "-o", "{tmp}/v.dxf"], ".gpkg"),
]


@pytest.mark.parametrize(("arguments", "word"), WRONG)
def test_what_cannot_be_meant(mission, tmp_path, capsys, arguments, word):
    filled = [a.format(tmp=tmp_path) for a in arguments]
    where = [] if "-o" in filled else ["-o", str(tmp_path / "out")]
    suffix = {"--geotiff": ".tif", "--mbtiles": ".mbtiles"}.get(filled[0], "")
    where = [f"{w}{suffix}" if w.endswith("out") else w for w in where]
    assert main(["export", str(mission), *filled, *where, "-q"]) == 2
    assert word in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_cutline_that_is_not_there(mission, tmp_path, capsys):
    line = ["export", str(mission), "--geotiff", "--cutline", str(tmp_path / "x.kml"), "-o", str(tmp_path / "m.tif")]
    assert main(line) == 3
    assert "no such file" in capsys.readouterr().err


def test_a_relative_map_refuses_what_needs_a_place_and_says_the_way_out(relative, tmp_path, capsys):
    for f in ("kml", "tiles", "mbtiles", "pmtiles", "tms", "atak", "geopdf", "stac"):
        assert main(["export", str(relative), f"--{f}", "-q"]) == 3
        assert "--track" in capsys.readouterr().err
    fine = ["--geotiff", "--worldfile", "--gpkg", "--vectors", "--poses"]
    assert main(["export", str(relative), *fine, "-o", str(tmp_path), "-q"]) == 0
    assert main(["export", str(relative), "--vectors", "-o", str(tmp_path / "v.geojson"), "-q"]) == 3
