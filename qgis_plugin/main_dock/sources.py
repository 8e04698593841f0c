"""What a map is made of: folders of photos, photos, or videos, chosen or dropped."""

from __future__ import annotations

from pathlib import Path

from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtGui import QKeySequence
from qgis.PyQt.QtWidgets import (
    QAbstractItemView,
    QFileDialog,
    QHBoxLayout,
    QListWidget,
    QPushButton,
    QShortcut,
    QVBoxLayout,
    QWidget,
)

from ..translation import tr

PICTURES = "*.jpg *.jpeg *.tif *.tiff *.png"
VIDEOS = "*.mp4 *.mov *.m4v *.avi *.mkv *.ts *.mts *.m2ts *.mpg *.mpeg *.webm"
ROWS = 4


class SourceList(QWidget):
    """The list of sources, with buttons to add and remove; files and folders may be dropped on it."""

    changed = pyqtSignal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAcceptDrops(True)
        self._last = ""
        self.list = QListWidget(self)
        self.list.setAccessibleName(tr("Photos or video"))
        self.list.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.list.setTextElideMode(Qt.TextElideMode.ElideLeft)
        self.list.setFixedHeight(self.list.fontMetrics().height() * (ROWS + 1))
        self.folder_button = QPushButton(tr("Photo &folder…"), self)
        self.files_button = QPushButton(tr("Photos or &video…"), self)
        self.remove_button = QPushButton(tr("&Remove"), self)
        self.folder_button.clicked.connect(self._choose_folder)
        self.files_button.clicked.connect(self._choose_files)
        self.remove_button.clicked.connect(self.remove_selected)
        delete = QShortcut(QKeySequence(QKeySequence.StandardKey.Delete), self.list)
        delete.setContext(Qt.ShortcutContext.WidgetShortcut)
        delete.activated.connect(self.remove_selected)
        row = QHBoxLayout()
        for button in (self.folder_button, self.files_button, self.remove_button):
            row.addWidget(button)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.list)
        layout.addLayout(row)

    def paths(self) -> list[str]:
        """Return the sources in their order."""
        return [self.list.item(k).text() for k in range(self.list.count())]

    def add(self, paths: list[str]) -> None:
        """Add sources; what is in the list already is not added again."""
        known = set(self.paths())
        for path in paths:
            if path and path not in known:
                known.add(path)
                self.list.addItem(path)
                self.list.item(self.list.count() - 1).setToolTip(path)
                self._last = str(Path(path).parent)
        self.changed.emit()

    def remove_selected(self) -> None:
        """Take the selected sources off the list, or the only one."""
        chosen = self.list.selectedItems() or ([self.list.item(0)] if self.list.count() == 1 else [])
        for item in chosen:
            self.list.takeItem(self.list.row(item))
        self.changed.emit()

    def dragEnterEvent(self, event) -> None:
        """Take files and folders of this machine."""
        if any(url.isLocalFile() for url in event.mimeData().urls()):
            event.acceptProposedAction()

    def dropEvent(self, event) -> None:
        """Add what was dropped."""
        self.add([url.toLocalFile() for url in event.mimeData().urls() if url.isLocalFile()])
        event.acceptProposedAction()

    def _choose_folder(self) -> None:
        folder = QFileDialog.getExistingDirectory(self, tr("Choose a folder of photos"), self._last)
        if folder:
            self.add([folder])

    def _choose_files(self) -> None:
        kinds = f"{tr('Photos and videos')} ({PICTURES} {PICTURES.upper()} {VIDEOS} {VIDEOS.upper()});;{tr('All')} (*)"
        files, _ = QFileDialog.getOpenFileNames(self, tr("Choose photos or videos"), self._last, kinds)
        self.add(files)
