"""The dock "Photo map": what it asks of the engine, what it shows of its answers, and what it says when it fails."""

import shutil
from pathlib import Path

import pytest
from qgis.core import QgsProject, QgsRasterLayer, QgsVectorLayer
from qgis.PyQt.QtCore import QMimeData, QPointF, Qt, QUrl
from qgis.PyQt.QtGui import QDropEvent
from qgis.PyQt.QtWidgets import QApplication
from window import role_layers

from qgis_plugin.engine import Engine
from qgis_plugin.main_dock.dock import MainDock
from qgis_plugin.messages import Messages
from qgis_plugin.plugin import Context
from qgis_plugin.settings import Settings, recent_missions, save_settings

REPORT = {
    "registrations": {"sequential": 5},
    "frames": {"total": 6, "registered": 5, "gps_only": 1},
    "warnings": ["one", "two", "three", "four"],
}


@pytest.fixture
def dock(context, window):
    made = MainDock(context)
    window.addDockWidget(Qt.DockWidgetArea.RightDockWidgetArea, made)
    yield made
    made.release()
    made.deleteLater()


def test_photos_become_a_job_with_only_what_was_said(dock, context, flight, tmp_path):
    assert not dock.start_button.isEnabled()
    assert dock.words.text() == "Choose a folder of photos, photos, or a video."
    dock.form.sources.add([str(flight / "photos")])
    assert dock.form.folder() == str(tmp_path / "missions" / "photos"), "a folder is offered"
    dock.start_button.click()
    assert context.engine.last.kind == "map"
    assert context.engine.last.arguments == {
        "sources": [str(flight / "photos")], "output": str(tmp_path / "missions" / "photos"), "layers": True
    }  # fmt: skip
    assert not dock.start_button.isEnabled(), "one map at a time"


def test_every_option_reaches_the_engine(dock, context, flight, tmp_path, mission):
    raster = QgsRasterLayer(str(mission / "map.tif"), "ortho")
    QgsProject.instance().addMapLayer(raster)
    save_settings(Settings(folder=str(tmp_path / "missions"), memory_mb=2048))
    form = dock.form
    form.sources.add([str(flight / "photos")])
    form.output.setFilePath(str(tmp_path / "mine"))
    form.track.setFilePath("/log/flight.tlog")
    form.gsd_cm.setValue(7.5)
    form.prefer.setCurrentIndex(2)
    form.crs.setCrs(raster.crs())
    form.dem.setLayer(raster)
    form.reference.setLayer(raster)
    form.gcp.setFilePath("/points.csv")
    form.check.setText("P3,P7")
    form.fov_deg.setValue(78.0)
    form.layers.setChecked(False)
    dock.start()
    assert context.engine.last.arguments == {
        "sources": [str(flight / "photos")], "output": str(tmp_path / "mine"), "track": "/log/flight.tlog",
        "gsd": 0.075, "prefer": "newest", "crs": "EPSG:32632", "dem": str(mission / "map.tif"),
        "reference": [str(mission / "map.tif")], "gcp": "/points.csv", "check": "P3,P7", "fov_deg": 78.0,
        "memory": 2048, "layers": False,
    }  # fmt: skip


def test_what_cannot_work_is_said_before_anything_starts(dock, flight, tmp_path):
    form = dock.form
    form.sources.add([str(tmp_path / "gone")])
    assert "is not there: remove it" in form.problem()
    form.sources.remove_selected()
    form.sources.add([str(flight / "photos")])
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "diary.txt").touch()
    form.output.setFilePath(str(tmp_path / "full"))
    assert "holds other files" in form.problem()
    form.output.setFilePath(str(tmp_path / "full" / "diary.txt"))
    assert "is a file" in form.problem()
    form.output.setFilePath("")
    assert "Choose the folder" in form.problem()
    form.output.setFilePath(str(tmp_path / "m"))
    web = QgsRasterLayer("type=xyz&url=http://127.0.0.1:9/{z}/{x}/{y}.png", "web", "wms")
    QgsProject.instance().addMapLayer(web)
    form.reference.setLayer(web)
    assert "“web” is no file on this machine" in form.problem()
    form.reference.setCurrentIndex(0)
    assert form.problem() == ""


def test_files_are_dropped_once_and_taken_away_by_a_key(dock, flight):
    sources, photos = dock.form.sources, sorted((flight / "photos").iterdir())
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(p)) for p in (photos[0], photos[1], photos[0])])
    drop = QDropEvent(QPointF(5, 5), Qt.DropAction.CopyAction, data, Qt.MouseButton.LeftButton,
                      Qt.KeyboardModifier.NoModifier)  # fmt: skip
    sources.dropEvent(drop)
    assert sources.paths() == [str(photos[0]), str(photos[1])]
    assert Path(dock.form.folder()).name == "photos", "photos give their folder's name to the map"
    sources.list.item(0).setSelected(True)
    sources.list.setFocus()
    QApplication.setActiveWindow(dock.window())
    sources.remove_selected()
    assert sources.paths() == [str(photos[1])]


def test_progress_has_stage_rate_and_time_left(dock, context, flight):
    dock.form.sources.add([str(flight / "photos")])
    dock.start()
    job = context.engine.last
    job.progress.emit("render", 30.0, 120.0, 4.5, 83.0)
    assert dock.jobs.words.text() == "render: 30 / 120, 4.5/s, 1:23 left"
    assert dock.jobs.bar.value() / dock.jobs.bar.maximum() == 0.25
    job.progress.emit("look", 12.0, 0.0, 0.0, 0.0)
    assert dock.jobs.words.text() == "look: 12"
    assert dock.jobs.bar.maximum() == 0, "nobody knows how much there is to do"
    dock.jobs.cancel_button.click()
    assert job.cancelled == 1
    job.failed.emit("stopped")
    assert dock.start_button.isEnabled()


def test_a_finished_map_is_added_after_its_track_was_written(
    dock, context, said, window, mission, tmp_path, wait_until
):
    own = shutil.copytree(mission, tmp_path / "own")
    dock.form.sources.add([str(own)])
    dock.start()
    context.engine.last.finished.emit({**REPORT, "mission": str(own)})
    assert (context.engine.last.kind, context.engine.last.arguments) == (
        "export",
        {"mission": str(own), "vectors": True},
    )
    assert not role_layers(), "not before the track is there"
    context.engine.last.finished.emit({"outputs": []})
    wait_until(lambda: len(role_layers()) == 8, "all layers")
    wait_until(lambda: window.active is role_layers()["map"], "the map as the active layer")
    extent = window.canvas.extent()
    assert extent.contains(role_layers()["map"].extent())
    assert extent.width() < 3.0 * role_layers()["map"].extent().width()
    assert recent_missions()[0] == str(own)
    assert dock.recent.folder() == str(own)
    assert said == [
        ("info", "6 of 6 frames are in the map."), ("warn", "one"), ("warn", "two"),
        ("warn", "2 more warnings stand in the log panel “photomap”."),
    ]  # fmt: skip


def test_a_map_is_shown_even_where_its_track_could_not_be_written(dock, context, said, mission, tmp_path, wait_until):
    own = shutil.copytree(mission, tmp_path / "own")
    dock.form.sources.add([str(own)])
    dock.start()
    context.engine.last.finished.emit({**REPORT, "warnings": [], "mission": str(own)})
    context.engine.last.failed.emit("the disk is full")
    wait_until(lambda: "map" in role_layers(), "the map")
    assert said == [("fail", "the disk is full"), ("info", "6 of 6 frames are in the map.")]


def test_a_failure_is_said_and_the_form_is_free_again(dock, context, said, flight):
    dock.form.sources.add([str(flight / "photos")])
    dock.start()
    context.engine.last.failed.emit("no photo could be read: give JPEG or TIFF")
    assert said == [("fail", "no photo could be read: give JPEG or TIFF")]
    assert dock.start_button.isEnabled()
    assert not dock.jobs.busy


def test_released_in_mid_job_it_stops_the_job_and_listens_no_more(dock, context, said, flight):
    dock.form.sources.add([str(flight / "photos")])
    dock.start()
    job = context.engine.last
    dock.release()
    assert job.cancelled == 1
    job.finished.emit({**REPORT, "mission": "/nowhere"})
    assert said == []


def test_a_mission_that_is_gone_is_said(dock, said, mission, tmp_path):
    own = shutil.copytree(mission, tmp_path / "own")
    dock.show_mission(str(own))
    shutil.rmtree(own)
    dock.show_mission(str(own))
    assert "is not there any more" in said[-1][1]
    assert str(own) not in recent_missions()


def test_export_asks_for_formats_area_and_crs(dock, context, window, mission, tmp_path, said):
    own = shutil.copytree(mission, tmp_path / "own")
    dock.export(str(own))
    dialog = dock._export
    assert dialog.problem() == "Tick at least one format."
    dialog.choose(["geotiff", "kml"])
    area = QgsVectorLayer("Polygon?crs=EPSG:32632", "sector", "memory")
    QgsProject.instance().addMapLayer(area)
    dialog.cutline.setLayer(area)
    dialog.view_only.setChecked(True)
    dialog.attribution.setText("Fire Dept")
    dialog.start()
    job = context.engine.last
    box = [float(part) for part in job.arguments.pop("bbox").split(",")]
    assert len(box) == 4
    cutline = Path(job.arguments.pop("cutline"))
    assert '"FeatureCollection"' in cutline.read_text()
    assert (job.kind, job.arguments) == ("export", {
        "mission": str(own), "output": str(own / "exports"), "compress": "deflate", "tile_format": "auto",
        "attribution": "Fire Dept", "geotiff": True, "kml": True,
    })  # fmt: skip
    shutil.copy(own / "map.tif", own / "exports" / "map.tif")
    job.finished.emit({"outputs": [str(own / "exports" / "map.tif")], "files": [{"note": "packed with loss"}]})
    assert said == [("info", "Written: map.tif"), ("warn", "packed with loss")]
    (layer,) = QgsProject.instance().mapLayersByName("own: export map.tif")
    assert layer.source() == str(own / "exports" / "map.tif")
    dialog.start()
    context.engine.last.finished.emit({"outputs": [str(own / "exports" / "map.tif")], "files": []})
    assert QgsProject.instance().mapLayersByName("own: export map.tif") == [layer], "not a second one of the same file"


def test_burning_into_old_imagery_is_a_geotiff_on_its_grid(dock, context, mission, tmp_path):
    old = QgsRasterLayer(str(mission / "map.tif"), "old")
    QgsProject.instance().addMapLayer(old)
    dock.export(str(shutil.copytree(mission, tmp_path / "own")))
    dialog = dock._export
    dialog.choose(["geotiff", "kml"])
    dialog.over.setLayer(old)
    assert "tick that format alone" in dialog.problem()
    dialog.choose(["geotiff"])
    dialog.start()
    assert context.engine.last.arguments["over"] == str(mission / "map.tif")
    assert context.engine.last.arguments["output"] == str(tmp_path / "own" / "exports" / "map-new.tif")


def test_a_map_made_and_exported_by_the_real_engine(window, said, program, flight, tmp_path, wait_until):
    engine = Engine(settings=lambda: Settings(engine_path=program))
    context = Context(window, engine, Messages(window), lambda key: None)
    dock = MainDock(context)
    stages = []
    dock.form.sources.add([str(flight / "photos")])
    dock.form.output.setFilePath(str(tmp_path / "flight-1"))
    dock.start()
    engine.jobs[0].progress.connect(lambda stage, *_: stages.append(stage))
    wait_until(lambda: "map" in role_layers() and not dock.jobs.busy, "the map", 120.0)
    assert {"read", "render"} <= set(stages)
    dock.export(str(tmp_path / "flight-1"))
    dock._export.choose(["mbtiles"])
    dock._export.start()
    wait_until(lambda: not dock._export.jobs.busy, "the export", 60.0)
    assert (tmp_path / "flight-1" / "exports" / "map.mbtiles").stat().st_size > 10_000
    assert [level for level, _ in said] == ["info", "info"], said
    dock.release()
    pid = engine.pid
    engine.shutdown()
    wait_until(lambda: not Path(f"/proc/{pid}").exists() or "\tZ" in Path(f"/proc/{pid}/status").read_text(), "its end")


def test_the_dock_can_be_walked_through_by_keyboard(dock, window):
    dock.show()
    start = dock.form.sources.list
    start.setFocus()
    seen, widget = [], start
    for _ in range(200):
        widget = widget.nextInFocusChain()
        if widget is start:
            break
        if widget.focusPolicy() & Qt.FocusPolicy.TabFocus and dock.isAncestorOf(widget):
            seen.append(widget)
    assert {dock.start_button, dock.recent.list, dock.recent.open_button, dock.form.layers} <= set(seen)
