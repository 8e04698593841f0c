"""The dock "Georeference": pairs, existing imagery, control points of a file, and nudges; the engine re-solves."""

from __future__ import annotations

from qgis.core import QgsCoordinateTransform, QgsCsException, QgsPointXY, QgsProject
from qgis.PyQt.QtWidgets import (
    QDockWidget,
    QDoubleSpinBox,
    QFormLayout,
    QFrame,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QScrollArea,
    QSpinBox,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from ..compare_dialog import file_of
from ..job_bar import JobBar
from ..layers import add_mission, map_layers, zoom_to
from ..main_dock.map_form import file_widget, raster_box
from ..mission import MissionError, MissionFiles, read_mission
from ..mission_box import MissionBox
from ..places import PlaceError, from_lonlat, metres_between, to_lonlat
from ..scrolling import narrow_no_further
from ..stepwise import Stepwise
from ..translation import tr
from .map_view import MapView
from .pair_table import PairMarks, PairTable
from .pairs import Pair, pick_arguments, solved_pairs
from .tools import NudgeTool, PickTool


class GeoreferenceDock(QDockWidget):
    """One mission at a time. Places on the map are picked in the dock's own view, places on Earth in QGIS's canvas."""

    def __init__(self, context) -> None:
        super().__init__(context.iface.mainWindow())
        self._context = context
        self._canvas = context.iface.mapCanvas()
        self._mission: MissionFiles | None = None
        self._tool: PickTool | NudgeTool | None = None
        self._stepwise: Stepwise | None = None
        self.mission = MissionBox(self)
        self.piece = QSpinBox(self)
        self.piece.setMinimum(1)
        self.view = MapView(self._picked_on_map, self)
        self.table = PairTable(self)
        self.marks = PairMarks(self._canvas, self._on_canvas)
        self.words = QLabel(self)
        self.words.setWordWrap(True)
        self.accuracy = QLabel(self)
        self.accuracy.setWordWrap(True)
        self.jobs = JobBar(self)
        self.jobs.done.connect(self._solved)
        self.jobs.failed.connect(self._failed)
        self.jobs.cancelled.connect(self._judge)
        self.pick_button = QPushButton(tr("&Pick pairs"), self)
        self.pick_button.setCheckable(True)
        self.pick_button.clicked.connect(self.pick)
        self.remove_button = QPushButton(tr("&Remove"), self)
        self.remove_button.clicked.connect(self.table.remove_selected)
        self.solve_button = QPushButton(tr("&Solve with these pairs"), self)
        self.solve_button.clicked.connect(self.solve)
        self.reset_button = QPushButton(tr("&Forget picks and nudges"), self)
        self.reset_button.clicked.connect(lambda: self._start("georeference", {"reset": True}))
        self.reference = raster_box(self, tr("choose a raster layer"))
        self.reference_sigma_m = _metres(self, 0.0, 1000.0)
        self.reference_sigma_m.setSpecialValueText(tr("one of its pixels"))
        self.reference_button = QPushButton(tr("&Lay the map on it"), self)
        self.reference_button.clicked.connect(self.lay_on_reference)
        self.gcp = file_widget(self, tr("Control points") + " (*.txt *.csv *.TXT *.CSV);;" + tr("All") + " (*)")
        self.check = QLineEdit(self)
        self.check.setPlaceholderText(tr("names with commas, or every-third"))
        self.gcp_button = QPushButton(tr("Solve with &these points"), self)
        self.gcp_button.clicked.connect(self.solve_with_points)
        self.east_m, self.north_m = _metres(self, -1e5, 1e5), _metres(self, -1e5, 1e5)
        self.turn_deg = QDoubleSpinBox(self)
        self.turn_deg.setRange(-180.0, 180.0)
        self.turn_deg.setSuffix(" °")
        self.drag_button = QPushButton(tr("&Drag the map…"), self)
        self.drag_button.setCheckable(True)
        self.drag_button.clicked.connect(self.drag)
        self.nudge_button = QPushButton(tr("&Move the map"), self)
        self.nudge_button.clicked.connect(self.nudge)
        self._lay_out()
        self.mission.changed.connect(self._read)
        self.piece.valueChanged.connect(lambda _: self._show_piece())
        self.table.changed.connect(self._judge)
        self.gcp.fileChanged.connect(lambda _: self._judge())
        self.reference.layerChanged.connect(lambda _: self._judge())
        for box in (self.east_m, self.north_m, self.turn_deg):
            box.valueChanged.connect(lambda _: self._judge())
        self._canvas.destinationCrsChanged.connect(self._mark)
        self._read(self.mission.folder())

    def choose(self, folder: str) -> None:
        """Take up a mission."""
        self.mission.choose(folder)
        self._read(folder)

    def pick(self, on: bool = True) -> None:
        """Have clicks in QGIS's canvas pick places on Earth, or end that."""
        self._take_tool(PickTool(self._canvas, self._picked_on_earth, self._tool_ended) if on else None)
        self.pick_button.setChecked(on)

    def drag(self, on: bool = True) -> None:
        """Have a drag in QGIS's canvas say where the map belongs, or end that."""
        layers = [] if self._mission is None else map_layers(self._mission.folder, QgsProject.instance())
        if on and not layers:
            self._context.messages.warn(tr("Add the mission to the project first: there is no map to drag."))
            on = False
        tool = None
        if on:
            project = QgsProject.instance()
            change = QgsCoordinateTransform(layers[0].crs(), self._canvas.mapSettings().destinationCrs(), project)
            try:
                outline = change.transformBoundingBox(layers[0].extent())
            except QgsCsException:
                outline = self._canvas.extent()
            tool = NudgeTool(self._canvas, outline, self._dragged, self._tool_ended)
        self._take_tool(tool)
        self.drag_button.setChecked(on)

    def solve(self) -> None:
        """Have the engine solve with the pairs of the table, and no others that it was told before."""
        try:
            arguments = pick_arguments(self.table.pairs)
        except ValueError as error:
            self._failed(str(error))
            return
        self._start("georeference", {**arguments, "piece": self.piece.value(), "reset": True})

    def lay_on_reference(self) -> None:
        """Have the engine find the frames in existing imagery."""
        file = file_of(self.reference.currentLayer())
        if file:
            sigma_m = self.reference_sigma_m.value() or None
            self._start("reference", {"references": [file], "reference_sigma": sigma_m})

    def solve_with_points(self) -> None:
        """Have the engine solve with the control points of a file."""
        self._start("solve", {"gcp": self.gcp.filePath(), "check": self.check.text().strip() or None})

    def nudge(self) -> None:
        """Have the engine move the map by the metres and degrees that are shown."""
        words = f"{self.east_m.value():.3f},{self.north_m.value():.3f},{self.turn_deg.value():.4f}"
        self._start("georeference", {"nudge": words})

    def release(self) -> None:
        """Give back tool and marks, end what runs."""
        self._take_tool(None)
        self.jobs.release()
        if self._stepwise is not None:
            self._stepwise.stop()
        self._canvas.destinationCrsChanged.disconnect(self._mark)
        self.marks.clear()
        self.view.release()

    def _start(self, kind: str, arguments: dict) -> None:
        if self._mission is None or self.jobs.busy:
            return
        self._take_tool(None)
        arguments = {"mission": str(self._mission.folder), **{k: v for k, v in arguments.items() if v is not None}}
        self.jobs.watch(self._context.engine.start(kind, arguments), tr("Starting the engine…"))
        self._judge()

    def _solved(self, document: object) -> None:
        document = document if isinstance(document, dict) else {}
        assert self._mission is not None
        for warning in document.get("warnings", [])[:2]:
            self._context.messages.warn(str(warning))
        self.accuracy.setText(accuracy_words(document))
        for box in (self.east_m, self.north_m, self.turn_deg):
            box.setValue(0.0)
        pairs = self.table.pairs
        self._read(str(self._mission.folder), keep=True)
        if self._mission is None:
            return
        self.table.show_pairs(solved_pairs(pairs, document.get("control"), self.view.crs()))
        self._judge()
        project, mission = QgsProject.instance(), self._mission
        if self._stepwise is not None:
            self._stepwise.stop()
        self._stepwise = Stepwise(add_mission(mission, project), lambda _: self._shown(mission), self._not_shown, self)

    def _shown(self, mission: MissionFiles) -> None:
        layers = map_layers(mission.folder, QgsProject.instance())
        if layers and mission.georeferenced:
            zoom_to(layers[0], self._canvas)
        self._context.messages.info(tr("The map lies anew: {}").format(mission.maps[0].statement))

    def _not_shown(self, error: Exception) -> None:
        if isinstance(error, RuntimeError):  # the group was removed while it was being filled
            return
        if not isinstance(error, MissionError):
            raise error
        self._failed(str(error))

    def _failed(self, words: str) -> None:
        self._context.messages.fail(words)
        self._judge()

    def _read(self, folder: str, keep: bool = False) -> None:
        self._mission = None
        if not keep:
            self.table.show_pairs([])
            self.accuracy.setText("")
        words = tr("Choose a mission.")
        if folder:
            try:
                self._mission = read_mission(folder)
                words = self._mission.title
            except MissionError as error:
                words = str(error)
        self.words.setText(words)
        count = 1 if self._mission is None else len(self._mission.maps)
        self.piece.setMaximum(count)
        self.piece.setEnabled(count > 1)
        self._show_piece()
        self._judge()

    def _show_piece(self) -> None:
        found = None if self._mission is None else self._mission.maps[self.piece.value() - 1]
        self.view.show_map(found)
        self._mark()

    def _picked_on_map(self, point: QgsPointXY) -> None:
        self.table.place(map_xy=(point.x(), point.y()))

    def _picked_on_earth(self, point: QgsPointXY) -> None:
        try:
            lonlat = to_lonlat(point, self._canvas.mapSettings().destinationCrs())
        except PlaceError as error:
            self._failed(str(error))
            return
        self.table.place(lonlat=(lonlat.x(), lonlat.y()))

    def _dragged(self, start: QgsPointXY, end: QgsPointXY) -> None:
        crs = self._canvas.mapSettings().destinationCrs()
        try:
            east_m, north_m = metres_between(to_lonlat(start, crs), to_lonlat(end, crs))
        except PlaceError as error:
            self._failed(str(error))
            return
        self.east_m.setValue(east_m)
        self.north_m.setValue(north_m)
        self.turn_deg.setValue(0.0)
        self.nudge()

    def _take_tool(self, tool: PickTool | NudgeTool | None) -> None:
        old, self._tool = self._tool, None
        if old is not None:
            if self._canvas.mapTool() is old:
                self._canvas.unsetMapTool(old)
            self._bury(old)
        self.pick_button.setChecked(False)
        self.drag_button.setChecked(False)
        if tool is not None:
            self._tool = tool
            self._canvas.setMapTool(tool)
        elif old is not None and self._canvas.mapTool() is None:
            self._context.iface.actionPan().trigger()

    def _tool_ended(self) -> None:
        """Another tool was chosen, or Esc pressed."""
        tool, self._tool = self._tool, None
        self.pick_button.setChecked(False)
        self.drag_button.setChecked(False)
        if tool is not None:
            self._bury(tool)

    def _bury(self, tool: PickTool | NudgeTool) -> None:
        if isinstance(tool, NudgeTool):
            tool.take_off()
        tool.deleteLater()

    def _on_canvas(self, pair: Pair) -> QgsPointXY | None:
        crs = self._canvas.mapSettings().destinationCrs()
        if pair.lonlat is None or not crs.isValid():
            return None
        try:
            return from_lonlat(QgsPointXY(*pair.lonlat), crs)
        except PlaceError:
            return None

    def _mark(self) -> None:
        self.marks.show(self.table.pairs)
        self.view.marks.show(self.table.pairs)

    def _judge(self) -> None:
        self._mark()
        free = self._mission is not None and not self.jobs.busy
        placed = free and self._mission.georeferenced
        fitted = sum(p.whole and not p.check for p in self.table.pairs)
        self.solve_button.setEnabled(free and fitted >= (1 if placed else 2))
        self.pick_button.setEnabled(free)
        self.reset_button.setEnabled(free)
        self.reference_button.setEnabled(free and bool(file_of(self.reference.currentLayer())))
        self.gcp_button.setEnabled(free and bool(self.gcp.filePath().strip()))
        self.drag_button.setEnabled(placed)
        moved = any(box.value() for box in (self.east_m, self.north_m, self.turn_deg))
        self.nudge_button.setEnabled(placed and moved)

    def _lay_out(self) -> None:
        inside = QWidget(self)
        top = QFormLayout()
        top.addRow(tr("M&ission"), self.mission)
        top.addRow(tr("Pie&ce"), self.piece)
        tabs = QTabWidget(inside)
        hint = QLabel(tr("Click a place in the map above, and the same place in the QGIS window."), tabs)
        hint.setWordWrap(True)
        pairs = _column(tabs, hint, self.table, _row(self.pick_button, self.remove_button), self.solve_button)
        tabs.addTab(pairs, tr("Pairs"))
        imagery = _form(tabs, (tr("&Imagery"), self.reference), (tr("Its own error (si&gma)"), self.reference_sigma_m))
        imagery.layout().addRow(self.reference_button)
        tabs.addTab(imagery, tr("Imagery"))
        points = _form(tabs, (tr("Fil&e"), self.gcp), (tr("For the chec&k"), self.check))
        points.layout().addRow(self.gcp_button)
        tabs.addTab(points, tr("Points"))
        hand = _form(tabs, (tr("&East"), self.east_m), (tr("&North"), self.north_m), (tr("Cloc&kwise"), self.turn_deg))
        hand.layout().addRow(_row(self.drag_button, self.nudge_button))
        tabs.addTab(hand, tr("By hand"))
        layout = QVBoxLayout(inside)
        layout.addLayout(top)
        for part in (self.words, self.view):
            layout.addWidget(part)
        layout.addWidget(tabs)
        for part in (self.accuracy, self.jobs, self.reset_button):
            layout.addWidget(part)
        scroll = QScrollArea(self)
        scroll.setWidgetResizable(True)
        scroll.setFrameShape(QFrame.Shape.NoFrame)
        scroll.setWidget(inside)
        narrow_no_further(scroll)
        self.setWidget(scroll)


def accuracy_words(document: dict) -> str:
    """Return what a solution says of its accuracy: tested by check points, else predicted (residuals are none)."""
    words = []
    tested, predicted = document.get("accuracy"), document.get("predicted_ce90_m")
    if tested:
        words.append(tr("CE90 {} m, tested by {} check point(s).").format(f"{tested['ce90_m']:.2f}", tested["n"]))
    elif predicted is not None:
        words.append(tr("CE90 {} m, predicted; only check points can test it.").format(f"{predicted:.2f}"))
    residual = (document.get("control") or {}).get("residual_rms_m")
    if residual is not None:
        words.append(tr("Residual of the fit: {} m (not the accuracy).").format(f"{residual:.2f}"))
    return " ".join(words)


def _metres(parent: QWidget, low: float, high: float) -> QDoubleSpinBox:
    box = QDoubleSpinBox(parent)
    box.setRange(low, high)
    box.setDecimals(2)
    box.setSuffix(" m")
    return box


def _row(*widgets: QWidget) -> QWidget:
    holder = QWidget()
    layout = QHBoxLayout(holder)
    layout.setContentsMargins(0, 0, 0, 0)
    for widget in widgets:
        layout.addWidget(widget)
    return holder


def _column(parent: QWidget, *widgets: QWidget) -> QWidget:
    holder = QWidget(parent)
    layout = QVBoxLayout(holder)
    for widget in widgets:
        layout.addWidget(widget)
    return holder


def _form(parent: QWidget, *rows: tuple[str, QWidget]) -> QWidget:
    holder = QWidget(parent)
    layout = QFormLayout(holder)
    for words, widget in rows:
        layout.addRow(words, widget)
    return holder
