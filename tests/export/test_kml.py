"""The superoverlay's documents and pictures."""

import io
import zipfile
from pathlib import PurePosixPath
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from photomap_gis.core.errors import NotGeoreferencedError, OutputError, UsageError
from photomap_gis.core.grid import MapGrid
from photomap_gis.export import MapWords, write_kmz


def box_of(element):
    return {n: float(element.find(f"{{*}}{n}").text) for n in ("north", "south", "east", "west")}


@pytest.fixture
def archive(scene, tmp_path):
    source = scene.source()
    big = np.tile(source.rgba, (2, 3, 1))
    grid = MapGrid(source.grid.crs_wkt, 391_000.0, 5_820_000.0, 0.25, big.shape[1], big.shape[0])
    path = tmp_path / "map.kmz"
    write_kmz(scene.of_array(big, grid), path, words=MapWords("A <b> & c", '"d" < e', last_utc="2026-11-22"))
    with zipfile.ZipFile(path) as opened:
        yield opened


def test_doc_kml_comes_first_and_is_the_only_one_at_the_top(archive):
    names = archive.namelist()
    assert names[0] == "doc.kml"
    assert [n for n in names if n.endswith(".kml") and "/" not in n] == ["doc.kml"]
    assert all(not n.startswith("/") and ".." not in n for n in names)
    document = ElementTree.fromstring(archive.read("doc.kml")).find("{*}Document")
    assert document.find("{*}name").text == "A <b> & c"
    assert "2026-11-22" in document.find("{*}description").text
    assert document.find("{*}LookAt") is not None
    # a Region here would hide everything from afar, and GDAL would take the document for a tile
    assert document.find("{*}Region") is None


def test_the_tree_holds_together(archive):
    names = set(archive.namelist())
    visited, levels = set(), {}

    def visit(name, level, outer):
        visited.add(name)
        document = ElementTree.fromstring(archive.read(name)).find("{*}Document")
        folder = PurePosixPath(name).parent
        region = document.find("{*}Region")
        box = box_of(region.find("{*}LatLonAltBox"))
        if outer is not None:
            assert box == outer
        overlay = document.find("{*}GroundOverlay")
        assert box_of(overlay.find("{*}LatLonBox")) == box
        assert overlay.find("{*}LatLonBox/{*}rotation") is None
        picture = str(folder / overlay.find("{*}Icon/{*}href").text)
        assert picture in names
        with Image.open(archive.open(picture)) as image:
            assert image.size == (256, 256)
            assert (image.format == "JPEG") == picture.endswith(".jpg")
            if image.format == "PNG":
                assert np.asarray(image.convert("RGBA"))[..., 3].min() < 255
        lod = region.find("{*}Lod")
        assert int(lod.find("{*}minLodPixels").text) == (128 if level else 0)
        assert int(lod.find("{*}maxLodPixels").text) == -1
        assert int(overlay.find("{*}drawOrder").text) == level + 1
        links = document.findall("{*}NetworkLink")
        levels.setdefault(level, []).append(len(links))
        for link in links:
            assert link.find("{*}Link/{*}viewRefreshMode").text == "onRegion"
            parts = PurePosixPath(link.find("{*}Link/{*}href").text).parts
            target = folder
            for part in parts:
                target = target.parent if part == ".." else target / part
            child = box_of(link.find("{*}Region/{*}LatLonAltBox"))
            assert box["west"] - 1e-9 <= child["west"] < child["east"] <= box["east"] + 1e-9
            assert box["south"] - 1e-9 <= child["south"] < child["north"] <= box["north"] + 1e-9
            visit(str(target), level + 1, child)

    doc = ElementTree.fromstring(archive.read("doc.kml")).find("{*}Document")
    link = doc.find("{*}NetworkLink")
    visit(link.find("{*}Link/{*}href").text, 0, box_of(link.find("{*}Region/{*}LatLonAltBox")))
    assert visited == {n for n in names if n.endswith(".kml")} - {"doc.kml"}
    deepest = max(levels)
    assert deepest == 3
    assert set(levels[deepest]) == {0}
    assert all(n > 0 for level in range(deepest) for n in levels[level])


def test_pixels_are_square_on_the_ground(archive):
    doc = ElementTree.fromstring(archive.read("doc.kml")).find("{*}Document")
    box = box_of(doc.find("{*}NetworkLink/{*}Region/{*}LatLonAltBox"))
    shape = (box["east"] - box["west"]) * np.cos(np.radians(box["north"])) / (box["north"] - box["south"])
    assert 0.99 < shape < 1.01


def test_same_map_same_bytes(scene, tmp_path):
    for name in ("a.kmz", "b.kmz"):
        write_kmz(scene.source(), tmp_path / name)
    assert (tmp_path / "a.kmz").read_bytes() == (tmp_path / "b.kmz").read_bytes()


def test_plain_kml_names_its_folder(scene, tmp_path):
    write_kmz(scene.source(), tmp_path / "Flug 1 & ä.kml")
    folder = tmp_path / "Flug_1_files"
    assert folder.is_dir()
    doc = ElementTree.fromstring((tmp_path / "Flug 1 & ä.kml").read_bytes())
    for href in doc.iter("{http://www.opengis.net/kml/2.2}href"):
        assert (tmp_path / href.text).is_file()
    assert not (folder / "doc.kml").exists()


def test_refusals(scene, tmp_path):
    with pytest.raises(NotGeoreferencedError, match="--track"):
        write_kmz(scene.source(None), tmp_path / "map.kmz")
    with pytest.raises(UsageError, match=r"\.kmz or \.kml"):
        write_kmz(scene.source(), tmp_path / "map.zip")
    empty = scene.of_array(np.zeros((380, 420, 4), np.uint8), scene.source().grid)
    for name in ("map.kmz", "map.kml"):
        with pytest.raises(OutputError, match="shows nothing"):
            write_kmz(empty, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_tiny_map(scene, tmp_path):
    grid = MapGrid(scene.source().grid.crs_wkt, 391_000.0, 5_820_000.0, 0.25, 1, 1)
    assert write_kmz(scene.of_array(np.full((1, 1, 4), 255, np.uint8), grid), tmp_path / "map.kmz") == 1
    with zipfile.ZipFile(tmp_path / "map.kmz") as opened:
        assert Image.open(io.BytesIO(opened.read("tiles/overview.png"))).size[0] <= 2
