"""Tiles of every zoom in one pass: the map is read once, at the finest level, and each parent is made of its children.

Walks the quad tree depth first, so that at most four tiles a level are held, whatever the map's size.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from photomap_gis.core.grid import Window
from photomap_gis.export.pixels import Rgba, shrink
from photomap_gis.export.warp import Resampler

_LEVELS_PER_READ = 2  # leaves are read in blocks of 4 x 4: less overlap and fewer calls than one by one


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


@dataclass(frozen=True, slots=True)
class Pyramid:
    """A quad tree of tiles over ``extent``, a window of the finest level's pixels.

    Tile (x, y) of the finest level ``max_zoom`` covers pixels ``tile_px`` x to ``tile_px`` (x + 1); levels go down to
    ``min_zoom``. Tiles finer than ``keep_zoom`` are read for their parents' sake only.
    """

    resampler: Resampler
    extent: Window
    max_zoom: int
    min_zoom: int = 0
    keep_zoom: int | None = None
    tile_px: int = 256

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

    def tiles(self) -> Generator[Tile, None, None]:
        """Yield every tile that shows something, children before their parent."""
        for key in self.keys(self.min_zoom):
            yield from self._branch(key)

    def _branch(self, key: TileKey) -> Generator[Tile, None, Rgba | None]:
        """Yield the tiles of a branch; return its top tile's pixels, ``None`` where nothing is seen."""
        if self.max_zoom - key.zoom <= _LEVELS_PER_READ:
            pixels = self._read(key)
            return None if pixels is None else (yield from self._split(key, pixels))
        canvas: Rgba | None = None
        n = self.tile_px
        for row in (0, 1):
            for col in (0, 1):
                child = TileKey(key.zoom + 1, 2 * key.x + col, 2 * key.y + row)
                if not self._touches(child):
                    continue
                pixels = yield from self._branch(child)
                if pixels is not None:
                    if canvas is None:
                        canvas = np.zeros((2 * n, 2 * n, 4), np.uint8)
                    canvas[row * n : (row + 1) * n, col * n : (col + 1) * n] = pixels
        if canvas is None:
            return None
        top = shrink(canvas, 2)
        yield from self._emit(key, top)
        return top

    def _split(self, key: TileKey, pixels: Rgba) -> Generator[Tile, None, Rgba]:
        """Yield the tiles of a branch whose finest pixels are at hand; return its top tile's pixels."""
        if key.zoom == self.max_zoom:
            yield from self._emit(key, pixels)
            return pixels
        half = pixels.shape[0] // 2
        tops = np.zeros((2 * self.tile_px, 2 * self.tile_px, 4), np.uint8)
        for row in (0, 1):
            for col in (0, 1):
                part = pixels[row * half : (row + 1) * half, col * half : (col + 1) * half]
                if part[..., 3].any():
                    top = yield from self._split(TileKey(key.zoom + 1, 2 * key.x + col, 2 * key.y + row), part)
                    n = self.tile_px
                    tops[row * n : (row + 1) * n, col * n : (col + 1) * n] = top
        top = shrink(tops, 2)
        yield from self._emit(key, top)
        return top

    def _emit(self, key: TileKey, pixels: Rgba) -> Generator[Tile, None, None]:
        if (self.keep_zoom is None or key.zoom <= self.keep_zoom) and pixels[..., 3].any():
            yield Tile(key, np.ascontiguousarray(pixels))

    def _read(self, key: TileKey) -> Rgba | None:
        span = self.tile_px << (self.max_zoom - key.zoom)
        pixels = self.resampler.read(Window(key.x * span, key.y * span, span, span))
        return pixels if pixels[..., 3].any() else None

    def _touches(self, key: TileKey) -> bool:
        span = self.tile_px << (self.max_zoom - key.zoom)
        c, r, w, h = self.extent
        return key.x * span < c + w and (key.x + 1) * span > c and key.y * span < r + h and (key.y + 1) * span > r
