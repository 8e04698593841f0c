"""The export dialog: every format of the engine, part of the map, CRS and pixel; the engine writes."""

from __future__ import annotations

from pathlib import Path

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsCsException,
    QgsMapLayerProxyModel,
    QgsProject,
    QgsRasterLayer,
    QgsVectorFileWriter,
    QgsVectorLayer,
)
from qgis.gui import QgsFileWidget, QgsMapLayerComboBox, QgsProjectionSelectionWidget
from qgis.PyQt.QtCore import Qt, QTemporaryDir, QUrl
from qgis.PyQt.QtGui import QDesktopServices
from qgis.PyQt.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QDoubleSpinBox,
    QFormLayout,
    QLabel,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QVBoxLayout,
)

from .compare_dialog import file_of
from .formats import COMPRESSIONS, TILE_FORMATS, formats
from .job_bar import JobBar
from .layers import reopen
from .main_dock.map_form import raster_box
from .mission import MissionError, read_mission
from .mission_box import MissionBox
from .styles import style_map
from .translation import tr

SHOWN = frozenset({".tif"})
"""Outputs that are added to the project where the user wants that: the map once, not in every format of it."""
WGS84 = "EPSG:4326"


class ExportDialog(QDialog):
    """Asks what is to be written where; stays open while the engine writes."""

    def __init__(self, context) -> None:
        super().__init__(context.iface.mainWindow())
        self._context = context
        self._scratch = QTemporaryDir()
        self.setObjectName("photomapExportDialog")
        self.setWindowTitle(tr("Export a photo map"))
        self.mission = MissionBox(self)
        self.formats = QListWidget(self)
        self.formats.setAccessibleName(tr("Formats"))
        for form in formats():
            item = QListWidgetItem(form.words, self.formats)
            item.setData(Qt.ItemDataRole.UserRole, form.flag)
            item.setFlags(item.flags() | Qt.ItemFlag.ItemIsUserCheckable)
            item.setCheckState(Qt.CheckState.Unchecked)
        self.folder = QgsFileWidget(self)
        self.folder.setStorageMode(QgsFileWidget.StorageMode.GetDirectory)
        self.crs = QgsProjectionSelectionWidget(self)
        self.crs.setOptionVisible(QgsProjectionSelectionWidget.CrsOption.CrsNotSet, True)
        self.crs.setNotSetText(tr("the mission's, or that of the format"))
        self.gsd_m = QDoubleSpinBox(self)
        self.gsd_m.setRange(0.0, 1000.0)
        self.gsd_m.setDecimals(3)
        self.gsd_m.setSuffix(" m")
        self.gsd_m.setSpecialValueText(tr("the map's own"))
        self.compress, self.tile_format = QComboBox(self), QComboBox(self)
        self.compress.addItems(COMPRESSIONS)
        self.tile_format.addItems(TILE_FORMATS)
        self.view_only = QCheckBox(tr("Only what the &window shows"), self)
        self.cutline = QgsMapLayerComboBox(self)
        self.cutline.setFilters(QgsMapLayerProxyModel.Filter.PolygonLayer)
        self.cutline.setAllowEmptyLayer(True, tr("all of it"))
        self.cutline.setCurrentIndex(0)
        self.over = raster_box(self, tr("none"))
        self.attribution = QLineEdit(self)
        self.add = QCheckBox(tr("&Add the GeoTIFF to the project"), self)
        self.add.setChecked(True)
        self.words = QLabel(self)
        self.words.setWordWrap(True)
        self.words.setTextInteractionFlags(Qt.TextInteractionFlag.TextBrowserInteraction)
        self.words.linkActivated.connect(lambda path: QDesktopServices.openUrl(QUrl.fromLocalFile(path)))
        self.jobs = JobBar(self)
        self.jobs.done.connect(self._done)
        self.jobs.failed.connect(self._failed)
        self.jobs.cancelled.connect(self._judge)
        self.buttons = QDialogButtonBox(
            QDialogButtonBox.StandardButton.Ok | QDialogButtonBox.StandardButton.Close, self
        )
        self.buttons.button(QDialogButtonBox.StandardButton.Ok).setText(tr("&Export"))
        self.buttons.accepted.connect(self.start)
        self.buttons.rejected.connect(self.close)
        self.formats.itemChanged.connect(lambda _: self._judge())
        self.folder.fileChanged.connect(lambda _: self._judge())
        self.cutline.layerChanged.connect(lambda _: self._judge())
        self.over.layerChanged.connect(lambda _: self._judge())
        self.mission.changed.connect(self._offer_folder)
        self._lay_out()

    def begin(self, folder: str = "") -> None:
        """Show the dialog for a mission; it stays as it was left otherwise."""
        self.mission.reload()
        if folder:
            self.mission.choose(folder)
        self._offer_folder(self.mission.folder())
        self.show()
        self.raise_()

    def chosen(self) -> list[str]:
        """Return the flags of the formats that are ticked."""
        items = (self.formats.item(k) for k in range(self.formats.count()))
        return [i.data(Qt.ItemDataRole.UserRole) for i in items if i.checkState() == Qt.CheckState.Checked]

    def choose(self, flags: list[str]) -> None:
        """Tick these formats and no others."""
        for k in range(self.formats.count()):
            item = self.formats.item(k)
            on = item.data(Qt.ItemDataRole.UserRole) in flags
            item.setCheckState(Qt.CheckState.Checked if on else Qt.CheckState.Unchecked)

    def arguments(self) -> dict:
        """Return the arguments of the job ``export``; what was left as it is is not said."""
        crs, flags, folder = self.crs.crs(), self.chosen(), self.folder.filePath().strip()
        over = file_of(self.over.currentLayer())
        said = {
            "mission": self.mission.folder(),
            "output": str(Path(folder) / f"{Path(over).stem}-new.tif") if over else folder,
            "crs": "" if over or not crs.isValid() else crs.authid() or crs.toWkt(),
            "gsd": self.gsd_m.value(),
            "compress": self.compress.currentText() if "geotiff" in flags else "",
            "tile_format": self.tile_format.currentText(),
            "cutline": self._cutline(),
            "attribution": self.attribution.text().strip(),
            "over": over,
        }
        if self.view_only.isChecked():
            said["bbox"] = view_box(self._context.iface.mapCanvas())
        return {name: value for name, value in said.items() if value} | dict.fromkeys(flags, True)

    def problem(self) -> str:
        """Return what keeps the export from being started, in words; empty where nothing does."""
        flags = self.chosen()
        if not self.mission.folder():
            return tr("Choose a mission.")
        if not flags:
            return tr("Tick at least one format.")
        if not self.folder.filePath().strip():
            return tr("Choose the folder to write to.")
        if self.over.currentLayer() is not None:
            if not file_of(self.over.currentLayer()):
                return tr("The imagery to burn into is no file on this machine: export it as a GeoTIFF first.")
            if flags != ["geotiff"]:
                return tr("Burning into existing imagery writes a GeoTIFF: tick that format alone.")
        cutline = self.cutline.currentLayer()
        if cutline is not None and not cutline.crs().isValid():
            return tr("The layer that cuts has no coordinate system: set it in the layer's properties.")
        try:
            mission = read_mission(self.mission.folder())
        except MissionError as error:
            return str(error)
        if not mission.georeferenced:
            barred = [f.words for f in formats() if f.flag in flags and f.needs_place]
            if barred:
                return tr("This map has no place on Earth yet, which {} needs: pick two points first.").format(
                    barred[0]
                )
        return ""

    def start(self) -> None:
        """Have the engine write."""
        if self.problem() or self.jobs.busy:
            return
        try:
            Path(self.folder.filePath().strip()).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            self._failed(tr("The folder cannot be made ({}): choose another one.").format(error.strerror))
            return
        try:
            arguments = self.arguments()
        except OSError as error:
            self._failed(tr("The area that is cut to cannot be handed over: {}").format(error))
            return
        self.jobs.watch(self._context.engine.start("export", arguments), tr("Exporting…"))
        self._judge()

    def release(self) -> None:
        """End what runs."""
        self.jobs.release()
        self.close()

    def _done(self, document: object) -> None:
        outputs = [Path(p) for p in (document.get("outputs", []) if isinstance(document, dict) else [])]
        if self.add.isChecked():
            for path in outputs:
                self._show(path)
        self._context.messages.info(tr("Written: {}").format(", ".join(path.name for path in outputs)))
        for file in document.get("files", []) if isinstance(document, dict) else []:
            if file.get("note"):
                self._context.messages.warn(str(file["note"]))
        self._judge()
        if outputs:
            self.words.setText(f'<a href="{outputs[0].parent}">{tr("Open the folder")}</a>')
            self.words.setVisible(True)

    def _cutline(self) -> str:
        layer = self.cutline.currentLayer()
        if layer is None:
            return ""
        path = Path(self._scratch.path()) / "area.geojson"
        path.unlink(missing_ok=True)
        write_area(layer, path)
        return str(path)

    def _show(self, path: Path) -> None:
        there = [layer for layer in QgsProject.instance().mapLayers().values() if layer.source() == str(path)]
        for layer in there:  # exported once more: the same file, other pixels
            reopen(layer)
        if path.suffix in SHOWN and path.is_file() and not there:
            layer = QgsRasterLayer(
                str(path), tr("{}: export {}").format(Path(self.mission.folder()).name, path.name), "gdal"
            )
            if layer.isValid():
                style_map(layer)
                QgsProject.instance().addMapLayer(layer, False)
                node = QgsProject.instance().layerTreeRoot().insertLayer(0, layer)
                node.setExpanded(False)

    def _failed(self, words: str) -> None:
        self._context.messages.fail(words)
        self._judge()

    def _offer_folder(self, folder: str) -> None:
        if folder:
            self.folder.setFilePath(str(Path(folder) / "exports"))
        self._judge()

    def _judge(self) -> None:
        words = self.problem()
        self.words.setText(words)
        self.words.setVisible(bool(words))
        ok = self.buttons.button(QDialogButtonBox.StandardButton.Ok)
        ok.setEnabled(not words and not self.jobs.busy)

    def _lay_out(self) -> None:
        form = QFormLayout()
        form.addRow(tr("&Mission"), self.mission)
        form.addRow(tr("&Formats"), self.formats)
        form.addRow(tr("F&older"), self.folder)
        form.addRow(tr("C&RS"), self.crs)
        form.addRow(tr("&Pixel"), self.gsd_m)
        form.addRow(tr("&Compression of the GeoTIFF"), self.compress)
        form.addRow(tr("&Tiles as"), self.tile_format)
        form.addRow(tr("Only insi&de"), self.cutline)
        form.addRow(self.view_only)
        form.addRow(tr("&Burn into a copy of"), self.over)
        form.addRow(tr("Cred&it"), self.attribution)
        form.addRow(self.add)
        layout = QVBoxLayout(self)
        layout.addLayout(form)
        layout.addWidget(self.words)
        layout.addWidget(self.jobs)
        layout.addWidget(self.buttons)


def view_box(canvas) -> str:
    """Return what a canvas shows as ``W,S,E,N`` in degrees; empty where that is no place on Earth."""
    settings = canvas.mapSettings()
    change = QgsCoordinateTransform(
        settings.destinationCrs(), QgsCoordinateReferenceSystem(WGS84), QgsProject.instance().transformContext()
    )
    try:
        box = change.transformBoundingBox(settings.visibleExtent())
    except QgsCsException:
        return ""
    return f"{box.xMinimum():.8f},{box.yMinimum():.8f},{box.xMaximum():.8f},{box.yMaximum():.8f}"


def write_area(layer: QgsVectorLayer, path: Path) -> None:
    """Write a polygon layer (its selection, where there is one) as GeoJSON in degrees; ``OSError`` where that fails.

    So any layer will do: of a database, in memory, filtered, in any coordinate system.
    """
    options = QgsVectorFileWriter.SaveVectorOptions()
    options.driverName = "GeoJSON"
    options.onlySelectedFeatures = layer.selectedFeatureCount() > 0
    transforms = QgsProject.instance().transformContext()
    options.ct = QgsCoordinateTransform(layer.crs(), QgsCoordinateReferenceSystem(WGS84), transforms)
    error, words, *_ = QgsVectorFileWriter.writeAsVectorFormatV3(layer, str(path), transforms, options)
    if error != QgsVectorFileWriter.WriterError.NoError:
        raise OSError(words or f"{path} cannot be written")
