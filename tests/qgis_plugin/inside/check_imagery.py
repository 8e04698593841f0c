"""Replace imagery, in the tree and in the layer, and back; swipe; what has changed."""

import json
import shutil

import pytest
from osgeo import gdal
from qgis.core import QgsCoordinateReferenceSystem, QgsProject, QgsRasterLayer
from qgis.PyQt.QtCore import QPoint, Qt
from qgis.PyQt.QtTest import QTest
from window import role_layers

from qgis_plugin.imagery import ImageryTools
from qgis_plugin.layers import add_mission, whole
from qgis_plugin.mission import read_mission
from qgis_plugin.replace_dialog import ReplaceDialog
from qgis_plugin.replacement import place_above, swap_source
from qgis_plugin.settings import remember_mission


@pytest.fixture
def own(mission, tmp_path):
    return shutil.copytree(mission, tmp_path / "flight-7")


@pytest.fixture
def project(window):
    return QgsProject.instance()


@pytest.fixture
def stale(project, own, tmp_path):
    """Grey imagery of the same ground in another CRS, between two others in a group "Base"."""
    path = tmp_path / "old.tif"
    gdal.Warp(str(path), str(own / "map.tif"), dstSRS="EPSG:3857", width=200, height=200)
    gdal.Translate(str(tmp_path / "grey.tif"), str(path), bandList=[1])
    base = project.layerTreeRoot().insertGroup(0, "Base")
    made = []
    for name in ("above", "orthophoto 2019", "below"):
        layer = QgsRasterLayer(str(tmp_path / "grey.tif"), name)
        project.addMapLayer(layer, False)
        base.addLayer(layer)
        made.append(layer)
    made[1].setOpacity(0.6)
    return made[1]


@pytest.fixture
def tools(context):
    made = ImageryTools(context)
    yield made
    made.release()


def names(group):
    return [(n.name().split(",")[0], n.itemVisibilityChecked()) for n in group.children()]


def test_above_the_stale_layer_in_its_group_and_back(project, own, stale):
    base = project.layerTreeRoot().findGroup("Base")
    found = read_mission(own)
    done = place_above(stale, found, found.maps[0], project)
    title = f"flight-7: {found.maps[0].statement}".split(",")[0]
    assert names(base) == [("above", True), (title, True), ("orthophoto 2019", False), ("below", True)]
    assert project.mapLayer(done.layer_id).source() == str(own / "map.tif")
    assert "CE90" in project.mapLayer(done.layer_id).name()
    done.undo()
    assert names(base) == [("above", True), ("orthophoto 2019", True), ("below", True)]
    assert project.mapLayer(done.layer_id) is None


def test_a_map_that_is_in_the_project_is_moved_there_and_back(project, own, stale):
    found = read_mission(own)
    group = whole(add_mission(found, project, index=1))
    before, count = names(group), len(project.mapLayers())
    layer = role_layers()["map"]
    done = place_above(stale, found, found.maps[0], project)
    assert done.layer_id == layer.id()
    assert len(project.mapLayers()) == count
    assert project.layerTreeRoot().findLayer(layer.id()).parent().name() == "Base"
    done.undo()
    assert names(group) == before
    assert project.mapLayer(layer.id()) is layer


def test_a_drawing_order_of_its_own_is_followed(project, own, stale):
    root = project.layerTreeRoot()
    order = [layer for layer in project.mapLayers().values()]
    root.setCustomLayerOrder(order)
    root.setHasCustomLayerOrder(True)
    found = read_mission(own)
    done = place_above(stale, found, found.maps[0], project)
    drawn = [layer.id() for layer in root.customLayerOrder()]
    assert drawn.index(done.layer_id) == drawn.index(stale.id()) - 1


def test_the_source_swapped_and_put_back_with_name_style_and_crs(project, own, stale):
    stale.setCrs(QgsCoordinateReferenceSystem("EPSG:25832"))  # as somebody may have overridden it
    source, kind, found = stale.source(), stale.renderer().type(), read_mission(own)
    done = swap_source(stale, found, found.maps[0], project)
    assert done.layer_id == stale.id()
    assert stale.source() == str(own / "map.tif")
    assert stale.renderer().type() == "multibandcolor"
    assert stale.crs().authid() == "EPSG:32632"
    assert stale.opacity() == pytest.approx(0.6)
    assert stale.name() == f"orthophoto 2019 [flight-7: {found.maps[0].statement}]"
    swap_source(stale, found, found.maps[0], project)
    assert stale.name().count("CE90") == 1, "the last map's statement makes room for the new one's"
    done.undo()
    assert (stale.source(), stale.name(), stale.renderer().type()) == (source, "orthophoto 2019", kind)
    assert stale.crs().authid() == "EPSG:25832"
    assert stale.opacity() == pytest.approx(0.6)


def test_the_dialog_offers_what_can_be_replaced_and_by_what(window, project, own, stale):
    remember_mission(str(own))
    whole(add_mission(read_mission(own), project))
    dialog = ReplaceDialog(window.main, stale, project)
    offered = {dialog.stale.layer(k).name() for k in range(dialog.stale.count())}
    assert offered == {"above", "orthophoto 2019", "below"}, "not the maps of photomap themselves"
    dialog.mission.choose(str(own))
    layer, found, piece, swap = dialog.choice()
    assert (layer, found.folder, piece.path.name, swap) == (stale, own, "map.tif", False)
    (own / "map.tif").unlink()
    dialog.mission.changed.emit(str(own))
    assert "no finished map" in dialog.words.text()
    assert not dialog.buttons.button(dialog.buttons.StandardButton.Ok).isEnabled()


def test_replacements_are_undone_one_by_one(tools, said, project, own, stale):
    heard, found = [], read_mission(own)
    tools.undo_available.connect(heard.append)
    tools.replace_by(stale, found, found.maps[0], True)
    tools.replace_by(stale, found, found.maps[0], False)
    tools.undo()
    tools.undo()
    assert heard == [True, True, True, False]
    assert stale.name() == "orthophoto 2019"
    tools.replace_by(stale, found, found.maps[0], True)
    project.removeMapLayer(stale.id())
    tools.undo()
    assert said[-1] == ("fail", "The replaced layer has been removed from the project: nothing can be put back.")


def test_a_swipe_shows_what_lies_below_right_of_the_cursor(tools, window, project, own, stale, wait_until):
    found = read_mission(own)
    done = place_above(stale, found, found.maps[0], project)
    for node in project.layerTreeRoot().findLayers():
        node.setItemVisibilityChecked(node.name() != "above")
    layer = project.mapLayer(done.layer_id)
    window.bridge.setCanvasLayers()
    window.canvas.setExtent(layer.extent())
    window.active = layer
    window.canvas.refresh()
    window.canvas.waitWhileRendering()
    before = window.canvas.mapTool()
    tools.swipe(True)
    tool = window.canvas.mapTool()
    wait_until(lambda: tool.curtain.image is not None, "the picture of the map below")
    items = len(window.canvas.scene().items())
    QTest.mouseMove(window.canvas.viewport(), QPoint(300, 200))
    wait_until(lambda: tool.curtain.x_px == 300, "the divider at the cursor")
    shown = window.canvas.grab().toImage()
    middle = window.canvas.height() // 2
    colours = {side: {shown.pixelColor(x, y).name() for x in xs for y in range(middle - 60, middle + 60, 5)}
               for side, xs in (("left", range(240, 296, 4)), ("right", range(306, 360, 4)))}  # fmt: skip
    assert all(c[1:3] == c[3:5] == c[5:7] for c in colours["right"]), "the old imagery is grey"
    assert any(not c[1:3] == c[3:5] == c[5:7] for c in colours["left"]), "the new one has colours"
    QTest.keyClick(window.canvas, Qt.Key.Key_Right)
    assert tool.curtain.x_px == 320
    QTest.keyClick(window.canvas, Qt.Key.Key_Escape)
    assert window.canvas.mapTool() is not tool
    assert window.canvas.mapTool() is before or before is None
    assert len(window.canvas.scene().items()) == items - 1


def test_swiping_nothing_says_what_to_do(tools, said, window):
    ended = []
    tools.swiping.connect(ended.append)
    tools.swipe(True)
    assert ended == [False]
    assert said[-1][0] == "warn"


def test_what_has_changed_is_asked_of_the_engine_and_shown(tools, context, said, window, project, own, stale, tmp_path):
    whole(add_mission(read_mission(own), project))
    window.active = role_layers()["map"]
    window.bridge.setCanvasLayers()
    tools.compare()
    dialog = tools._compare
    dialog.old.setLayer(stale)
    dialog.start()
    assert said == []
    job = context.engine.last
    assert job.kind == "compare"
    assert job.arguments["old"].endswith("grey.tif")
    assert job.arguments["new"] == str(own / "map.tif")
    areas = tmp_path / "change.geojson"
    ring = [[8.0, 53.0], [8.1, 53.0], [8.1, 53.1], [8.0, 53.0]]
    area = {"type": "Feature", "properties": {"score": 0.9}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    areas.write_text(json.dumps({"type": "FeatureCollection", "features": [area]}))
    shutil.copy(tmp_path / "grey.tif", tmp_path / "change.tif")
    outputs = [str(tmp_path / "change.tif"), str(areas)]
    job.finished.emit({"outputs": outputs, "areas": 1, "changed_m2": 12.0, "warnings": []})
    group = project.layerTreeRoot().children()[0]
    assert group.name().startswith("Changes: orthophoto 2019")
    assert [n.name() for n in group.children()] == ["Changed areas", "Probability of change"]
    assert not dialog.isVisible()
