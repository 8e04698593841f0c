"""The dock "Photo map": a new map from files, with its progress, and the missions that were open last."""

from __future__ import annotations

from pathlib import Path

from qgis.core import QgsProject
from qgis.gui import QgsCollapsibleGroupBox
from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtWidgets import (
    QDockWidget,
    QFileDialog,
    QFrame,
    QLabel,
    QPushButton,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from ..export_dialog import ExportDialog
from ..job_bar import JobBar
from ..layers import add_mission, map_layers, zoom_to
from ..mission import MissionError, MissionFiles, read_mission
from ..scrolling import narrow_no_further
from ..settings import default_folder, load_settings, remember_mission
from ..stepwise import Stepwise
from ..translation import tr
from .map_form import MapForm
from .recent import RecentMissions

MOST_WARNINGS = 2


class MainDock(QDockWidget):
    """Starts jobs of the engine and shows what they made; one map at a time."""

    def __init__(self, context) -> None:
        super().__init__(context.iface.mainWindow())
        self._context = context
        self._stepwise: Stepwise | None = None
        self._export: ExportDialog | None = None
        self._folder = ""
        self._document: dict | None = None
        """What was told of a map that is made, while what goes with it is still being written."""
        self.form = MapForm(load_settings(), self)
        self.start_button = QPushButton(tr("&Make the map"), self)
        self.start_button.clicked.connect(self.start)
        self.words = QLabel(self)
        self.words.setWordWrap(True)
        self.jobs = JobBar(self)
        self.jobs.done.connect(self._job_done)
        self.jobs.failed.connect(self._job_failed)
        self.jobs.cancelled.connect(self._job_cancelled)
        self.recent = RecentMissions(self)
        self.recent.open_asked.connect(self.show_mission)
        self.recent.export_asked.connect(self.export)
        self.recent.georeference_asked.connect(self._georeference)
        self.recent.browse_asked.connect(self._browse)
        self.help_link = QLabel(f'<a href="help">{tr("Help")}</a>', self)
        self.help_link.setTextInteractionFlags(Qt.TextInteractionFlag.LinksAccessibleByMouse
                                               | Qt.TextInteractionFlag.LinksAccessibleByKeyboard)  # fmt: skip
        self.help_link.linkActivated.connect(lambda _: context.show_help())
        self.form.changed.connect(self._judge)
        self._lay_out()
        self._judge()

    def start(self) -> None:
        """Have the engine make the map that the form describes."""
        problem = self.form.problem()
        if problem or self.jobs.busy:
            self._context.messages.fail(problem or tr("A map is being made: wait for it, or cancel it."))
            return
        settings = load_settings()
        self._folder = self.form.folder()
        self.jobs.watch(self._context.engine.start("map", self.form.arguments(settings)), tr("Starting the engine…"))
        self._judge()

    def show_mission(self, folder: str) -> None:
        """Add a mission's layers to the project, a layer a turn of the event loop, and zoom to its map."""
        try:
            mission = read_mission(folder)
        except MissionError as error:
            self._context.messages.fail(str(error))
            self.recent.reload()
            return
        remember_mission(folder)
        self.recent.reload()
        if self._stepwise is not None:
            self._stepwise.stop()
        self._stepwise = Stepwise(
            add_mission(mission, QgsProject.instance()),
            lambda group: self._shown(mission, group),
            lambda error: self._not_shown(error),
            self,
        )

    def export(self, folder: str) -> None:
        """Open the export dialog for a mission."""
        if self._export is None:
            self._export = ExportDialog(self._context)
        self._export.begin(folder)

    def release(self) -> None:
        """End what runs and close what is open."""
        self.jobs.release()
        if self._stepwise is not None:
            self._stepwise.stop()
        if self._export is not None:
            self._export.release()
            self._export.deleteLater()
            self._export = None

    def _job_done(self, document: object) -> None:
        document = document if isinstance(document, dict) else {}
        if "registrations" in document:  # the map itself: now what can be drawn over it
            self._document = document
            folder = str(document.get("mission") or self._folder)
            self._folder = folder
            remember_mission(folder)
            job = self._context.engine.start("export", {"mission": folder, "vectors": True})
            self.jobs.watch(job, tr("Writing track and footprints…"))
            return
        self._show_made()

    def _job_failed(self, words: str) -> None:
        self._context.messages.fail(words)
        self._show_made()

    def _job_cancelled(self) -> None:
        if self._document is None:
            self._context.messages.info(tr("Stopped. The same photos into the same folder go on from there."))
        self._show_made()

    def _show_made(self) -> None:
        """Show the map that was made, where one was: without its track, should that have failed."""
        document, self._document = self._document, None
        self._judge()
        self.recent.reload()
        if document is not None:
            self._tell(document)
            self.show_mission(self._folder)

    def _tell(self, document: dict) -> None:
        frames = document.get("frames", {})
        placed = frames.get("registered", 0) + frames.get("gps_only", 0)
        self._context.messages.info(tr("{} of {} frames are in the map.").format(placed, frames.get("total", 0)))
        warnings = [str(w) for w in document.get("warnings", [])]
        for warning in warnings[:MOST_WARNINGS]:
            self._context.messages.warn(warning)
        for warning in warnings[MOST_WARNINGS:]:
            self._context.messages.log(warning)
        if len(warnings) > MOST_WARNINGS:
            more = tr("{} more warnings stand in the log panel “photomap”.")
            self._context.messages.warn(more.format(len(warnings) - MOST_WARNINGS))

    def _shown(self, mission: MissionFiles, group) -> None:
        layers = map_layers(mission.folder, QgsProject.instance())
        if layers:
            self._context.iface.setActiveLayer(layers[0])
            zoom_to(layers[0], self._context.iface.mapCanvas())
        if not mission.georeferenced:
            self._context.messages.warn(
                tr("“{}” has no place on Earth: pick two points of it in the dock “Georeference”.").format(mission.name)
            )

    def _not_shown(self, error: Exception) -> None:
        if isinstance(error, RuntimeError):  # the group was removed while it was being filled
            return
        if not isinstance(error, MissionError):
            raise error
        self._context.messages.fail(str(error))

    def _georeference(self, folder: str) -> None:
        self._context.open_dock("georeference").choose(folder)

    def _browse(self) -> None:
        start = str(default_folder(load_settings()))
        folder = QFileDialog.getExistingDirectory(self, tr("Choose a mission's folder"), start)
        if folder:
            self.show_mission(folder)

    def _judge(self) -> None:
        problem = self.form.problem()
        self.start_button.setEnabled(not problem and not self.jobs.busy)
        if not problem and (Path(self.form.folder()) / "mission.json").is_file():
            problem = tr("There is a mission in this folder: the same photos go on where it stopped.")
        self.words.setText("" if self.jobs.busy else problem)
        self.words.setVisible(bool(self.words.text()))

    def _lay_out(self) -> None:
        inside = QWidget(self)
        make = QgsCollapsibleGroupBox(tr("New map"), inside)
        make.setObjectName("photomapNewMap")
        column = QVBoxLayout(make)
        for part in (self.form, self.words, self.start_button, self.jobs):
            column.addWidget(part)
        missions = QgsCollapsibleGroupBox(tr("Recent missions"), inside)
        missions.setObjectName("photomapRecent")
        QVBoxLayout(missions).addWidget(self.recent)
        layout = QVBoxLayout(inside)
        layout.addWidget(make)
        layout.addWidget(missions)
        layout.addWidget(self.help_link)
        layout.addStretch(1)
        scroll = QScrollArea(self)
        scroll.setWidgetResizable(True)
        scroll.setFrameShape(QFrame.Shape.NoFrame)
        scroll.setWidget(inside)
        narrow_no_further(scroll)
        self.setWidget(scroll)
