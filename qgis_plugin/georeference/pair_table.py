"""The table of pairs: role, both places, and by how much the solved map misses them; marks on both canvases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from qgis.core import QgsPointXY
from qgis.gui import QgsMapCanvas, QgsVertexMarker
from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtGui import QColor
from qgis.PyQt.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget, QTableWidgetItem

from ..translation import tr
from .pairs import Pair

COLOURS = {False: "#d81b60", True: "#1e88e5"}
"""Of control points and of check points, in table and canvas."""
ROLE = 0


class PairTable(QTableWidget):
    """Shows the pairs; a double click or Space on a role changes it; ``changed`` after every change by the user."""

    changed = pyqtSignal()

    def __init__(self, parent=None) -> None:
        super().__init__(0, 7, parent)
        self.pairs: list[Pair] = []
        self.setAccessibleName(tr("Pairs of places"))
        self.setHorizontalHeaderLabels(
            [tr("Role"), tr("Miss (m)"), tr("East"), tr("North"), tr("Sigma"), tr("On the map"), tr("On Earth")]
        )
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.cellDoubleClicked.connect(lambda row, column: self.toggle(row) if column == ROLE else None)

    def show_pairs(self, pairs: list[Pair]) -> None:
        """Show these pairs instead."""
        self.pairs = list(pairs)
        self.setRowCount(len(pairs))
        for row, pair in enumerate(pairs):
            miss = pair.miss
            role = tr("check") if pair.check else tr("control")
            aside = miss is not None and not miss.used and not pair.check
            numbers = () if miss is None else (miss.metres, miss.east_m, miss.north_m, miss.sigma_m)
            words = [
                tr("put aside") if aside else role,
                *([f"{v:.2f}" for v in numbers] or [""] * 4),
                tr("click…") if pair.map_xy is None else "{:.2f}, {:.2f}".format(*pair.map_xy),
                tr("click…") if pair.lonlat is None else f"{pair.lonlat[1]:.6f}, {pair.lonlat[0]:.6f}",
            ]
            for column, word in enumerate(words):
                item = QTableWidgetItem(word)
                if column == ROLE:
                    item.setForeground(QColor(COLOURS[pair.check]))
                    item.setToolTip(tr("Double click or Space: for the fit, or for the check"))
                self.setItem(row, column, item)

    def toggle(self, row: int) -> None:
        """Make a control point a check point, or the other way round."""
        pairs = list(self.pairs)
        pairs[row] = replace(pairs[row], check=not pairs[row].check, miss=None)
        self.show_pairs(pairs)
        self.selectRow(row)
        self.changed.emit()

    def place(self, *, map_xy: tuple[float, float] | None = None, lonlat: tuple[float, float] | None = None) -> None:
        """Fill a side of the last pair, or begin a new one where both sides are known."""
        pairs = list(self.pairs)
        if not pairs or pairs[-1].whole:
            pairs.append(Pair())
        pairs[-1] = replace(pairs[-1], map_xy=map_xy or pairs[-1].map_xy, lonlat=lonlat or pairs[-1].lonlat)
        self.show_pairs(pairs)
        self.scrollToBottom()
        self.changed.emit()

    def remove_selected(self) -> None:
        """Take the selected pairs away; the last one where none is selected."""
        rows = {index.row() for index in self.selectedIndexes()} or ({len(self.pairs) - 1} if self.pairs else set())
        self.show_pairs([p for row, p in enumerate(self.pairs) if row not in rows])
        self.changed.emit()

    def keyPressEvent(self, event) -> None:
        """Space changes the role, Delete removes."""
        if event.key() == Qt.Key.Key_Space and self.currentRow() >= 0:
            self.toggle(self.currentRow())
        elif event.key() == Qt.Key.Key_Delete:
            self.remove_selected()
        else:
            super().keyPressEvent(event)


class PairMarks:
    """Crosses on a canvas, one a pair: red for the fit, blue for the check."""

    def __init__(self, canvas: QgsMapCanvas, where: Callable[[Pair], QgsPointXY | None]) -> None:
        self._canvas, self._where = canvas, where
        self.marks: list[QgsVertexMarker] = []

    def show(self, pairs: list[Pair]) -> None:
        """Mark these pairs and no others."""
        self.clear()
        for pair in pairs:
            point = self._where(pair)
            if point is not None:
                mark = QgsVertexMarker(self._canvas)
                mark.setIconType(QgsVertexMarker.IconType.ICON_CROSS)
                mark.setColor(QColor(COLOURS[pair.check]))
                mark.setIconSize(16)
                mark.setPenWidth(3)
                mark.setCenter(point)
                self.marks.append(mark)

    def clear(self) -> None:
        """Take all marks off."""
        while self.marks:
            self._canvas.scene().removeItem(self.marks.pop())
