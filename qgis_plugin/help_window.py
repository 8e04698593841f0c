"""The help page in a window of its own: the same text as ``docs/qgis.md``, without the internet."""

from __future__ import annotations

from pathlib import Path

from qgis.PyQt.QtWidgets import QDialog, QTextBrowser, QVBoxLayout

from .translation import tr

HERE = Path(__file__).parent
PLACES = (HERE / "help", HERE.parent / "docs")
"""In the plugin as it is installed, and in a checkout."""


def help_page() -> Path | None:
    """Return where the help page is, ``None`` where it was not packed."""
    return next((place / "qgis.md" for place in PLACES if (place / "qgis.md").is_file()), None)


class HelpWindow(QDialog):
    """Shows the help page; links to the web open in the browser."""

    def __init__(self, parent=None) -> None:
        super().__init__(parent)
        self.setObjectName("photomapHelp")
        self.setWindowTitle(tr("Help: photomap in QGIS"))
        self.resize(760, 720)
        self.text = QTextBrowser(self)
        self.text.setOpenExternalLinks(True)
        page = help_page()
        if page is None:
            self.text.setPlainText(tr("The help page is missing: install the plugin again from its zip."))
        else:
            self.text.setSearchPaths([str(page.parent)])
            self.text.setMarkdown(page.read_text(encoding="utf-8"))
        QVBoxLayout(self).addWidget(self.text)
