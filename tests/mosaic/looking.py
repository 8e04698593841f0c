"""How placed frames see a window of a grid, and who gives its pixels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.mosaic.cells import UNSETTLED, label_cells
from photomap_gis.mosaic.lattice import Lattice
from photomap_gis.mosaic.sighting import ranked_costs, sights_of
from photomap_gis.mosaic.views import View, views_of
from tests.mosaic.flight import GSD_M, MAP_FRAME


def look(grid: MapGrid, *placements: FramePlacement) -> tuple[Lattice, list[View], np.ndarray]:
    """Return the lattice over a whole grid, the frames' views, and how they see its nodes."""
    lattice = Lattice.over(Window(0, 0, grid.width, grid.height), grid, MAP_FRAME)
    views = views_of(Trajectory(placements))
    return lattice, views, sights_of(views, lattice, GSD_M)


def labels_of(
    views: Sequence[View], sights: np.ndarray, lattice: Lattice, at_nodes: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return who gives each pixel of the domain, and each cell; each pixel to the cheapest, where no node says whom."""
    nodes = np.full(lattice.shape, UNSETTLED, np.int16) if at_nodes is None else at_nodes.astype(np.int16)
    labels = np.empty((lattice.height, lattice.width), np.int16)
    givers = np.empty((lattice.shape[0] - 1, lattice.shape[1] - 1), np.int16)
    sizes_px = np.array([(v.placement.width_px, v.placement.height_px) for v in views], np.float32)
    label_cells(nodes, sights, ranked_costs(views, sights), sizes_px, labels, givers)
    return labels, givers
