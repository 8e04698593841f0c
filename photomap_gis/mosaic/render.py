"""One tile from the frames that see it. Every pixel of a frame is resampled once, straight into the map's grid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.grid import CrsFrame, MapGrid, Window, ground_pixel_m
from photomap_gis.mosaic.blend import Seen, consensus_weights, detail_weights, labels_of, shift_to_consensus
from photomap_gis.mosaic.choice import TIER_COST, radius_and_border, sight
from photomap_gis.mosaic.exposure import Exposure
from photomap_gis.mosaic.lattice import STEP_PX, Box, FloatImage, Lattice
from photomap_gis.mosaic.lowband import LowBand
from photomap_gis.mosaic.pixels import SourceImage
from photomap_gis.mosaic.seams import node_labels
from photomap_gis.mosaic.tiles import NOBODY, RgbaArray, SourceArray
from photomap_gis.mosaic.views import View

_SLACK_NODES = 3.0
_LEAST_WEIGHT = np.float32(1e-3)  # far below what any pixel that shows something has
# Measured on aerial imagery: bilinear keeps 0.76 of the ground's gradient energy, cubic 1.01, Lanczos 1.00; the cost of
# the whole tile is the same within 10 %.
_INTERPOLATION = cv2.INTER_CUBIC


Slices = tuple[slice, slice]


class FrameSource(Protocol):
    """Where a tile gets its frames from; both raise ``FrameReadError`` for a frame that cannot be read."""

    def image(self, view: View) -> SourceImage:
        """Return the frame's pixels, prepared for the grid."""
        ...

    def low_band(self, view: View) -> LowBand:
        """Return the frame's low frequencies."""
        ...


class _Correction(NamedTuple):
    """What makes a frame's pixels part of the map: ``pixel * factor + offset``, ``(rows, columns, 3)`` at the nodes."""

    factor: FloatImage
    offset: FloatImage | None


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
    if not giving:
        return out
    for tile, here, there in _tiles_under(window, grid.tile_size):
        lattice = Lattice.over(tile, grid, map_frame)
        slack_m = _SLACK_NODES * STEP_PX * ground_pixel_m(grid, map_frame)
        seen = [Seen(v, sight(v, lattice.nodes_xy_map_m, lattice.shape, slack_m=slack_m)) for v in neighbours]
        candidates = [one for one in seen if one.view.frame in giving]
        labels = _labels(candidates, lattice, source, exposure, tile)
        part = labels[there]
        if (part >= 0).any():
            colour = _colour(seen, candidates, labels, lattice, source, exposure)[there]
            rounded = cv2.add(np.ascontiguousarray(colour), 0.0, dtype=cv2.CV_8U)  # rounds and saturates
            rgba = cv2.cvtColor(rounded, cv2.COLOR_BGR2RGBA)
            rgba[part < 0] = 0
            out.rgba[here] = rgba
            frames = np.array([*(one.view.frame for one in candidates), NOBODY], dtype=np.int32)  # -1 is the last
            out.source[here] = frames[part]
    return out


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


def _labels(
    candidates: Sequence[Seen], lattice: Lattice, source: FrameSource, exposure: Exposure, tile: Window
) -> npt.NDArray[np.int16]:
    """Return ``(height, width)`` which candidate gives each pixel of the domain, along seams that spare objects."""
    if len(candidates) < 2 or tile.width % STEP_PX:
        return labels_of(candidates, lattice)
    costs = np.stack([one.at_nodes.cost + TIER_COST * one.view.tier for one in candidates]).astype(np.float32)
    costs[np.isnan(costs)] = np.inf
    greys, roughness = [], []
    for one in candidates:
        x, y = (v.astype(np.float32) for v in (one.at_nodes.x_px, one.at_nodes.y_px))
        outlook = source.low_band(one.view).sample_outlook(x, y) * _factor(one, exposure).mean(axis=-1, keepdims=True)
        greys.append(outlook[..., 0])
        roughness.append(outlook[..., 1])
    # Node 1 lies in the margin, node 2 in the tile's first pixels; the next tile's first pixels hold the last but one.
    return labels_of(candidates, lattice, node_labels(costs, greys, roughness, edges=(2, lattice.shape[0] - 2)))


def _colour(
    seen: Sequence[Seen],
    candidates: Sequence[Seen],
    labels: npt.NDArray[np.int16],
    lattice: Lattice,
    source: FrameSource,
    exposure: Exposure,
) -> FloatImage:
    """Return ``(height, width, 3)`` float BGR of the domain."""
    present = [int(i) for i in np.flatnonzero(np.bincount(labels.ravel() + 1, minlength=len(candidates) + 1)[1:])]
    corrections = _corrections(seen, [candidates[i] for i in present], source, exposure)
    if len(present) == 1:
        return _corrected(candidates[present[0]], lattice.domain, lattice, source, corrections[0])
    colour = np.zeros((lattice.height, lattice.width, 3), dtype=np.float32)
    total = np.zeros((lattice.height, lattice.width, 1), dtype=np.float32)
    for index, correction in zip(present, corrections, strict=True):
        found = detail_weights(labels, index)
        if found is None:
            continue
        box, weight = found
        pixels = _corrected(candidates[index], box, lattice, source, correction)
        pixels *= weight[..., None]
        colour[box.slices] += pixels
        total[box.slices] += weight[..., None]
    colour /= np.maximum(total, _LEAST_WEIGHT)
    return colour


def _corrections(
    seen: Sequence[Seen], givers: Sequence[Seen], source: FrameSource, exposure: Exposure
) -> list[_Correction]:
    """Return for every giver what moves its low frequencies to the consensus of all that see the place."""
    weights = consensus_weights(seen)
    sharing = [k for k in range(len(seen)) if weights[k].any()]
    factors = {one.view.frame: _factor(one, exposure) for one in [*givers, *(seen[k] for k in sharing)]}
    if len(sharing) < 2:
        return [_Correction(factors[one.view.frame], None) for one in givers]
    lows = {
        one.view.frame: _low(one, source) * factors[one.view.frame] for one in [*givers, *(seen[k] for k in sharing)]
    }
    shares = [(weights[k][..., None], lows[seen[k].view.frame]) for k in sharing]
    return [_Correction(factors[one.view.frame], shift_to_consensus(lows[one.view.frame], shares)) for one in givers]


def _factor(one: Seen, exposure: Exposure) -> FloatImage:
    radius, _ = radius_and_border(one.view, one.at_nodes.x_px, one.at_nodes.y_px)
    return exposure.factor(one.view, radius).astype(np.float32)


def _low(one: Seen, source: FrameSource) -> FloatImage:
    at = one.at_nodes
    return source.low_band(one.view).sample(at.x_px.astype(np.float32), at.y_px.astype(np.float32))


def _corrected(one: Seen, box: Box, lattice: Lattice, source: FrameSource, correction: _Correction) -> FloatImage:
    """Return ``(height, width, 3)`` float BGR of a frame over a box of the lattice's domain."""
    pixels = _resampled(one, box, lattice, source.image(one.view)).astype(np.float32)
    pixels *= lattice.dense(correction.factor, box)
    if correction.offset is not None:
        pixels += lattice.dense(correction.offset, box)
    return pixels


def _resampled(one: Seen, box: Box, lattice: Lattice, source: SourceImage) -> np.ndarray:
    """Return ``(height, width, 3)`` uint8 BGR of a frame over a box of the lattice's domain."""
    image, scale = source
    x = lattice.dense(((one.at_nodes.x_px + 0.5) * scale - 0.5).astype(np.float32), box)
    y = lattice.dense(((one.at_nodes.y_px + 0.5) * scale - 0.5).astype(np.float32), box)
    # Only the part of the frame that is asked for: remap takes no raster of more than 32767 pixels a side.
    (x0, x1), (y0, y1) = _span(x, image.shape[1]), _span(y, image.shape[0])
    part = cv2.remap(
        image[y0:y1, x0:x1], np.nan_to_num(x - x0, nan=-1e4), np.nan_to_num(y - y0, nan=-1e4), _INTERPOLATION,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    return np.asarray(cv2.cvtColor(part, cv2.COLOR_GRAY2BGR) if part.ndim == 2 else part)


def _span(values: FloatImage, size: int) -> tuple[int, int]:
    """Return the pixels (first, one past the last) that interpolation at these coordinates may touch."""
    low, high = np.nanmin(values), np.nanmax(values)
    first = int(np.clip(np.floor(low) - 2, 0, size - 1))
    return first, int(np.clip(np.ceil(high) + 3, first + 1, size))
