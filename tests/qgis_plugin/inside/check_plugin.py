"""The plugin loaded, unloaded and loaded again: what it brings, and that nothing of it stays behind."""

import gc
import importlib
import pkgutil
import shutil
import subprocess

import pytest
from qgis.core import QgsApplication, QgsSettings
from qgis.PyQt.QtCore import QCoreApplication, QEvent, QThread
from qgis.PyQt.QtWidgets import QAction, QDockWidget, QMenu, QToolBar

import qgis_plugin
from qgis_plugin import translation
from qgis_plugin.options import OptionsPage
from qgis_plugin.plugin import DOCKS
from qgis_plugin.settings import Settings, load_settings, save_settings


def census(window):
    """How many things of the plugin there are in the window and in QGIS."""
    for _ in range(3):
        gc.collect()
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        QCoreApplication.processEvents()
    main = window.main
    return {
        "actions": sorted(a.objectName() for a in main.findChildren(QAction) if a.objectName().startswith("photomap")),
        "docks": [d.objectName() for d in main.findChildren(QDockWidget)],
        "bars": [b.objectName() for b in main.findChildren(QToolBar)],
        "menu": [a.text() for a in window.menu.actions()],
        "options": len(window.options),
        "layer actions": len(window.layer_actions),
        "menus": [m.objectName() for m in main.findChildren(QMenu) if m.objectName().startswith("photomap")],
        "canvas items": len(window.canvas.scene().items()),
        "map tool": window.canvas.mapTool(),
        "providers": [p.id() for p in QgsApplication.processingRegistry().providers() if p.id() == "photomap"],
        "threads": len(window.main.findChildren(QThread)),
    }


@pytest.fixture
def empty(window, said):
    return census(window)


def test_loaded_and_unloaded_three_times_it_leaves_nothing(window, empty):
    for _ in range(3):
        plugin = qgis_plugin.classFactory(window)
        plugin.initGui()
        there = census(window)
        assert there["providers"] == ["photomap"]
        assert there["bars"] == ["photomapToolBar"]
        assert there["options"] == there["layer actions"] == 1
        assert there["docks"] == [], "docks are made when they are asked for"
        assert there["menu"] == ["photomap"]
        assert len(there["actions"]) == 6 + len(DOCKS)
        for entry in DOCKS:
            plugin.open_dock(entry.key)
        assert len(census(window)["docks"]) == len(DOCKS)
        plugin.unload()
        del plugin
        assert census(window) == empty


def test_a_dock_of_the_table_is_shown_and_hidden_by_its_action(window):
    plugin = qgis_plugin.classFactory(window)
    plugin.initGui()
    try:
        for entry in DOCKS:
            action = window.main.findChild(QAction, f"photomap_action_{entry.key}")
            action.trigger()
            dock = window.main.findChild(QDockWidget, f"photomap_{entry.key}")
            assert dock.isVisible()
            assert action.isChecked()
            action.trigger()
            assert not dock.isVisible()
            dock.show()
            assert action.isChecked()
            dock.close()
            assert not action.isChecked()
    finally:
        plugin.unload()


def test_a_running_job_is_ended_with_the_plugin(window, empty, program, flight, tmp_path, wait_until):
    save_settings(Settings(engine_path=program, folder=str(tmp_path)))
    plugin = qgis_plugin.classFactory(window)
    plugin.initGui()
    dock = plugin.open_dock("map")
    dock.form.sources.add([str(flight / "photos")])
    dock.start()
    engine = plugin.context.engine
    wait_until(lambda: engine.is_ready, "the engine")
    pid = engine.pid
    plugin.unload()
    wait_until(lambda: ended(pid), "the end of the engine")
    assert census(window) == empty


def ended(pid):
    try:
        with open(f"/proc/{pid}/stat") as status:  # noqa: PTH123
            return status.read().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def test_a_dock_that_fails_to_let_go_does_not_keep_the_others(window, empty):
    plugin = qgis_plugin.classFactory(window)
    plugin.initGui()
    for entry in DOCKS:
        plugin.open_dock(entry.key)
    release = plugin.dock("map").release

    def broken():
        release()
        raise RuntimeError("wrapped C/C++ object has been deleted")

    plugin.dock("map").release = broken
    plugin.unload()
    assert census(window) == empty


def test_without_a_window_only_processing_is_there_and_goes_again(qgis_app, empty):
    plugin = qgis_plugin.classFactory(None)
    plugin.initProcessing()
    assert "photomap" in [p.id() for p in QgsApplication.processingRegistry().providers()]
    plugin.unload()
    assert "photomap" not in [p.id() for p in QgsApplication.processingRegistry().providers()]


def test_every_module_of_the_plugin_can_be_imported(qgis_app):
    names = [m.name for m in pkgutil.walk_packages(qgis_plugin.__path__, "qgis_plugin.")]
    assert len(names) > 25
    for name in names:
        importlib.import_module(name)


def test_the_options_page_shows_and_keeps_what_was_chosen(window, program, tmp_path):
    save_settings(Settings())
    page = OptionsPage()
    page.engine.setFilePath(program)
    page.environment.setFilePath(str(tmp_path))
    page.folder.setFilePath(str(tmp_path))
    page.memory.setValue(2048)
    page.stay.setChecked(True)
    page.apply()
    assert load_settings() == Settings(program, str(tmp_path), True, 2048, str(tmp_path))
    page.test.click()
    assert program in page.found.text()
    again = OptionsPage()
    assert (again.engine.filePath(), again.memory.value(), again.stay.isChecked()) == (program, 2048, True)
    again.engine.setFilePath("/nowhere/photomap")
    again.test.click()
    assert "/nowhere/photomap" in again.found.text()
    save_settings(Settings())


def test_it_speaks_german_where_qgis_does(qgis_app, tmp_path, monkeypatch):
    tool = shutil.which("lrelease")
    if tool is None:
        pytest.skip("no lrelease (apt install qttools5-dev-tools)")
    source = translation.FOLDER / "photomap_de.ts"
    subprocess.run([tool, str(source), "-qm", str(tmp_path / "photomap_de.qm")], check=True, capture_output=True)
    monkeypatch.setattr(translation, "FOLDER", tmp_path)
    assert translation.install_translator() is None or translation.language() == "de"
    QgsSettings().setValue("locale/overrideFlag", True)
    QgsSettings().setValue("locale/userLocale", "de_DE")
    found = translation.install_translator()
    try:
        assert translation.tr("Replace imagery…") == "Bilddaten ersetzen …"
        assert translation.tr("words that nobody has translated") == "words that nobody has translated"
    finally:
        QCoreApplication.removeTranslator(found)
        QgsSettings().setValue("locale/overrideFlag", False)
    assert translation.tr("Replace imagery…") == "Replace imagery…"


def test_help_is_a_page_with_its_pictures(window):
    plugin = qgis_plugin.classFactory(window)
    plugin.initGui()
    plugin.show_help()
    text = plugin._help.text.toPlainText()
    assert text.startswith("photomap in QGIS")
    assert "Replace imagery" in text
    plugin.unload()
