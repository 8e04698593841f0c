"""Docks scroll up and down; they are never so narrow that they would have to scroll sideways too."""

from __future__ import annotations

from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtWidgets import QScrollArea


def narrow_no_further(scroll: QScrollArea) -> None:
    """Keep a scroll area as wide as what is in it needs at least, with room for its scroll bar."""
    scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    scroll.setMinimumWidth(scroll.widget().minimumSizeHint().width() + scroll.verticalScrollBar().sizeHint().width())
