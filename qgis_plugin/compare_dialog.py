"""The dialog "What has changed": old imagery against a new map, compared by the engine, shown as areas and a score."""

from __future__ import annotations

from pathlib import Path

from qgis.core import QgsMapLayerProxyModel, QgsProject, QgsRasterLayer, QgsVectorLayer
from qgis.gui import QgsMapLayerComboBox
from qgis.PyQt.QtWidgets import QDialog, QDialogButtonBox, QDoubleSpinBox, QFormLayout, QLabel, QVBoxLayout

from .job_bar import JobBar
from .layers import titles
from .settings import default_folder, load_settings
from .styles import style_change, style_vector
from .translation import tr


class CompareDialog(QDialog):
    """Stays open while the engine compares; what has changed is added to the project as a group on top."""

    def __init__(self, context) -> None:
        super().__init__(context.iface.mainWindow())
        self._context = context
        self.setObjectName("photomapCompareDialog")
        self.setWindowTitle(tr("What has changed?"))
        self.old, self.new = QgsMapLayerComboBox(self), QgsMapLayerComboBox(self)
        for box in (self.old, self.new):
            box.setFilters(QgsMapLayerProxyModel.Filter.RasterLayer)
            box.layerChanged.connect(lambda _: self._judge())
        self.threshold = QDoubleSpinBox(self)
        self.threshold.setRange(0.05, 0.99)
        self.threshold.setSingleStep(0.05)
        self.threshold.setValue(0.5)
        self.min_area = QDoubleSpinBox(self)
        self.min_area.setRange(0.0, 1e6)
        self.min_area.setSuffix(" m²")
        self.min_area.setSpecialValueText(tr("automatic"))
        self.words = QLabel(self)
        self.words.setWordWrap(True)
        self.jobs = JobBar(self)
        self.jobs.done.connect(self._done)
        self.jobs.failed.connect(self._failed)
        self.jobs.cancelled.connect(lambda: self._judge())
        self.buttons = QDialogButtonBox(
            QDialogButtonBox.StandardButton.Ok | QDialogButtonBox.StandardButton.Close, self
        )
        self.buttons.button(QDialogButtonBox.StandardButton.Ok).setText(tr("&Compare"))
        self.buttons.accepted.connect(self.start)
        self.buttons.rejected.connect(self.close)
        form = QFormLayout()
        form.addRow(tr("&Old imagery"), self.old)
        form.addRow(tr("&New map"), self.new)
        form.addRow(tr("Changed from a &score of"), self.threshold)
        form.addRow(tr("S&mallest area"), self.min_area)
        layout = QVBoxLayout(self)
        layout.addLayout(form)
        layout.addWidget(self.words)
        layout.addWidget(self.jobs)
        layout.addWidget(self.buttons)

    def begin(self) -> None:
        """Show the dialog; the active layer is offered as the new map."""
        active = self._context.iface.activeLayer()
        if isinstance(active, QgsRasterLayer) and not self.jobs.busy:
            self.new.setLayer(active)
            other = next((x for x in self._context.iface.mapCanvas().layers()
                          if isinstance(x, QgsRasterLayer) and x is not active), None)  # fmt: skip
            if other is not None:
                self.old.setLayer(other)
        self._judge()
        self.show()
        self.raise_()

    def start(self) -> None:
        """Have the engine compare."""
        old, new = file_of(self.old.currentLayer()), file_of(self.new.currentLayer())
        folder = default_folder(load_settings()) / "changes"
        name = f"{Path(old).stem}-{Path(new).parent.name}-{Path(new).stem}"
        number = next(n for n in range(1, 10**6) if not (folder / f"{name}-{n}.tif").exists())
        arguments = {
            "old": old,
            "new": new,
            "output": str(folder / f"{name}-{number}.tif"),
            "polygons": str(folder / f"{name}-{number}.gpkg"),
            "threshold": self.threshold.value(),
            "min_area": self.min_area.value() or None,
        }
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            self._failed(tr("{} cannot be made ({}): choose another folder in the settings.").format(folder, error))
            return
        self.jobs.watch(self._context.engine.start("compare", arguments), tr("Comparing…"))
        self._judge()

    def release(self) -> None:
        """End what runs."""
        self.jobs.release()
        self.close()

    def _done(self, document: dict) -> None:
        project = QgsProject.instance()
        group = project.layerTreeRoot().insertGroup(0, tr("Changes: {}").format(self.old.currentText()))
        outputs = [Path(p) for p in document.get("outputs", [])]
        areas = next((p for p in outputs if p.suffix in (".gpkg", ".geojson")), None)
        score = next((p for p in outputs if p.suffix == ".tif"), None)
        if areas is not None:
            layer = QgsVectorLayer(str(areas), titles()["change"], "ogr")
            if layer.isValid():
                style_vector(layer, "change")
                project.addMapLayer(layer, False)
                group.addLayer(layer)
        if score is not None:
            raster = QgsRasterLayer(str(score), tr("Probability of change"), "gdal")
            if raster.isValid():
                style_change(raster, self.threshold.value())
                project.addMapLayer(raster, False)
                group.addLayer(raster).setItemVisibilityChecked(False)
        for warning in document.get("warnings", []):
            self._context.messages.warn(warning)
        count, square_m = document.get("areas", 0), document.get("changed_m2", 0.0)
        self._context.messages.info(tr("{} changed area(s), {} m² in all.").format(count, f"{square_m:.0f}"))
        self._judge()
        self.close()

    def _failed(self, words: str) -> None:
        self._context.messages.fail(words)
        self._judge()

    def _judge(self) -> None:
        words = ""
        old, new = self.old.currentLayer(), self.new.currentLayer()
        if old is None or new is None or old is new:
            words = tr("Choose two raster layers: the old imagery, and the new map.")
        for layer in (old, new):
            if not words and not file_of(layer):
                words = tr("“{}” is no file on this machine: export it as a GeoTIFF first.").format(layer.name())
        self.words.setText(words)
        self.words.setVisible(bool(words))
        ok = self.buttons.button(QDialogButtonBox.StandardButton.Ok)
        ok.setEnabled(not words and not self.jobs.busy)


def file_of(layer) -> str:
    """Return the file that a raster layer shows; empty where it is none (a web service, say)."""
    if layer is None or layer.dataProvider() is None or layer.dataProvider().name() != "gdal":
        return ""
    path = layer.source().split("|", 1)[0]
    return path if Path(path).is_file() else ""
