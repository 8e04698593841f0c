"""The vehicle's part of the planner: upload with its verified end, what it holds, how it is. It never arms anything."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from qgis.core import QgsSettings
from qgis.PyQt.QtCore import pyqtSignal
from qgis.PyQt.QtWidgets import (
    QComboBox,
    QDoubleSpinBox,
    QFormLayout,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from ..translation import tr
from .layers import place_feature, stored_overlay
from .result import report_words
from .stored import UnreadableMissionError, stored_features

_LAST = "photomap/connection"
ANSWER_WITHIN_S = 20
USUAL = ("udpin:0.0.0.0:14550", "tcp:127.0.0.1:5760", "udpin:0.0.0.0:14540", "tcp:127.0.0.1:5762")
"""A telemetry bridge or ground station that sends here, ArduPilot's simulator, PX4's, ArduPilot's second port."""


class VehiclePanel(QWidget):
    """Connection, upload, download, status; ``start`` begins an engine's job, ``messages`` speaks to the user.

    ``upload_wanted`` asks the dock for the plan: it answers by ``upload(path)``, or says why it cannot. ``stands_at``
    is the vehicle's latitude and longitude in degrees, sent when the user wants to take off there.
    """

    upload_wanted = pyqtSignal()
    stands_at = pyqtSignal(float, float)

    def __init__(self, start: Callable[[str, dict], object], messages, kept_folder: Path, scratch: Path) -> None:
        super().__init__()
        self._start, self._messages = start, messages
        self._kept_folder, self._scratch = kept_folder, scratch
        self._job: object | None = None
        self._doing = ""
        self._previous = ""
        self._number = 0
        self._released = False
        self.overlay = stored_overlay()
        self._build()

    def release(self) -> None:
        """Stop what runs and take the layers away."""
        self._released = True
        if self._job is not None:
            self._job.cancel()
            self._job = None
        self.overlay.remove()

    def _build(self) -> None:
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        form = QFormLayout()
        self.connection = QComboBox()
        self.connection.setEditable(True)
        self.connection.setObjectName("planner_connection")
        self.connection.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.connection.setMinimumContentsLength(8)
        last = QgsSettings().value(_LAST, "", type=str)
        for url in dict.fromkeys(u for u in (last, *USUAL, *serial_ports()) if u):
            self.connection.addItem(url)
        self.connection.setToolTip(
            tr("udpin:0.0.0.0:14550 listens, udpout:HOST:PORT, tcp:HOST:PORT, serial:/dev/ttyUSB0:57600 or COM3")
        )
        form.addRow(tr("Co&nnection"), self.connection)
        self.sortie = QComboBox()
        self.sortie.setObjectName("planner_sortie")
        form.addRow(tr("So&rtie"), self.sortie)
        self.most_height = _metres(1, 10_000, 120)
        self.most_height.setToolTip(tr("An upload with an item higher above home is refused"))
        self.most_distance = _metres(1, 100_000, 5000)
        self.most_distance.setToolTip(tr("An upload with an item farther from home is refused"))
        limits = QHBoxLayout()
        limits.addWidget(self.most_height)
        limits.addWidget(self.most_distance)
        form.addRow(tr("Refuse above, beyond"), limits)
        column.addLayout(form)
        buttons = QGridLayout()
        self.upload_button = _button(tr("&Upload"), "upload", self.upload_wanted.emit)
        self.stored_button = _button(tr("Show its &mission"), "stored", self.show_stored)
        self.status_button = _button(tr("&Status"), "status", self.show_status)
        self.here_button = _button(tr("Take off &here"), "here", self.take_off_here)
        self.restore_button = _button(tr("&Put back"), "restore", self.put_back)
        self.cancel_button = _button(tr("Stop"), "cancel", self.cancel)
        for button, words in (
            (self.upload_button, tr("Upload the chosen sortie, read it back, put the old mission back if it differs")),
            (self.stored_button, tr("Read the mission that the vehicle holds, and show it on the map")),
            (self.here_button, tr("Plan the take-off where the vehicle stands")),
            (self.restore_button, tr("Give the vehicle the mission again that the last upload replaced")),
        ):
            button.setToolTip(words)
        for at, button in enumerate(
            (
                self.upload_button, self.stored_button, self.status_button, self.here_button, self.restore_button,
                self.cancel_button,
            )
        ):  # fmt: skip
            buttons.addWidget(button, at // 2, at % 2)
        column.addLayout(buttons)
        self.bar = QProgressBar()
        self.bar.setVisible(False)
        column.addWidget(self.bar)
        self.words = QLabel()
        self.words.setWordWrap(True)
        self.words.setObjectName("planner_vehicle_words")
        column.addWidget(self.words)
        self._set_busy(False)

    # what the user asks for

    def set_sorties(self, count: int) -> None:
        """Offer the sorties of the plan; the one that was chosen stays where it is still there."""
        if self.sortie.count() == count:
            return
        chosen = max(self.sortie.currentIndex(), 0)
        self.sortie.clear()
        self.sortie.addItems([tr("{} of {}").format(n, count) for n in range(1, count + 1)])
        self.sortie.setCurrentIndex(min(chosen, count - 1))
        self.sortie.setEnabled(count > 1)

    def upload(self, plan: str) -> None:
        """Upload a .plan file; what the vehicle holds is kept first, where it stays when QGIS is closed."""
        arguments = {
            **self._link(),
            **self._keep(),
            "plan": plan,
            "max_height": self.most_height.value(),
            "max_distance": self.most_distance.value(),
        }
        self._run("upload", arguments, tr("Uploading…"), self._uploaded)

    def put_back(self) -> None:
        """Give the vehicle the mission again that the last upload replaced."""
        arguments = {**self._link(), **self._keep(), "restore": self._previous}
        self._run("upload", arguments, tr("Putting back…"), self._uploaded)

    def show_stored(self) -> None:
        """Read what the vehicle holds and show it on the map."""
        self._number += 1
        path = self._scratch / f"stored-{self._number}.plan"
        self._run(
            "download",
            {**self._link(), "output": str(path)},
            tr("Reading the vehicle's mission…"),
            lambda result: self._downloaded(path, result),
        )

    def show_status(self) -> None:
        """Ask the vehicle how it is."""
        self._run("vehicle", self._link(), tr("Asking the vehicle…"), self._looked)

    def take_off_here(self) -> None:
        """Make the vehicle's place the take-off place of the plan."""
        self._run("vehicle", self._link(), tr("Asking the vehicle…"), self._looked_for_home)

    def cancel(self) -> None:
        """Stop; an upload first brings the vehicle to a known state."""
        if self._job is not None:
            self.words.setText(tr("Stopping: the vehicle is brought to a known state first…"))
            self.cancel_button.setEnabled(False)
            self._job.cancel()

    # how it goes

    def _link(self) -> dict:
        return {"connect": self.connection.currentText().strip(), "timeout": ANSWER_WITHIN_S}

    def _keep(self) -> dict:
        """Where what the vehicle holds is kept: a name that no earlier run has; beside the plan where that fails."""
        try:
            self._kept_folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            words = tr("{} cannot be made ({}): what the vehicle holds is kept in {} until QGIS closes.")
            self._messages.warn(words.format(self._kept_folder, error.strerror, self._scratch))
            return {}
        number = 1
        while (path := self._kept_folder / f"vehicle-before-{number:03d}.json").exists():
            number += 1
        return {"save_previous": str(path)}

    def _run(self, kind: str, arguments: dict, doing: str, done: Callable[[dict], None]) -> None:
        if self._job is not None:
            return
        url = arguments["connect"]
        if not url:
            self._messages.fail(tr("Say how the vehicle is connected, as udpin:0.0.0.0:14550 or serial:COM3:57600."))
            return
        QgsSettings().setValue(_LAST, url)
        job = self._start(kind, arguments)
        if job is None:
            return
        self._job, self._doing = job, doing
        self._set_busy(True)
        self.words.setText(doing)
        job.progress.connect(self._progress)
        job.finished.connect(lambda result: self._end(lambda: done(result)))
        job.failed.connect(lambda message: self._end(lambda: self._failed(job, message)))

    def _progress(self, stage: str, done: float, total: float, *_) -> None:
        if self._released:
            return
        self.bar.setMaximum(max(int(total), 1))
        self.bar.setValue(int(done))
        self.words.setText(f"{self._doing} {stage}")

    def _end(self, tell: Callable[[], None]) -> None:
        if self._released:
            return
        self._job = None
        self._set_busy(False)
        tell()

    def _set_busy(self, busy: bool) -> None:
        for button in (self.upload_button, self.stored_button, self.status_button, self.here_button):
            button.setEnabled(not busy)
        self.restore_button.setEnabled(not busy and bool(self._previous))
        self.cancel_button.setEnabled(busy)
        self.bar.setVisible(busy)
        self.bar.setMaximum(0)

    def _failed(self, job, message: str) -> None:
        report = getattr(job, "result", None)
        if isinstance(report, dict) and report.get("outcome"):
            self._uploaded(report)
            return
        self.words.setText(message)
        self._messages.fail(message)

    def _uploaded(self, report: dict) -> None:
        if report.get("saved_previous"):
            self._previous = report["saved_previous"]
            self.restore_button.setEnabled(True)
        words = report_words(report)
        self.words.setText(words)
        for warning in report.get("warnings", []):
            self._messages.log(warning)
        verified = report.get("outcome") == "verified"
        (self._messages.info if verified else self._messages.fail)(words)

    def _downloaded(self, path: Path, result: dict) -> None:
        try:
            found = stored_features(path)
        except UnreadableMissionError as error:
            self._messages.fail(str(error))
            return
        self.overlay.show(found)
        words = tr("The vehicle holds {items} items, {fence} of a fence, {rally} rally points.").format(
            items=result.get("items", 0), fence=result.get("fence", 0), rally=result.get("rally", 0)
        )
        if not found["items"]:
            words += " " + tr("None of them has a place to show.")
        self.words.setText(" ".join([words, *result.get("warnings", [])]))

    def _looked(self, state: dict) -> None:
        self.words.setText(status_words(state))
        lat, lon = state.get("lat_deg"), state.get("lon_deg")
        if lat is not None and lon is not None:
            self.overlay.set_features("vehicle", [place_feature("vehicle", (lat, lon), str(state.get("mode", "")))])

    def _looked_for_home(self, state: dict) -> None:
        self._looked(state)
        if state.get("lat_deg") is None or not (state["lat_deg"] or state["lon_deg"]):
            self._messages.fail(tr("The vehicle does not know where it is yet: wait for its GPS."))
            return
        self.stands_at.emit(state["lat_deg"], state["lon_deg"])


def status_words(state: dict) -> str:
    """Return what ``photomap vehicle --json`` says in a line or two; what is not known is left out."""
    mission = state.get("mission") or {}
    parts = [
        tr("Vehicle {number}: {autopilot} {version}")
        .format(
            number=state.get("system"),
            autopilot=state.get("autopilot") or tr("unknown autopilot"),
            version=state.get("version") or "",
        )
        .strip(),
        f"{state.get('mode') or '?'}, {tr('ARMED') if state.get('armed') else tr('disarmed')}",
    ]
    for key, words, digits in (
        ("height_m", tr("{} m above home"), 1),
        ("satellites", tr("{} satellites"), 0),
        ("battery_v", "{} V", 1),
        ("battery_percent", "{} %", 0),
    ):
        if state.get(key) is not None:
            parts.append(words.format(f"{state[key]:.{digits}f}"))
    if mission.get("total") is not None:
        parts.append(
            tr("mission item {current} of {total}").format(current=mission.get("current") or 0, total=mission["total"])
        )
    if state.get("text"):
        parts.append(f"“{state['text']}”")
    return ", ".join(parts)


def serial_ports() -> list[str]:
    """Return the serial ports where a telemetry radio may be, as connection strings."""
    if sys.platform == "win32":
        return ["serial:COM3:57600"]
    found = [p for pattern in ("ttyUSB*", "ttyACM*", "cu.usb*") for p in sorted(Path("/dev").glob(pattern))]
    return [f"serial:{port}:57600" for port in found] or ["serial:/dev/ttyUSB0:57600"]


def _button(text: str, name: str, slot) -> QPushButton:
    button = QPushButton(text)
    button.setObjectName(f"planner_{name}")
    button.clicked.connect(lambda *_: slot())
    return button


def _metres(low: float, high: float, value: float) -> QDoubleSpinBox:
    spin = QDoubleSpinBox()
    spin.setDecimals(0)
    spin.setRange(low, high)
    spin.setValue(value)
    spin.setSuffix(" m")
    return spin
