"""The live dock: connect to a flight under way, or start one; see it grow, mark finds, end it."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from qgis.core import QgsProject, QgsSettings
from qgis.PyQt.QtCore import QTimer, QUrl
from qgis.PyQt.QtGui import QDesktopServices
from qgis.PyQt.QtWidgets import QDockWidget, QLabel

from ..point_tool import PointTool
from ..settings import default_folder, load_settings, remember_mission
from ..translation import tr
from .connection import LiveAddress, LiveConnection, LiveError
from .feed import LiveFeed
from .layers import area_features, find_features, gap_features, pose_features
from .panel import LAST_ADDRESS, LAST_SOURCE, LivePanel
from .screen import LiveScreen
from .words import accuracy_words, drone_words, health_html

DRAW_MS, LOOK_MS, CURSOR_MS = 500, 3000, 400
"""How often the drone is drawn, track and coverage are asked for, the accuracy under the cursor is."""
ZOOM_AFTER_MS = 250
MOST_SKIPPED = 16
"""How often the drone waits for a window that is drawing: 8 s."""


class LiveDock(QDockWidget):
    """See ``plugin.DockEntry`` for what a dock must be."""

    def __init__(self, context) -> None:
        super().__init__()
        self._messages, self._engine = context.messages, context.engine
        self._iface, self._canvas = context.iface, context.iface.mapCanvas()
        self._feed: LiveFeed | None = None
        self._address: LiveAddress | None = None
        self._job = None
        self._flies_into = ""
        self._forget()
        self.panel = LivePanel()
        self.setWidget(self.panel)
        self.screen = LiveScreen(self._canvas)
        self.tool = PointTool(self._canvas)
        self.tool.setButton(self.panel.find_button)
        self.panel.output.setFilePath(str(_new_folder()))
        self.status = QLabel()
        self.status.setObjectName("photomap_live_status")
        bar = getattr(self._iface, "statusBarIface", lambda: None)()
        self._status_bar = bar if hasattr(bar, "addPermanentWidget") else None
        if self._status_bar is not None:
            self._status_bar.addPermanentWidget(self.status)
            self.status.hide()
        self._timers = {}
        for name, pause_ms, slot in (
            ("draw", DRAW_MS, self._draw), ("look", LOOK_MS, self._look), ("cursor", CURSOR_MS, self._ask_under_cursor)
        ):  # fmt: skip
            timer = QTimer(self)
            timer.setInterval(pause_ms)
            timer.timeout.connect(slot)
            self._timers[name] = timer
        self._wire()

    def release(self) -> None:
        """Give back the connection, layers, map tool and the words in the status line."""
        self.disconnect_session()
        self._canvas.xyCoordinates.disconnect(self._cursor_moved)
        QgsProject.instance().cleared.disconnect(self._project_cleared)
        if self._job is not None:
            self._job.output.disconnect(self._told)
            self._job.finished.disconnect(self._flown)
            self._job.failed.disconnect(self._not_flown)
            self._job = None  # the flight goes on as long as the engine does
        self.tool.release()
        self.screen.release()
        if self._status_bar is not None:
            self._status_bar.removeWidget(self.status)
        self.status.deleteLater()

    def _forget(self) -> None:
        self._mission: dict | None = None
        self._live: dict | None = None
        self._pose: dict | None = None
        self._health: dict | None = None
        self._coverage: dict | None = None
        self._cursor: tuple[float, float] | None = None
        self._under_cursor = ""
        self._lost = ""
        self._drawn_frame: object = None
        self._skipped = 0
        self._ground_is_new = self._finds_are_new = True
        self._asking: set[str] = set()
        self._zoomed = False

    def _wire(self) -> None:
        panel = self.panel
        panel.connect_button.clicked.connect(lambda *_: self._toggle())
        panel.address.returnPressed.connect(self._toggle)
        panel.find_button.clicked.connect(lambda *_: self._mark())
        panel.page_button.clicked.connect(lambda *_: QDesktopServices.openUrl(QUrl(self._address.page)))
        panel.finalise_wanted.connect(self._finalise)
        panel.start_button.clicked.connect(lambda *_: self.start_session())
        self.tool.picked.connect(self._picked)
        self.tool.refused.connect(self._messages.warn)
        self.tool.left.connect(self._leave_tool)
        self._canvas.xyCoordinates.connect(self._cursor_moved)
        QgsProject.instance().cleared.connect(self._project_cleared)

    # the connection

    def _toggle(self) -> None:
        if self._feed is not None:
            self.disconnect_session()
            return
        try:
            self.connect_session(LiveAddress.parse(self.panel.address.text()))
        except LiveError as error:
            self._messages.fail(str(error))

    def connect_session(self, address: LiveAddress) -> None:
        """Follow the session at an address; its layers come when it answers."""
        self.disconnect_session()
        self._address = address
        self.panel.address.setText(address.page)
        # without the token: settings are read by other plugins, and a session's token is of no use later
        QgsSettings().setValue(LAST_ADDRESS, f"{address.origin}/")
        self._feed = LiveFeed(LiveConnection(address), self)
        self._feed.opened.connect(self._opened)
        self._feed.happened.connect(self._happened)
        self._feed.lost.connect(self._link_lost)
        self._feed.refused.connect(self._refused)
        self.panel.set_connected(True)
        self.status.show()
        for timer in self._timers.values():
            timer.start()
        self._say()

    def disconnect_session(self) -> None:
        """Follow no more; the layers go, the flight goes on."""
        for timer in self._timers.values():
            timer.stop()
        feed, self._feed = self._feed, None
        if feed is not None:
            feed.close()
            feed.deleteLater()
        self._leave_tool()
        self._forget()
        self.screen.clear()
        self.panel.set_connected(False)
        self.panel.bar.hide()
        for label in (self.panel.health, self.panel.accuracy, self.panel.drone, self.status):
            label.clear()
        self.status.hide()

    def _opened(self, mission: dict) -> None:
        was_lost, self._lost = bool(self._lost), ""
        self._show(mission)
        self._ground_is_new = self._finds_are_new = True
        if was_lost:
            self.screen.everything_changed()
            self._messages.info(tr("The link to {} is there again.").format(self._address.origin))
        self._look()

    def _link_lost(self, words: str) -> None:
        if self._feed is None or (self._live or {}).get("phase") == "ended":
            return  # a flight that has ended may leave
        if not self._lost:
            self._messages.warn(tr("{} It is tried again.").format(words))
        self._lost = words
        self._say()

    def _refused(self, words: str) -> None:
        self.disconnect_session()
        self._messages.fail(words)

    def _show(self, mission: dict) -> None:
        self._mission = mission
        live = mission.get("live")
        if live is not None:
            self._take_live(live)
        shown = self.screen.show_mission(mission, self._address)
        bounds = mission.get("bounds")
        if shown and bounds and not self._zoomed:
            self._zoomed = True
            # The first layer of an empty project sets its CRS and view, which for XYZ is the world: after that.
            QTimer.singleShot(ZOOM_AFTER_MS, lambda: self._zoom_to(bounds))
        self._say()

    def _zoom_to(self, bounds) -> None:
        if self._feed is not None:
            self.screen.zoom_to(bounds)

    def _read_mission(self) -> None:
        self._ask("mission", lambda c: c.get("missions/1"), self._show)

    # what happens in the flight

    def _happened(self, name: str, event: dict) -> None:
        if self._feed is None:
            return
        if name == "live":
            self._take_live(event)
            if event.get("missed"):
                self.screen.everything_changed()
        elif name == "pose":
            self._pose = event
        elif name == "health":
            self._health = event
        elif name == "tiles":
            self._ground_is_new = True
            self.screen.tiles_changed(event)
        elif name == "solution":
            self._ground_is_new = self._finds_are_new = True
        elif name == "find":
            self._finds_are_new = True
            self._look()
        elif name == "snapped":
            self._messages.info(event.get("words") or tr("The map lies in its place now."))
            self._zoomed = False
            self._read_mission()
        elif name == "mission":
            self._read_mission()
        elif name == "segment" and event.get("words"):
            self._messages.log(event["words"])
        elif name in ("finalising", "ended"):
            self._ending(name, event)
        if name != "pose":
            self._say()

    def _take_live(self, live: dict) -> None:
        self._live = live
        self._pose = live.get("pose") or self._pose
        self._health = live.get("health") or self._health
        if self._on_earth():
            self.screen.overlay.set_features("area", area_features(live))
        self.panel.set_connected(True, flying=live.get("phase") in ("starting", "flying"))

    def _ending(self, name: str, event: dict) -> None:
        self._live = {**(self._live or {}), "phase": name}
        self.panel.set_connected(True, flying=False)
        self.panel.bar.setVisible(name == "finalising")
        self.panel.bar.setValue(round(1000 * float(event.get("progress") or 0.0)))
        if name == "ended":
            self._messages.info(
                tr("The flight has ended; its map is a mission now. {}").format(event.get("words") or "")
            )
            self._ground_is_new = True

    def _on_earth(self) -> bool:
        return bool((self._mission or {}).get("georeferenced"))

    # what is drawn

    def _draw(self) -> None:
        """Draw the drone where it is now; a window that is still busy with its last picture is not hurried much."""
        pose = self._pose
        self._say()
        if pose is None or not self._on_earth() or pose.get("frame") == self._drawn_frame:
            return
        if self._window_is_busy():
            return
        self._drawn_frame = pose.get("frame")
        self.screen.overlay.show(pose_features(pose))
        at = pose.get("drone") or pose.get("centre")
        if at and self.panel.follow.isChecked():
            self.screen.follow(at)

    def _window_is_busy(self) -> bool:
        """Whether to wait: whatever changes while a picture is drawn makes QGIS begin it anew, a slow one for ever."""
        if self._canvas.isDrawing() and self._skipped < MOST_SKIPPED:
            self._skipped += 1
            return True
        self._skipped = 0
        return False

    def _look(self) -> None:
        """Ask for what comes in no event: track, coverage, finds, and new ranges of colours."""
        if self._feed is None or self._lost or not self._on_earth():
            return
        if self._ground_is_new and not self._canvas.isDrawing():
            self._ground_is_new = False
            overlay = self.screen.overlay
            self._ask("track", lambda c: c.get("missions/1/track.geojson"),
                      lambda d: overlay.set_features("track", d["features"]))  # fmt: skip
            if (self._mission.get("links") or {}).get("coverage"):
                self._ask("coverage", lambda c: c.get("missions/1/live/coverage.geojson"), self._take_coverage)
            self._read_mission()
        if self._finds_are_new:
            self._finds_are_new = False
            self._ask("finds", lambda c: c.get("missions/1/finds.geojson"), self._take_finds)

    def _take_finds(self, document: dict) -> None:
        self.screen.overlay.set_features("finds", find_features(document))

    def _take_coverage(self, coverage: dict) -> None:
        self._coverage = coverage
        self.screen.overlay.set_features("gaps", gap_features(coverage))
        self._say()

    def _say(self) -> None:
        if self._feed is None:
            return
        words = health_html(self._health, self._live, lost=self._lost)
        if not self._lost and self._mission is not None and not self._on_earth():
            words += "<br>" + tr(
                "The map has no place on Earth yet: it comes here once it has; see the page meanwhile."
            )
        _set(self.panel.health, words)
        accuracy = accuracy_words(self._pose, self._coverage)
        _set(self.panel.accuracy, accuracy)
        _set(self.panel.drone, drone_words(self._pose))
        short = [accuracy] if not self._lost else [tr("photomap live: the link is lost")]
        _set(self.status, ", ".join(w for w in (*short, self._under_cursor) if w))

    # the accuracy under the cursor

    def _cursor_moved(self, point) -> None:
        if self._feed is not None:
            self._cursor = (point.x(), point.y())

    def _ask_under_cursor(self) -> None:
        cursor, self._cursor = self._cursor, None
        if cursor is None or not self._on_earth() or self._lost or self._live is None:
            return
        place = self.tool.to_degrees(*cursor)
        if place is not None:
            self._ask("accuracy", lambda c: c.accuracy(place), self._take_accuracy)

    def _take_accuracy(self, ellipse: dict | None) -> None:
        known = ellipse is not None and ellipse.get("ce90") is not None
        self._under_cursor = tr("under the cursor ±{} m").format(f"{ellipse['ce90']:.1f}") if known else ""
        self._say()

    # what the user does

    def _mark(self) -> None:
        if self._canvas.mapTool() is self.tool:
            self._leave_tool()
            return
        self._canvas.setMapTool(self.tool)
        self._canvas.setFocus()

    def _leave_tool(self) -> None:
        if self._canvas.mapTool() is self.tool:
            self._canvas.unsetMapTool(self.tool)

    def _picked(self, lon: float, lat: float) -> None:
        kind, note = self.panel.find_kind.currentData(), self.panel.find_note.text().strip()
        self._leave_tool()
        if self._feed is not None:
            self._feed.ask(lambda c: c.mark(kind, (lon, lat), note), self._marked, self._messages.fail)

    def _marked(self, find: dict) -> None:
        self.panel.find_note.clear()
        within = f" ±{find['ce90_m']:.1f} m (CE90)" if find.get("ce90_m") is not None else ""
        self._messages.info(tr("Marked: {}").format(f"{find.get('name') or find.get('kind')}{within}"))
        self._finds_are_new = True
        self._look()

    def _finalise(self) -> None:
        if self._feed is not None:
            self._feed.ask(lambda c: c.finalise(), failed=self._messages.fail)

    def start_session(self) -> None:
        """Start ``photomap live`` as a job of the engine, and connect to it when it is ready."""
        source, output = self.panel.source.text().strip(), self.panel.output.filePath().strip()
        if not source or not output:
            self._messages.fail(tr("Say where the pictures come from, and into which folder the map goes."))
            return
        if self._job is not None:
            self._messages.fail(tr("A session that was started here still runs: end it first."))
            return
        QgsSettings().setValue(LAST_SOURCE, source)
        arguments = {"source": source, "output": output, "port": 0}
        if self.panel.mavlink.text().strip():
            arguments["mavlink"] = self.panel.mavlink.text().strip()
        self._job = self._engine.start("live", arguments)
        self._job.output.connect(self._told)
        self._job.finished.connect(self._flown)
        self._job.failed.connect(self._not_flown)
        self._flies_into = output
        self.panel.start_button.setEnabled(False)

    def _told(self, document: dict) -> None:
        if document.get("event") == "ready":
            self.connect_session(LiveAddress("127.0.0.1", int(document["port"]), document.get("token") or ""))

    def _flown(self, document: dict) -> None:
        self._job = None
        self.panel.start_button.setEnabled(True)
        self.panel.output.setFilePath(str(_new_folder()))
        self.disconnect_session()
        remember_mission(self._flies_into)
        self._messages.info(
            tr("The flight's mission is finished: {}. The dock Photo map has it among the recent missions.").format(
                self._flies_into
            )
        )

    def _not_flown(self, words: str) -> None:
        self._job = None
        self.panel.start_button.setEnabled(True)
        self._messages.fail(words)

    # the project

    def _project_cleared(self) -> None:
        if self._feed is not None and self._mission is not None:
            self.screen.clear()
            self._drawn_frame, self._ground_is_new, self._finds_are_new = None, True, True
            self._show(self._mission)

    def _ask(self, name: str, call, done) -> None:
        """Ask the server, one question of a kind at a time; answers of a session that is no more are dropped."""
        feed = self._feed
        if feed is None or name in self._asking:
            return
        self._asking.add(name)

        def answered(answer) -> None:
            self._asking.discard(name)
            if self._feed is feed:
                done(answer)

        feed.ask(call, answered, lambda words: self._asking.discard(name))


def _set(label: QLabel, words: str) -> None:
    if label.text() != words:
        label.setText(words)


def _new_folder() -> Path:
    return default_folder(load_settings()) / f"live-{datetime.now():%Y%m%d-%H%M%S}"
