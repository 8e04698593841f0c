"""The planner's form: what to fly over, with what, how; its fields as one value."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from qgis.core import QgsMapLayerProxyModel, QgsRasterLayer
from qgis.gui import QgsCollapsibleGroupBox, QgsMapLayerComboBox
from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from ..translation import tr
from .request import CORRIDOR, CROSSHATCH, FROM_DATUM, SEARCHES, SURVEY, Camera, PlanRequest

OWN_CAMERA = "own"
_OWN_TARGET = "own"


class UnusableFieldError(Exception):
    """A field that cannot be planned with, in words that say what to do."""


class PlannerForm(QWidget):
    """Sends ``changed`` with every edit; ``request()`` is what the fields say (without area, no-fly areas, places)."""

    changed = pyqtSignal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._rows: dict[str, tuple[QFormLayout, QWidget]] = {}
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        for box in (self._what_box(), self._camera_box(), self._flight_box(), self._ground_box()):
            column.addWidget(box)
        for combo in self.findChildren(QComboBox):  # a long name must not make the dock wide
            combo.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
            combo.setMinimumContentsLength(8)
        self._connect()
        self._show_what_matters()

    # the boxes

    def _what_box(self) -> QWidget:
        box, form = self._box(tr("What"))
        self.pattern = QComboBox()
        for key, words in (
            (SURVEY, tr("Cover the area")),
            (CROSSHATCH, tr("Cover the area twice, crosswise")),
            (CORRIDOR, tr("A strip along a line")),
            ("expanding-square", tr("Search: expanding square (SS)")),
            ("sector", tr("Search: sectors (VS)")),
            ("parallel", tr("Search: parallel tracks (PS)")),
            ("creeping", tr("Search: creeping line (CS)")),
            ("trackline", tr("Search: along a track (TSR)")),
            ("spiral", tr("Search: spiral")),
            ("orbit", tr("Circles about a place")),
            ("perimeter", tr("Along the area's rim")),
        ):
            self.pattern.addItem(words, key)
        self._row(form, "pattern", tr("&Flight"), self.pattern)
        self.corridor_width = _number(0.5, 20_000, 50, " m")
        self._row(form, "corridor_width", tr("Width of the strip"), self.corridor_width)
        self.radius = _number(1, 200_000, 300, " m")
        self._row(form, "radius", tr("Radius"), self.radius)
        self.avoid = QgsMapLayerComboBox()
        self.avoid.setFilters(QgsMapLayerProxyModel.Filter.PolygonLayer)
        self.avoid.setAllowEmptyLayer(True, tr("none"))
        self.avoid.setCurrentIndex(0)
        self.avoid.setToolTip(tr("A polygon layer, any CRS: never fly over its features."))
        self._row(form, "avoid", tr("&No-fly areas"), self.avoid)
        self.inset = QCheckBox(tr("Never leave the area"))
        self._row(form, "inset", "", self.inset)
        return box

    def _camera_box(self) -> QWidget:
        box, form = self._box(tr("Camera"))
        self.camera = QComboBox()
        self.camera.setEditable(True)
        self.camera.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        self.camera.completer().setFilterMode(Qt.MatchFlag.MatchContains)
        self.camera.completer().setCompletionMode(self.camera.completer().CompletionMode.PopupCompletion)
        self.camera.addItem(tr("A one-inch mapping camera (assumed)"), "")
        self.camera.addItem(tr("By numbers…"), OWN_CAMERA)
        self._row(form, "camera", tr("&Camera"), self.camera)
        self.fov = _number(1, 160, 73.7, "°", decimals=1)
        self._row(form, "fov", tr("Horizontal view"), self.fov)
        self.width, self.height_px = QSpinBox(), QSpinBox()
        for spin, value in ((self.width, 4000), (self.height_px, 3000)):
            spin.setRange(1, 100_000)
            spin.setValue(value)
            spin.setSuffix(" px")
        self._row(form, "raster", tr("Picture"), _side_by_side(self.width, QLabel("x"), self.height_px))
        self.fineness = QComboBox()
        for key, words in (
            ("target", tr("What must be seen")),
            ("gsd", tr("Ground pixel (GSD)")),
            ("height", tr("Height above ground")),
        ):
            self.fineness.addItem(words, key)
        self._row(form, "fineness", tr("Height &by"), self.fineness)
        self.target = QComboBox()
        for key, words in (
            ("card", tr("a hazard card, 40 x 30 cm")),
            ("person", tr("a person")),
            ("vehicle", tr("a vehicle")),
            (_OWN_TARGET, tr("of this size:")),
        ):
            self.target.addItem(words, key)
        self.target_size = _number(0.01, 1000, 0.3, " m", decimals=2)
        self._row(form, "target", "", _side_by_side(self.target, self.target_size))
        self.gsd = _number(0.05, 100, 2.0, " cm/px", decimals=2)
        self._row(form, "gsd", "", self.gsd)
        self.height_m = _number(1, 10_000, 60, " m")
        self._row(form, "height", "", self.height_m)
        self.front, self.side = _number(0, 97, 80, " %", decimals=0), _number(0, 97, 65, " %", decimals=0)
        self._row(form, "overlap", tr("&Overlap front, side"), _side_by_side(self.front, self.side))
        return box

    def _flight_box(self) -> QWidget:
        box, form = self._box(tr("Flight"))
        self.speed = _number(0.1, 100, 10, " m/s", decimals=1)
        self._row(form, "speed", tr("&Speed"), self.speed)
        self.wind, self.wind_from = _number(0, 100, 0, " m/s", decimals=1), _number(0, 359, 270, "°", decimals=0)
        self.wind.setSpecialValueText(tr("no wind"))
        self.wind_from.setToolTip(tr("Where the wind comes from, clockwise from north"))
        self._row(form, "wind", tr("&Wind, from"), _side_by_side(self.wind, self.wind_from))
        self.endurance = _number(0, 10_000, 0, " min", decimals=1)
        self.endurance.setSpecialValueText(tr("one flight"))
        self.endurance.setToolTip(tr("What one battery flies: the plan is split into sorties"))
        self._row(form, "endurance", tr("&Battery"), self.endurance)
        self.angle = _number(-1, 359, -1, "°", decimals=0)
        self.angle.setSpecialValueText(tr("the fastest"))
        self._row(form, "angle", tr("&Lanes' heading"), self.angle)
        self.transit = _number(0, 10_000, 0, " m")
        self.transit.setSpecialValueText(tr("as the survey"))
        self._row(form, "transit", tr("Height on the &way"), self.transit)
        self.lands = QComboBox()
        self.lands.addItem(tr("returns (RTL)"), False)
        self.lands.addItem(tr("lands at home"), True)
        self._row(form, "lands", tr("At the &end"), self.lands)
        self.autopilot = QComboBox()
        self.autopilot.addItem("ArduPilot", "ardupilot")
        self.autopilot.addItem("PX4", "px4")
        self._row(form, "autopilot", tr("&Autopilot"), self.autopilot)
        return box

    def _ground_box(self) -> QWidget:
        box, form = self._box(tr("Terrain"), collapsed=True)
        self.dem = QgsMapLayerComboBox()
        self.dem.setFilters(QgsMapLayerProxyModel.Filter.RasterLayer)
        self.dem.setAllowEmptyLayer(True, tr("flat ground"))
        self.dem.setCurrentIndex(0)
        self.dem.setToolTip(tr("An elevation model from a file: the flight keeps its height above the ground."))
        self._row(form, "dem", tr("&Elevation layer"), self.dem)
        self.vertical = QComboBox()
        for key, words in (
            ("", tr("as the file says")),
            ("egm96", "EGM96"),
            ("egm2008", "EGM2008"),
            ("msl", tr("mean sea level")),
            ("ellipsoid", tr("the ellipsoid")),
        ):
            self.vertical.addItem(words, key)
        self._row(form, "vertical", tr("Heights are above"), self.vertical)
        self.geoid = _number(-150, 150, 0, " m", decimals=1)
        self._row(form, "geoid", tr("Geoid's height"), self.geoid)
        return box

    # what the fields say

    def set_cameras(self, cameras: list[dict]) -> None:
        """Offer the engine's cameras; what was chosen stays."""
        chosen = self.camera.currentData()
        self.camera.blockSignals(True)
        while self.camera.count() > 2:
            self.camera.removeItem(2)
        for camera in cameras:
            self.camera.addItem(camera["name"], camera["name"])
            at = self.camera.count() - 1
            self.camera.setItemData(at, camera.get("fov_deg") is None, Qt.ItemDataRole.UserRole + 1)
            if camera.get("fov_deg"):
                words = f"{camera['width_px']} x {camera['height_px']} px, {camera['fov_deg']}°"
                self.camera.setItemData(at, words, Qt.ItemDataRole.ToolTipRole)
        at = self.camera.findData(chosen) if chosen else 0
        self.camera.setCurrentIndex(max(at, 0))
        self.camera.blockSignals(False)
        self._show_what_matters()

    def request(self) -> PlanRequest:
        """Return what the fields say. Raises ``UnusableFieldError`` with words on what to change."""
        fineness = self.fineness.currentData()
        target = self.target.currentData()
        request = PlanRequest(
            pattern=self.pattern.currentData(),
            camera=self._camera(),
            target=f"{self.target_size.value():g}" if target == _OWN_TARGET else target,
            gsd_m=self.gsd.value() / 100.0 if fineness == "gsd" else None,
            height_m=self.height_m.value() if fineness == "height" else None,
            front_overlap_percent=self.front.value(),
            side_overlap_percent=self.side.value(),
            speed_m_s=self.speed.value(),
            wind_m_s=self.wind.value(),
            wind_from_deg=self.wind_from.value(),
            endurance_min=self.endurance.value() or None,
            radius_m=self.radius.value(),
            corridor_width_m=self.corridor_width.value(),
            angle_deg=None if self.angle.value() < 0 else self.angle.value(),
            inset=self.inset.isChecked(),
            transit_height_m=self.transit.value() or None,
            lands=bool(self.lands.currentData()),
            autopilot=self.autopilot.currentData(),
        )
        layer = self.dem.currentLayer()
        if layer is None:
            return request
        vertical = self.vertical.currentData()
        return replace(
            request,
            dem=elevation_file(layer),
            dem_vertical=vertical,
            geoid_m=self.geoid.value() if vertical == "ellipsoid" else None,
        )

    def _camera(self) -> Camera:
        index = self.camera.findText(self.camera.currentText(), Qt.MatchFlag.MatchFixedString)
        if index < 0:  # typed: any part of maker and model, or a photo
            return Camera(name=self.camera.currentText().strip())
        key = self.camera.itemData(index)
        if key == OWN_CAMERA:
            return Camera("", self.fov.value(), self.width.value(), self.height_px.value())
        return Camera(key, self.fov.value() if self._wants_fov() and key else None)

    def _wants_fov(self) -> bool:
        index = self.camera.currentIndex()
        if self.camera.itemData(index) == OWN_CAMERA:
            return True
        return bool(self.camera.itemData(index, Qt.ItemDataRole.UserRole + 1))

    # rows that come and go

    def _show_what_matters(self) -> None:
        pattern, fineness = self.pattern.currentData(), self.fineness.currentData()
        own = self.camera.currentData() == OWN_CAMERA
        searches = pattern in SEARCHES
        for key, shown in {
            "corridor_width": pattern == CORRIDOR,
            "radius": pattern in FROM_DATUM,
            "inset": not searches,
            "overlap": not searches,
            "angle": pattern != CORRIDOR,
            "fov": self._wants_fov(),
            "raster": own,
            "target": fineness == "target",
            "gsd": fineness == "gsd",
            "height": fineness == "height",
            "vertical": self.dem.currentLayer() is not None,
            "geoid": self.dem.currentLayer() is not None and self.vertical.currentData() == "ellipsoid",
        }.items():
            form, field = self._rows[key]
            field.setVisible(shown)
            label = form.labelForField(field)
            if label is not None:
                label.setVisible(shown)
        self.camera.lineEdit().setCursorPosition(0)  # a long name is read from its beginning
        self.target_size.setVisible(fineness == "target" and self.target.currentData() == _OWN_TARGET)

    def _connect(self) -> None:
        for combo in (
            self.pattern, self.camera, self.fineness, self.target, self.lands, self.autopilot, self.vertical
        ):  # fmt: skip
            combo.currentIndexChanged.connect(self._edited)
        self.camera.lineEdit().editingFinished.connect(self._edited)
        for layers in (self.avoid, self.dem):
            layers.layerChanged.connect(self._edited)
        for spin in (
            self.corridor_width, self.radius, self.fov, self.width, self.height_px, self.target_size, self.gsd,
            self.height_m, self.front, self.side, self.speed, self.wind, self.wind_from, self.endurance, self.angle,
            self.transit, self.geoid,
        ):  # fmt: skip
            spin.valueChanged.connect(self._edited)
        self.inset.toggled.connect(self._edited)

    def _edited(self, *_) -> None:
        self._show_what_matters()
        self.changed.emit()

    def _box(self, title: str, *, collapsed: bool = False) -> tuple[QWidget, QFormLayout]:
        box = QgsCollapsibleGroupBox(title)
        box.setCollapsed(collapsed)
        form = QFormLayout(box)
        form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
        return box, form

    def _row(self, form: QFormLayout, key: str, label: str, field: QWidget) -> None:
        field.setObjectName(f"planner_{key}")
        form.addRow(label, field)
        self._rows[key] = (form, field)


def elevation_file(layer: QgsRasterLayer) -> str:
    """Return the file of an elevation layer. Raises ``UnusableFieldError`` where it is none."""
    source = layer.source().split("|")[0]
    if layer.providerType() != "gdal" or not Path(source).is_file():
        raise UnusableFieldError(
            tr("“{}” is not a raster file: export it as GeoTIFF (Layer, Save As), and choose that.").format(
                layer.name()
            )
        )
    return source


def _number(low: float, high: float, value: float, suffix: str, *, decimals: int = 1) -> QDoubleSpinBox:
    spin = QDoubleSpinBox()
    spin.setDecimals(decimals)
    spin.setRange(low, high)
    spin.setValue(value)
    spin.setSuffix(suffix)
    spin.setKeyboardTracking(False)  # 120 typed is not a plan of 1, of 12 and of 120
    return spin


def _side_by_side(*widgets: QWidget) -> QWidget:
    row = QWidget()
    layout = QHBoxLayout(row)
    layout.setContentsMargins(0, 0, 0, 0)
    for widget in widgets:
        layout.addWidget(widget, 1 if not isinstance(widget, QLabel) else 0)
    return row
