"""One tile from the frames that see it. Every pixel of a frame is resampled once, straight into the map's grid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.grid import CrsFrame, MapGrid, Window, ground_pixel_m
from photomap_gis.mosaic.blend import (
    Seen,
    consensus_weights,
    labels_of,
    shift_to_consensus,
)
from photomap_gis.mosaic.choice import TIER_COST, radius_and_border, sight
from photomap_gis.mosaic.exposure import Exposure
from photomap_gis.mosaic.lattice import STEP_PX, Box, FloatImage, Lattice
from photomap_gis.mosaic.lowband import LowBand
from photomap_gis.mosaic.paint import Correction, paint
from photomap_gis.mosaic.pixels import SourceImage
from photomap_gis.mosaic.seams import node_labels
from photomap_gis.mosaic.tiles import NOBODY, RgbaArray, SourceArray
from photomap_gis.mosaic.views import View

_SLACK_NODES = 3.0
_LIGHT_STEP_PX, _LIGHT_STEPS_A_SIDE = 32, 16
Slices = tuple[slice, slice]


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
    out = RenderedTile(
        np.zeros((window.height, window.width, 4), dtype=np.uint8),
        np.full((window.height, window.width), NOBODY, dtype=np.int32),
    )
    giving = {view.frame for view in givers}
    pixel_m = ground_pixel_m(grid, map_frame)
    light_step = _light_step(neighbours, pixel_m)
    if not giving:
        return out
    for tile, here, there in _tiles_under(window, grid.tile_size):
        lattice = Lattice.over(tile, grid, map_frame)
        candidates = _seen([v for v in neighbours if v.frame in giving], lattice, pixel_m)
        if grid.tile_size % STEP_PX == 0:
            labels = _labels(candidates, lattice, source, exposure, pixel_m)
        else:  # nodes of neighbouring tiles lie apart: their seams would not meet
            labels = labels_of(candidates, lattice)
        box = Box(there[1].start, there[0].start, there[1].stop - there[1].start, there[0].stop - there[0].start)
        part = labels[there]
        if (part >= 0).any():
            coarse = Lattice.over(tile, grid, map_frame, step_px=light_step)
            present = [k for k in range(len(candidates)) if cv2.countNonZero(cv2.compare(labels, k, cv2.CMP_EQ))]
            light = _light(_seen(neighbours, coarse, pixel_m), candidates, present, coarse, source, exposure)
            paint(out.rgba[here], candidates, labels, box, lattice, light, source.image)
            if part.min() < 0:
                out.rgba[here][part < 0] = 0
            out.source[here] = _frames_of(part, candidates)
    return out


def _frames_of(labels: npt.NDArray[np.int16], candidates: Sequence[Seen]) -> SourceArray:
    """Return the frame of each label, ``NOBODY`` where that is -1."""
    frames = np.array([*(one.view.frame for one in candidates), NOBODY], dtype=np.int32)  # -1 is the last
    if len(candidates) > 255:
        return np.asarray(np.take(frames, labels))
    table = np.full(256, NOBODY, dtype=np.int32)
    table[: len(candidates)] = frames[:-1]
    return np.asarray(cv2.LUT(labels.astype(np.uint8), table))  # three times as fast


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


def _seen(views: Sequence[View], lattice: Lattice, pixel_m: float) -> list[Seen]:
    slack_m = _SLACK_NODES * lattice.step_px * pixel_m
    return [Seen(v, sight(v, lattice.nodes_xy_map_m, lattice.shape, slack_m=slack_m)) for v in views]


def _labels(
    candidates: Sequence[Seen], lattice: Lattice, source: FrameSource, exposure: Exposure, pixel_m: float
) -> npt.NDArray[np.int16]:
    """Return ``(height, width)`` which candidate gives each pixel of the domain, along seams that spare objects."""
    if len(candidates) < 2:
        return labels_of(candidates, lattice)
    costs = np.stack([one.at_nodes.cost + TIER_COST * one.view.tier for one in candidates]).astype(np.float32)
    costs[np.isnan(costs)] = np.inf
    greys, roughness = [], []
    for one in candidates:
        x, y = (v.astype(np.float32) for v in (one.at_nodes.x_px, one.at_nodes.y_px))
        radius, _ = radius_and_border(one.view, one.at_nodes.x_px, one.at_nodes.y_px)
        factor = exposure.grey_factor(one.view, radius).astype(np.float32)
        outlook = source.low_band(one.view).sample_outlook(x, y)
        greys.append(outlook[..., 0] * factor)
        roughness.append(outlook[..., 1] * factor)
    # Node 1 lies in the margin, node 2 in the tile's first pixels; the next tile's first pixels hold the last but one.
    nodes = node_labels(
        costs, greys, roughness, edges=(2, lattice.shape[0] - 2),
        half_diagonals_nodes=[v.half_diagonal_px * v.gsd_m_per_px / (STEP_PX * pixel_m) for v, _ in candidates],
    )  # fmt: skip
    return labels_of(candidates, lattice, nodes)


def _light(
    seen: Sequence[Seen],
    candidates: Sequence[Seen],
    present: Sequence[int],
    coarse: Lattice,
    source: FrameSource,
    exposure: Exposure,
) -> dict[int, Correction]:
    """Return for every candidate that gives pixels what moves its low frequencies to the consensus of all.

    ``seen`` are all that see the place, at the nodes of ``coarse``.
    """
    weights = consensus_weights(seen)
    by_frame = {one.view.frame: one for one in seen}
    givers = {k: by_frame[candidates[k].view.frame] for k in present}
    sharing = [k for k in range(len(seen)) if weights[k].any()]
    asked = {one.view.frame: one for one in [*givers.values(), *(seen[k] for k in sharing)]}
    factors = {frame: _factor(one, exposure) for frame, one in asked.items()}
    if len(sharing) < 2:
        return {k: Correction(coarse, factors[one.view.frame], None) for k, one in givers.items()}
    lows = {frame: _low(one, source) * factors[frame] for frame, one in asked.items()}
    shares = [(weights[k][..., None], lows[seen[k].view.frame]) for k in sharing]
    return {
        k: Correction(coarse, factors[one.view.frame], shift_to_consensus(lows[one.view.frame], shares))
        for k, one in givers.items()
    }


def _factor(one: Seen, exposure: Exposure) -> FloatImage:
    radius, _ = radius_and_border(one.view, one.at_nodes.x_px, one.at_nodes.y_px)
    return exposure.factor(one.view, radius).astype(np.float32)


def _low(one: Seen, source: FrameSource) -> FloatImage:
    at = one.at_nodes
    return source.low_band(one.view).sample(at.x_px.astype(np.float32), at.y_px.astype(np.float32))
