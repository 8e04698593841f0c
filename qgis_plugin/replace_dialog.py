"""The dialog "Replace imagery": which layer is stale, which map takes its place, and how."""

from __future__ import annotations

from qgis.core import QgsMapLayerProxyModel, QgsRasterLayer
from qgis.gui import QgsMapLayerComboBox
from qgis.PyQt.QtWidgets import QComboBox, QDialog, QDialogButtonBox, QFormLayout, QLabel, QRadioButton, QVBoxLayout

from .layers import ROLE
from .mission import MapFile, MissionError, MissionFiles, read_mission
from .mission_box import MissionBox
from .translation import tr


class ReplaceDialog(QDialog):
    """Asks what is to be replaced by what; ``choice`` answers after it was accepted."""

    def __init__(self, parent, active: QgsRasterLayer | None, project) -> None:
        super().__init__(parent)
        self.setWindowTitle(tr("Replace imagery by a photo map"))
        self.setObjectName("photomapReplaceDialog")
        self._mission: MissionFiles | None = None
        self.stale = QgsMapLayerComboBox(self)
        self.stale.setFilters(QgsMapLayerProxyModel.Filter.RasterLayer)
        own = [layer for layer in project.mapLayers().values() if layer.customProperty(ROLE)]
        self.stale.setExceptedLayerList(own)
        if active is not None and active not in own:
            self.stale.setLayer(active)
        self.mission = MissionBox(self)
        self.piece = QComboBox(self)
        self.words = QLabel(self)
        self.words.setWordWrap(True)
        self.above = QRadioButton(tr("&Above it: the new map is a layer of its own, the old one stays, unticked"), self)
        self.above.setChecked(True)
        self.swap = QRadioButton(tr("&In it: the layer itself shows the new map, in layouts and themes too"), self)
        self.buttons = QDialogButtonBox(
            QDialogButtonBox.StandardButton.Ok | QDialogButtonBox.StandardButton.Cancel, self
        )
        self.buttons.accepted.connect(self.accept)
        self.buttons.rejected.connect(self.reject)
        form = QFormLayout()
        form.addRow(tr("&Stale layer"), self.stale)
        form.addRow(tr("&New map"), self.mission)
        form.addRow(tr("&Piece"), self.piece)
        layout = QVBoxLayout(self)
        layout.addLayout(form)
        layout.addWidget(self.words)
        layout.addWidget(self.above)
        layout.addWidget(self.swap)
        layout.addWidget(self.buttons)
        self.mission.changed.connect(self._read)
        self.stale.layerChanged.connect(lambda _: self._judge())
        self._read(self.mission.folder())

    def choice(self) -> tuple[QgsRasterLayer, MissionFiles, MapFile, bool]:
        """Return the stale layer, the mission, its map, and whether the layer's source is swapped."""
        assert self._mission is not None
        found = self._mission.maps[max(0, self.piece.currentIndex())]
        return self.stale.currentLayer(), self._mission, found, self.swap.isChecked()

    def _read(self, folder: str) -> None:
        self._mission = None
        self.piece.clear()
        if not folder:
            self._judge(tr("Choose the mission whose map is new: make one in the dock “Photo map”."))
            return
        try:
            self._mission = read_mission(folder)
        except MissionError as error:
            self._judge(str(error))
            return
        self.piece.addItems([m.path.name for m in self._mission.maps])
        self.piece.setEnabled(self.piece.count() > 1)
        self._judge(self._mission.title)

    def _judge(self, words: str | None = None) -> None:
        if words is not None:
            self.words.setText(words)
        possible = self._mission is not None and self._mission.georeferenced
        if self._mission is not None and not possible:
            self.words.setText(
                tr("This map has no place on Earth yet: pick two points of it in the dock “Georeference” first.")
            )
        if self.stale.currentLayer() is None:
            self.words.setText(tr("There is no raster layer to replace in this project: add the stale imagery first."))
            possible = False
        self.buttons.button(QDialogButtonBox.StandardButton.Ok).setEnabled(possible)
