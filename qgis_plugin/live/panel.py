"""The live dock's widgets: where the session is, how it does, what can be done; no wiring."""

from __future__ import annotations

from qgis.core import QgsSettings
from qgis.gui import QgsCollapsibleGroupBox, QgsFileWidget
from qgis.PyQt.QtCore import Qt, QTimer, pyqtSignal
from qgis.PyQt.QtWidgets import (
    QCheckBox,
    QComboBox,
    QFormLayout,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from ..translation import tr

LAST_ADDRESS, LAST_SOURCE = "photomap/live_address", "photomap/live_source"
SURE_MS = 4000


class LivePanel(QWidget):
    """Buttons by name; ``finalise_wanted`` comes at the second press, since a flight that has ended does not go on."""

    finalise_wanted = pyqtSignal()

    def __init__(self) -> None:
        super().__init__()
        column = QVBoxLayout(self)
        row = QHBoxLayout()
        self.address = QLineEdit(str(QgsSettings().value(LAST_ADDRESS, "", type=str)))
        self.address.setObjectName("live_address")
        self.address.setPlaceholderText("http://127.0.0.1:8765/?token=…")
        self.address.setAccessibleName(tr("Address of the session"))
        self.connect_button = _button(tr("&Connect"), "connect")
        row.addWidget(self.address, 1)
        row.addWidget(self.connect_button)
        column.addLayout(row)
        self.health = _words("health")
        self.accuracy = _words("accuracy")
        self.drone = _words("drone")
        for label in (self.health, self.accuracy, self.drone):
            column.addWidget(label)
        self.bar = QProgressBar()
        self.bar.setRange(0, 1000)
        self.bar.hide()
        column.addWidget(self.bar)
        self.follow = QCheckBox(tr("&Follow the drone"))
        self.follow.setObjectName("live_follow")
        column.addWidget(self.follow)
        column.addLayout(self._finds())
        row = QHBoxLayout()
        self.page_button = _button(tr("Open the &page"), "page")
        self.finalise_button = _button("", "finalise")
        row.addWidget(self.page_button)
        row.addWidget(self.finalise_button)
        column.addLayout(row)
        column.addWidget(self._start_box())
        column.addStretch(1)
        self._sure = QTimer(self)
        self._sure.setSingleShot(True)
        self._sure.setInterval(SURE_MS)
        self._sure.timeout.connect(self._not_sure)
        self.finalise_button.clicked.connect(self._finalise_pressed)
        self._not_sure()
        self.set_connected(False)

    def set_connected(self, connected: bool, *, flying: bool = False) -> None:
        """Offer what can be done now."""
        self.connect_button.setText(tr("Dis&connect") if connected else tr("&Connect"))
        self.address.setEnabled(not connected)
        for widget in (self.find_button, self.page_button, self.follow):
            widget.setEnabled(connected)
        self.finalise_button.setEnabled(connected and flying)

    def _finds(self) -> QGridLayout:
        grid = QGridLayout()
        self.find_kind = QComboBox()
        self.find_kind.setObjectName("live_find_kind")
        for key, words in (
            ("victim", tr("victim")),
            ("intruder", tr("intruder")),
            ("hazard", tr("hazard card")),
            ("other", tr("other")),
        ):
            self.find_kind.addItem(words, key)
        self.find_note = QLineEdit()
        self.find_note.setPlaceholderText(tr("note"))
        self.find_note.setMaxLength(2000)
        self.find_button = _button(tr("&Mark a find"), "find", checkable=True)
        self.find_button.setToolTip(tr("Then click its place on the map; Esc leaves"))
        grid.addWidget(self.find_kind, 0, 0)
        grid.addWidget(self.find_note, 0, 1)
        grid.addWidget(self.find_button, 0, 2)
        return grid

    def _start_box(self) -> QWidget:
        box = QgsCollapsibleGroupBox(tr("Start a session"))
        form = QFormLayout(box)
        self.source = QLineEdit(str(QgsSettings().value(LAST_SOURCE, "", type=str)))
        self.source.setObjectName("live_source")
        self.source.setPlaceholderText(tr("rtsp://…, udp://…, a video, a folder that is being filled"))
        form.addRow(tr("&Source"), self.source)
        self.mavlink = QLineEdit()
        self.mavlink.setObjectName("live_mavlink")
        self.mavlink.setPlaceholderText("udpin:0.0.0.0:14550")
        self.mavlink.setToolTip(tr("Positions from the autopilot; leave it empty where the source brings its own"))
        form.addRow("MA&VLink", self.mavlink)
        self.output = QgsFileWidget()
        self.output.setStorageMode(QgsFileWidget.StorageMode.SaveFile)
        self.output.setObjectName("live_output")
        form.addRow(tr("&Into"), self.output)
        self.start_button = _button(tr("St&art"), "start")
        form.addRow("", self.start_button)
        return box

    def _finalise_pressed(self) -> None:
        if self._sure.isActive():
            self._not_sure()
            self.finalise_wanted.emit()
            return
        self.finalise_button.setText(tr("Again: end the flight"))
        self._sure.start()

    def _not_sure(self) -> None:
        self._sure.stop()
        self.finalise_button.setText(tr("&End and finalise"))


def _button(text: str, name: str, *, checkable: bool = False) -> QPushButton:
    button = QPushButton(text)
    button.setObjectName(f"live_{name}")
    button.setCheckable(checkable)
    return button


def _words(name: str) -> QLabel:
    label = QLabel()
    label.setObjectName(f"live_{name}")
    label.setWordWrap(True)
    label.setTextFormat(Qt.TextFormat.RichText)
    return label
