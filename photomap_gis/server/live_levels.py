"""A growing raster at every level of detail, each piece as fresh as the pixels under it.

The raster's lattice has no edges, so it is seen through an *arena*: a square of it, a whole number of tiles about its
corner, which doubles where the flight leaves it. Level ``k`` is the arena shrunk by ``2**k``; a tile of it is made of
four of the level below and kept until one of the pixels under it has changed.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.export.pixels import Rgba, shrink
from photomap_gis.server.live_view import LiveRaster

TILE_PX = 512
_HALF_PX = 1 << 17
_MOST_HALF_PX = 1 << 23
_KEPT_BYTES = 64 << 20

Colours = Callable[[npt.NDArray[Any]], Rgba]
"""What a raster holds, ``(h, w)`` or ``(h, w, 4)``, as RGBA."""


class _Key(NamedTuple):
    level: int
    row: int
    col: int


class Levels:
    """A raster's levels within an arena; safe among threads. ``at(k)`` is one of them as a ``TileSource``."""

    def __init__(self, raster: LiveRaster, colours: Colours, half_px: int = _HALF_PX) -> None:
        self.raster, self.half_px = raster, half_px
        self._colours = colours
        self._lock = threading.Lock()
        self._kept: OrderedDict[_Key, tuple[int, Rgba | None]] = OrderedDict()
        self._held = 0

    @property
    def count(self) -> int:
        """How many levels there are; the coarsest is a few tiles."""
        return max(1, (2 * self.half_px // TILE_PX).bit_length() - 1)

    @property
    def grid(self) -> MapGrid:
        """The arena's finest pixels."""
        lattice, side = self.raster.lattice, 2 * self.half_px
        size = lattice.pixel_size
        west, north = lattice.west - self.half_px * size, lattice.north + self.half_px * size
        return MapGrid(lattice.crs_wkt, west, north, size, side, side, TILE_PX)

    def holds(self, window: Window) -> bool:
        """Whether a window of the lattice lies within the arena."""
        h = self.half_px
        return (
            -h <= window.col_off and window.col_off + window.width <= h
            and -h <= window.row_off and window.row_off + window.height <= h
        )  # fmt: skip

    def at(self, level: int) -> Level:
        """Return a level, 0 the finest."""
        g, size = self.grid, self.grid.pixel_size * 2**level
        side = g.width >> level
        return Level(self, level, MapGrid(g.crs_wkt, g.west, g.north, size, side, side, TILE_PX))

    def lattice_window(self, level: int, window: Window) -> Window:
        """Return the lattice's pixels under a window of a level."""
        f = 1 << level
        c, r, w, h = window
        return Window(c * f - self.half_px, r * f - self.half_px, w * f, h * f)

    def version_in(self, level: int, window: Window) -> int:
        """Return the newest version of what lies under a window of a level; 0 where nothing does."""
        # Cut to what there is: seen from far away, a tile lies over a large piece of the world.
        extent = self.raster.extent()
        asked = self.lattice_window(level, window)
        if extent is None:
            return 0
        left, top = max(asked.col_off, extent.col_off), max(asked.row_off, extent.row_off)
        right = min(asked.col_off + asked.width, extent.col_off + extent.width)
        bottom = min(asked.row_off + asked.height, extent.row_off + extent.height)
        if right <= left or bottom <= top:
            return 0
        return self.raster.version_in(Window(left, top, right - left, bottom - top))

    def read(self, level: int, window: Window) -> Rgba:
        """``(height, width, 4)`` RGBA of a window of a level, transparent beyond the arena."""
        if level == 0:
            return self._colours(self.raster.read(self.lattice_window(0, window)))
        out = np.zeros((window.height, window.width, 4), np.uint8)
        side = 2 * self.half_px >> level
        left, top = max(0, window.col_off), max(0, window.row_off)
        right, bottom = min(side, window.col_off + window.width), min(side, window.row_off + window.height)
        for row in range(top // TILE_PX, -(-bottom // TILE_PX)):
            for col in range(left // TILE_PX, -(-right // TILE_PX)):
                tile = self._tile(_Key(level, row, col))
                if tile is None:
                    continue
                x, y = col * TILE_PX, row * TILE_PX
                x0, x1, y0, y1 = max(x, left), min(x + TILE_PX, right), max(y, top), min(y + TILE_PX, bottom)
                out[y0 - window.row_off : y1 - window.row_off, x0 - window.col_off : x1 - window.col_off] = tile[
                    y0 - y : y1 - y, x0 - x : x1 - x
                ]
        return out

    def _tile(self, key: _Key) -> Rgba | None:
        window = Window(key.col * TILE_PX, key.row * TILE_PX, TILE_PX, TILE_PX)
        # Before the pixels: were they to change while they are read, the tile counts as old and is made again.
        version = self.version_in(key.level, window)
        if version == 0:
            return None
        if key.level == 0:
            rgba = self.read(0, window)
            return rgba if rgba[..., 3].any() else None
        with self._lock:
            if key in self._kept and self._kept[key][0] == version:
                self._kept.move_to_end(key)
                return self._kept[key][1]
        made = self._shrunk(key)
        with self._lock:
            old = self._kept.pop(key, None)
            self._held += (0 if made is None else made.nbytes) - (0 if old is None or old[1] is None else old[1].nbytes)
            self._kept[key] = (version, made)
            while self._held > _KEPT_BYTES and len(self._kept) > 1:
                gone = self._kept.popitem(last=False)[1][1]
                self._held -= 0 if gone is None else gone.nbytes
        return made

    def _shrunk(self, key: _Key) -> Rgba | None:
        out: Rgba | None = None
        half = TILE_PX // 2
        for dr in (0, 1):
            for dc in (0, 1):
                below = self._tile(_Key(key.level - 1, 2 * key.row + dr, 2 * key.col + dc))
                if below is None:
                    continue
                if out is None:
                    out = np.zeros((TILE_PX, TILE_PX, 4), np.uint8)
                out[dr * half : (dr + 1) * half, dc * half : (dc + 1) * half] = shrink(below, 2)
        return out


def levels_for(raster: LiveRaster, colours: Colours) -> Levels:
    """Return the levels of the smallest arena that holds what a raster shows by now."""
    levels = Levels(raster, colours)
    extent = raster.extent()
    while extent is not None and not levels.holds(extent) and levels.half_px < _MOST_HALF_PX:
        levels = Levels(raster, colours, 2 * levels.half_px)
    return levels


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """One level, read as a ``TileSource``."""

    levels: Levels
    level: int
    grid: MapGrid
    revision: int = 0

    def read(self, window: Window) -> Rgba:
        """``(height, width, 4)`` RGBA, transparent beyond the arena."""
        return self.levels.read(self.level, window)
