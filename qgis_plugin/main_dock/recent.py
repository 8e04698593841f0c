"""The missions that were open last: show them again, export, georeference, forget."""

from __future__ import annotations

from pathlib import Path

from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtWidgets import QHBoxLayout, QListWidget, QListWidgetItem, QPushButton, QVBoxLayout, QWidget

from ..settings import forget_mission, recent_missions
from ..translation import tr

ROWS = 6


class RecentMissions(QWidget):
    """A list of missions; its signals carry the folder of the chosen one."""

    open_asked = pyqtSignal(str)
    export_asked = pyqtSignal(str)
    georeference_asked = pyqtSignal(str)
    browse_asked = pyqtSignal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.list = QListWidget(self)
        self.list.setAccessibleName(tr("Recent missions"))
        self.list.setFixedHeight(self.list.fontMetrics().height() * (ROWS + 1))
        self.list.itemActivated.connect(lambda item: self.open_asked.emit(item.data(Qt.ItemDataRole.UserRole)))
        self.open_button = QPushButton(tr("&Add to project"), self)
        self.export_button = QPushButton(tr("E&xport…"), self)
        self.georeference_button = QPushButton(tr("&Georeference…"), self)
        self.forget_button = QPushButton(tr("Forg&et"), self)
        self.browse_button = QPushButton(tr("Other &mission…"), self)
        self.open_button.clicked.connect(lambda: self.open_asked.emit(self.folder()))
        self.export_button.clicked.connect(lambda: self.export_asked.emit(self.folder()))
        self.georeference_button.clicked.connect(lambda: self.georeference_asked.emit(self.folder()))
        self.forget_button.clicked.connect(self._forget)
        self.browse_button.clicked.connect(self.browse_asked)
        self.list.currentRowChanged.connect(lambda _: self._judge())
        first, second = QHBoxLayout(), QHBoxLayout()
        for button in (self.open_button, self.export_button, self.georeference_button):
            first.addWidget(button)
        for button in (self.browse_button, self.forget_button):
            second.addWidget(button)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.list)
        layout.addLayout(first)
        layout.addLayout(second)
        self.reload()

    def folder(self) -> str:
        """Return the chosen mission's folder, empty for none."""
        item = self.list.currentItem()
        return "" if item is None else item.data(Qt.ItemDataRole.UserRole)

    def reload(self) -> None:
        """Read the list anew; the first one is chosen."""
        self.list.clear()
        for folder in recent_missions():
            item = QListWidgetItem(Path(folder).name, self.list)
            item.setToolTip(folder)
            item.setData(Qt.ItemDataRole.UserRole, folder)
        self.list.setCurrentRow(0 if self.list.count() else -1)
        self._judge()

    def _forget(self) -> None:
        forget_mission(self.folder())
        self.reload()

    def _judge(self) -> None:
        chosen = bool(self.folder())
        for button in (self.open_button, self.export_button, self.georeference_button, self.forget_button):
            button.setEnabled(chosen)
