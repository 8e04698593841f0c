"""The finished map as its readers see it: a grid whose pixels can be read window by window."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from photomap_gis.core.grid import MapGrid, Window


class TileSource(Protocol):
    """A map that can be read piece by piece; never whole in memory."""

    @property
    def grid(self) -> MapGrid:
        """The map's grid."""
        ...

    @property
    def revision(self) -> int:
        """Counts the solutions: a reader with another number holds a stale picture."""
        ...

    def read(self, window: Window) -> npt.NDArray[np.uint8]:
        """``(height, width, 4)`` RGBA; alpha 0 where nothing was seen, as where the window overhangs the grid."""
        ...
