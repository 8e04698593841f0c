"""Words for the user in QGIS's message bar: what happened, and what to do."""

from __future__ import annotations

from qgis.core import Qgis, QgsMessageLog

from .translation import tr

TITLE = "photomap"
SECONDS = 8


class Messages:
    """Says things in the message bar, and keeps them in the log panel "photomap"."""

    def __init__(self, iface) -> None:
        self._iface = iface

    def info(self, text: str) -> None:
        """Say that something was done."""
        self._say(text, Qgis.MessageLevel.Success, SECONDS)

    def warn(self, text: str) -> None:
        """Say what is to be known of a result; it stays until it is closed."""
        self._say(text, Qgis.MessageLevel.Warning, 0)

    def fail(self, text: str) -> None:
        """Say that something failed and what to do; it stays until it is closed."""
        self._say(text or tr("The engine gave no reason: see the log panel “photomap”."), Qgis.MessageLevel.Critical, 0)

    def log(self, text: str) -> None:
        """Keep a line in the log panel only."""
        QgsMessageLog.logMessage(text, TITLE, Qgis.MessageLevel.Info, False)

    def _say(self, text: str, level, seconds: int) -> None:
        QgsMessageLog.logMessage(text, TITLE, level, False)
        self._iface.messageBar().pushMessage(TITLE, text, level, seconds)
