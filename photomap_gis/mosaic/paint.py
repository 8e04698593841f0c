"""The pixels of a tile, once it is known who gives which and what makes them part of the map."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.mosaic.cells import shares_of
from photomap_gis.mosaic.drawing import draw, fill_nodes, mix
from photomap_gis.mosaic.lattice import STEP_PX, Box, FloatImage
from photomap_gis.mosaic.light import Light
from photomap_gis.mosaic.pixels import SourceImage
from photomap_gis.mosaic.sighting import X_PX, Y_PX
from photomap_gis.mosaic.taps import AT_X, AT_Y, LANES
from photomap_gis.mosaic.tiles import RgbaArray
from photomap_gis.mosaic.views import View

_REACH_PX = 4  # what taps of a place read around it, and a pixel more


class Shares(NamedTuple):
    """Who gives what of a box of a tile's domain, as ``cells.shares_of`` tells it; ``labels`` are by pixel."""

    labels: npt.NDArray[np.int16]
    box: Box
    cells: npt.NDArray[np.int32]
    slots: npt.NDArray[np.int32]
    starts: npt.NDArray[np.int64]
    slot_cells: npt.NDArray[np.int32]

    @classmethod
    def of(cls, labels: npt.NDArray[np.int16], givers: npt.NDArray[np.int16], count: int, box: Box) -> Shares:
        """Return the shares of ``count`` frames."""
        return cls(labels, box, *shares_of(labels, givers, count, *box))

    @property
    def present(self) -> list[int]:
        """The frames that have a share."""
        return np.flatnonzero(np.diff(self.starts)).tolist()


def paint(
    rgba: RgbaArray,
    shares: Shares,
    views: Sequence[View],
    sights: FloatImage,
    lights: Mapping[int, Light],
    light_step_px: int,
    image_of: Callable[[View], SourceImage],
) -> None:
    """Draw ``shares.box`` into ``(height, width, 4)`` zeros: each pixel is one frame's, along seams a mean of several.

    ``lights`` are of the frames that are present, at nodes ``light_step_px`` apart.
    """
    rows, columns = sights.shape[2:]
    sums = np.zeros(4 * STEP_PX**2 * len(shares.slot_cells), dtype=np.float32)
    nodes = np.empty((rows, columns, LANES), dtype=np.float32)
    for k in shares.present:
        image, scale = image_of(views[k])
        mine = slice(shares.starts[k], shares.starts[k + 1])
        cells = shares.cells[mine]
        fill_nodes(sights[k, X_PX], sights[k, Y_PX], scale, *lights[k], light_step_px, nodes)
        bgr = np.ascontiguousarray(image) if image.ndim == 3 else _coloured_part(image, nodes, cells)
        draw(bgr, nodes, cells, shares.slots[mine], k, shares.labels, shares.box.x, shares.box.y, rgba, sums)
    if len(shares.slot_cells):
        mix(shares.slot_cells, columns - 1, sums, shares.labels, shares.box.x, shares.box.y, rgba)


def _coloured_part(grey: ImageArray, nodes: FloatImage, cells: npt.NDArray[np.int32]) -> ImageArray:
    """Return the part of a grey raster that some cells show, as BGR; the nodes' places become those in it."""
    i, j = np.divmod(cells, nodes.shape[1] - 1)
    under = nodes[i.min() : i.max() + 2, j.min() : j.max() + 2]
    parts = []
    for at, side in ((AT_X, grey.shape[1]), (AT_Y, grey.shape[0])):
        low, high = float(under[..., at].min()) - _REACH_PX, float(under[..., at].max()) + _REACH_PX
        first = int(min(max(low, 0.0), side - 1.0))
        parts.append(slice(first, int(min(max(high, first), side - 1.0)) + 1))
        nodes[..., at] -= first
    return np.asarray(cv2.cvtColor(grey[parts[1], parts[0]], cv2.COLOR_GRAY2BGR))
