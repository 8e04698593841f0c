"""A layer of a live map: tiles that know their version, so that only what changed travels.

Pixels come through ``export.warp.Resampler``, the path of every export: a landmark lies on the live page where an
export of the same moment has it.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from photomap_gis.core.errors import UsageError
from photomap_gis.core.grid import Window
from photomap_gis.export.crs import WEB_MERCATOR, WGS84, parse_crs, point_map
from photomap_gis.export.encode import TileFormat, encode
from photomap_gis.export.pixels import Rgba
from photomap_gis.export.warp import Resampler, pixel_steps
from photomap_gis.export.webtiles import TILE_PX
from photomap_gis.server.layers import MAX_ZOOM, TileScheme
from photomap_gis.server.live_levels import Levels, levels_for
from photomap_gis.server.live_view import LiveRaster, RasterKind
from photomap_gis.server.ramp import Ramp

_HALF_WORLD_M = math.pi * 6378137.0
_LOCAL_ZOOMS = 13
"""A local map's zoom 0 is so many times coarser, and its tiles are counted from that far off: it may grow anywhere."""
_CACHED_BYTES = 48 << 20
TITLES = {
    RasterKind.MAP: "Photo map",
    RasterKind.AGE: "Age: when last seen",
    RasterKind.SIGMA: "Sigma: predicted error",
    RasterKind.SEARCHED: "Searched: resolution",
}
_STEPS = (1.0, 2.0, 5.0, 10.0)
_AROUND = [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (1.0, 0.5), (1.0, 1.0), (0.5, 1.0), (0.0, 1.0), (0.0, 0.5)]
"""Corners and middles of sides, as shares of a window."""


@dataclass(frozen=True, slots=True)
class LiveTile:
    """A tile's version and how it is stored; ``data`` is empty where it shows nothing."""

    version: int
    data: bytes


class _Address(NamedTuple):
    zoom: int
    x: int
    y: int
    format: TileFormat


class _Plan(NamedTuple):
    resampler: Resampler
    levels: Levels
    level: int


class LiveLayer:
    """One raster of a live session and its tiles; safe among threads. It holds for one epoch."""

    def __init__(self, raster: LiveRaster) -> None:
        self.raster = raster
        self.id = raster.kind.value
        self.title = TITLES[raster.kind]
        self.ramp: Ramp | None = None if raster.kind is RasterKind.MAP else Ramp(0.0, 1.0)
        self.generation = 0
        """Counts changes of the colours' meaning, at which every tile changes."""
        self._lock = threading.Lock()
        self._levels = levels_for(raster, self._colours)
        self._plans: dict[int, _Plan] = {}
        self._tiles: OrderedDict[_Address, LiveTile] = OrderedDict()
        self._held = 0
        self._empty = {f: encode(np.zeros((TILE_PX, TILE_PX, 4), np.uint8), f) for f in TileFormat}
        self._scheme = self._first_scheme()

    @property
    def units(self) -> str:
        """What its numbers are in."""
        return {RasterKind.AGE: "min flown", RasterKind.SEARCHED: "m per pixel"}.get(self.raster.kind, "m")

    @property
    def scheme(self) -> TileScheme:
        """How its tiles are addressed; ``bounds`` grow, all else stays."""
        s = self._scheme
        return TileScheme(s.kind, s.min_zoom, s.max_zoom, self._bounds(), s.origin_xy, s.unit_per_px)

    def tell_range(self, high: float) -> None:
        """Stretch the ramp to a round number above ``high``, where it is not near that already."""
        if self.ramp is None or not (math.isfinite(high) and high > 0):
            return
        top = _round_above(high)
        if top > self.ramp.high or (self.generation == 0 and top != self.ramp.high):
            with self._lock:
                self.ramp = Ramp(0.0, top)
                self.generation += 1
                self._plans.clear()
                self._tiles.clear()
                self._held = 0
                self._levels = levels_for(self.raster, self._colours)

    def version_of(self, zoom: int, x: int, y: int) -> int:
        """Return a tile's version, 0 where it shows nothing; ``UsageError`` for an address that no tile can have."""
        plan = self._plan(zoom, x, y)
        window = plan.resampler.source_window(_window(x, y))
        return 0 if window is None else plan.levels.version_in(plan.level, window)

    def tile(self, zoom: int, x: int, y: int, tile_format: TileFormat) -> LiveTile:
        """Return a tile, wholly transparent where it shows nothing; ``UsageError`` where there can be none."""
        version = self.version_of(zoom, x, y)
        if version == 0:
            return LiveTile(0, self._empty[tile_format])
        address = _Address(zoom, x, y, tile_format)
        with self._lock:
            kept = self._tiles.get(address)
            if kept is not None and kept.version == version:
                self._tiles.move_to_end(address)
                return kept
        rgba = self._plan(zoom, x, y).resampler.read(_window(x, y))
        data = encode(rgba, tile_format) if rgba[..., 3].any() else self._empty[tile_format]
        made = LiveTile(version, data)
        with self._lock:
            old = self._tiles.pop(address, None)
            self._held += len(data) - (0 if old is None else len(old.data))
            self._tiles[address] = made
            while self._held > _CACHED_BYTES and len(self._tiles) > 1:
                self._held -= len(self._tiles.popitem(last=False)[1].data)
        return made

    def value_at(self, xy_crs: tuple[float, float]) -> float | None:
        """Return the number at a place of the lattice's CRS as the raster has it; ``None`` where there is none."""
        if self.raster.kind is RasterKind.MAP:
            return None
        col, row = (math.floor(float(v) + 0.5) for v in self.raster.lattice.to_px([xy_crs])[0])
        value = float(self.raster.read(Window(col, row, 1, 1))[0, 0])
        return value if math.isfinite(value) else None

    def around(self, xy_crs: tuple[float, float], side_px: int) -> Rgba:
        """``(side, side, 4)`` RGBA of its finest pixels about a place of the lattice's CRS."""
        x, y = (round(float(v)) for v in self.raster.lattice.to_px([xy_crs])[0])
        return self._colours(self.raster.read(Window(x - side_px // 2, y - side_px // 2, side_px, side_px)))

    def window_bounds(self, windows: Sequence[Window]) -> list[tuple[float, float, float, float]]:
        """Return west, south, east, north of windows of the lattice: degrees, or the map's own units."""
        g = self.raster.lattice
        if not windows:
            return []
        w = np.array(windows, dtype=np.float64)
        corners = np.stack([w[:, :2] + w[:, 2:] * share for share in _AROUND], axis=1) - 0.5
        xy = g.to_crs(corners.reshape(-1, 2))
        if g.crs_wkt is not None:
            xy = point_map(g.crs_wkt, WGS84, around_xy=xy)(xy)
        xy = xy.reshape(-1, len(_AROUND), 2)
        return [(float(a[0]), float(a[1]), float(b[0]), float(b[1])) for a, b in zip(xy.min(1), xy.max(1), strict=True)]

    def overview(self, window: Window, most_px: int) -> tuple[Rgba, int]:
        """Return a window of the lattice shrunk to at most ``most_px`` a side, and by how much (a power of 2).

        The picture's corner is the window's, moved out to whole shrunk pixels.
        """
        levels = self._current_levels()
        level = 0
        while max(window.width, window.height) >> level > most_px and level + 1 < levels.count:
            level += 1
        f, half = 1 << level, levels.half_px
        left, top = (window.col_off + half) // f, (window.row_off + half) // f
        right, bottom = (
            -(-(window.col_off + half + window.width) // f),
            -(-(window.row_off + half + window.height) // f),
        )
        return levels.read(level, Window(left, top, right - left, bottom - top)), f

    def _plan(self, zoom: int, x: int, y: int) -> _Plan:
        if not (0 <= zoom <= self._scheme.max_zoom and 0 <= x < 1 << zoom and 0 <= y < 1 << zoom):
            raise UsageError(f"no such tile: zoom 0 to {self._scheme.max_zoom}, x and y below 2 to the zoom")
        levels = self._current_levels()
        with self._lock:
            plan = self._plans.get(zoom)
            if plan is None or plan.levels is not levels:
                level = min(self._scheme.max_zoom - zoom, levels.count - 1)
                plan = _Plan(Resampler(levels.at(level), self._scheme.grid(zoom)), levels, level)
                self._plans[zoom] = plan
            return plan

    def _current_levels(self) -> Levels:
        extent = self.raster.extent()
        with self._lock:
            if extent is not None and not self._levels.holds(extent):
                self._levels = levels_for(self.raster, self._colours)
            return self._levels

    def _colours(self, pixels: npt.NDArray[Any]) -> Rgba:
        if self.ramp is None:
            return np.asarray(pixels, dtype=np.uint8)
        values = pixels / 60.0 if self.raster.kind is RasterKind.AGE else pixels
        return self.ramp.colours(values, np.isfinite(values))

    def _first_scheme(self) -> TileScheme:
        g = self.raster.lattice
        if g.crs_wkt is None:
            far = g.pixel_size * TILE_PX * 2.0 ** (_LOCAL_ZOOMS - 1)
            origin = (g.west - far, g.north + far)
            return TileScheme("local", 0, _LOCAL_ZOOMS, g.bounds, origin, g.pixel_size)
        steps = pixel_steps(g, parse_crs(WEB_MERCATOR).to_wkt())
        finest = max(0, min(MAX_ZOOM, round(math.log2(2.0 * _HALF_WORLD_M / TILE_PX / min(steps)))))
        return TileScheme("webmercator", max(0, finest - _LOCAL_ZOOMS), finest, self._bounds())

    def _bounds(self) -> tuple[float, float, float, float]:
        g = self.raster.lattice
        return self.window_bounds([self.raster.extent() or Window(0, 0, g.tile_size, g.tile_size)])[0]


def _window(x: int, y: int) -> Window:
    return Window(x * TILE_PX, y * TILE_PX, TILE_PX, TILE_PX)


def _round_above(value: float) -> float:
    power = 10.0 ** math.floor(math.log10(value))
    return next(s * power for s in _STEPS if s * power >= value * (1.0 - 1e-9))
