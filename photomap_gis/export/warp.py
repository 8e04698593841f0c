"""The one transform path: a map read on any other grid, window by window, whatever the format.

Every export and the live view read through here, so that a landmark lies at the same place in all of them. A window of
the target is transformed exactly (PROJ) on a lattice and linearly between, the lattice refined until that is true to a
hundredth of a pixel; the source is shrunk first where many of its pixels fall into one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from pyproj import Geod

from photomap_gis.core.errors import UsageError
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.mosaic import TileSource
from photomap_gis.core.similarity import FloatArray
from photomap_gis.export.area import Area, cut_grid
from photomap_gis.export.crs import WGS84, PointMap, bounds_in, needs_place, parse_crs, point_map, same_crs
from photomap_gis.export.pixel_grid import PixelGrid
from photomap_gis.export.pixels import Rgba, sample, shrink

_BLOCK_PX = 1024  # the target is resampled in blocks of this side
_CHUNK_PX = 2048  # the source is read for shrinking in chunks of about this side
_PART_PX = 256
_LATTICE_PX = 64
_LATTICE_TOLERANCE_PX = 0.01
_SAME_PX = 1e-4  # grids that differ by less than this part of a pixel are one
_MAX_SIDE_PX = 2_000_000_000
_MOST_EMPTY_PX = 1_000_000_000  # a map may have more pixels than this, but not where most of them are made up
_MOST_TIMES = 256
AnyFloat = TypeVar("AnyFloat", np.float32, np.float64)
Coordinates = npt.NDArray[np.float32]
_CROSS = np.array([[-0.5, 0.0], [0.5, 0.0], [0.0, -0.5], [0.0, 0.5]])


def warped(source: TileSource, grid: MapGrid) -> TileSource:
    """Return the map on another grid; the map itself, or its pixels moved by whole ones, where the grids allow it."""
    old = source.grid
    if same_crs(old.crs_wkt, grid.crs_wkt) and old.pixel_size == grid.pixel_size:
        shift = old.to_px(grid.to_crs([[0.0, 0.0]]))[0]
        col, row = (round(float(v)) for v in shift)
        if abs(shift[0] - col) < _SAME_PX and abs(shift[1] - row) < _SAME_PX:
            return source if grid == old else ShiftedSource(source, grid, col, row)
    return WarpedSource(source, grid, Resampler(source, grid))


def target_grid(
    source_grid: MapGrid, crs: str | None, pixel_size: float | None = None, area: Area | None = None
) -> MapGrid:
    """Return the grid in another CRS that holds all of ``source_grid``, its corner a whole multiple of a pixel.

    ``pixel_size`` is in units of ``crs``; by default the finer side of a source pixel as it lies there, or the source's
    own size where the two differ by less than a map's scale factor does (0.2 %). ``area`` keeps what it covers, in
    pixels of the same lattice. A map without a place on Earth keeps its local frame (``crs`` ``None``).
    """
    grid = _whole_grid(source_grid, crs, pixel_size)
    return grid if area is None else cut_grid(grid, area.cut(grid.bounds, grid.crs_wkt))


def check_size(size_wh: tuple[int, int], source_grid: MapGrid, what: str) -> None:
    """Raise ``UsageError`` where ``what`` asks for far more pixels than a map has: hours of work for no detail."""
    pixels, own = size_wh[0] * size_wh[1], source_grid.width * source_grid.height
    if max(size_wh) > _MAX_SIDE_PX or pixels > max(_MOST_EMPTY_PX, _MOST_TIMES * own):
        raise UsageError(
            f"{what} makes {size_wh[0]} x {size_wh[1]} pixels of a map of {source_grid.width} x {source_grid.height}, "
            "which holds no more detail: choose larger ones"
        )


def ground_pixel_m(grid: MapGrid) -> float:
    """Return the size of a pixel on the ground in metres: root of its area at the grid's centre, by the ellipsoid."""
    middle = np.array([grid.width / 2.0, grid.height / 2.0])
    p = grid.to_crs(middle + _CROSS)
    wkt = needs_place(grid.crs_wkt, "a size in metres")
    lon_lat = point_map(wkt, WGS84, around_xy=p)(p)
    geod = Geod(ellps="WGS84")
    sides = [geod.inv(*lon_lat[i], *lon_lat[i + 1])[2] for i in (0, 2)]
    return math.sqrt(sides[0] * sides[1])


def _whole_grid(source_grid: MapGrid, crs: str | None, pixel_size: float | None) -> MapGrid:
    if crs is None:
        crs = source_grid.crs_wkt
    if crs is None:
        if pixel_size is None:
            return source_grid
        raise UsageError("a map without a place on Earth keeps its own pixel size: leave out --crs and --gsd")
    target_wkt = parse_crs(crs).to_wkt()
    source_wkt = needs_place(source_grid.crs_wkt, f"a map in {crs}")
    if same_crs(source_wkt, target_wkt):
        target_wkt, bounds, native = source_wkt, source_grid.bounds, source_grid.pixel_size
    else:
        bounds = bounds_in(source_grid.bounds, source_wkt, target_wkt)  # type: ignore[assignment]
        native = min(pixel_steps(source_grid, target_wkt))
        if abs(native / source_grid.pixel_size - 1.0) < 2e-3:
            native = source_grid.pixel_size
    size = native if pixel_size is None else pixel_size
    if not (math.isfinite(size) and size > 0):
        raise UsageError(f"the pixel size must be positive, got {size}")
    if pixel_size is None and target_wkt is source_wkt:
        return source_grid
    west, south = (math.floor(v / size + 1e-9) for v in bounds[:2])
    east, north = (math.ceil(v / size - 1e-9) for v in bounds[2:])
    check_size((east - west, north - south), source_grid, f"a pixel size of {size:g}")
    return MapGrid(
        target_wkt, west * size, north * size, size, max(1, east - west), max(1, north - south), source_grid.tile_size
    )


def pixel_steps(grid: MapGrid, crs_wkt: str) -> tuple[float, float]:
    """Return how far apart pixels lie along x and along y of another CRS, in its units, at the grid's centre."""
    centre = np.array([grid.width / 2.0, grid.height / 2.0])
    p = grid.to_crs(centre + _CROSS)
    q = point_map(grid.crs_wkt or "", crs_wkt, around_xy=p)(p)
    d = np.stack([q[1] - q[0], q[3] - q[2]], axis=1)
    if not np.isfinite(d).all():
        raise UsageError("the map does not fit into that coordinate reference system: choose one made for its region")
    return float(np.hypot(*d[0])), float(np.hypot(*d[1]))


@dataclass(frozen=True, slots=True)
class ShiftedSource:
    """The same pixels counted from another corner."""

    source: TileSource
    grid: MapGrid
    col: int
    row: int

    @property
    def revision(self) -> int:
        """The source's."""
        return self.source.revision

    def read(self, window: Window) -> Rgba:
        """``(height, width, 4)`` RGBA, transparent beyond the grid."""
        c, r, w, h = window
        return _cut(self.source.read(Window(c + self.col, r + self.row, w, h)), window, self.grid)


@dataclass(frozen=True, slots=True)
class WarpedSource:
    """A map resampled onto another grid."""

    source: TileSource
    grid: MapGrid
    resampler: Resampler

    @property
    def revision(self) -> int:
        """The source's."""
        return self.source.revision

    def read(self, window: Window) -> Rgba:
        """``(height, width, 4)`` RGBA, transparent beyond the grid."""
        return _cut(self.resampler.read(window), window, self.grid)


@dataclass(frozen=True, slots=True)
class OverviewSource:
    """The map shrunk by a whole number; its last column and row may hold a part of a pixel only."""

    source: TileSource
    factor: int
    grid: MapGrid = field(init=False)

    def __post_init__(self) -> None:
        g, f = self.source.grid, self.factor
        if f < 1:
            raise ValueError(f"factor must be at least 1, got {f}")
        size = (-(-g.width // f), -(-g.height // f))
        object.__setattr__(self, "grid", MapGrid(g.crs_wkt, g.west, g.north, g.pixel_size * f, *size, g.tile_size))

    @property
    def revision(self) -> int:
        """The source's."""
        return self.source.revision

    def read(self, window: Window) -> Rgba:
        """``(height, width, 4)`` RGBA, the alpha-weighted mean of ``factor`` x ``factor`` pixels."""
        return read_shrunk(self.source, window, self.factor)


def overview(source: TileSource, factor: int) -> TileSource:
    """Return the map shrunk ``factor`` times, read in bounded pieces."""
    return source if factor == 1 else OverviewSource(source, factor)


class Resampler:
    """A plan to read ``source`` on the pixels of ``grid``, also beyond its edges; precomputed, without other memory."""

    def __init__(self, source: TileSource, grid: PixelGrid) -> None:
        self.source, self.grid = source, grid
        self._to_source = _pixel_map(grid, source.grid)
        shrink_xy = _shrink(source.grid, grid)
        self._factor = max(1, min(_CHUNK_PX, math.floor(min(shrink_xy) + 1e-6)))
        self._rest = (shrink_xy[0] / self._factor, shrink_xy[1] / self._factor)
        self._margin = 4 + math.ceil(2.2 * max(0.0, max(self._rest) - 1.0) + 1.0)

    def read(self, window: Window) -> Rgba:
        """``(height, width, 4)`` RGBA of a window of the target's pixels."""
        out = np.zeros((window.height, window.width, 4), np.uint8)
        for r in range(0, window.height, _BLOCK_PX):
            for c in range(0, window.width, _BLOCK_PX):
                h, w = min(_BLOCK_PX, window.height - r), min(_BLOCK_PX, window.width - c)
                block = self._read_block(Window(window.col_off + c, window.row_off + r, w, h))
                if block is not None:
                    out[r : r + h, c : c + w] = block
        return out

    def source_window(self, window: Window) -> Window | None:
        """Return the source's pixels that ``read`` may look at for a window; ``None`` where it looks at none."""
        nodes = _lattice(self._to_source, window).nodes
        known = np.isfinite(nodes).all(axis=-1)
        if not known.any():
            return None
        margin = (self._margin + 1) * self._factor
        left, top = (math.floor(float(v)) - margin for v in nodes[known].min(axis=0))
        right, bottom = (math.ceil(float(v)) + margin for v in nodes[known].max(axis=0))
        return Window(left, top, right - left, bottom - top)

    def _read_block(self, window: Window) -> Rgba | None:
        found = _lattice(self._to_source, window)
        f, g = self._factor, self.source.grid
        # A shrunk pixel i is the mean of pixels i f ... i f + f - 1: its centre lies at i f + (f - 1) / 2.
        nodes = (found.nodes - (f - 1) / 2.0) / f
        known = np.isfinite(nodes).all(axis=-1)
        if not known.any():
            return None
        cols, rows = -(-g.width // f), -(-g.height // f)
        # between nodes the map is linear: none of its points lies beyond them
        left, top = (max(0, math.floor(float(v)) - self._margin) for v in nodes[known].min(axis=0))
        right, bottom = (
            min(n, math.ceil(float(v)) + self._margin + 1)
            for n, v in zip((cols, rows), nodes[known].max(axis=0), strict=True)
        )
        if right <= left or bottom <= top:
            return None
        piece = read_shrunk(self.source, Window(left, top, right - left, bottom - top), f)
        if not piece[..., 3].any():
            return None
        near = (nodes - (left, top)).astype(np.float32)
        x, y = (_between(near[..., i], found.step, window) for i in (0, 1))
        return self._sample(piece, x, y, bool(known.all()))

    def _sample(self, piece: Rgba, x: Coordinates, y: Coordinates, all_known: bool) -> Rgba:
        """Sample in parts: only those at the map's border need the slow way with alpha."""
        out = np.zeros((*x.shape, 4), np.uint8)
        m = self._margin
        low, high = (np.min, np.max) if all_known else (np.nanmin, np.nanmax)
        for r in range(0, x.shape[0], _PART_PX):
            for c in range(0, x.shape[1], _PART_PX):
                part = (slice(r, r + _PART_PX), slice(c, c + _PART_PX))
                px, py = x[part], y[part]
                if not all_known and not (np.isfinite(px).any() and np.isfinite(py).any()):
                    continue
                left, top = (max(0, math.floor(float(low(v))) - m) for v in (px, py))
                right, bottom = (math.ceil(float(high(v))) + m + 1 for v in (px, py))
                near = piece[top : max(top, bottom), left : max(left, right)]
                if near.size and near[..., 3].any():
                    out[part] = sample(near, px - np.float32(left), py - np.float32(top), shrink_xy=self._rest)
        return out


@dataclass(frozen=True, slots=True, eq=False)
class _Lattice:
    """``(rows, cols, 2)`` where every ``step``-th pixel of a window is mapped to; linear between. 1: every pixel."""

    nodes: FloatArray
    step: int


def lattice(point_map_px: PointMap, window: Window) -> tuple[FloatArray, FloatArray]:
    """Return ``(h, w)`` x and y to which the pixels of a window are mapped, true to a hundredth of a pixel."""
    found = _lattice(point_map_px, window)
    x, y = (_between(found.nodes[..., i], found.step, window) for i in (0, 1))
    return x, y


def _lattice(point_map_px: PointMap, window: Window) -> _Lattice:
    """Return the coarsest lattice whose linear interpolation is true to a hundredth of a pixel.

    Where the middle of a cell says that it is not, the lattice is refined, at last to every pixel.
    """
    step = _LATTICE_PX
    while step > 4:
        cols, rows = (math.ceil((n - 1) / step) + 1 if n > 1 else 1 for n in (window.width, window.height))
        nodes = _points_at(point_map_px, window, np.arange(cols) * float(step), np.arange(rows) * float(step))
        if cols == 1 or rows == 1:
            break
        middles = _points_at(
            point_map_px, window, (np.arange(cols - 1) + 0.5) * step, (np.arange(rows - 1) + 0.5) * step
        )
        guess = (nodes[:-1, :-1] + nodes[1:, :-1] + nodes[:-1, 1:] + nodes[1:, 1:]) / 4.0
        error = np.abs(guess - middles).max()
        if error <= _LATTICE_TOLERANCE_PX:  # also False for NaN
            return _Lattice(nodes, step)
        step //= 2
    exact = _points_at(point_map_px, window, np.arange(window.width) * 1.0, np.arange(window.height) * 1.0)
    return _Lattice(exact, 1)


def _between(nodes: npt.NDArray[AnyFloat], step: int, window: Window) -> npt.NDArray[AnyFloat]:
    """``(h, w)`` values between ``(rows, cols)`` nodes, in their number type.

    Two products with tent matrices would say the same: but the linear algebra's own threads fight ours.
    """
    if step == 1:
        return nodes
    h, w = window.height, window.width
    share = (np.arange(step) / step).astype(nodes.dtype)
    steps = np.diff(nodes, axis=0)
    tall = (nodes[:-1, None] + steps[:, None] * share[:, None]).reshape(-1, nodes.shape[1])[:h]
    if len(tall) < h:  # the last row of nodes is a row of pixels itself
        tall = np.concatenate([tall, nodes[-1:]])
    wide = (tall[:, :-1, None] + np.diff(tall, axis=1)[..., None] * share).reshape(h, -1)[:, :w]
    return wide if wide.shape[1] == w else np.concatenate([wide, tall[:, -1:]], axis=1)


def read_shrunk(source: TileSource, window: Window, factor: int) -> Rgba:
    """``(height, width, 4)`` of the map shrunk ``factor`` times, the window counted in shrunk pixels.

    The map itself is read in chunks, so that memory does not grow with ``factor``.
    """
    if factor == 1:
        return source.read(window)
    out = np.zeros((window.height, window.width, 4), np.uint8)
    g, side = source.grid, max(1, _CHUNK_PX // factor)
    for r in range(0, window.height, side):
        for c in range(0, window.width, side):
            h, w = min(side, window.height - r), min(side, window.width - c)
            col, row = (window.col_off + c) * factor, (window.row_off + r) * factor
            if col >= g.width or row >= g.height or col + w * factor <= 0 or row + h * factor <= 0:
                continue
            out[r : r + h, c : c + w] = shrink(source.read(Window(col, row, w * factor, h * factor)), factor)
    return out


def _cut(rgba: Rgba, window: Window, grid: MapGrid) -> Rgba:
    """Clear what lies beyond the grid."""
    c, r, w, h = window
    left, top = max(0, -c), max(0, -r)
    right, bottom = min(w, grid.width - c), min(h, grid.height - r)
    if (left, top, right, bottom) == (0, 0, w, h):
        return rgba
    out = np.zeros_like(rgba)
    if right > left and bottom > top:
        out[top:bottom, left:right] = rgba[top:bottom, left:right]
    return out


def _pixel_map(grid: PixelGrid, source_grid: MapGrid) -> PointMap:
    """Return the map from the target's pixel-centre coordinates to the source's."""
    if same_crs(grid.crs_wkt, source_grid.crs_wkt):
        return lambda xy: source_grid.to_px(grid.to_crs(xy))
    wkt = needs_place(source_grid.crs_wkt, "a map in another coordinate reference system")
    target_wkt = needs_place(grid.crs_wkt, "a map in another coordinate reference system")
    outline = bounds_in(source_grid.bounds, wkt, target_wkt)
    corners = np.array([[x, y] for x in outline[0::2] for y in outline[1::2]])
    between = point_map(target_wkt, wkt, around_xy=corners)
    return lambda xy: source_grid.to_px(between(grid.to_crs(xy)))


def _shrink(source_grid: MapGrid, grid: PixelGrid) -> tuple[float, float]:
    """Return how many source pixels (along x, along y) one target pixel spans, where the source's middle lies."""
    middle = np.array([[source_grid.width / 2.0, source_grid.height / 2.0]])
    on_ground = source_grid.to_crs(middle)
    if not same_crs(source_grid.crs_wkt, grid.crs_wkt):
        on_ground = point_map(source_grid.crs_wkt or "", grid.crs_wkt or "", around_xy=on_ground)(on_ground)
    around = grid.to_px(on_ground) + _CROSS
    q = _pixel_map(grid, source_grid)(around)
    d = np.stack([q[1] - q[0], q[3] - q[2]], axis=1)
    if not np.isfinite(d).all():
        raise UsageError("the map does not fit into that coordinate reference system: choose one made for its region")
    return float(np.hypot(*d[0])), float(np.hypot(*d[1]))


def _points_at(point_map_px: PointMap, window: Window, x: npt.ArrayLike, y: npt.ArrayLike) -> FloatArray:
    """``(len(y), len(x), 2)`` the mapped points at offsets within the window."""
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    grid_x, grid_y = np.meshgrid(x + window.col_off, y + window.row_off)
    p = point_map_px(np.stack([grid_x.ravel(), grid_y.ravel()], axis=-1))
    return np.where(np.isfinite(p), p, np.nan).reshape(len(y), len(x), 2)
