"""The page "photomap" of QGIS's options: where the engine is, and how it is run."""

from __future__ import annotations

from qgis.gui import QgsFileWidget, QgsOptionsPageWidget, QgsOptionsWidgetFactory
from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import QCheckBox, QFormLayout, QLabel, QPushButton, QSpinBox, QVBoxLayout

from .settings import Settings, load_settings, save_settings
from .translation import tr


class OptionsFactory(QgsOptionsWidgetFactory):
    """Makes the page when the options dialog opens."""

    def __init__(self, icon: QIcon) -> None:
        super().__init__("photomap", icon)
        self._icon = icon

    def icon(self) -> QIcon:
        """Return the page's icon."""
        return self._icon

    def createWidget(self, parent) -> OptionsPage:
        """Return a new page."""
        return OptionsPage(parent)


class OptionsPage(QgsOptionsPageWidget):
    """Where the engine is (empty: it is looked for on the path), whether it stays, its memory, the missions' folder."""

    def __init__(self, parent=None) -> None:
        super().__init__(parent)
        self.setObjectName("photomapOptions")
        settings = load_settings()
        self.engine = QgsFileWidget(self)
        self.engine.setStorageMode(QgsFileWidget.StorageMode.GetFile)
        self.engine.setFilePath(settings.engine_path)
        self.environment = QgsFileWidget(self)
        self.environment.setStorageMode(QgsFileWidget.StorageMode.GetDirectory)
        self.environment.setFilePath(settings.environment)
        self.folder = QgsFileWidget(self)
        self.folder.setStorageMode(QgsFileWidget.StorageMode.GetDirectory)
        self.folder.setFilePath(settings.folder)
        self.memory = QSpinBox(self)
        self.memory.setRange(0, 1_000_000)
        self.memory.setSingleStep(128)
        self.memory.setSuffix(" MB")
        self.memory.setSpecialValueText(tr("the engine's default"))
        self.memory.setValue(settings.memory_mb)
        self.stay = QCheckBox(tr("&Leave the engine running when QGIS closes"), self)
        self.stay.setChecked(settings.stay)
        self.test = QPushButton(tr("&Find the engine"), self)
        self.test.clicked.connect(self._find)
        self.found = QLabel(self)
        self.found.setWordWrap(True)
        self.found.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)

        form = QFormLayout()
        form.addRow(tr("&Environment of the engine"), self.environment)
        form.addRow(tr("or the &program itself"), self.engine)
        form.addRow(self.test, self.found)
        form.addRow(tr("&Memory while a map is drawn"), self.memory)
        form.addRow(tr("F&older of new missions"), self.folder)
        form.addRow(self.stay)
        layout = QVBoxLayout(self)
        layout.addLayout(form)
        layout.addStretch(1)

    def apply(self) -> None:
        """Keep what is shown; QGIS calls this when the dialog is accepted."""
        save_settings(self._shown())

    def helpKey(self) -> str:
        """Return no page of QGIS's own manual: the plugin brings its help along."""
        return ""

    def _shown(self) -> Settings:
        return Settings(
            engine_path=self.engine.filePath().strip(),
            environment=self.environment.filePath().strip(),
            stay=self.stay.isChecked(),
            memory_mb=self.memory.value(),
            folder=self.folder.filePath().strip(),
        )

    def _find(self) -> None:
        from .engine import where_is_the_engine

        self.found.setText(where_is_the_engine(self._shown()))
