"""What formats say besides pixels: metadata, manifests, catalogues, vectors; and files that GDAL's layouts need."""

import itertools
import json
import sqlite3
import zipfile
from datetime import UTC, datetime
from xml.etree import ElementTree

import numpy as np
import pyogrio
import pystac
import pytest
import rasterio
import shapely
from PIL import Image
from pmtiles.reader import MemorySource, Reader
from pmtiles.tile import deserialize_directory, tileid_to_zxy
from rio_cogeo.cogeo import cog_validate

from photomap_gis.core.errors import DataError, NotGeoreferencedError, OutputError, UsageError
from photomap_gis.export import (
    MapWords,
    VectorLayer,
    tiff_file,
    write_atak,
    write_geopackage,
    write_geopdf,
    write_geotiff,
    write_kmz,
    write_mbtiles,
    write_picture,
    write_pmtiles,
    write_stac_item,
    write_tiles,
    write_vectors,
)
from photomap_gis.export.finds import Find, read_finds
from photomap_gis.export.pmtiles import Entry, _directories, tile_id
from photomap_gis.export.pyramid import TileKey

NOW = datetime(2026, 11, 25, 12, 0, tzinfo=UTC)
WORDS = MapWords(
    "Flood <3>", "A & B", "© Fire Dept", "2026-11-25T09:00:00Z", "2026-11-25T10:00:00Z", 2.5, "photomap 1",
    {"version": "1", "inputs": {"files": 2, "sha256": "abc"}},
)  # fmt: skip


@pytest.fixture
def written(scene, tmp_path):
    source = scene.source()
    write_geotiff(source, tmp_path / "map.tif", metadata={"PROVENANCE": WORDS.provenance_json})
    write_kmz(source, tmp_path / "map.kmz", words=WORDS)
    write_tiles(source, tmp_path / "tiles", words=WORDS)
    write_tiles(source, tmp_path / "tms", tms=True, words=WORDS)
    write_mbtiles(source, tmp_path / "map.mbtiles", words=WORDS)
    write_pmtiles(source, tmp_path / "map.pmtiles", words=WORDS)
    write_geopackage(source, tmp_path / "map.gpkg", words=WORDS)
    write_picture(source, tmp_path / "map.png", words=WORDS)
    write_picture(source, tmp_path / "map.jpg", words=WORDS)
    write_geopdf(source, tmp_path / "map.pdf", words=WORDS)
    write_atak(source, tmp_path / "map.zip", now=NOW, words=WORDS)
    return tmp_path


def words_of(folder):
    """The metadata of each format, read without the product."""
    found = {}
    with zipfile.ZipFile(folder / "map.kmz") as z:
        found["kmz"] = " ".join(ElementTree.fromstring(z.read("doc.kml")).itertext())
    found["tiles"] = json.dumps(json.loads((folder / "tiles" / "tiles.json").read_text()), ensure_ascii=False)
    found["tms"] = (folder / "tms" / "tiles.json").read_text()
    with sqlite3.connect(folder / "map.mbtiles") as db:
        found["mbtiles"] = str(dict(db.execute("SELECT name, value FROM metadata")))
    found["pmtiles"] = str(Reader(MemorySource((folder / "map.pmtiles").read_bytes())).metadata())
    with sqlite3.connect(folder / "map.gpkg") as db:
        rows = db.execute("SELECT metadata FROM gpkg_metadata").fetchall()
        found["gpkg"] = str(rows) + str(db.execute("SELECT identifier, description FROM gpkg_contents").fetchall())
    with Image.open(folder / "map.png") as png:
        found["png"] = str(png.text)
    with Image.open(folder / "map.jpg") as jpg:
        found["jpg"] = jpg.info["comment"].decode()
    with zipfile.ZipFile(folder / "map.zip") as z:
        manifest = ElementTree.fromstring(z.read("MANIFEST/manifest.xml"))
        found["atak"] = str([p.attrib for p in manifest.iter("Parameter")]) + z.read("provenance.json").decode()
    return found


def test_every_format_carries_the_words(written):
    found = words_of(written)
    assert set(found) == {"kmz", "tiles", "tms", "mbtiles", "pmtiles", "gpkg", "png", "jpg", "atak"}
    for name, text in found.items():
        assert "Fire Dept" in text, name
        assert "2026-11-25T10:00:00Z" in text, name
        assert "sha256" in text, name
        assert "abc" in text, name
    assert "Fire Dept".encode("utf-16-be").hex().upper().encode() in (written / "map.pdf").read_bytes()


def test_tile_map_resource(written):
    root = ElementTree.parse(written / "tms" / "tilemapresource.xml").getroot()
    assert root.findtext("SRS") == "EPSG:3857"
    box = {k: float(v) for k, v in root.find("BoundingBox").attrib.items()}
    assert 1_490_000 < box["minx"] < box["maxx"] < 1_492_000
    orders = [(int(t.get("order")), float(t.get("units-per-pixel"))) for t in root.iter("TileSet")]
    assert all(a[1] == pytest.approx(2 * b[1]) for a, b in itertools.pairwise(orders))
    assert root.find("TileSets").get("profile") == "global-mercator"


def test_geopackage_follows_the_standard(written):
    with sqlite3.connect(written / "map.gpkg") as db:
        assert db.execute("PRAGMA application_id").fetchone() == (0x47504B47,)
        assert db.execute("PRAGMA foreign_key_check").fetchall() == []
        assert {r[0] for r in db.execute("SELECT srs_id FROM gpkg_spatial_ref_sys")} >= {-1, 0, 4326, 32633}
        matrices = db.execute(
            "SELECT zoom_level, matrix_width, tile_width, pixel_x_size FROM gpkg_tile_matrix ORDER BY zoom_level"
        ).fetchall()
        x0, x1 = db.execute("SELECT min_x, max_x FROM gpkg_tile_matrix_set").fetchone()
        assert len(matrices) > 1
        for _, n, side, pixel in matrices:
            assert n * side * pixel == pytest.approx(x1 - x0)
        zooms = {r[0] for r in db.execute("SELECT DISTINCT zoom_level FROM map")}
        assert zooms == {m[0] for m in matrices}
        assert db.execute("SELECT count(*) FROM gpkg_extensions WHERE extension_name = 'gpkg_metadata'").fetchone() == (
            2,
        )
        kinds = {bytes(r[0][:3]) for r in db.execute("SELECT tile_data FROM map")}
    assert kinds <= {b"\x89PN", b"\xff\xd8\xff"}


def test_local_maps_as_geopackage_and_picture(scene, tmp_path):
    source = scene.source(None, 0.0, 0.0, 1.0)
    write_geopackage(source, tmp_path / "m.gpkg")
    with sqlite3.connect(tmp_path / "m.gpkg") as db:
        assert db.execute("SELECT srs_id FROM gpkg_tile_matrix_set").fetchone() == (-1,)
    assert [f.suffix for f in write_picture(source, tmp_path / "m.png")] == [".png", ".pgw"]
    for write in (write_pmtiles, write_geopdf):
        with pytest.raises(NotGeoreferencedError, match="--track"):
            write(source, tmp_path / "x.pdf")
    with pytest.raises(NotGeoreferencedError, match="--track"):
        write_atak(source, tmp_path / "x.zip", now=NOW)


def test_atak_manifest_and_events(scene, tmp_path):
    source = scene.source()
    finds = (Find("person", 13.3945, 52.5188, 3.2, None, "red <jacket>"), Find("car", 13.3944, 52.5187))
    assert write_atak(source, tmp_path / "p.zip", now=NOW, finds=finds, words=WORDS) == 4
    with zipfile.ZipFile(tmp_path / "p.zip") as archive:
        manifest = ElementTree.fromstring(archive.read("MANIFEST/manifest.xml"))
        assert (manifest.tag, manifest.get("version")) == ("MissionPackageManifest", "2")
        entries = [c.get("zipEntry") for c in manifest.iter("Content")]
        assert set(entries) <= set(archive.namelist())
        events = [ElementTree.fromstring(archive.read(e)) for e in entries if e.endswith(".cot")]
        uids = [e.get("uid") for e in events]
    assert len(set(uids)) == 3
    by_type = {e.get("type"): e for e in events}
    assert set(by_type) == {"u-d-f", "b-m-p-s-m"}
    names = {e.find("detail/contact").get("callsign"): e for e in events}
    assert names["person"].find("point").get("ce") == "3.20"
    assert names["car"].find("point").get("ce") == "2.50"  # the map's
    assert "red <jacket>" in names["person"].findtext("detail/remarks")
    assert float(names["person"].find("point").get("lat")) == pytest.approx(52.5188)
    for e in events:
        assert e.get("version") == "2.0"
        assert e.get("start") == "2026-11-25T12:00:00.000Z" < e.get("stale")
    corners = [tuple(map(float, k.get("point").split(","))) for k in by_type["u-d-f"].iter("link")]
    assert len(corners) >= 4
    assert all(52.5 < lat < 52.6 and 13.3 < lon < 13.5 for lat, lon in corners)
    unknown = tmp_path / "u.zip"
    write_atak(source, unknown, now=NOW, finds=finds[1:])
    with zipfile.ZipFile(unknown) as archive:
        cots = [ElementTree.fromstring(archive.read(n)) for n in archive.namelist() if n.endswith(".cot")]
    assert {c.find("point").get("ce") for c in cots} == {"9999999.0"}


def test_stac_item(scene, tmp_path):
    source = scene.source()
    write_geotiff(source, tmp_path / "map.tif")
    write_stac_item(source, tmp_path / "map.json", [tmp_path / "map.tif"], now=NOW, words=WORDS)
    item = pystac.Item.from_file(str(tmp_path / "map.json"))
    assert item.datetime == datetime(2026, 11, 25, 10, tzinfo=UTC)
    assert item.properties["proj:code"] == "EPSG:32633"  # as pystac writes what was proj:epsg
    assert item.properties["gsd"] == pytest.approx(0.25, rel=2e-3)
    assert item.assets["map"].href.endswith("map.tif")
    assert item.properties["photomap:predicted_ce90_m"] == 2.5
    outline = shapely.geometry.shape(item.geometry)
    assert outline.is_valid
    np.testing.assert_allclose(item.bbox, outline.bounds)
    import hashlib

    digest = hashlib.sha256((tmp_path / "map.tif").read_bytes()).hexdigest()
    assert item.assets["map"].extra_fields["file:checksum"] == "1220" + digest
    with rasterio.open(tmp_path / "map.tif") as d:
        np.testing.assert_allclose(item.properties["proj:transform"], tuple(d.transform)[:9])
        assert item.properties["proj:shape"] == list(d.shape)
    with pytest.raises(UsageError, match="--geotiff"):
        write_stac_item(source, tmp_path / "n.json", [], now=NOW)


def layers():
    line = shapely.LineString([(391_010, 5_819_990), (391_050, 5_819_950)])
    points = tuple(shapely.Point(391_010 + i, 5_819_990) for i in range(3))
    rows = tuple({"name": f"p{i} <&>", "sigma": 0.5 if i else None, "n": i, "ok": bool(i)} for i in range(3))
    return [
        VectorLayer("track", (line,), ({"name": "flight"},)),
        VectorLayer("cameras", points, rows),
        VectorLayer("finds", (), ()),
        VectorLayer("footprints", (shapely.box(391_000, 5_819_900, 391_020, 5_819_920),), ({"name": "a\x01b"},)),
    ]


@pytest.mark.parametrize("crs", [None, "EPSG:3857"])
def test_vectors_in_a_geopackage(tmp_path, crs):
    path = tmp_path / "v.gpkg"
    assert write_vectors(layers(), path, crs_wkt="EPSG:32633", crs=crs, words=WORDS) == 5
    assert [n for n, _ in pyogrio.list_layers(path)] == ["track", "cameras", "footprints"]
    meta, _, wkb, fields = pyogrio.raw.read(path, layer="cameras")
    assert meta["crs"] == (crs or "EPSG:32633")
    assert list(meta["fields"]) == ["name", "sigma", "n", "ok"]
    assert list(fields[0]) == ["p0 <&>", "p1 <&>", "p2 <&>"]
    assert np.isnan(fields[1][0])
    assert fields[1][1] == 0.5
    assert list(fields[2]) == [0, 1, 2]
    assert list(fields[3]) == [False, True, True]
    if crs is None:
        np.testing.assert_allclose(shapely.get_coordinates(shapely.from_wkb(wkb))[1], (391_011, 5_819_990))


@pytest.mark.parametrize("suffix", [".geojson", ".kml"])
def test_vectors_in_degrees(tmp_path, suffix):
    path = tmp_path / f"v{suffix}"
    write_vectors(layers(), path, crs_wkt="EPSG:32633", words=WORDS)
    names = [n for n, _ in pyogrio.list_layers(path)]
    found = [g for n in names for g in shapely.from_wkb(pyogrio.raw.read(path, layer=n)[2])]
    assert len(found) == 5
    xy = shapely.get_coordinates(np.array(found))
    assert (np.abs(xy - (13.395, 52.518)) < 0.01).all()
    if suffix == ".geojson":
        document = json.loads(path.read_text())
        assert {f["properties"]["layer"] for f in document["features"]} == {"track", "cameras", "footprints"}
        assert document["attribution"] == "© Fire Dept"


def test_vectors_that_cannot_be_written(tmp_path):
    with pytest.raises(NotGeoreferencedError):
        write_vectors(layers(), tmp_path / "v.kml", crs_wkt=None)
    with pytest.raises(UsageError, match="must end in"):
        write_vectors(layers(), tmp_path / "v.dxf", crs_wkt="EPSG:32633")
    with pytest.raises(OutputError, match="nothing to show"):
        write_vectors([], tmp_path / "v.gpkg", crs_wkt="EPSG:32633")
    write_vectors(layers(), tmp_path / "local.gpkg", crs_wkt=None)
    assert len(pyogrio.list_layers(tmp_path / "local.gpkg")) == 3


def test_finds_are_read_from_any_vector_file(tmp_path):
    def feature(kind, coordinates, **properties):
        geometry = {"type": kind, "coordinates": coordinates}
        return {"type": "Feature", "properties": properties, "geometry": geometry}

    features = [
        feature("Point", [13.4, 52.5, 90], Name="a", CE90_m=4),
        feature("Point", [13.5, 52.6], Name=None, CE90_m=None),
        feature("LineString", [[1, 2], [3, 4]]),
    ]
    document = {"type": "FeatureCollection", "features": features}
    (tmp_path / "f.geojson").write_text(json.dumps(document))
    found = read_finds(tmp_path / "f.geojson")
    assert [(f.name, f.ce90_m) for f in found] == [("a", 4.0), ("find 2", None)]
    assert (found[0].lon_deg, found[0].lat_deg) == (13.4, 52.5)
    (tmp_path / "none.geojson").write_text('{"type":"FeatureCollection","features":[]}')
    with pytest.raises(DataError, match="no point"):
        read_finds(tmp_path / "none.geojson")
    with pytest.raises(DataError, match="no such file"):
        read_finds(tmp_path / "missing.kml")


def test_geopdf_of_a_large_map_is_shrunk_and_says_so(scene, tmp_path, monkeypatch):
    from photomap_gis.export import geopdf

    monkeypatch.setattr(geopdf, "MAX_SIDE_PX", 200)
    source = scene.source()
    grid = write_geopdf(source, tmp_path / "m.pdf", words=WORDS)
    assert (grid.width, grid.pixel_size) == (140, 0.75)
    data = (tmp_path / "m.pdf").read_bytes()
    assert data.startswith(b"%PDF-")
    assert b"/Measure" in data or b"/ObjStm" in data


def test_hilbert_numbers_are_those_of_the_specification(rng):
    for zoom in (0, 1, 2, 5, 13, 22):
        for x, y in rng.integers(0, 1 << zoom, (50, 2)):
            assert tileid_to_zxy(tile_id(TileKey(zoom, int(x), int(y)))) == (zoom, x, y)
    with pytest.raises(ValueError, match="within zoom"):
        tile_id(TileKey(1, 2, 0))


def test_directories_larger_than_a_root(rng):
    """Sixty thousand tiles do not fit into the first 16 kB: leaves hold them, and the root points to each."""
    lengths = rng.integers(100, 90_000, 60_000)
    ids = np.cumsum(rng.integers(1, 50, 60_000))
    offsets = np.cumsum(lengths) - lengths
    entries = [Entry(int(i), int(o), int(n), 1) for i, o, n in zip(ids, offsets, lengths, strict=True)]
    root, leaves = _directories(entries)
    assert len(root) < 16_384 - 127
    read = []
    for pointer in deserialize_directory(root):
        assert pointer.run_length == 0
        read += deserialize_directory(leaves[pointer.offset : pointer.offset + pointer.length])
    assert [(e.tile_id, e.offset, e.length, e.run_length) for e in read] == [
        (e.tile_id, e.offset, e.length, e.run) for e in entries
    ]


@pytest.mark.parametrize("compression", ["DEFLATE", "JPEG", "ZSTD"])
@pytest.mark.parametrize("big", [False, True])
def test_cogs_with_overviews_in_classic_and_big_tiff(scene, tmp_path, monkeypatch, compression, big):
    if big:
        monkeypatch.setattr(tiff_file, "_CLASSIC_LIMIT", 0)
    grid = scene.source().grid
    rgba = np.tile(scene.source().rgba, (4, 4, 1))
    from photomap_gis.core.grid import MapGrid

    source = scene.of_array(rgba, MapGrid(grid.crs_wkt, grid.west, grid.north, 0.25, 1680, 1520))
    write_geotiff(source, tmp_path / "m.tif", compression=compression)
    assert (tmp_path / "m.tif").read_bytes()[2] == (43 if big else 42)
    assert cog_validate(str(tmp_path / "m.tif"), strict=True, quiet=True)[0]
    with rasterio.open(tmp_path / "m.tif") as d:
        assert d.overviews(1) == [2, 4]
        assert d.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert d.tags(ns="IMAGE_STRUCTURE")["COMPRESSION"] in (compression, "YCbCr JPEG")
        if compression != "JPEG":
            seen = rgba[..., 3] > 0
            np.testing.assert_array_equal(d.read().transpose(1, 2, 0)[seen], rgba[seen])
    with rasterio.open(tmp_path / "m.tif", overview_level=0) as d:
        means = rgba.reshape(760, 2, 840, 2, 4).astype(float).mean(axis=(1, 3))
        opaque = means[..., 3] == 255
        got = d.read([1, 2, 3]).transpose(1, 2, 0)[opaque].astype(float)
        assert np.abs(got - means[..., :3][opaque]).mean() < (0.6 if compression != "JPEG" else 2.5)


@pytest.mark.parametrize(("side_px", "long_mm"), [(500, 176), (1500, 297), (5000, 423), (10_000, 594)])
def test_a_page_is_one_to_print(side_px, long_mm):
    from photomap_gis.export.geopdf import _dpi

    assert side_px / _dpi(side_px) * 25.4 == pytest.approx(long_mm, rel=0.01)


def test_a_folder_of_layers_is_told_file_by_file(scene, tmp_path):
    layers = tmp_path / "layers"
    layers.mkdir()
    for name in ("age.tif", "views.tif"):
        (layers / name).write_bytes(b"x")
    write_tiles(scene.source(), tmp_path / "tiles")
    write_stac_item(scene.source(), tmp_path / "item.json", [tmp_path / "tiles", layers], now=NOW)
    item = pystac.Item.from_dict(json.loads((tmp_path / "item.json").read_text()))
    hrefs = {a.href for a in item.assets.values()}
    assert hrefs == {"tiles/tiles.json", "layers/age.tif", "layers/views.tif"}
    assert all((tmp_path / href).is_file() for href in hrefs)


def test_an_item_across_the_antimeridian(scene, tmp_path):
    source = scene.source("EPSG:32660", 832_660.0, 553_470.0)
    write_geotiff(source, tmp_path / "map.tif")
    write_stac_item(source, tmp_path / "item.json", [tmp_path / "map.tif"], now=NOW)
    west, _, east, _ = json.loads((tmp_path / "item.json").read_text())["bbox"]
    assert west > 179.9 and east < -179.9
