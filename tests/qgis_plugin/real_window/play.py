"""The whole day in QGIS's window: run by ``qgis --code``, written down in ``result.json``, looked at in pictures.

A stale layer lies in a group; photos are mapped; the map takes the stale layer's place; it is swiped, undone, exported;
a flight is planned over a polygon drawn by hand and uploaded; the plugin is unloaded and loaded again.
"""

from __future__ import annotations

import os
import sys
import traceback
from pathlib import Path

sys.path.insert(0, os.environ["PHOTOMAP_PLAY"])

from qgis.core import QgsApplication, QgsCoordinateTransform, QgsPointXY, QgsProject, QgsRasterLayer
from qgis.PyQt.QtCore import QCoreApplication, QEvent, QTimer
from qgis.PyQt.QtWidgets import QAction, QApplication, QDialog, QDialogButtonBox, QDockWidget, QToolBar
from qgis.utils import iface, loadPlugin, plugins, startPlugin, unloadPlugin
from stage import Stage, Until
from stopwatch import Stopwatch
from x_mouse import RIGHT

FOLDER = Path(os.environ["PHOTOMAP_PLAY_OUT"])
FLIGHT = Path(os.environ["PHOTOMAP_PLAY_FLIGHT"])
STALE = Path(os.environ["PHOTOMAP_PLAY_STALE"])
MISSION = FOLDER / "flight-1"


def button_of(key: str):
    """The toolbar's button of an action."""
    bar = iface.mainWindow().findChild(QToolBar, "photomapToolBar")
    return bar.widgetForAction(action_of(key))


def action_of(key: str) -> QAction:
    return iface.mainWindow().findChild(QAction, f"photomap_action_{key}")


def dialog(name: str):
    """A dialog of the plugin that is to be seen, or nothing."""
    found = (w for w in QApplication.topLevelWidgets() if isinstance(w, QDialog) and w.objectName() == name)
    return next((w for w in found if w.isVisible()), None)


def roles() -> dict:
    layers = QgsProject.instance().mapLayers().values()
    return {layer.customProperty("photomap/role"): layer for layer in layers if layer.customProperty("photomap/role")}


def tree(group) -> list:
    return [
        [n.name(), n.itemVisibilityChecked(), tree(n) if hasattr(n, "addGroup") else None] for n in group.children()
    ]


def census() -> dict:
    """What of the plugin is in QGIS."""
    for _ in range(3):
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    main = iface.mainWindow()
    return {
        "actions": sorted(a.objectName() for a in main.findChildren(QAction) if a.objectName().startswith("photomap")),
        "menu": [a.text() for a in iface.rasterMenu().actions() if "photomap" in a.text()],
        "bars": [b.objectName() for b in main.findChildren(QToolBar) if "photomap" in b.objectName()],
        "docks": [d.objectName() for d in main.findChildren(QDockWidget) if "photomap" in d.objectName()],
        "providers": [p.id() for p in QgsApplication.processingRegistry().providers() if p.id() == "photomap"],
        "windows": [w.objectName() for w in QApplication.topLevelWidgets() if "photomap" in w.objectName()],
        "canvas tool": type(iface.mapCanvas().mapTool()).__module__,
    }


def play(stage: Stage, watch: Stopwatch):
    """The play, step by step."""
    project, canvas = QgsProject.instance(), iface.mapCanvas()
    root = project.layerTreeRoot()
    before = census()
    plugin = plugins["photomap"]
    stage.note(loaded=before, plugin_file=sys.modules["photomap"].__file__)

    base = root.insertGroup(0, "Base maps")
    for name in ("roads 2024", "orthophoto 2019", "hills"):
        layer = QgsRasterLayer(str(STALE), name)
        project.addMapLayer(layer, False)
        base.addLayer(layer).setItemVisibilityChecked(name == "orthophoto 2019")
    stale = project.mapLayersByName("orthophoto 2019")[0]
    canvas.setDestinationCrs(stale.crs())
    canvas.setExtent(stale.extent())

    yield stage.click(button_of("map"))
    yield Until(lambda: "map" in plugin._docks and plugin._docks["map"].isVisible(), "the dock Photo map")
    dock = plugin._docks["map"]
    dock.form.sources.add([str(FLIGHT / "photos")])
    dock.form.output.setFilePath(str(MISSION))
    yield stage.picture("1-ready")
    yield stage.click(dock.start_button)
    yield Until(lambda: dock.jobs.busy, "the job")
    yield Until(lambda: plugin.context.engine.is_ready, "the engine")
    stage.note(engine_pid=plugin.context.engine.pid)
    yield Until(lambda: dock.jobs.bar.maximum() > 0, "progress", 60.0)
    yield stage.picture("2-progress")
    yield Until(lambda: len(roles()) >= 8 and not dock.jobs.busy, "the finished map", 120.0)
    yield stage.picture("3-mapped")
    group = next(n for n in root.children() if n.name().startswith("flight-1"))
    stage.note(mapped=tree(group), map_extent=roles()["map"].extent().toString(3), canvas=canvas.extent().toString(3))

    iface.setActiveLayer(stale)
    yield stage.click(button_of("replace"))
    yield Until(lambda: dialog("photomapReplaceDialog"), "the dialog Replace imagery")
    asked = dialog("photomapReplaceDialog")
    stage.note(offered=[asked.stale.currentText(), asked.mission.folder()])
    yield stage.picture("4-replace")
    yield stage.click(asked.buttons.button(QDialogButtonBox.StandardButton.Ok))
    yield Until(lambda: dialog("photomapReplaceDialog") is None, "the end of the dialog")
    stage.note(replaced=tree(base))
    yield stage.picture("5-replaced")
    action_of("undo").trigger()
    yield stage.pause()
    stage.note(undone=tree(base))
    iface.setActiveLayer(stale)
    yield stage.click(button_of("replace"))
    yield Until(lambda: dialog("photomapReplaceDialog"), "the dialog Replace imagery")
    asked = dialog("photomapReplaceDialog")
    asked.swap.setChecked(True)
    yield stage.click(asked.buttons.button(QDialogButtonBox.StandardButton.Ok))
    yield Until(lambda: dialog("photomapReplaceDialog") is None, "the end of the dialog")
    stage.note(swapped=[stale.source(), stale.name()])
    action_of("undo").trigger()
    stage.note(swapped_back=[stale.source(), stale.name()])

    iface.setActiveLayer(roles()["map"])
    yield stage.pause()
    yield stage.click(button_of("swipe"))
    yield Until(lambda: getattr(canvas.mapTool(), "curtain", None) is not None, "the swipe")
    tool = canvas.mapTool()
    yield Until(lambda: tool.curtain.image is not None, "the map below")
    x, y = stage.place(canvas.extent().center())
    stage.mouse.move(x - 60, y)
    yield Until(lambda: abs(tool.curtain.x_px - (canvas.width() // 2 - 60)) < 6, "the divider at the mouse")
    yield stage.picture("6-swipe")
    yield stage.click(button_of("swipe"))
    yield Until(lambda: canvas.mapTool() is not tool, "the end of the swipe")

    dock.export(str(MISSION))
    wanted = dialog("photomapExportDialog")
    wanted.choose(["geotiff"])
    yield stage.click(wanted.buttons.button(QDialogButtonBox.StandardButton.Ok))
    yield Until(lambda: (MISSION / "exports" / "map.tif").is_file() and not wanted.jobs.busy, "the export", 60.0)
    yield stage.picture("7-exported")
    yield stage.click(wanted.buttons.button(QDialogButtonBox.StandardButton.Close))

    yield from plan_and_upload(stage, plugin)

    stage.note(worst=watch.worst(), gaps_ms=sorted(watch.gaps_ms)[-5:], entries=len(watch.entries))
    sys.setprofile(None)
    iface.setActiveLayer(roles()["map"])
    action_of("swipe").trigger()  # taken away with a tool of ours in hand
    yield stage.pause()
    unloadPlugin("photomap")
    yield stage.pause(200)
    stage.note(unloaded=census())
    loadPlugin("photomap")
    startPlugin("photomap")
    yield stage.pause(200)
    stage.note(reloaded=census())
    engine = plugins["photomap"].context.engine
    engine.ensure()
    yield Until(lambda: engine.is_ready, "the engine once more")
    stage.note(last_engine_pid=engine.pid)  # QGIS closes now


def plan_and_upload(stage: Stage, plugin):
    """An area drawn by the mouse, its flight, and the flight on the (simulated) vehicle."""
    canvas = iface.mapCanvas()
    yield stage.click(button_of("map"))  # away with it: room for the planner
    yield stage.click(button_of("planner"))
    yield Until(
        lambda: plugin._docks.get("planner") is not None and plugin._docks["planner"].isVisible(), "the planner"
    )
    dock = plugin._docks["planner"]
    yield stage.pause(300)
    yield stage.click(dock.draw_button)
    yield Until(lambda: canvas.mapTool() is dock.tool, "the drawing tool")
    extent = roles()["map"].extent()
    to_canvas = QgsCoordinateTransform(
        roles()["map"].crs(), canvas.mapSettings().destinationCrs(), QgsProject.instance()
    )
    corners = [
        to_canvas.transform(QgsPointXY(extent.xMinimum() + u * extent.width(), extent.yMinimum() + v * extent.height()))
        for u, v in ((0.25, 0.25), (0.7, 0.3), (0.65, 0.75), (0.3, 0.7))
    ]
    for corner in corners:
        stage.mouse.click(*stage.place(corner))
        yield stage.pause(600)  # two clicks of one place would be a double click
    stage.mouse.click(*stage.place(corners[-1]), RIGHT)
    yield Until(lambda: dock.save_button.isEnabled(), "the plan", 60.0)
    stage.note(drawn=len(dock.tool.corners), plan=dock.words.text(), covered=dock._facts["covered_share"])
    yield stage.picture("8-planned")
    dock.vehicle.most_height.setValue(200)
    dock.vehicle.connection.setCurrentText(os.environ["PHOTOMAP_PLAY_VEHICLE"])
    yield stage.click(dock.vehicle.upload_button)
    yield Until(lambda: dock.vehicle._job is not None, "the upload")
    yield Until(lambda: dock.vehicle._job is None, "the end of the upload", 60.0)
    stage.note(uploaded=dock.vehicle.words.text())
    yield stage.picture("9-uploaded")


def begin() -> None:
    stage = Stage(iface, FOLDER)
    watch = Stopwatch(str(Path(sys.modules["photomap"].__file__).parent))

    def end() -> None:
        sys.setprofile(None)
        stage.save()
        QgsProject.instance().clear()  # else QGIS asks about layers in a temporary folder
        QTimer.singleShot(0, iface.actionExit().trigger)

    iface.mainWindow().setGeometry(0, 0, 1280, 860)
    watch.start(iface.mainWindow())
    stage.run(play(stage, watch), end)


try:
    QTimer.singleShot(500, begin)
except Exception:
    (FOLDER / "result.json").write_text('{"fault": ' + repr(traceback.format_exc()) + "}")
