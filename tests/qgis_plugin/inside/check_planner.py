"""The planner's dock in real QGIS: real clicks on the canvas, plans by the real photomap."""

from __future__ import annotations

import json

import pytest
from planner_fixtures import FIELD
from qgis.core import QgsFeature, QgsGeometry, QgsProject, QgsVectorLayer
from qgis.PyQt.QtCore import Qt

from qgis_plugin.overlay import sweep
from qgis_plugin.planner.dock import FILE_KINDS, PlannerDock

pytest_plugins = ("planner_fixtures",)


@pytest.fixture
def dock(context, wait_until):
    dock = PlannerDock(context)
    dock.form.fineness.setCurrentIndex(dock.form.fineness.findData("height"))
    dock.form.height_m.setValue(60)
    yield dock
    dock.release()
    dock.deleteLater()


def _draw(dock, hand, corners=FIELD):
    dock.draw_button.click()
    for corner in corners:
        hand.click(*corner)
    hand.key(Qt.Key.Key_Return)


def _planned(dock, wait_until, after=None):
    """Wait for a plan (another one than ``after``) and return its document."""
    return wait_until(lambda: dock._facts is not None and dock._facts is not after and dock._facts, "the plan")


def _count(dock, key):
    return dock.overlay.layers[key].featureCount()


def test_a_polygon_drawn_with_the_mouse_becomes_a_plan_on_the_map(dock, hand, wait_until, said):
    _draw(dock, hand)
    facts = _planned(dock, wait_until)
    assert facts["covered_share"] == 1.0
    assert facts["area_m2"] == pytest.approx(65_000, rel=0.01)  # the shoelace of FIELD, to a pixel
    assert {"waypoints", "path", "lanes", "footprints", "covered", "area", "places"} <= set(dock.overlay.layers)
    assert _count(dock, "footprints") == facts["photos"]
    assert [f["sortie"] for f in dock.overlay.layers["path"].getFeatures()] == [1]
    waypoints = [(f["sortie"], f["seq"], f["role"]) for f in dock.overlay.layers["waypoints"].getFeatures()]
    assert waypoints[:2] == [(1, 1, "takeoff"), (1, 2, "survey")]
    assert {f["photo"] for f in dock.overlay.layers["footprints"].getFeatures()} == set(range(1, facts["photos"] + 1))
    assert "100 %" in dock.words.text()
    assert dock.save_button.isEnabled()
    assert not said.failures
    group = QgsProject.instance().layerTreeRoot().children()[0]
    assert group.name() == "photomap flight plan"
    assert not QgsProject.instance().isDirty()


def test_keys_take_corners_back_and_begin_anew(dock, hand, wait_until, said):
    dock.draw_button.click()
    hand.click(*FIELD[0])
    hand.click(*FIELD[1])
    hand.key(Qt.Key.Key_Return)
    assert "three corners" in said.warnings[-1]
    hand.click(2668150, 1211300)  # wrong
    hand.key(Qt.Key.Key_Backspace)
    hand.click(*FIELD[2])
    hand.click(*FIELD[3], button=Qt.MouseButton.RightButton)  # closes without a corner there
    assert len(dock.tool.corners) == 3
    dock.clear_button.click()
    hand.click(*FIELD[0])
    hand.key(Qt.Key.Key_Escape)
    assert not dock.tool.corners
    assert hand.canvas.mapTool() is dock.tool
    hand.key(Qt.Key.Key_Escape)
    assert hand.canvas.mapTool() is not dock.tool
    assert not dock.draw_button.isChecked()


def test_a_dragged_corner_and_every_field_make_a_new_plan(dock, hand, wait_until):
    _draw(dock, hand)
    first = _planned(dock, wait_until)
    hand.drag(FIELD[2], (2668320, 1211280))
    second = _planned(dock, wait_until, first)
    assert second["area_m2"] > first["area_m2"] + 5_000
    middle = ((FIELD[0][0] + FIELD[1][0]) / 2, FIELD[0][1])
    hand.drag(middle, (middle[0], 1210950))  # the cross between two corners
    third = _planned(dock, wait_until, second)
    assert len(dock.tool.corners) == 5
    assert third["area_m2"] > second["area_m2"] + 5_000
    dock.form.height_m.setValue(90)
    fourth = _planned(dock, wait_until, third)
    assert fourth["photos"] < third["photos"]
    dock.form.endurance.setValue(4)
    fifth = _planned(dock, wait_until, fourth)
    assert len(fifth["sorties"]) > 1
    assert dock.vehicle.sortie.count() == len(fifth["sorties"])
    assert _count(dock, "path") == len(fifth["sorties"])


def test_many_edits_are_one_plan_and_stale_answers_are_dropped(dock, hand, wait_until, engine):
    _draw(dock, hand)
    first = _planned(dock, wait_until)
    before = len(engine.started)
    for height in (61, 62, 63, 64):
        dock.form.height_m.setValue(height)
    wait_until(lambda: len(engine.started) > before, "a job")
    dock.form.height_m.setValue(80)  # while that one runs
    wait_until(lambda: len(engine.started) > before + 1, "another job")
    last = wait_until(lambda: dock._facts is not None and dock._facts["height_m"] == 80.0 and dock._facts, "the last")
    assert last is not first
    assert len(engine.started) == before + 2
    assert [a["height"] for k, a in engine.started[before:]] == [64, 80]


def _layer(crs, wkts, kind="Polygon"):
    layer = QgsVectorLayer(f"{kind}?crs={crs}", "fields", "memory")
    features = []
    for wkt in wkts:
        feature = QgsFeature()
        feature.setGeometry(QgsGeometry.fromWkt(wkt))
        features.append(feature)
    layer.dataProvider().addFeatures(features)
    QgsProject.instance().addMapLayer(layer)
    return layer


def _wkt(ring):
    return f"POLYGON(({', '.join(f'{x} {y}' for x, y in [*ring, ring[0]])}))"


def test_the_selected_feature_of_another_crs_is_flown_over(dock, context, wait_until, said):
    far = [(x + 2_000, y) for x, y in FIELD]
    layer = _layer("EPSG:2056", [_wkt(FIELD), _wkt(far)])
    context.iface.setActiveLayer(layer)
    dock.take_button.click()
    assert "select the feature" in said.failures[-1]
    layer.selectByIds([list(layer.getFeatures())[1].id()])
    dock.take_button.click()
    facts = _planned(dock, wait_until)
    assert facts["area_m2"] == pytest.approx(65_000, rel=1e-3)
    west = min(w[1] for w in facts["waypoints"])
    assert west > 8.355  # two kilometres east of the other


def test_zones_are_kept_clear_of_and_flown_round(dock, hand, wait_until):
    _draw(dock, hand)
    first = _planned(dock, wait_until)
    zone = ((2668100, 1211080), (2668180, 1211080), (2668180, 1211140), (2668100, 1211140))
    layer = _layer("EPSG:2056", [_wkt(zone)])
    dock.form.avoid.setLayer(layer)
    second = _planned(dock, wait_until, first)
    assert second["area_m2"] == pytest.approx(first["area_m2"] - 80 * 60, rel=0.01)
    assert _count(dock, "avoid") == 1


@pytest.mark.parametrize(
    ("ring", "words"),
    [
        (((0, 0), (300, 200), (300, 0), (0, 200)), "not valid"),  # a bow-tie
        (((0, 0), (300, 0), (0.0, 0)), "not valid"),
    ],
)
def test_what_is_not_valid_is_said(dock, context, wait_until, said, ring, words):
    layer = _layer("EPSG:2056", [_wkt([(2668000 + x, 1211000 + y) for x, y in ring])])
    context.iface.setActiveLayer(layer)
    dock.take_button.click()
    assert words in said.warnings[-1]
    wait_until(lambda: dock._facts is not None or said.failures, "an answer")
    if dock._facts is not None:
        assert any("repaired" in w for w in dock._facts["warnings"])
    else:
        assert not dock.save_button.isEnabled()


def test_layers_that_cannot_be_an_area_are_told(dock, context, said):
    context.iface.setActiveLayer(_layer("EPSG:2056", ["LINESTRING(0 0, 1 1)"], "LineString"))
    dock.take_button.click()
    assert "no polygons" in said.failures[-1]
    empty = _layer("EPSG:2056", ["POLYGON EMPTY"])
    context.iface.setActiveLayer(empty)
    dock.take_button.click()
    assert "Nothing is left" in said.failures[-1]
    layer = _layer("", [_wkt(FIELD)])
    context.iface.setActiveLayer(layer)
    dock.take_button.click()
    assert "no CRS" in said.failures[-1]


def test_a_search_needs_a_datum_and_is_drawn_about_it(dock, hand, wait_until):
    dock.form.pattern.setCurrentIndex(dock.form.pattern.findData("expanding-square"))
    assert "datum" in dock.words.text()
    dock.datum_button.click()
    hand.click(2668150, 1211100)
    dock.form.radius.setValue(120)
    facts = wait_until(lambda: dock._facts, "the search")
    assert facts["pattern"] == "expanding-square"
    assert "probability" in dock.words.text()
    kinds = {f["kind"] for f in dock.overlay.layers["places"].getFeatures()}
    assert kinds == {"home", "datum"}


def test_a_corridor_is_drawn_as_a_line(dock, hand, wait_until):
    dock.form.pattern.setCurrentIndex(dock.form.pattern.findData("corridor"))
    _draw(dock, hand, FIELD[:3])
    facts = _planned(dock, wait_until)
    assert facts["pattern"] == "corridor"
    dock.form.pattern.setCurrentIndex(dock.form.pattern.findData("survey"))
    assert "Draw the area" in dock.words.text()
    assert _count(dock, "path") == 0


def test_home_is_where_one_clicks(dock, hand, wait_until):
    _draw(dock, hand)
    first = _planned(dock, wait_until)
    dock.home_button.click()
    hand.click(2667950, 1210950)
    second = _planned(dock, wait_until, first)
    assert not any("--home" in w for w in second["warnings"])
    assert second["home"] == pytest.approx((47.0461, 8.3328), abs=3e-4)
    assert hand.canvas.mapTool() is not dock.home_tool


def test_every_format_is_saved(dock, hand, wait_until, said, tmp_path):
    _draw(dock, hand)
    _planned(dock, wait_until)
    for _, ending in FILE_KINDS:
        path = tmp_path / f"field{ending}"
        dock.save(str(path))
        wait_until(lambda: (said.infos and f"field{ending}" in said.infos[-1]) or said.failures, "the file")  # noqa: B023
        assert not said.failures
        assert path.stat().st_size > 100
    assert json.loads((tmp_path / "field.plan").read_text())["fileType"] == "Plan"


def test_saving_where_nothing_can_be_written_is_told(dock, hand, wait_until, said, tmp_path):
    _draw(dock, hand)
    _planned(dock, wait_until)
    (tmp_path / "taken.plan").mkdir()
    dock.save(str(tmp_path / "taken.plan"))
    wait_until(lambda: said.failures, "the failure")
    assert "taken.plan" in said.failures[-1]
    assert dock.save_button.isEnabled()


def test_a_plan_is_uploaded_verified_and_shown_again(dock, hand, wait_until, said, vehicle, tmp_path):
    url, truth = vehicle
    dock.vehicle._kept_folder = tmp_path
    dock.vehicle.connection.setEditText(url)
    _draw(dock, hand)
    facts = _planned(dock, wait_until)
    dock.vehicle.upload_button.click()
    wait_until(lambda: said.infos or said.failures, "the end of the upload")
    assert not said.failures
    assert "Verified" in said.infos[-1]
    held = truth()["0"]
    assert len(held) > len(facts["sorties"][0]["waypoints"])
    assert list(tmp_path.glob("vehicle-before-*.json"))
    dock.vehicle.stored_button.click()
    wait_until(lambda: "items" in dock.vehicle.overlay.layers, "the stored mission")
    assert dock.vehicle.overlay.layers["items"].featureCount() >= 2 * facts["lanes"]
    assert dock.vehicle.overlay.layers["route"].featureCount() == 1
    dock.vehicle.restore_button.click()
    wait_until(lambda: len(said.infos) > 1 or said.failures, "what was there")
    assert not said.failures
    assert len(truth()["0"]) < len(held)


def test_status_is_told_in_words(dock, wait_until, vehicle):
    dock.vehicle.connection.setEditText(vehicle[0])
    dock.vehicle.status_button.click()
    wait_until(lambda: "Vehicle 1" in dock.vehicle.words.text(), "its status")
    assert "disarmed" in dock.vehicle.words.text()
    assert dock.vehicle.overlay.layers["vehicle"].featureCount() == 1


def test_take_off_is_where_the_vehicle_stands(dock, hand, wait_until, vehicle):
    _draw(dock, hand)
    first = _planned(dock, wait_until)
    dock.vehicle.connection.setEditText(vehicle[0])
    dock.vehicle.here_button.click()
    second = _planned(dock, wait_until, first)
    assert second["home"] == pytest.approx((47.0471, 8.3352), abs=1e-6)


def test_no_vehicle_gives_words(dock, hand, wait_until, said, monkeypatch):
    monkeypatch.setattr("qgis_plugin.planner.vehicle.ANSWER_WITHIN_S", 1)
    dock.vehicle.connection.setEditText("tcp:127.0.0.1:9")
    dock.vehicle.status_button.click()
    wait_until(lambda: said.failures, "the failure")
    assert "--connect" in said.failures[-1] or "127.0.0.1:9" in said.failures[-1]
    assert dock.vehicle.upload_button.isEnabled()
    dock.vehicle.upload_button.click()
    assert "Draw the area" in said.failures[-1]


def test_nothing_is_left_behind(context, hand, wait_until):
    items = set(hand.canvas.scene().items())
    dock = PlannerDock(context)
    _draw(dock, hand)
    _planned(dock, wait_until)
    folder = dock.preview.folder
    assert folder.is_dir()
    dock.release()
    dock.deleteLater()
    assert not QgsProject.instance().mapLayers()
    assert not QgsProject.instance().layerTreeRoot().children()
    assert set(hand.canvas.scene().items()) == items
    assert hand.canvas.mapTool() is None or hand.canvas.mapTool() is not dock.tool
    assert not folder.exists()


def test_a_saved_project_is_swept_when_it_is_opened(dock, hand, wait_until, tmp_path):
    """As ``plugin.py`` has it: ``sweep`` is called whenever a project was read."""
    _draw(dock, hand)
    _planned(dock, wait_until)
    path = str(tmp_path / "project.qgz")
    assert QgsProject.instance().write(path)
    dock.overlay.remove()
    assert QgsProject.instance().read(path)
    assert QgsProject.instance().mapLayers()
    sweep()
    assert not QgsProject.instance().mapLayers()
    assert not QgsProject.instance().layerTreeRoot().findGroups()
