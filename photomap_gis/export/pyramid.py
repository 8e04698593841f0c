"""Tiles of every zoom in one pass: the map is read once, at the finest level, and each parent is made of its children.

The quad tree is cut into branches of some 2048 pixels. A branch is a job: it reads its pixels, makes its tiles of all
levels and hands each to the caller's function (to be encoded), all in one thread of several. The few tiles above the
branches are put together where the results are taken, depth first, so that at most four tiles a level are held.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from photomap_gis.core.grid import Window
from photomap_gis.export.pixels import Rgba, shrink
from photomap_gis.parallel import map_jobs, usable_cpus

_BRANCH_PX = 2048  # less overlap and fewer calls than tile by tile
_BRANCHES_A_WORKER = 4  # small maps are cut finer, so that every core has something to do

MadeT = TypeVar("MadeT")
OnProgress = Callable[[int, int], None]


class TileKey(NamedTuple):
    """A tile: zoom level, column from the west, row from the **north**."""

    zoom: int
    x: int
    y: int


@dataclass(frozen=True, slots=True, eq=False)
class Tile:
    """One tile with its ``(tile_px, tile_px, 4)`` RGBA pixels; never wholly transparent."""

    key: TileKey
    rgba: Rgba


class Reader(Protocol):
    """What a pyramid is made from: a resampler, or a map on the pyramid's own pixels."""

    def read(self, window: Window) -> Rgba:
        """``(height, width, 4)`` RGBA."""
        ...


class Kept(Protocol[MadeT]):
    """Finished branches that outlive a killed run; called in several threads."""

    def find(self, key: TileKey) -> tuple[list[MadeT], Rgba | None] | None:
        """Return what a branch gave and its top's pixels, ``None`` where it is not kept."""
        ...

    def keep(self, key: TileKey, made: list[MadeT], top: Rgba | None) -> None:
        """Keep a branch."""
        ...


@dataclass(frozen=True, slots=True)
class Pyramid:
    """A quad tree of tiles over ``extent``, a window of the finest level's pixels.

    Tile (x, y) of the finest level ``max_zoom`` covers pixels ``tile_px`` x to ``tile_px`` (x + 1); levels go down to
    ``min_zoom``. Tiles finer than ``keep_zoom`` are read for their parents' sake only.
    """

    resampler: Reader
    extent: Window
    max_zoom: int
    min_zoom: int = 0
    keep_zoom: int | None = None
    tile_px: int = 256
    branch_px: int = _BRANCH_PX

    def keys(self, zoom: int) -> list[TileKey]:
        """Return the tiles of a level that touch the extent, row by row."""
        span = self.tile_px << (self.max_zoom - zoom)
        c, r, w, h = self.extent
        cols = range(c // span, -(-(c + w) // span))
        rows = range(r // span, -(-(r + h) // span))
        return [TileKey(zoom, x, y) for y in rows for x in cols]

    @property
    def leaf_count(self) -> int:
        """Number of tiles of the finest level that touch the extent."""
        span = self.tile_px
        c, r, w, h = self.extent
        return (-(-(c + w) // span) - c // span) * (-(-(r + h) // span) - r // span)

    def tiles(self) -> Iterator[Tile]:
        """Yield every tile that shows something, children before their parent."""
        return self.made(_itself)

    def made(
        self,
        make: Callable[[Tile], MadeT],
        on_progress: OnProgress | None = None,
        kept: Kept[MadeT] | None = None,
    ) -> Iterator[MadeT]:
        """Yield ``make(tile)`` for every tile that shows something, children before their parent.

        ``make`` is called in several threads. ``on_progress`` counts tiles of the finest level, empty ones too.
        Branches that are ``kept`` are not made again.
        """
        branch_zoom = self._branch_zoom()
        keys = [key for root in self.keys(self.min_zoom) for key in self._below(root, branch_zoom)]
        total, done = self.leaf_count, 0

        def branch(key: TileKey) -> tuple[list[MadeT], Rgba | None]:
            known = None if kept is None else kept.find(key)
            if known is not None:
                return known
            made: list[MadeT] = []
            top = self._branch(key, lambda tile: made.append(make(tile)))
            if kept is not None:
                kept.keep(key, made, top)
            return made, top

        def taken() -> Iterator[tuple[list[MadeT], Rgba | None]]:
            nonlocal done
            for key, result in zip(keys, map_jobs(branch, keys), strict=True):
                done += self._leaves_of(key)
                if on_progress is not None:
                    on_progress(done, total)
                yield result

        results = taken()
        for root in self.keys(self.min_zoom):
            yield from self._joined(root, branch_zoom, results, make)

    def _branch_zoom(self) -> int:
        """Return the level at which a tile is a job."""
        levels = max(0, int(math.log2(self.branch_px / self.tile_px)))
        while levels and len(self.keys(self.max_zoom - levels)) < _BRANCHES_A_WORKER * usable_cpus():
            levels -= 1
        return max(self.min_zoom, self.max_zoom - levels)

    def _below(self, key: TileKey, zoom: int) -> Iterator[TileKey]:
        """Yield the tiles of a level under a tile that touch the extent, depth first."""
        if key.zoom == zoom:
            yield key
            return
        for child in self._children(key):
            yield from self._below(child, zoom)

    def _joined(
        self,
        key: TileKey,
        branch_zoom: int,
        results: Iterator[tuple[list[MadeT], Rgba | None]],
        make: Callable[[Tile], MadeT],
    ) -> Generator[MadeT, None, Rgba | None]:
        """Yield what was made under a tile and of itself; return its pixels, ``None`` where nothing is seen."""
        if key.zoom == branch_zoom:
            made, top = next(results)
            yield from made
            return top
        canvas: Rgba | None = None
        for child in self._children(key):
            pixels = yield from self._joined(child, branch_zoom, results, make)
            if pixels is not None:
                canvas = self._placed(canvas, child, pixels)
        if canvas is None:
            return None
        top = shrink(canvas, 2)
        if self._is_kept(key, top):
            yield make(Tile(key, top))
        return top

    def _branch(self, key: TileKey, emit: Callable[[Tile], None]) -> Rgba | None:
        """Read a branch, emit its tiles and return its top tile's pixels, ``None`` where nothing is seen."""
        pixels = self._read(key)
        return None if pixels is None else self._split(key, pixels, emit)

    def _split(self, key: TileKey, pixels: Rgba, emit: Callable[[Tile], None]) -> Rgba:
        """Emit the tiles of a branch whose finest pixels are at hand; return its top tile's pixels."""
        if key.zoom == self.max_zoom:
            if self._is_kept(key, pixels):
                emit(Tile(key, np.ascontiguousarray(pixels)))
            return pixels
        half = pixels.shape[0] // 2
        canvas: Rgba | None = None
        for child in self._children(key):
            r, c = (child.y - 2 * key.y) * half, (child.x - 2 * key.x) * half
            part = pixels[r : r + half, c : c + half]
            if part[..., 3].any():
                canvas = self._placed(canvas, child, self._split(child, part, emit))
        if canvas is None:
            canvas = np.zeros((2 * self.tile_px, 2 * self.tile_px, 4), np.uint8)
        top = shrink(canvas, 2)
        if self._is_kept(key, top):
            emit(Tile(key, top))
        return top

    def _placed(self, canvas: Rgba | None, child: TileKey, pixels: Rgba) -> Rgba:
        """Put a child's pixels into its quarter of the canvas of its parent."""
        n = self.tile_px
        if canvas is None:
            canvas = np.zeros((2 * n, 2 * n, 4), np.uint8)
        r, c = n * (child.y % 2), n * (child.x % 2)
        canvas[r : r + n, c : c + n] = pixels
        return canvas

    def _is_kept(self, key: TileKey, pixels: Rgba) -> bool:
        return (self.keep_zoom is None or key.zoom <= self.keep_zoom) and bool(pixels[..., 3].any())

    def _read(self, key: TileKey) -> Rgba | None:
        """Return the finest pixels under a tile, transparent beyond the extent."""
        span = self.tile_px << (self.max_zoom - key.zoom)
        x, y = key.x * span, key.y * span
        within = _intersection(Window(x, y, span, span), self.extent)
        pixels = self.resampler.read(within)
        if not pixels[..., 3].any():
            return None
        if within == (x, y, span, span):
            return pixels
        whole = np.zeros((span, span, 4), np.uint8)
        r, c = within.row_off - y, within.col_off - x
        whole[r : r + within.height, c : c + within.width] = pixels
        return whole

    def _leaves_of(self, key: TileKey) -> int:
        span, n = self.tile_px << (self.max_zoom - key.zoom), self.tile_px
        c, r, w, h = _intersection(Window(key.x * span, key.y * span, span, span), self.extent)
        return (-(-(c + w) // n) - c // n) * (-(-(r + h) // n) - r // n)

    def _children(self, key: TileKey) -> Iterator[TileKey]:
        """Yield the children that touch the extent, row by row."""
        span = self.tile_px << (self.max_zoom - key.zoom - 1)
        c, r, w, h = self.extent
        for y in (2 * key.y, 2 * key.y + 1):
            for x in (2 * key.x, 2 * key.x + 1):
                if x * span < c + w and (x + 1) * span > c and y * span < r + h and (y + 1) * span > r:
                    yield TileKey(key.zoom + 1, x, y)


def _itself(tile: Tile) -> Tile:
    return tile


def _intersection(a: Window, b: Window) -> Window:
    left, top = max(a.col_off, b.col_off), max(a.row_off, b.row_off)
    right = min(a.col_off + a.width, b.col_off + b.width)
    bottom = min(a.row_off + a.height, b.row_off + b.height)
    return Window(left, top, right - left, bottom - top)
