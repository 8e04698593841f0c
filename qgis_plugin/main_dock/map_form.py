"""The form of a new map: sources, where it goes, and the options that matter; it becomes the arguments of a job."""

from __future__ import annotations

from pathlib import Path

from qgis.core import QgsMapLayerProxyModel
from qgis.gui import QgsCollapsibleGroupBox, QgsFileWidget, QgsMapLayerComboBox, QgsProjectionSelectionWidget
from qgis.PyQt.QtCore import pyqtSignal
from qgis.PyQt.QtWidgets import QCheckBox, QComboBox, QDoubleSpinBox, QFormLayout, QLineEdit, QVBoxLayout, QWidget

from ..compare_dialog import file_of
from ..settings import Settings, default_folder, load_settings
from ..translation import tr
from .sources import VIDEOS, SourceList

TRACKS = "*.srt *.gpx *.csv *.tlog *.bin *.ulg *.klv *.SRT *.GPX *.CSV *.BIN"


class MapForm(QWidget):
    """What the user says of a new map; ``changed`` after every change."""

    changed = pyqtSignal()

    def __init__(self, settings: Settings, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._proposed = ""
        self.sources = SourceList(self)
        self.track = file_widget(self, tr("Track logs") + f" ({TRACKS});;" + tr("All") + " (*)")
        self.output = QgsFileWidget(self)
        self.output.setStorageMode(QgsFileWidget.StorageMode.GetDirectory)
        self.output.lineEdit().setPlaceholderText(str(default_folder(settings)))
        self.gsd_cm = QDoubleSpinBox(self)
        self.gsd_cm.setRange(0.0, 1000.0)
        self.gsd_cm.setDecimals(1)
        self.gsd_cm.setSuffix(" cm")
        self.gsd_cm.setSpecialValueText(tr("as fine as the camera saw"))
        self.prefer = QComboBox(self)
        for value, words in (
            ("", tr("the frame that looks down most steeply")),
            ("sharp", tr("the sharpest frame")),
            ("newest", tr("the newest frame")),
        ):
            self.prefer.addItem(words, value)
        self.crs = QgsProjectionSelectionWidget(self)
        self.crs.setOptionVisible(QgsProjectionSelectionWidget.CrsOption.CrsNotSet, True)
        self.crs.setNotSetText(tr("automatic: the UTM zone"))
        self.dem = raster_box(self, tr("found from the pictures"))
        self.reference = raster_box(self, tr("none: the positions of the photos alone"))
        self.gcp = file_widget(self, tr("Control points") + " (*.txt *.csv *.TXT *.CSV);;" + tr("All") + " (*)")
        self.check = QLineEdit(self)
        self.check.setPlaceholderText(tr("names with commas, or every-third"))
        self.fov_deg = QDoubleSpinBox(self)
        self.fov_deg.setRange(0.0, 170.0)
        self.fov_deg.setSuffix(" °")
        self.fov_deg.setSpecialValueText(tr("known by photo or drone"))
        self.layers = QCheckBox(tr("&Layers of accuracy, age and what was searched"), self)
        self.layers.setChecked(True)
        self._lay_out()
        self.sources.changed.connect(self._propose)
        self.output.fileChanged.connect(lambda _: self.changed.emit())

    def arguments(self, settings: Settings) -> dict:
        """Return the arguments of the job ``map``; what was left as it is is not said."""
        crs = self.crs.crs()
        said = {
            "sources": self.sources.paths(),
            "output": self.folder(),
            "track": self.track.filePath(),
            "gsd": self.gsd_cm.value() / 100.0,
            "prefer": self.prefer.currentData(),
            "crs": (crs.authid() or crs.toWkt()) if crs.isValid() else "",
            "dem": file_of(self.dem.currentLayer()),
            "reference": [path for path in [file_of(self.reference.currentLayer())] if path],
            "gcp": self.gcp.filePath(),
            "check": self.check.text().strip(),
            "fov_deg": self.fov_deg.value(),
            "memory": settings.memory_mb,
        }
        return {name: value for name, value in said.items() if value} | {"layers": self.layers.isChecked()}

    def folder(self) -> str:
        """Return the mission's folder."""
        text = self.output.filePath().strip()
        return str(Path(text).expanduser()) if text else ""

    def problem(self) -> str:
        """Return what keeps the map from being started, in words; empty where nothing does."""
        if not self.sources.paths():
            return tr("Choose a folder of photos, photos, or a video.")
        gone = [path for path in self.sources.paths() if not Path(path).exists()]
        if gone:
            return tr("{} is not there: remove it, or choose it again.").format(gone[0])
        if not self.folder():
            return tr("Choose the folder in which the map is made.")
        folder = Path(self.folder())
        if folder.is_file():
            return tr("{} is a file: choose a folder for the map.").format(folder)
        if folder.is_dir() and not (folder / "mission.json").is_file() and any(folder.iterdir()):
            return tr("{} holds other files: choose a new or empty folder for the map.").format(folder)
        for box in (self.dem, self.reference):
            layer = box.currentLayer()
            if layer is not None and not file_of(layer):
                return tr("The layer “{}” is no file on this machine: export it as a GeoTIFF first.").format(
                    layer.name()
                )
        return ""

    def _propose(self) -> None:
        """Offer a new folder named after the first source, as long as the user has not chosen one."""
        paths = self.sources.paths()
        if paths and self.output.filePath().strip() in ("", self._proposed):
            first = Path(paths[0])
            video = f"*{first.suffix.lower()}" in VIDEOS.split()
            name = first.name if first.is_dir() else first.stem if video else first.parent.name
            self._proposed = str(free_folder(default_folder(load_settings()), name or "map"))
            self.output.setFilePath(self._proposed)
        self.changed.emit()

    def _lay_out(self) -> None:
        form = QFormLayout()
        form.addRow(self.sources)
        form.addRow(tr("&Track log"), self.track)
        form.addRow(tr("Map f&older"), self.output)
        more = QgsCollapsibleGroupBox(tr("Options"), self)
        more.setCollapsed(True)
        more.setObjectName("photomapMapOptions")
        inside = QFormLayout(more)
        inside.addRow(tr("&Pixel of the map"), self.gsd_cm)
        inside.addRow(tr("&Show"), self.prefer)
        inside.addRow(tr("C&RS"), self.crs)
        inside.addRow(tr("&Elevation model"), self.dem)
        inside.addRow(tr("Lay on &imagery"), self.reference)
        inside.addRow(tr("&Ground control"), self.gcp)
        inside.addRow(tr("Chec&k points"), self.check)
        inside.addRow(tr("Field of vie&w"), self.fov_deg)
        inside.addRow(self.layers)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addLayout(form)
        layout.addWidget(more)


def file_widget(parent: QWidget, kinds: str) -> QgsFileWidget:
    """Return a widget for one file that may be left empty."""
    widget = QgsFileWidget(parent)
    widget.setStorageMode(QgsFileWidget.StorageMode.GetFile)
    widget.setFilter(kinds)
    widget.lineEdit().setPlaceholderText(tr("none"))
    return widget


def raster_box(parent: QWidget, none: str) -> QgsMapLayerComboBox:
    """Return a list of the project's raster layers with a first entry for none of them."""
    box = QgsMapLayerComboBox(parent)
    box.setFilters(QgsMapLayerProxyModel.Filter.RasterLayer)
    box.setAllowEmptyLayer(True, none)
    box.setCurrentIndex(0)
    box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
    box.setMinimumContentsLength(12)
    return box


def free_folder(parent: Path, name: str) -> Path:
    """Return ``parent / name``, or with a number behind it where that is taken."""
    if not (parent / name).exists():
        return parent / name
    return next(parent / f"{name}-{n}" for n in range(2, 10**6) if not (parent / f"{name}-{n}").exists())
