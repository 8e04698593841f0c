"""A mission as layers: which, where in the tree, how they look, and that they follow when the files change."""

import json
import shutil

import pytest
from osgeo import gdal, osr
from qgis.core import QgsMapRendererParallelJob, QgsMapSettings, QgsProject, QgsRasterLayer
from qgis.PyQt.QtCore import QSize
from window import role_layers

from qgis_plugin.layers import add_mission, map_layers, mission_group, whole
from qgis_plugin.mission import MissionError, read_mission
from qgis_plugin.settings import forget_mission, recent_missions, remember_mission


@pytest.fixture
def own(mission, tmp_path):
    """A copy of the simulated mission that a check may change."""
    return shutil.copytree(mission, tmp_path / "flight-7")


def tree(group):
    """Names of a group's nodes with their ticks, in order."""
    return [
        (n.name(), tree(n)) if hasattr(n, "addLayer") else (n.name().split(":")[0], n.itemVisibilityChecked())
        for n in group.children()
    ]


def picture(layer, size=80):
    settings = QgsMapSettings()
    settings.setLayers([layer])
    settings.setDestinationCrs(layer.crs())
    settings.setExtent(layer.extent())
    settings.setOutputSize(QSize(size, size))
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    image = job.renderedImage()
    return {image.pixelColor(x, y).name() for x in range(5, size, 7) for y in range(5, size, 7)}


def test_a_mission_is_a_tidy_group_with_date_and_accuracy_in_its_name(window, own):
    place = {"type": "Point", "coordinates": [8.648, 53.167]}
    find = {"type": "Feature", "properties": {"name": "tent"}, "geometry": place}
    (own / "finds.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [find]}))
    found = read_mission(own)
    group = whole(add_mission(found, QgsProject.instance()))
    assert group.name() == found.title
    assert found.title.startswith("flight-7: 2026-06-15 10:0")
    assert f"CE90 {found.maps[0].ce90_m:.2g} m" in found.title
    assert tree(group) == [
        ("Finds", True),
        ("Track", True),
        ("Cameras", False),
        ("Footprints of the frames", False),
        ("What is known of each pixel", [
            ("Accuracy", False), ("Age", False), ("Searched", False), ("Views", False),
        ]),
        ("Map", True),
    ]  # fmt: skip


def test_every_layer_draws_something_in_more_than_one_colour(window, own):
    whole(add_mission(read_mission(own), QgsProject.instance()))
    layers = role_layers()
    assert set(layers) == {"map", "track", "cameras", "footprints", "sigma", "last_seen", "searched", "views"}
    for role, layer in layers.items():
        assert layer.isValid(), role
        assert len(picture(layer)) >= (1 if role in ("cameras", "track") else 2), role
    assert layers["last_seen"].renderer().shader().rasterShaderFunction().colorRampItemList()[0].label.endswith("UTC")


def test_opened_again_it_is_not_there_twice(window, own):
    first = whole(add_mission(read_mission(own), QgsProject.instance()))
    count = len(QgsProject.instance().mapLayers())
    assert whole(add_mission(read_mission(own), QgsProject.instance())) is first
    assert len(QgsProject.instance().mapLayers()) == count


def test_after_a_solution_the_same_layer_shows_the_new_pixels_place_and_name(window, own):
    whole(add_mission(read_mission(own), QgsProject.instance()))
    (layer,) = map_layers(own, QgsProject.instance())
    layer.setOpacity(0.5)
    before, west = picture(layer), layer.extent().xMinimum()
    old = gdal.Open(str(own / "map.tif"))
    place = old.GetGeoTransform()
    new = gdal.GetDriverByName("GTiff").Create(str(own / "new.tif"), 64, 64, 4)
    new.SetGeoTransform((place[0] + 1000.0, *place[1:]))
    new.SetSpatialRef(old.GetSpatialRef())
    new.SetMetadata({"TIFFTAG_DATETIME": "2026:07:01 08:00:00", "CHECK_CE90_M": "1.234"})
    for band, value in ((1, 255), (2, 0), (3, 0), (4, 255)):
        new.GetRasterBand(band).Fill(value)
    new = old = None
    (own / "new.tif").replace(own / "map.tif")
    whole(add_mission(read_mission(own), QgsProject.instance()))
    assert map_layers(own, QgsProject.instance()) == [layer]
    assert layer.extent().xMinimum() == pytest.approx(west + 1000.0)
    assert picture(layer) != before
    assert layer.opacity() == 0.5
    assert layer.name() == "Map: 2026-07-01 08:00 UTC, CE90 1.2 m (tested)"
    assert mission_group(own, QgsProject.instance()).name() == "flight-7: 2026-07-01 08:00 UTC, CE90 1.2 m (tested)"


def test_layers_that_show_the_map_otherwise_follow_too_and_lost_pieces_go(window, own):
    project = QgsProject.instance()
    for n in (1, 2):
        shutil.copy(own / "map.tif", own / f"map-{n}.tif")
    whole(add_mission(read_mission(own), project))
    swapped = QgsRasterLayer(str(own / "map.tif"), "orthophoto 2019 [flight-7: 2020-01-01 10:00 UTC, CE90 9 m]")
    theirs = QgsRasterLayer(str(own / "map.tif"), "a name of the user's own")
    project.addMapLayers([swapped, theirs])
    for n in (1, 2):
        (own / f"map-{n}.tif").unlink()
    found = read_mission(own)
    whole(add_mission(found, project))
    assert swapped.name() == f"orthophoto 2019 [flight-7: {found.maps[0].statement}]"
    assert theirs.name() == "a name of the user's own"
    (layer,) = map_layers(own, project)
    assert layer.source() == str(own / "map.tif")


def test_a_map_without_a_place_says_so(window, own):
    local = osr.SpatialReference()
    local.SetLocalCS("pixels of the first frame")
    picture = gdal.Open(str(own / "map.tif"), gdal.GA_Update)
    picture.SetSpatialRef(local)
    picture = None
    assert not read_mission(own).georeferenced
    assert "no place on Earth yet" in read_mission(own).title


def test_pieces_are_layers_of_their_own(window, own):
    for n in (1, 2, 10):
        shutil.copy(own / "map.tif", own / f"map-{n}.tif")
    whole(add_mission(read_mission(own), QgsProject.instance()))
    maps = [layer.name().split(":")[0] for layer in map_layers(own, QgsProject.instance())]
    assert sorted(maps) == ["Map, piece 1", "Map, piece 10", "Map, piece 2"]
    assert [m.path.name for m in read_mission(own).maps] == ["map-1.tif", "map-2.tif", "map-10.tif"]


def test_a_folder_that_cannot_be_shown_says_what_to_do(window, own, tmp_path):
    with pytest.raises(MissionError, match="choose the mission's folder again"):
        read_mission(tmp_path / "gone")
    with pytest.raises(MissionError, match="is no mission"):
        read_mission(tmp_path)
    (own / "map.tif").write_bytes(b"II*\0 no picture")
    with pytest.raises(MissionError, match="cannot be read as a raster"):
        read_mission(own)
    (own / "map.tif").unlink()
    with pytest.raises(MissionError, match="no finished map"):
        read_mission(own)
    assert not QgsProject.instance().mapLayers()


def test_recent_missions_are_newest_first_and_forget_what_is_gone(window, tmp_path):
    for name in ("a", "b", "c"):
        (tmp_path / name).mkdir()
        remember_mission(str(tmp_path / name))
    remember_mission(str(tmp_path / "a"))
    names = [path.rsplit("/", 1)[-1] for path in recent_missions()]
    assert names[:3] == ["a", "c", "b"]
    (tmp_path / "c").rmdir()
    assert str(tmp_path / "c") not in recent_missions()
    assert str(tmp_path / "a") not in forget_mission(str(tmp_path / "a"))
