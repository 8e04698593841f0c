"""The dock "Georeference": pairs by clicks, what the engine is asked, and what is made of its answers."""

import shutil

import pytest
from qgis.core import QgsCoordinateReferenceSystem, QgsPointXY, QgsProject, QgsRasterLayer
from qgis.PyQt.QtCore import QPoint, Qt
from qgis.PyQt.QtTest import QTest
from window import role_layers

from qgis_plugin.engine import Engine
from qgis_plugin.georeference.dock import GeoreferenceDock
from qgis_plugin.georeference.pairs import Pair, pick_arguments, solved_pairs
from qgis_plugin.layers import add_mission, whole
from qgis_plugin.messages import Messages
from qgis_plugin.mission import read_mission
from qgis_plugin.places import PlaceError, from_lonlat, metres_between, moved_m, to_lonlat, utm_of
from qgis_plugin.plugin import Context
from qgis_plugin.settings import Settings

UTM32 = "EPSG:32632"


@pytest.fixture
def own(mission, tmp_path):
    return shutil.copytree(mission, tmp_path / "flight-7")


@pytest.fixture
def dock(context, window, own):
    made = GeoreferenceDock(context)
    window.addDockWidget(Qt.DockWidgetArea.RightDockWidgetArea, made)
    made.show()
    made.choose(str(own))
    whole(add_mission(read_mission(own), QgsProject.instance()))
    layer = role_layers()["map"]
    window.canvas.setExtent(layer.extent())
    yield made
    made.release()
    made.deleteLater()


def click(canvas, point):
    """A real click at a place of a canvas."""
    at = canvas.getCoordinateTransform().transform(point)
    QTest.mouseClick(canvas.viewport(), Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier,
                     QPoint(round(at.x()), round(at.y())))  # fmt: skip


def pick_three(dock, window):
    """Two pairs for the fit and one for the check, by clicks in both canvases."""
    e = role_layers()["map"].extent()
    places = [QgsPointXY(e.xMinimum() + e.width() * u, e.yMinimum() + e.height() * v)
              for u, v in ((0.3, 0.4), (0.7, 0.6), (0.5, 0.5))]  # fmt: skip
    dock.pick_button.click()
    for at in places:
        click(dock.view.canvas, at)
        click(window.canvas, QgsPointXY(at.x() + 2.0, at.y()))
    dock.table.toggle(2)
    return places


def test_clicks_in_both_windows_make_pairs(dock, window, context):
    places = pick_three(dock, window)
    px = window.canvas.mapUnitsPerPixel(), dock.view.canvas.mapUnitsPerPixel()
    assert [p.whole for p in dock.table.pairs] == [True, True, True]
    assert [p.check for p in dock.table.pairs] == [False, False, True]
    for at, pair in zip(places, dock.table.pairs):  # noqa: B905
        assert pair.map_xy == pytest.approx((at.x(), at.y()), abs=px[1])
        earth = from_lonlat(QgsPointXY(*pair.lonlat), QgsCoordinateReferenceSystem(UTM32))
        assert (earth.x(), earth.y()) == pytest.approx((at.x() + 2.0, at.y()), abs=px[0])
    assert len(dock.marks.marks) == len(dock.view.marks.marks) == 3
    dock.solve_button.click()
    job = context.engine.last
    assert job.kind == "georeference"
    assert (len(job.arguments["pick"]), len(job.arguments["check_pick"])) == (2, 1)
    assert job.arguments["reset"] is True
    x, _, rest = job.arguments["pick"][0].partition(",")
    _, _, latlon = rest.partition("=")
    assert float(x) == pytest.approx(places[0].x(), abs=px[1])
    assert 53.0 < float(latlon.split(",")[0]) < 53.4, "latitude comes first"
    assert window.canvas.mapTool() is window.pan_tool, "the tool is put away while the engine works"


def test_the_answer_stands_in_the_table_and_the_map_is_where_it_says(dock, window, context, own, wait_until, said):
    pick_three(dock, window)
    before = dock.table.pairs
    dock.solve()
    point = {"used": True, "role": "control", "miss_m": 0.5, "predicted_sigma_m": 0.4, "pictures": 3}
    context.engine.last.finished.emit({
        "mission": str(own), "warnings": ["the map is nudged"], "predicted_ce90_m": 3.0,
        "control": {"residual_rms_m": 0.31, "points": [
            {**point, "name": "check-1", "dx_m": 1.5, "dy_m": 0.0, "role": "check", "used": False},
            {**point, "name": "pick-1", "dx_m": 0.3, "dy_m": -0.4},
            {**point, "name": "pick-2", "dx_m": 9.0, "dy_m": 0.0, "used": False},
        ]},
        "accuracy": {"ce90_m": 1.61, "n": 1},
    })  # fmt: skip
    words = [[dock.table.item(row, column).text() for column in (0, 1, 2, 3)] for row in range(3)]
    assert words == [["control", "0.50", "0.30", "-0.40"], ["put aside", "9.00", "9.00", "0.00"],
                     ["check", "1.50", "1.50", "0.00"]]  # fmt: skip
    assert "CE90 1.61 m, tested by 1 check point" in dock.accuracy.text()
    assert "0.31 m (not the accuracy)" in dock.accuracy.text()
    for old, new, (dx, dy) in zip(before, dock.table.pairs, ((0.3, -0.4), (9.0, 0.0), (1.5, 0.0))):  # noqa: B905
        earth = from_lonlat(QgsPointXY(*old.lonlat), QgsCoordinateReferenceSystem(UTM32))
        assert new.map_xy == pytest.approx((earth.x() + dx, earth.y() + dy), abs=1e-3)
        assert new.lonlat == old.lonlat
    wait_until(lambda: ("warn", "the map is nudged") in said and any("lies anew" in w for _, w in said), "the words")


def test_picks_are_mended_and_removed(dock, window):
    dock.table.place(map_xy=(1.0, 2.0))
    dock.table.place(map_xy=(3.0, 4.0))
    assert dock.table.pairs == [Pair(map_xy=(3.0, 4.0))], "a second click on the same side mends the first"
    assert not dock.solve_button.isEnabled()
    dock.table.place(lonlat=(8.6, 53.1))
    dock.table.place(lonlat=(8.7, 53.1))
    assert len(dock.table.pairs) == 2
    dock.table.selectRow(0)
    dock.remove_button.click()
    assert dock.table.pairs == [Pair(lonlat=(8.7, 53.1))]
    dock.table.setCurrentCell(0, 0)
    QTest.keyClick(dock.table, Qt.Key.Key_Space)
    assert dock.table.pairs[0].check
    QTest.keyClick(dock.table, Qt.Key.Key_Delete)
    assert dock.table.pairs == []
    assert len(dock.marks.marks) == 0


def test_a_drag_nudges_by_metres_of_the_ground_whatever_the_canvas_is_in(dock, window, context):
    window.canvas.setDestinationCrs(QgsCoordinateReferenceSystem("EPSG:3857"))
    e = role_layers()["map"].extent()
    start = to_lonlat(e.center(), QgsCoordinateReferenceSystem(UTM32))
    end = moved_m(start, 12.0, -7.0)
    mercator = QgsCoordinateReferenceSystem("EPSG:3857")
    window.canvas.setCenter(from_lonlat(start, mercator))
    window.canvas.zoomScale(150)
    dock.drag_button.click()
    items = len(window.canvas.scene().items())
    a, b = (window.canvas.getCoordinateTransform().transform(from_lonlat(p, mercator)) for p in (start, end))
    a, b = (QPoint(round(p.x()), round(p.y())) for p in (a, b))
    view = window.canvas.viewport()
    QTest.mousePress(view, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, a)
    QTest.mouseMove(view, b)
    QTest.mouseRelease(view, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, b)
    job = context.engine.last
    east, north, turn = map(float, job.arguments["nudge"].split(","))
    px = window.canvas.mapUnitsPerPixel()
    assert (east, north, turn) == pytest.approx((12.0, -7.0, 0.0), abs=2.0 * px)
    assert len(window.canvas.scene().items()) < items, "what was drawn is gone"


def test_imagery_points_and_reset_reach_the_engine(dock, context, mission):
    ortho = QgsRasterLayer(str(mission / "map.tif"), "ortho")
    QgsProject.instance().addMapLayer(ortho)
    dock.reference.setLayer(ortho)
    dock.reference_sigma_m.setValue(0.5)
    dock.reference_button.click()
    folder = str(dock._mission.folder)
    assert (context.engine.last.kind, context.engine.last.arguments) == (
        "reference", {"mission": folder, "references": [str(mission / "map.tif")], "reference_sigma": 0.5}
    )  # fmt: skip
    context.engine.last.failed.emit("no")
    dock.gcp.setFilePath("/points.csv")
    dock.check.setText("every-third")
    dock.gcp_button.click()
    assert (context.engine.last.kind, context.engine.last.arguments) == (
        "solve", {"mission": folder, "gcp": "/points.csv", "check": "every-third"}
    )  # fmt: skip
    context.engine.last.failed.emit("no")
    dock.reset_button.click()
    assert context.engine.last.arguments == {"mission": folder, "reset": True}


def test_released_it_leaves_nothing_on_the_canvas(dock, window):
    pick_three(dock, window)
    items = len(window.canvas.scene().items())
    dock.release()
    dock.release = lambda: None  # once is what is promised
    assert window.canvas.mapTool() is window.pan_tool
    assert len(window.canvas.scene().items()) == items - 3


def test_pairs_without_one_for_the_fit_are_refused():
    pair = Pair((1.0, 2.0), (8.0, 53.0), check=True)
    with pytest.raises(ValueError, match="no pair is for the fit"):
        pick_arguments([pair, Pair((1.0, 2.0))])
    assert pick_arguments([Pair((1.0, 2.0), (8.5, 53.25))])["pick"] == ["1.000000,2.000000=53.250000000,8.500000000"]


def test_a_pair_of_which_nothing_is_said_keeps_its_place(qgis_app):
    pair = Pair((1.0, 2.0), (8.0, 53.0))
    assert solved_pairs([pair], None, QgsCoordinateReferenceSystem(UTM32)) == [pair]


@pytest.mark.parametrize("lon, lat, zone", [
    (8.6, 53.1, "EPSG:32632"), (-0.1, -33.0, "EPSG:32730"), (179.9, 10.0, "EPSG:32660"), (-180.0, 0.0, "EPSG:32601"),
    (180.0, 0.0, "EPSG:32660"),
])  # fmt: skip
def test_metres_are_of_the_utm_zone(qgis_app, lon, lat, zone):
    place = QgsPointXY(lon, lat)
    assert utm_of(place).authid() == zone
    assert metres_between(place, moved_m(place, 3.0, -4.0)) == pytest.approx((3.0, -4.0), abs=1e-5)


def test_no_place_on_earth_is_said(qgis_app):
    with pytest.raises(PlaceError, match="choose one at the bottom right"):
        to_lonlat(QgsPointXY(0, 0), QgsCoordinateReferenceSystem())
    with pytest.raises(PlaceError):
        to_lonlat(QgsPointXY(8.0, 123.0), QgsCoordinateReferenceSystem("EPSG:4326"))


def test_a_map_without_a_place_gets_one_from_two_pairs_and_is_nudged(
    window, said, photomap, program, flight, tmp_path, wait_until
):
    photos = tmp_path / "bare"
    photos.mkdir()
    for photo in (flight / "photos").iterdir():
        (photos / photo.name).write_bytes(without_exif(photo.read_bytes()))
    folder = tmp_path / "relative"
    photomap("map", photos, "-o", folder, "--fov-deg", "73.74")
    engine = Engine(settings=lambda: Settings(engine_path=program))
    context = Context(window, engine, Messages(window), lambda key: None)
    dock = GeoreferenceDock(context)
    dock.choose(str(folder))
    assert not dock.view.crs().isValid()
    whole(add_mission(read_mission(folder), QgsProject.instance()))
    (layer,) = (x for x in QgsProject.instance().mapLayers().values() if x.customProperty("photomap/role") == "map")
    e, start = layer.extent(), QgsPointXY(8.6, 53.1)
    places = [(e.xMinimum() + u * e.width(), e.yMinimum() + v * e.height()) for u, v in ((0.35, 0.4), (0.65, 0.6))]
    apart = [0.25 * (b - a) for a, b in zip(*places)]  # noqa: B905  (a quarter of a metre a unit)
    for place, lonlat in zip(places, (start, moved_m(start, *apart))):  # noqa: B905
        dock.table.place(map_xy=place)
        assert not dock.solve_button.isEnabled()
        dock.table.place(lonlat=(lonlat.x(), lonlat.y()))
    assert dock.solve_button.isEnabled()
    dock.solve_button.click()
    wait_until(lambda: not dock.jobs.busy and dock._mission is not None and dock._mission.georeferenced, "a place", 90)
    assert [level for level, _ in said if level == "fail"] == []
    assert dock.view.crs().authid() == UTM32
    assert all(p.miss is not None and p.miss.used and p.miss.metres < 0.5 for p in dock.table.pairs), dock.table.pairs
    wait_until(lambda: layer.crs().authid() == UTM32, "the layer at its place")
    before = layer.extent()
    near = from_lonlat(start, layer.crs())
    assert before.contains(near)
    dock.east_m.setValue(30.0)
    dock.nudge_button.click()
    wait_until(lambda: not dock.jobs.busy and layer.extent().xMinimum() > before.xMinimum() + 20.0, "the nudge", 90)
    assert layer.extent().xMinimum() - before.xMinimum() == pytest.approx(30.0, abs=0.5)
    dock.release()
    engine.shutdown()


def without_exif(jpeg: bytes) -> bytes:
    """A JPEG without its application segments but the first: neither position nor camera is told any more."""
    out, at = jpeg[:2], 2
    while jpeg[at + 1] != 0xDA:
        length = int.from_bytes(jpeg[at + 2 : at + 4], "big")
        if not 0xE1 <= jpeg[at + 1] <= 0xEF:
            out += jpeg[at : at + 2 + length]
        at += 2 + length
    return out + jpeg[at:]
