"""A mission to choose: the recent ones, or any other folder."""

from __future__ import annotations

from pathlib import Path

from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtWidgets import QComboBox, QFileDialog, QHBoxLayout, QPushButton, QWidget

from .settings import default_folder, load_settings, recent_missions, remember_mission
from .translation import tr


class MissionBox(QWidget):
    """A list of missions; ``changed`` carries the folder of the one that is chosen, empty for none."""

    changed = pyqtSignal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.list = QComboBox(self)
        self.list.setAccessibleName(tr("Mission"))
        self.list.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.list.setMinimumContentsLength(14)
        self.list.currentIndexChanged.connect(lambda _: self.changed.emit(self.folder()))
        self.browse = QPushButton(tr("&Other…"), self)
        self.browse.clicked.connect(self._browse)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.list, 1)
        layout.addWidget(self.browse)
        self.reload()

    def reload(self) -> None:
        """Read the recent missions anew; the chosen one stays chosen where it is still there."""
        chosen = self.folder()
        self.list.blockSignals(True)
        self.list.clear()
        for folder in recent_missions():
            self.list.addItem(Path(folder).name, folder)
            self.list.setItemData(self.list.count() - 1, folder, Qt.ItemDataRole.ToolTipRole)
        self.list.blockSignals(False)
        self.list.setCurrentIndex(max(0, self.list.findData(chosen)) if self.list.count() else -1)
        if self.folder() != chosen:
            self.changed.emit(self.folder())

    def folder(self) -> str:
        """Return the chosen mission's folder, empty for none."""
        return str(self.list.currentData() or "")

    def choose(self, folder: str) -> None:
        """Choose a mission, put at the head of the recent ones."""
        folder = remember_mission(folder)[0]
        self.reload()
        self.list.setCurrentIndex(self.list.findData(folder))

    def _browse(self) -> None:
        start = self.folder() or str(default_folder(load_settings()))
        folder = QFileDialog.getExistingDirectory(self, tr("Choose a mission's folder"), start)
        if folder:
            self.choose(folder)
