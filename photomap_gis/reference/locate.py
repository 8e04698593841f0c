"""A map without any position, looked for in the whole of a reference: unknown place, heading and scale.

The map is drawn small and compared with windows of the reference, from the whole of it down to an eighth, each half
over the next: registration finds turns of any size and scales within a factor of two, the sizes of the windows follow
each other by two. So a map is found that covers between about a tenth of the reference's longer side and all of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from photomap_gis.core.grid import MapFrame, MapGrid
from photomap_gis.core.measurement import Registration
from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.reference.draw import ReadGrey, draw_patch
from photomap_gis.reference.imagery import Patch, ReferenceImage
from photomap_gis.reference.match import spread_out
from photomap_gis.reference.pictures import Look, seen_as

SIDE_PX = 384
SHARES = (1.1, 0.55, 0.275, 0.14)
"""Sides of the windows as shares of the reference's longer side."""
FRAMES_DRAWN = 60
LEAST_NEW = 0.003
MIN_SEEN = 0.2
WORTH_A_LOOK = 0.6
"""Probability from which a find is worth to be tested by ties."""

RegisterFreely = Callable[[Patch, Patch], Registration]
"""The motion of the second picture into the first, nothing known."""


def locations(
    placements: Sequence[FramePlacement],
    image: ReferenceImage,
    map_frame: MapFrame,
    read_grey: ReadGrey,
    register: RegisterFreely,
) -> Iterator[tuple[Similarity2D, float]]:
    """Yield where a relative map may lie: ``T_map_local``, and the sigma of its place in metres; test each.

    ``placements`` share a local frame; ``map_frame`` is that of the result. Large windows come first.
    """
    outline = np.concatenate([p.outline_xy_map_m() for p in placements])
    low, high = outline.min(axis=0), outline.max(axis=0)
    pixel = float((high - low).max()) / SIDE_PX
    local = MapFrame(None)
    west, north = local.to_crs(low[None])[0]
    width, height = (max(32, math.ceil(v / pixel)) for v in high - low)
    grid = MapGrid(None, float(west), float(north), pixel, width, height)
    centres = np.array([p.centre_xy_map_m for p in placements])
    chosen = [placements[k] for k in spread_out(centres, FRAMES_DRAWN)]
    drawn = draw_patch(chosen, local, grid, read_grey, least_new=LEAST_NEW)
    T_local_drawn = _from_pixels(grid, local)
    for window in _windows(image, map_frame):
        old = image.read(window)
        if old.share_seen < MIN_SEEN:
            continue
        r = register(seen_as(old, Look.GRADIENT), seen_as(drawn, Look.GRADIENT))
        if r.probability >= WORTH_A_LOOK:
            yield _from_pixels(window, map_frame) @ r.T_a_b @ T_local_drawn.inverse(), 2.0 * window.pixel_size


def _windows(image: ReferenceImage, map_frame: MapFrame) -> Iterator[MapGrid]:
    """Yield square windows over the reference, the largest first."""
    west, south, east, north = image.bounds(str(map_frame.crs_wkt))
    longer = max(east - west, north - south)
    finest = image.gsd_m_per_px(str(map_frame.crs_wkt))
    for share in SHARES:
        side = share * longer
        pixel = max(side / SIDE_PX, finest)
        size = max(64, round(side / pixel))
        counts = [max(1, math.ceil((extent - side) / (side / 2.0)) + 1) for extent in (east - west, north - south)]
        for row in range(counts[1]):
            for col in range(counts[0]):
                # Spread evenly: the first and the last window end where the reference does.
                x, y = (
                    0.5 * extent if n == 1 else side / 2.0 + k * (extent - side) / (n - 1)
                    for k, n, extent in zip((col, row), counts, (east - west, north - south), strict=True)
                )
                yield MapGrid(map_frame.crs_wkt, west + x - side / 2.0, north - y + side / 2.0, pixel, size, size)


def _from_pixels(grid: MapGrid, frame: MapFrame) -> Similarity2D:
    """Return the similarity from a grid's pixels to the internal map frame: both have y down."""
    x, y = frame.from_crs(grid.to_crs(np.zeros((1, 2))))[0]
    return Similarity2D(float(x), float(y), 0.0, math.log(grid.pixel_size))
