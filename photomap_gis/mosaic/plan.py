"""What to render, from placements alone: the map's grid, and for every tile the frames that contribute to it.

Pure: no pixel is opened here. A tile's frames are found on coarse blocks with bounds on the cost of choosing
a frame, so that none is missed and few are named in vain.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from photomap_gis.core.errors import DataError
from photomap_gis.core.grid import CrsFrame, MapGrid, TileIndex, ground_per_unit, ground_pixel_m
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.core.similarity import FloatArray
from photomap_gis.mosaic.choice import (
    TIER_COST,
    WIDE_REACH,
    choice_cost,
    distance_from_middle,
    radius_and_border,
    taper_px,
)
from photomap_gis.mosaic.views import FILL_TIER, View, views_of

BLOCK_PX = 32
"""Side of the blocks on which frames are weighed against each other."""

MAX_PIXELS = 2 * 10**11
MAX_SPARSE_PIXELS = 2 * 10**9
MIN_COVERED = 0.01
"""A map larger than ``MAX_SPARSE_PIXELS`` of which less than this is covered is a mistake in some position."""

_FEATHER_PX = 8.0
_CURVATURE = 1.5  # a tilted or distorted frame's pixels may be this much denser than at its centre


@dataclass(frozen=True, slots=True)
class TileJob:
    """A tile to render.

    ``frames`` may give it their pixels; ``neighbours`` (a superset) share in its low frequencies.
    """

    tile: TileIndex
    frames: tuple[int, ...]
    neighbours: tuple[int, ...]


def plan_grid(
    trajectory: Trajectory, map_frame: CrsFrame, *, pixel_size: float | None = None, tile_size: int = 512
) -> MapGrid:
    """Return the grid that covers every frame to be pasted; ``pixel_size`` defaults to the median native sampling.

    ``pixel_size`` is on the ground: in a CRS that is not true to scale there, a pixel is as large as that looks.

    Raises ``DataError`` where nothing is placed or the extent makes no sense.
    """
    if pixel_size is not None and not (math.isfinite(pixel_size) and pixel_size > 0):
        raise ValueError(f"pixel_size must be positive, got {pixel_size}")
    views = views_of(trajectory)
    if not views:
        raise DataError("no frame could be placed on the ground: there is nothing to make a map of")
    size_m = pixel_size or float(np.median([view.gsd_m_per_px for view in views]))
    _refuse_absurd_extent(views, size_m)
    corners = map_frame.to_crs(np.concatenate([view.hull_xy_map_m for view in views]))
    size = size_m / ground_per_unit((corners.min(axis=0) + corners.max(axis=0)) / 2.0, map_frame)
    return MapGrid.covering(corners, map_frame, pixel_size=size, tile_size=tile_size)


def plan_tiles(trajectory: Trajectory, grid: MapGrid, map_frame: CrsFrame) -> list[TileJob]:
    """Return a job for every tile that some frame sees, row by row."""
    return list(plan_jobs(views_of(trajectory), grid, map_frame))


def plan_jobs(views: Sequence[View], grid: MapGrid, map_frame: CrsFrame) -> Iterator[TileJob]:
    """Yield the jobs of ``plan_tiles``; holds what concerns one row of tiles at a time."""
    spans = [tile_span(view, grid, map_frame) for view in views]
    by_first_row: defaultdict[int, list[int]] = defaultdict(list)
    for index, span in enumerate(spans):
        if span is not None:
            by_first_row[span.first_row].append(index)
    active: dict[int, _Footing] = {}
    for row in range(grid.tile_rows):
        active = {i: footing for i, footing in active.items() if spans[i].last_row >= row}  # type: ignore[union-attr]
        for i in by_first_row.pop(row, ()):
            active[i] = _footing(views[i], grid, map_frame)
        for col in range(grid.tile_cols):
            here = [i for i in sorted(active) if spans[i].first_col <= col <= spans[i].last_col]  # type: ignore[union-attr]
            job = _job(TileIndex(row, col), [(views[i], active[i]) for i in here], grid)
            if job is not None:
                yield job


class TileSpan(NamedTuple):
    """The tiles that a footprint's bounding box touches."""

    first_row: int
    last_row: int
    first_col: int
    last_col: int


class _Footing(NamedTuple):
    """Bounds of a view's cost on the blocks of its bounding box: ``(rows, cols)`` from block (row, col) of the grid.

    ``upper`` is infinite where the view may miss part of the block, ``lower`` where it surely misses all of it.
    ``deep`` is set where the whole block lies so far inside the raster that no other class of frames has a say.
    """

    row: int
    col: int
    lower: FloatArray
    upper: FloatArray
    deep: npt.NDArray[np.bool_]


def _refuse_absurd_extent(views: list[View], pixel_size: float) -> None:
    lows, highs = zip(*(view.bounds_map_m for view in views), strict=True)
    extent = (np.max(highs, axis=0) - np.min(lows, axis=0)) / pixel_size
    pixels = float(np.prod(np.maximum(extent, 1.0)))
    footprints = sum(float(np.prod(high - low)) for low, high in zip(lows, highs, strict=True)) / pixel_size**2
    sparse = pixels > MAX_SPARSE_PIXELS and footprints < MIN_COVERED * pixels
    if pixels <= MAX_PIXELS and not sparse:
        return
    centres = np.array([view.centre_xy_map_m for view in views])
    away = np.linalg.norm(centres - np.median(centres, axis=0), axis=1)
    farthest = views[int(np.argmax(away))]
    size = f"the map would be {extent[0]:.0f} x {extent[1]:.0f} pixels"
    if sparse:
        raise DataError(
            f"{size}, of which the frames cover {100 * footprints / pixels:.2g} %: frame {farthest.frame} lies "
            f"{away.max():.0f} m from the others; leave it out or map it apart, or ask for coarser pixels with --gsd"
        )
    raise DataError(f"{size}: ask for coarser pixels with --gsd (now {pixel_size:.3g} m)")


def tile_span(view: View, grid: MapGrid, map_frame: CrsFrame) -> TileSpan | None:
    """Return the tiles that a view's bounding box touches; ``None`` where it lies beside the grid."""
    low, high = _pixel_box(view, grid, map_frame)
    if (high < -0.5).any() or low[0] > grid.width - 0.5 or low[1] > grid.height - 0.5:
        return None
    first = np.maximum(np.floor((low - _FEATHER_PX) / grid.tile_size), 0).astype(int)
    last = np.floor((high + _FEATHER_PX) / grid.tile_size).astype(int)
    return TileSpan(
        int(first[1]), min(int(last[1]), grid.tile_rows - 1), int(first[0]), min(int(last[0]), grid.tile_cols - 1)
    )


def _pixel_box(view: View, grid: MapGrid, map_frame: CrsFrame) -> tuple[FloatArray, FloatArray]:
    px = grid.to_px(map_frame.to_crs(view.hull_xy_map_m))
    return px.min(axis=0), px.max(axis=0)


def _footing(view: View, grid: MapGrid, map_frame: CrsFrame) -> _Footing:
    low, high = _pixel_box(view, grid, map_frame)
    low, high = np.maximum(low, 0.0), np.minimum(high, (grid.width, grid.height))
    col0, row0 = (int(v) for v in np.floor((low - _FEATHER_PX) / BLOCK_PX))
    col1, row1 = (int(v) for v in np.floor((high + _FEATHER_PX) / BLOCK_PX))
    cols, rows = np.arange(col0, col1 + 1), np.arange(row0, row1 + 1)
    centres = np.stack(np.meshgrid((cols + 0.5) * BLOCK_PX - 0.5, (rows + 0.5) * BLOCK_PX - 0.5), axis=-1)
    xy_map = map_frame.from_crs(grid.to_crs(centres.reshape(-1, 2)))
    pixel_m = ground_pixel_m(grid, map_frame)
    reach_px = BLOCK_PX / math.sqrt(2.0) + _FEATHER_PX
    xy = view.locate(xy_map, slack_m=2.0 * reach_px * pixel_m)
    shape = (len(rows), len(cols))
    x, y = xy[:, 0].reshape(shape), xy[:, 1].reshape(shape)
    distance, (_, border) = distance_from_middle(view, x, y), radius_and_border(view, x, y)
    delta = _CURVATURE * reach_px * pixel_m / view.gsd_m_per_px
    with np.errstate(invalid="ignore"):
        lower = choice_cost(view, np.maximum(distance - delta, 0.0), border + delta)
        upper = choice_cost(view, distance + delta, border - delta)
        lower = np.where(border + delta >= 0.0, lower, np.inf)  # NaN compares false: not seen
        upper = np.where(border - delta >= 0.0, upper, np.inf)
        deep = border - delta >= taper_px(view)
    return _Footing(row0, col0, lower, upper, deep)


def _job(tile: TileIndex, candidates: list[tuple[View, _Footing]], grid: MapGrid) -> TileJob | None:
    if not candidates:
        return None
    window = grid.window(tile)
    row0, col0 = window.row_off // BLOCK_PX, window.col_off // BLOCK_PX
    shape = (
        (window.row_off + window.height - 1) // BLOCK_PX - row0 + 1,
        (window.col_off + window.width - 1) // BLOCK_PX - col0 + 1,
    )
    lower = np.full((len(candidates), *shape), np.inf)
    upper = np.full((len(candidates), *shape), np.inf)
    deep = np.zeros((len(candidates), *shape), dtype=bool)
    for k, (_, footing) in enumerate(candidates):
        here, there = _overlap(footing, row0, col0, shape)
        lower[k][here], upper[k][here], deep[k][here] = footing.lower[there], footing.upper[there], footing.deep[there]
    tier = np.array([view.tier for view, _ in candidates])
    ranked = TIER_COST * tier[:, None, None]
    chosen = np.isfinite(lower) & (lower + ranked <= np.min(upper + ranked, axis=0))
    if not chosen.any():
        return None
    registered = tier < FILL_TIER
    shared = np.zeros_like(chosen)
    for same in (registered, ~registered):
        if same.any():
            shared[same] = np.isfinite(lower[same]) & (lower[same] <= upper[same].min(axis=0) + WIDE_REACH)
    shared[~registered] &= ~deep[registered].any(axis=0)
    frames = [view.frame for view, _ in candidates]
    give, share = chosen.any(axis=(1, 2)), (chosen | shared).any(axis=(1, 2))
    return TileJob(
        tile,
        tuple(f for f, take in zip(frames, give, strict=True) if take),
        tuple(f for f, take in zip(frames, share, strict=True) if take),
    )


def _overlap(
    footing: _Footing, row0: int, col0: int, shape: tuple[int, int]
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the slices of a tile's blocks and of a footing's that mean the same blocks."""
    here, there = [], []
    for start, size, tile_size in zip(
        (footing.row - row0, footing.col - col0), footing.lower.shape, shape, strict=True
    ):
        first, last = max(start, 0), max(min(start + size, tile_size), 0)
        here.append(slice(first, max(first, last)))
        there.append(slice(first - start, max(first, last) - start))
    return (here[0], here[1]), (there[0], there[1])
