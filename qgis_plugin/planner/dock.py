"""The planner's dock: an area becomes flights as it is drawn, saved as any plan file, uploaded to a vehicle."""

from __future__ import annotations

import contextlib
import html
from dataclasses import replace

from qgis.core import QgsGeometry, QgsPointXY, QgsProject
from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtWidgets import (
    QDockWidget,
    QFileDialog,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from ..point_tool import PointTool
from ..settings import default_folder, load_settings
from ..translation import tr
from .area_tool import AreaTool
from .features import Taken, UnusableLayerError, every, selected
from .form import PlannerForm, UnusableFieldError
from .layers import by_layer, place_feature, plan_overlay
from .preview import Preview
from .request import FROM_DATUM, NEED_A_LINE, PlanRequest
from .result import in_the_docks_words, summary_html, warnings_html
from .vehicle import VehiclePanel

FILE_KINDS = (
    ("QGroundControl, MAVSDK (*.plan)", ".plan"),
    ("Mission Planner (*.waypoints)", ".waypoints"),
    ("Google Earth (*.kml)", ".kml"),
    ("Google Earth (*.kmz)", ".kmz"),
    ("DJI Pilot 2 (*.wpml.kmz)", ".wpml.kmz"),
    ("GeoJSON (*.geojson)", ".geojson"),
    ("GPX (*.gpx)", ".gpx"),
    ("CSV (*.csv)", ".csv"),
)


class PlannerDock(QDockWidget):
    """See ``plugin.DockEntry`` for what a dock must be."""

    def __init__(self, context) -> None:
        super().__init__()
        self._messages = context.messages
        self._iface = context.iface
        self._canvas = context.iface.mapCanvas()
        self._start = context.engine.start
        self._taken: Taken | None = None
        self._home: tuple[float, float] | None = None
        self._datum: tuple[float, float] | None = None
        self._facts: dict | None = None
        self._asked_cameras = False
        self._released = False
        self._last_failure = ""
        self._saving: object | None = None
        self._before_tool = None
        self.overlay = plan_overlay()
        self.tool = AreaTool(self._canvas)
        self.home_tool, self.datum_tool = PointTool(self._canvas), PointTool(self._canvas)
        self.preview = Preview(self._start, self)
        self.form = PlannerForm()
        self.vehicle = VehiclePanel(
            self._start, self._messages, default_folder(load_settings()) / "vehicle", self.preview.folder
        )
        self._build()
        self._connect()
        self._say_what_is_missing()

    def release(self) -> None:
        """Give back map tools, rubber bands, layers, jobs and files."""
        self._released = True
        QgsProject.instance().cleared.disconnect(self._project_cleared)
        if self._saving is not None:
            self._saving.cancel()
        for tool in (self.tool, self.home_tool, self.datum_tool):
            tool.release()
        self.vehicle.release()
        self.preview.release()
        self.overlay.remove()

    # how it looks

    def _build(self) -> None:
        inner = QWidget()
        column = QVBoxLayout(inner)
        row = QGridLayout()
        self.draw_button = _button(tr("&Draw"), "draw", self._draw, checkable=True)
        self.draw_button.setToolTip(
            tr(
                "Click the corners; right click or Enter closes, Backspace takes one back, Esc begins anew. "
                "Then drag corners, or the crosses between them; a right click on a corner takes it away."
            )
        )
        self.take_button = _button(tr("&Take selected"), "take", self._take)
        self.take_button.setToolTip(tr("The selected features of the active layer, in any CRS"))
        self.home_button = _button(tr("Set ta&ke-off"), "home", self._pick_home, checkable=True)
        self.datum_button = _button(tr("Set datu&m"), "datum", self._pick_datum, checkable=True)
        self.datum_button.setToolTip(tr("Where a search pattern begins"))
        self.clear_button = _button(tr("Clear"), "clear", self.clear)
        row.addWidget(self.draw_button, 0, 0)
        row.addWidget(self.take_button, 0, 1)
        row.addWidget(self.home_button, 1, 0)
        row.addWidget(self.datum_button, 1, 1)
        row.addWidget(self.clear_button, 2, 0)
        column.addLayout(row)
        self.words = QLabel()
        self.words.setWordWrap(True)
        self.words.setTextFormat(Qt.TextFormat.RichText)
        self.words.setObjectName("planner_words")
        self.warnings = QLabel()
        self.warnings.setWordWrap(True)
        self.warnings.setObjectName("planner_warnings")
        self.bar = QProgressBar()
        self.bar.setRange(0, 0)
        self.bar.setTextVisible(False)
        self.bar.setFixedHeight(4)
        policy = self.bar.sizePolicy()
        policy.setRetainSizeWhenHidden(True)  # the form must not jump at every edit
        self.bar.setSizePolicy(policy)
        self.bar.hide()
        column.addWidget(self.bar)
        column.addWidget(self.words)
        column.addWidget(self.warnings)
        buttons = QHBoxLayout()
        self.save_button = _button(tr("Sa&ve the plan…"), "save", self.save)
        self.save_button.setEnabled(False)
        buttons.addWidget(self.save_button)
        column.addLayout(buttons)
        column.addWidget(self.form)
        title = QLabel(f"<b>{tr('Vehicle')}</b>")
        column.addWidget(title)
        column.addWidget(self.vehicle)
        column.addStretch(1)
        area = QScrollArea()
        area.setWidgetResizable(True)
        area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        area.setWidget(inner)
        area.setMinimumWidth(inner.minimumSizeHint().width() + area.verticalScrollBar().sizeHint().width() + 4)
        self.setWidget(area)

    def _connect(self) -> None:
        self.form.changed.connect(self._edited)
        self.tool.shape_changed.connect(self._drawn)
        self.tool.refused.connect(self._messages.warn)
        self.tool.left.connect(self._leave_tools)
        for tool, take in ((self.home_tool, self._home_picked), (self.datum_tool, self._datum_picked)):
            tool.picked.connect(take)
            tool.refused.connect(self._messages.warn)
            tool.left.connect(self._leave_tools)
        for tool, button in (
            (self.tool, self.draw_button), (self.home_tool, self.home_button), (self.datum_tool, self.datum_button)
        ):  # fmt: skip
            tool.setButton(button)
        self.preview.planned.connect(self._planned)
        self.preview.failed.connect(self._failed)
        self.preview.busy.connect(self.bar.setVisible)
        self.vehicle.upload_wanted.connect(self._upload)
        self.vehicle.stands_at.connect(lambda lat, lon: self._home_picked(lon, lat))
        QgsProject.instance().cleared.connect(self._project_cleared)

    # places

    def _draw(self) -> None:
        self.tool.is_line = self.form.pattern.currentData() in NEED_A_LINE
        if self._taken is not None:
            self._taken = None
            self.tool.clear()
        self._use(self.tool, self.draw_button)

    def _pick_home(self) -> None:
        self._use(self.home_tool, self.home_button)

    def _pick_datum(self) -> None:
        self._use(self.datum_tool, self.datum_button)

    def _use(self, tool, button: QPushButton) -> None:
        if self._canvas.mapTool() is tool:
            self._leave_tools()
            return
        if self._canvas.mapTool() not in (self.tool, self.home_tool, self.datum_tool):
            self._before_tool = self._canvas.mapTool()
        self._canvas.setMapTool(tool)
        self._canvas.setFocus()

    def _leave_tools(self) -> None:
        current = self._canvas.mapTool()
        if current in (self.tool, self.home_tool, self.datum_tool):
            self._canvas.unsetMapTool(current)
            before, self._before_tool = self._before_tool, None
            if before is not None:
                with contextlib.suppress(RuntimeError):  # another plugin's tool, unloaded meanwhile
                    self._canvas.setMapTool(before)

    def _take(self) -> None:
        lines = self.form.pattern.currentData() in NEED_A_LINE
        try:
            taken = selected(self._iface.activeLayer(), lines=lines)
        except UnusableLayerError as error:
            self._messages.fail(str(error))
            return
        for words in taken.warnings:
            self._messages.warn(words)
        self.tool.set_corners(())
        self._taken = taken
        self._edited()

    def _home_picked(self, lon: float, lat: float) -> None:
        self._home = (lat, lon)
        self._leave_tools()
        self._show_places()
        self._edited()

    def _datum_picked(self, lon: float, lat: float) -> None:
        self._datum = (lat, lon)
        self._leave_tools()
        if self.form.pattern.currentData() not in FROM_DATUM:
            self.form.pattern.setCurrentIndex(self.form.pattern.findData(FROM_DATUM[0]))
        self._show_places()
        self._edited()

    def clear(self) -> None:
        """Begin with nothing: shape, places and result; the settings stay."""
        self.preview.stop()
        self._taken = self._home = self._datum = self._facts = None
        self.tool.set_corners(())
        self.overlay.clear()
        self.save_button.setEnabled(False)
        self._say_what_is_missing()

    def _show_places(self) -> None:
        home, datum = self._home, self._datum
        if home is None and self._facts is not None and self._facts.get("home"):
            home = tuple(self._facts["home"])
        features = [] if home is None else [place_feature("home", home)]
        if datum is not None and self.form.pattern.currentData() in FROM_DATUM:
            features.append(place_feature("datum", datum))
        self.overlay.set_features("places", features)

    # planning

    def _drawn(self) -> None:
        if self.tool.corners:
            self._taken = None
        self._edited()

    def _edited(self) -> None:
        self._ask_cameras()
        if not self.tool.begun:
            self.tool.is_line = self.form.pattern.currentData() in NEED_A_LINE
        if (missing := self._missing()) is not None:
            self.preview.stop()
            self._no_plan(missing)
            return
        self.preview.want(self._request)

    def _request(self) -> PlanRequest | None:
        """The request with its files; what cannot be planned with is said, and None is returned."""
        try:
            request = self.form.request()
            avoid = self.form.avoid.currentLayer()
            zones = every(avoid) if avoid is not None else None
        except (UnusableFieldError, UnusableLayerError) as error:
            self._failed(str(error))
            return None
        area = self._area()
        return replace(
            request,
            area=self.preview.keep("area.geojson", area.geojson()) if area is not None else "",
            avoid=self.preview.keep("avoid.geojson", zones.geojson()) if zones is not None and zones.geometries else "",
            home_lat_lon=self._home,
            datum_lat_lon=self._datum,
        )

    def _area(self) -> Taken | None:
        if self._taken is not None:
            return self._taken
        return _shape(self.tool.corners, is_line=self.tool.is_line) if self.tool.corners else None

    def _missing(self) -> str | None:
        pattern = self.form.pattern.currentData()
        if pattern in FROM_DATUM:
            return None if self._datum is not None else tr("Set the search's datum by a click on the map.")
        if pattern in NEED_A_LINE:
            has = self._taken is not None or (self.tool.is_line and self.tool.corners)
            return None if has else tr("Draw the line to fly along, or take the selected feature of a line layer.")
        has = self._taken is not None or (not self.tool.is_line and self.tool.corners)
        return None if has else tr("Draw the area to fly over, or take the selected feature of a polygon layer.")

    def _say_what_is_missing(self) -> None:
        self._no_plan(self._missing() or "")

    def _no_plan(self, words: str) -> None:
        self._facts = None
        self.overlay.clear([k for k in self.overlay.layers if k != "places"])
        self.words.setText(words)
        self.warnings.clear()
        self.save_button.setEnabled(False)
        self.vehicle.set_sorties(1)

    def _planned(self, facts: dict, drawing: dict) -> None:
        self._facts, self._last_failure = facts, ""
        self.overlay.show(by_layer(drawing))
        self._show_places()
        self.words.setText(summary_html(facts))
        self.warnings.setText(warnings_html(facts["warnings"]))
        self.save_button.setEnabled(True)
        self.vehicle.set_sorties(len(facts["sorties"]))

    def _failed(self, message: str) -> None:
        self._no_plan("")
        message = in_the_docks_words(message)
        self.words.setText(html.escape(message))
        if message != self._last_failure:  # a corner that is dragged need not say the same again and again
            self._messages.fail(message)
        self._last_failure = message

    def _ask_cameras(self) -> None:
        if self._asked_cameras:
            return
        self._asked_cameras = True
        job = self._start("cameras", {})
        if job is not None:
            job.finished.connect(self._cameras_known)
            job.failed.connect(self._no_cameras)

    def _cameras_known(self, result: dict) -> None:
        if not self._released:
            self.form.set_cameras(result.get("cameras", []))

    def _no_cameras(self, words: str) -> None:
        self._asked_cameras = False
        if not self._released:
            self._messages.log(words)  # the plan's job says the same, aloud

    def showEvent(self, event) -> None:
        """Fill the list of cameras when the dock is seen for the first time."""
        super().showEvent(event)
        self._ask_cameras()

    # files and the vehicle

    def save(self, path: str = "") -> None:
        """Write the plan as the file's name asks; several sorties become several files where the format has one."""
        if not path:
            chosen, kind = QFileDialog.getSaveFileName(
                self, tr("Save the plan"), str(default_folder(load_settings())), ";;".join(k for k, _ in FILE_KINDS)
            )
            if not chosen:
                return
            ending = dict(FILE_KINDS).get(kind, ".plan")
            known = tuple(e for _, e in FILE_KINDS)
            path = chosen if chosen.lower().endswith(known) else chosen + ending
        self._write(path, self._saved)

    def _write(self, path: str, done) -> None:
        request = self._request() if self._missing() is None else None
        if request is None or self._saving is not None:
            return
        job = self._start("plan", request.arguments(output=path))
        if job is None:
            return
        self._saving = job
        self.save_button.setEnabled(False)
        job.finished.connect(lambda result: self._written(lambda: done(result)))
        job.failed.connect(lambda message: self._written(lambda: self._messages.fail(message)))

    def _written(self, tell) -> None:
        if self._released:
            return
        self._saving = None
        self.save_button.setEnabled(self._facts is not None)
        tell()

    def _saved(self, result: dict) -> None:
        self._messages.info(tr("Saved: {}").format(", ".join(result["files"])))

    def _upload(self) -> None:
        if (missing := self._missing()) is not None:
            self._messages.fail(missing)
            return
        self._write(str(self.preview.folder / "upload.plan"), self._ready_to_upload)

    def _ready_to_upload(self, result: dict) -> None:
        plans = [f for f in result["files"] if f.endswith(".plan")]
        sortie = max(self.vehicle.sortie.currentIndex(), 0)
        if sortie >= len(plans):
            self._messages.fail(tr("The plan has {} sorties now: choose which one to upload.").format(len(plans)))
            self.vehicle.set_sorties(len(plans))
            return
        self.vehicle.upload(plans[sortie])

    # the project

    def _project_cleared(self) -> None:
        if self._facts is not None or self._home is not None:
            self._edited() if self._missing() is None else self._show_places()


def _shape(corners, *, is_line: bool) -> Taken:
    points = [QgsPointXY(x, y) for x, y in corners]
    geometry = QgsGeometry.fromPolylineXY(points) if is_line else QgsGeometry.fromPolygonXY([points])
    return Taken((geometry,))


def _button(text: str, name: str, slot, *, checkable: bool = False) -> QPushButton:
    button = QPushButton(text)
    button.setObjectName(f"planner_{name}")
    button.setCheckable(checkable)
    button.clicked.connect(lambda *_: slot())
    return button
