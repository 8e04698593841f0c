"""The live dock in real QGIS, on the server's fake flight in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest
from qgis.core import QgsCoordinateReferenceSystem, QgsCoordinateTransform, QgsPointXY, QgsProject
from qgis.PyQt.QtCore import QCoreApplication
from qgis.PyQt.QtGui import QColor

from qgis_plugin.live.connection import LiveAddress, LiveError
from qgis_plugin.live.dock import LiveDock
from qgis_plugin.live.layers import ellipse_ring

pytest_plugins = ("planner_fixtures",)

TOKEN = "a-token-of-tests"


class Flight:
    """The peer's process; one flight at a time."""

    def __init__(self) -> None:
        root = Path(__file__).resolve().parents[3]
        clean = {**{k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}, "PYTHONPATH": str(root)}
        self.process = subprocess.Popen(
            [os.environ["PHOTOMAP_TEST_PYTHON"], "-m", "tests.qgis_plugin.live_peer"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=clean, cwd=root,
        )  # fmt: skip
        self.url = ""

    def do(self, words: str) -> dict:
        self.process.stdin.write(words + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def close(self) -> None:
        self.process.stdin.close()
        self.process.wait(timeout=20)
        self.process.stdout.close()


@pytest.fixture(scope="session")
def peer():
    flight = Flight()
    yield flight
    flight.close()


@pytest.fixture
def fly(peer, tmp_path):
    def start(*words: str) -> Flight:
        peer.url = peer.do(" ".join(["new", str(tmp_path / "flight"), TOKEN, *words]))["url"]
        return peer

    return start


@pytest.fixture
def dock(context):
    dock = LiveDock(context)
    yield dock
    dock.release()
    dock.deleteLater()


def _caught_up(dock, told, wait_until):
    """Wait until the layer in view shows the server's version."""
    raster = dock.screen.rasters["map"]
    wait_until(lambda: dock.screen.heard >= told["version"] and raster.resting, "the newest ground")
    assert raster.edition == raster.wanted


def _connect(dock, flight, wait_until):
    dock.panel.address.setText(flight.url)
    dock.panel.connect_button.click()
    wait_until(lambda: "map" in dock.screen.rasters and "drone" in dock.screen.overlay.layers, "the live map")


def _image(canvas, wait_until):
    """What is on the canvas once it is drawn."""
    QCoreApplication.processEvents()  # waitWhileRendering would keep downloads from the events that they need
    wait_until(lambda: not canvas.isDrawing(), "the picture")
    return canvas.grab().toImage()


def _map_only(dock, canvas):
    """Show the photo map alone, so that what is drawn over it does not count."""
    root = QgsProject.instance().layerTreeRoot()
    keep = dock.screen.rasters["map"].layer.id()
    for node in root.findLayers():
        node.setItemVisibilityChecked(node.layerId() == keep)


def _share_of_ground(image):
    """The share of the picture that is no background."""
    white = QColor(255, 255, 255).rgb()
    places = [(x, y) for x in range(0, image.width(), 10) for y in range(0, image.height(), 10)]
    return sum(image.pixel(x, y) != white for x, y in places) / len(places)


def test_the_map_grows_in_the_right_place(dock, canvas, fly, wait_until, said):
    flight = fly()
    _connect(dock, flight, wait_until)
    assert {"map", "age", "sigma"} <= set(dock.screen.rasters)
    drone = next(dock.screen.overlay.layers["drone"].getFeatures()).geometry().asPoint()
    where = flight.do("ask")["lon_lat"]
    assert (drone.x(), drone.y()) == pytest.approx(where, abs=5e-5)  # the fake map drifts, by 2 m here
    assert "All is well" in dock.panel.health.text()
    assert "CE90" in dock.panel.accuracy.text()
    _map_only(dock, canvas)
    wait_until(lambda: _share_of_ground(_image(canvas, wait_until)) > 0.05, "the first ground")
    before = _share_of_ground(_image(canvas, wait_until))
    raster, source = dock.screen.rasters["map"], dock.screen.rasters["map"].layer.source()
    _caught_up(dock, flight.do("step 120"), wait_until)
    assert raster.swaps >= 1
    assert raster.layer.source() != source
    assert _share_of_ground(_image(canvas, wait_until)) > before + 0.02
    assert not said.failures


def test_new_ground_comes_without_a_blank_moment(dock, canvas, fly, wait_until):
    canvas.setCachingEnabled(True)  # as QGIS's own window has it
    flight = fly()
    _connect(dock, flight, wait_until)
    _map_only(dock, canvas)
    raster = dock.screen.rasters["map"]
    _caught_up(dock, flight.do("step 30"), wait_until)
    least = 0.9 * _share_of_ground(_image(canvas, wait_until))
    assert least > 0.03
    seen = []

    def watch() -> bool:
        seen.append(_share_of_ground(canvas.grab().toImage()))
        return dock.screen.heard >= told["version"] and raster.resting and not raster._under_is_old

    for _ in range(2):
        told = flight.do("step 8")
        wait_until(watch, "the new ground")
    canvas.setCachingEnabled(False)
    assert min(seen) > least


def test_ground_out_of_view_is_fetched_when_it_is_looked_at(dock, canvas, fly, wait_until):
    flight = fly()
    _connect(dock, flight, wait_until)
    raster = dock.screen.rasters["map"]
    home = canvas.extent()
    away = canvas.extent()
    away.setXMinimum(home.xMinimum() + 100_000)
    away.setXMaximum(home.xMaximum() + 100_000)
    canvas.setExtent(away)
    wait_until(lambda: raster.resting, "rest")
    swaps = raster.swaps
    told = flight.do("step 40")
    wait_until(lambda: dock.screen.heard >= told["version"], "the event")
    assert raster.resting
    assert raster.swaps == swaps
    canvas.setExtent(home)
    _caught_up(dock, told, wait_until)
    assert raster.swaps == swaps + 1


def test_a_solution_moves_everything_and_a_lost_server_is_found_again(dock, fly, wait_until, said):
    flight = fly()
    _connect(dock, flight, wait_until)
    flight.do("step 60")
    wait_until(lambda: "track" in dock.screen.overlay.layers, "the track")
    _caught_up(dock, flight.do("solve"), wait_until)
    edition = dock.screen.rasters["map"].edition
    flight.do("down")
    wait_until(lambda: dock._lost, "the loss")
    assert "tried again" in said.warnings[-1]
    assert "Nobody answers" in dock.panel.health.text() or "ended" in dock.panel.health.text()
    flight.do("step 20")
    flight.do("up")
    wait_until(lambda: not dock._lost, "the link")
    wait_until(lambda: dock.screen.rasters["map"].edition > edition, "what was missed")
    assert any("there again" in words for words in said.infos)


def test_a_find_is_marked_by_a_click(dock, canvas, hand, fly, wait_until, said):
    flight = fly()
    _connect(dock, flight, wait_until)
    wait_until(lambda: not canvas.isDrawing(), "the picture")
    lon, lat = flight.do("ask")["lon_lat"]
    to_map = QgsCoordinateTransform(
        QgsCoordinateReferenceSystem("EPSG:4326"), canvas.mapSettings().destinationCrs(), QgsProject.instance()
    )
    place = to_map.transform(QgsPointXY(lon, lat))
    dock.panel.find_kind.setCurrentIndex(dock.panel.find_kind.findData("victim"))
    dock.panel.find_note.setText("waves")
    dock.panel.find_button.click()
    hand.click(place.x(), place.y())
    wait_until(lambda: said.infos, "the find")
    assert "Marked" in said.infos[-1]
    assert "CE90" in said.infos[-1]
    wait_until(lambda: "finds" in dock.screen.overlay.layers, "the layer")
    find = next(dock.screen.overlay.layers["finds"].getFeatures())
    assert (find["kind"], find["note"]) == ("victim", "waves")
    per_px = canvas.mapUnitsPerPixel()
    assert find.geometry().asPoint().distance(QgsPointXY(lon, lat)) < 2 * per_px / 60_000
    assert canvas.mapTool() is not dock.tool


def test_follow_keeps_the_drone_in_view(dock, canvas, fly, wait_until):
    flight = fly()
    _connect(dock, flight, wait_until)
    far = canvas.extent()
    far.setXMinimum(far.xMinimum() + 3000)
    far.setXMaximum(far.xMaximum() + 3000)
    canvas.setExtent(far)
    dock.panel.follow.setChecked(True)
    flight.do("step 5")
    wait_until(lambda: abs(canvas.center().x() - far.center().x()) > 2000, "the view to follow")


def test_without_a_place_there_are_words_and_it_snaps(dock, fly, wait_until, said):
    flight = fly("relative")
    dock.panel.address.setText(flight.url)
    dock.panel.connect_button.click()
    wait_until(lambda: dock._mission is not None, "the mission")
    assert "no place on Earth" in dock.panel.health.text()
    assert not dock.screen.rasters
    flight.do("snap")
    flight.do("step 10")
    wait_until(lambda: "map" in dock.screen.rasters, "the map in its place")
    assert any("place" in words for words in said.infos)
    assert "no place on Earth" not in dock.panel.health.text()


def test_ending_needs_a_second_press_and_is_told(dock, fly, wait_until, said):
    flight = fly()
    _connect(dock, flight, wait_until)
    dock.panel.finalise_button.click()
    assert "Again" in dock.panel.finalise_button.text()
    assert flight.do("ask")["finalised"] == 0
    dock.panel.finalise_button.click()
    wait_until(lambda: flight.do("ask")["finalised"] == 1, "the end")
    flight.do("progress 0.5")
    wait_until(lambda: dock.panel.bar.value() == 500, "the progress")
    flight.do("progress 1")
    wait_until(lambda: any("has ended" in words for words in said.infos), "the words")
    assert not dock.panel.finalise_button.isEnabled()


def test_trouble_is_in_the_health_line(dock, fly, wait_until):
    flight = fly()
    _connect(dock, flight, wait_until)
    flight.do("lose")
    wait_until(lambda: "in range" in dock.panel.health.text(), "the trouble")
    flight.do("again")
    flight.do("step 31")
    wait_until(lambda: "All is well" in dock.panel.health.text(), "the good word")


@pytest.mark.parametrize("address", ["", "ftp://127.0.0.1/", "http://127.0.0.1:99999/", "https://127.0.0.1:1/"])
def test_what_is_no_address_is_told(dock, said, address):
    dock.panel.address.setText(address)
    dock.panel.connect_button.click()
    assert "is no address" in said.failures[-1]
    assert dock._feed is None


def test_the_wrong_token_and_nobody_there_are_told(dock, fly, wait_until, said):
    flight = fly()
    dock.panel.address.setText(flight.url.replace(TOKEN, "wrong"))
    dock.panel.connect_button.click()
    wait_until(lambda: said.failures, "the refusal")
    assert "token" in said.failures[-1]
    assert dock._feed is None
    dock.panel.address.setText("http://127.0.0.1:9/")
    dock.panel.connect_button.click()
    wait_until(lambda: said.warnings, "the warning")
    assert "Nobody answers" in said.warnings[-1]


def test_an_address_is_read_in_every_form():
    assert LiveAddress.parse("http://[::1]:8765/?token=x") == LiveAddress("::1", 8765, "x")
    assert LiveAddress.parse(" 10.0.0.5:8765 ") == LiveAddress("10.0.0.5", 8765)
    assert LiveAddress("::1", 8, "a b").url("x?y=1", v=2) == "http://[::1]:8/x?y=1&v=2&token=a+b"
    with pytest.raises(LiveError):
        LiveAddress.parse("https://example.org/")


def test_the_ellipse_is_as_large_as_it_says():
    ring = ellipse_ring([8.0, 60.0], {"major": 10.0, "minor": 2.0, "bearing_deg": 90.0})
    east = (max(p[0] for p in ring) - 8.0) * 111_320 * 0.5  # cos 60
    north = (max(p[1] for p in ring) - 60.0) * 111_320
    assert (east, north) == pytest.approx((21.46, 4.29), rel=1e-2)


def test_a_session_is_started_and_ended_here(dock, flight, tmp_path, wait_until, said):
    """The real ``photomap live`` as a job of the real engine, on a folder of photos."""
    dock.panel.source.setText(str(flight / "photos"))
    dock.panel.output.setFilePath(str(tmp_path / "live"))
    dock.panel.start_button.click()
    wait_until(lambda: (dock._health or {}).get("frames") or said.failures, "the first picture", 120)
    assert not said.failures
    dock.panel.finalise_button.click()
    dock.panel.finalise_button.click()
    wait_until(lambda: dock._job is None, "the end", 180)
    assert not said.failures
    assert str(tmp_path / "live") in said.infos[-1]
    assert (tmp_path / "live" / "mission.json").is_file()
    assert dock._feed is None
    assert dock.panel.start_button.isEnabled()


def test_nothing_is_left_behind(context, canvas, fly, wait_until):
    dock = LiveDock(context)
    flight = fly()
    _connect(dock, flight, wait_until)
    dock.panel.find_button.click()
    dock.release()
    dock.deleteLater()
    assert not QgsProject.instance().mapLayers()
    assert not QgsProject.instance().layerTreeRoot().children()
    assert canvas.mapTool() is not dock.tool
    flight.do("step 20")  # nobody listens: nothing may fail
    for _ in range(20):
        QCoreApplication.processEvents()
