"""One tile from the frames that see it. Every pixel of a frame is resampled once, straight into the map's grid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from photomap_gis.core.grid import CrsFrame, MapGrid, Window, ground_pixel_m
from photomap_gis.mosaic.cells import UNSETTLED, label_cells, name_frames
from photomap_gis.mosaic.exposure import Exposure
from photomap_gis.mosaic.lattice import STEP_PX, Box, FloatImage, Lattice
from photomap_gis.mosaic.light import Light, consensus_weights, exposed, levels_of, shift_to_consensus
from photomap_gis.mosaic.lowband import LowBand
from photomap_gis.mosaic.outlook import looks_of
from photomap_gis.mosaic.paint import Shares, paint
from photomap_gis.mosaic.pixels import SourceImage
from photomap_gis.mosaic.seams import node_labels, without_slivers
from photomap_gis.mosaic.sighting import ranked_costs, sights_of
from photomap_gis.mosaic.tiles import NOBODY, RgbaArray, SourceArray
from photomap_gis.mosaic.views import View

_LIGHT_STEP_PX, _LIGHT_STEPS_A_SIDE = 32, 16
Slices = tuple[slice, slice]
Labels = npt.NDArray[np.int16]


class FrameSource(Protocol):
    """Where a tile gets its frames from; both raise ``FrameReadError`` for a frame that cannot be read."""

    def image(self, view: View) -> SourceImage:
        """Return the frame's pixels, prepared for the grid."""
        ...

    def low_band(self, view: View) -> LowBand:
        """Return the frame's low frequencies."""
        ...


class RenderedTile(NamedTuple):
    """``(height, width, 4)`` RGBA, and ``(height, width)`` int32 the frame that each pixel shows, -1 where none."""

    rgba: RgbaArray
    source: SourceArray


def render_tile(
    window: Window,
    grid: MapGrid,
    map_frame: CrsFrame,
    *,
    givers: Sequence[View],
    neighbours: Sequence[View],
    source: FrameSource,
    exposure: Exposure,
) -> RgbaArray:
    """Return ``(height, width, 4)`` RGBA of a window of the grid; alpha is 255 exactly where a giver sees the ground.

    ``givers`` may give pixels, ``neighbours`` (which include them) low frequencies.
    """
    return render_tile_and_sources(
        window, grid, map_frame, givers=givers, neighbours=neighbours, source=source, exposure=exposure
    ).rgba


def render_tile_and_sources(
    window: Window,
    grid: MapGrid,
    map_frame: CrsFrame,
    *,
    givers: Sequence[View],
    neighbours: Sequence[View],
    source: FrameSource,
    exposure: Exposure,
) -> RenderedTile:
    """Return what ``render_tile`` does, and which frame each pixel shows (its detail; seams are blended).

    A window of several tiles, or of a part of one, shows what the tiles show.
    """
    out = _blank(window.height, window.width)
    giving = {view.frame for view in givers}
    pixel_m = ground_pixel_m(grid, map_frame)
    light_step = _light_step(neighbours, pixel_m)
    if not giving:
        return out
    for tile, here, there in _tiles_under(window, grid.tile_size):
        lattice = Lattice.over(tile, grid, map_frame)
        candidates = [v for v in neighbours if v.frame in giving]
        sights = sights_of(candidates, lattice, pixel_m)
        # Nodes of tiles that are no whole number of steps wide lie apart: their seams would not meet.
        seams = grid.tile_size % STEP_PX == 0
        labels, cell_givers = _labels(candidates, sights, lattice, source, exposure, pixel_m, seams=seams)
        box = Box(there[1].start, there[0].start, there[1].stop - there[1].start, there[0].stop - there[0].start)
        shares = Shares.of(labels, cell_givers, len(candidates), box)
        if not shares.present:
            continue
        coarse = Lattice.over(tile, grid, map_frame, step_px=light_step)
        frames = {k: candidates[k].frame for k in shares.present}
        lights = _lights(neighbours, sights_of(neighbours, coarse, pixel_m), set(frames.values()), source, exposure)
        whole = (box.height, box.width) == out.source.shape
        part = out if whole else _blank(box.height, box.width)
        paint(
            part.rgba, shares, candidates, sights, {k: lights[f] for k, f in frames.items()}, light_step, source.image
        )
        name_frames(
            labels, np.array([*(v.frame for v in candidates), NOBODY], dtype=np.int32), box.x, box.y, part.source
        )
        if part is not out:
            out.rgba[here], out.source[here] = part
    return out


def _blank(height: int, width: int) -> RenderedTile:
    return RenderedTile(np.zeros((height, width, 4), dtype=np.uint8), np.full((height, width), NOBODY, dtype=np.int32))


def _tiles_under(window: Window, tile_size: int) -> Iterator[tuple[Window, Slices, Slices]]:
    """Yield the whole tiles under a window, and which pixels of the window are which of the tile's domain."""
    last_row, last_col = window.row_off + window.height, window.col_off + window.width
    for y in range(window.row_off // tile_size * tile_size, last_row, tile_size):
        for x in range(window.col_off // tile_size * tile_size, last_col, tile_size):
            top, bottom = max(y, window.row_off), min(y + tile_size, last_row)
            left, right = max(x, window.col_off), min(x + tile_size, last_col)
            here = np.s_[top - window.row_off : bottom - window.row_off, left - window.col_off : right - window.col_off]
            there = np.s_[top - y + STEP_PX : bottom - y + STEP_PX, left - x + STEP_PX : right - x + STEP_PX]
            yield Window(x, y, tile_size, tile_size), here, there


def _light_step(views: Sequence[View], pixel_m: float) -> int:
    """Return the distance of nodes that light is levelled at: wide, but for frames so small that it changes faster."""
    sides = (min(v.placement.width_px, v.placement.height_px) * v.gsd_m_per_px / pixel_m for v in views)
    return _LIGHT_STEP_PX if min(sides, default=0.0) >= _LIGHT_STEPS_A_SIDE * _LIGHT_STEP_PX else STEP_PX


def _labels(
    candidates: Sequence[View],
    sights: FloatImage,
    lattice: Lattice,
    source: FrameSource,
    exposure: Exposure,
    pixel_m: float,
    *,
    seams: bool,
) -> tuple[Labels, Labels]:
    """Return which candidate gives each pixel of the domain, ``(height, width)``, and each cell (``label_cells``).

    With ``seams`` they meet along lines that spare objects, else where they cost the same.
    """
    costs = ranked_costs(candidates, sights)
    if seams:
        # Node 1 lies in the margin, node 2 in the tile's first pixels; the next tile's first pixels hold the last but
        # one.
        edges = (2, lattice.shape[0] - 2)
        at_nodes = node_labels(
            costs, looks_of(candidates, sights, source.low_band, exposure), edges=edges,
            half_diagonals_nodes=[v.half_diagonal_px * v.gsd_m_per_px / (STEP_PX * pixel_m) for v in candidates],
        )  # fmt: skip
        at_nodes = without_slivers(at_nodes, costs, edges)
    else:
        at_nodes = np.full(lattice.shape, UNSETTLED, dtype=np.int16)
    rows, columns = lattice.shape
    labels = np.empty((lattice.height, lattice.width), dtype=np.int16)
    givers = np.empty((rows - 1, columns - 1), dtype=np.int16)
    sizes_px = np.array([(v.placement.width_px, v.placement.height_px) for v in candidates], dtype=np.float32)
    label_cells(at_nodes, sights, costs, sizes_px, labels, givers)
    return labels, givers


def _lights(
    views: Sequence[View], sights: FloatImage, givers: set[int], source: FrameSource, exposure: Exposure
) -> dict[int, Light]:
    """Return for every frame that gives pixels what moves its low frequencies to the consensus of all.

    ``views`` are all that see the place, ``sights`` how they see the nodes of a coarse lattice.
    """
    weights = consensus_weights(views, sights)
    sharing = [bool(weight.any()) for weight in weights]
    asked = [k for k, view in enumerate(views) if sharing[k] or view.frame in givers]
    factors = {k: exposed(views[k], sights[k], exposure) for k in asked}
    if sum(sharing) < 2:
        return {views[k].frame: Light(factors[k], np.zeros_like(factors[k])) for k in asked}
    levels = np.stack([levels_of(source.low_band(views[k]), sights[k], factors[k]) for k in asked])
    shares = weights[asked]
    return {
        views[k].frame: Light(factors[k], shift_to_consensus(levels, shares, n))
        for n, k in enumerate(asked)
        if views[k].frame in givers
    }
