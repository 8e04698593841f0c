"""A layer of the page: pictures at several levels of detail, and the tile of any address cut out of the right one.

Tiles are read through ``export.warp.Resampler``, the path of every export, so a landmark lies on the page where it lies
in the files.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from photomap_gis.core.errors import UsageError
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.crs import WEB_MERCATOR, parse_crs
from photomap_gis.export.warp import Resampler
from photomap_gis.export.webtiles import TILE_PX, plan_web_tiles
from photomap_gis.server.raster import RasterFile

_HALF_WORLD_M = math.pi * 6378137.0
MAX_ZOOM = 26


@dataclass(frozen=True, slots=True)
class TileScheme:
    """How a layer's tiles are addressed: web tiles, or pixels of a map that has no place on Earth.

    ``bounds`` is west, south, east, north: degrees for ``webmercator``, the map's own units for ``local``. A local
    map's tile (0, 0) has its corner at ``origin_xy``, and a pixel of zoom ``max_zoom`` measures ``unit_per_px``.
    """

    kind: str
    min_zoom: int
    max_zoom: int
    bounds: tuple[float, float, float, float]
    origin_xy: tuple[float, float] = (-_HALF_WORLD_M, _HALF_WORLD_M)
    unit_per_px: float = 1.0

    def grid(self, zoom: int) -> MapGrid:
        """Return the pixels of a zoom level."""
        if self.kind == "local":
            size = self.unit_per_px * 2.0 ** (self.max_zoom - zoom)
            side = TILE_PX << zoom
            return MapGrid(None, *self.origin_xy, size, side, side, TILE_PX)
        side = TILE_PX << zoom
        return MapGrid(_MERCATOR, -_HALF_WORLD_M, _HALF_WORLD_M, 2.0 * _HALF_WORLD_M / side, side, side, TILE_PX)


_MERCATOR = parse_crs(WEB_MERCATOR).to_wkt()


class Layer:
    """One picture of the ground: ``id`` and ``title``, and its tiles.

    ``sources`` are the same picture from fine to coarse; ``values`` is the file whose numbers its colours stand for,
    and ``files`` are what is closed with it.
    """

    def __init__(
        self,
        id: str,
        title: str,
        sources: Sequence[TileSource],
        *,
        role: str = "map",
        piece: int | None = None,
        values: RasterFile | None = None,
        files: Sequence[RasterFile] = (),
    ) -> None:
        """Plan the tiles of a layer; ``PhotomapError`` where it cannot be shown as web tiles."""
        if not sources:
            raise ValueError("sources must not be empty")
        self.id, self.title, self.role, self.piece = id, title, role, piece
        self.values = values
        self._sources, self._files = tuple(sources), tuple(files)
        self.scheme = _scheme(self._sources[0])
        self._plans: dict[int, tuple[Resampler, Window]] = {}
        self._lock = threading.Lock()

    @property
    def grid(self) -> MapGrid:
        """The grid of its finest pixels."""
        return self._sources[0].grid

    def tile(self, zoom: int, x: int, y: int) -> npt.NDArray[np.uint8] | None:
        """``(256, 256, 4)`` RGBA of a tile (row 0 in the north); ``None`` where it shows nothing.

        ``UsageError`` for an address that no tile can have.
        """
        if not (0 <= zoom <= self.scheme.max_zoom and 0 <= x < 1 << zoom and 0 <= y < 1 << zoom):
            raise UsageError(f"no such tile: zoom 0 to {self.scheme.max_zoom}, x and y below 2 to the zoom")
        resampler, extent = self._plan(zoom)
        for column in (x, x + (1 << zoom)):  # across the antimeridian a map runs on beyond the last column
            window = Window(column * TILE_PX, y * TILE_PX, TILE_PX, TILE_PX)
            if _touch(window, extent):
                rgba = resampler.read(window)
                if rgba[..., 3].any():
                    return rgba
        return None

    def value_at(self, xy_crs: tuple[float, float]) -> float | None:
        """Return the number that the layer holds at a place of its CRS, ``None`` where it holds pictures or nothing."""
        if self.values is None:
            return None
        x, y = self.values.grid.to_px([xy_crs])[0]
        return self.values.value_at((float(x), float(y)))

    def around(self, xy_crs: tuple[float, float], side_px: int) -> npt.NDArray[np.uint8]:
        """``(side, side, 4)`` RGBA of its finest pixels about a place of its CRS."""
        x, y = (round(float(v)) for v in self.grid.to_px([xy_crs])[0])
        return self._sources[0].read(Window(x - side_px // 2, y - side_px // 2, side_px, side_px))

    def close(self) -> None:
        """Let go of its files."""
        for file in self._files:
            file.close()

    def _plan(self, zoom: int) -> tuple[Resampler, Window]:
        with self._lock:
            if zoom not in self._plans:
                grid = self.scheme.grid(zoom)
                source = self._source_for(zoom)
                self._plans[zoom] = (Resampler(source, grid), _extent(self.scheme, grid, zoom))
            return self._plans[zoom]

    def _source_for(self, zoom: int) -> TileSource:
        """Return the coarsest picture that is not coarser than the tile's pixels."""
        wanted = 2.0 ** (self.scheme.max_zoom - zoom)
        best = self._sources[0]
        for source in self._sources[1:]:
            if self.grid.width / source.grid.width <= wanted * 1.01:
                best = source
        return best


def _scheme(source: TileSource) -> TileScheme:
    g = source.grid
    if g.crs_wkt is not None:
        plan = plan_web_tiles(source, "a web page")
        return TileScheme("webmercator", plan.min_zoom, plan.max_zoom, plan.bounds_deg)
    levels = max(0, math.ceil(math.log2(max(1.0, max(g.width, g.height) / TILE_PX))))
    west, _, _, north = g.bounds
    return TileScheme("local", 0, levels, g.bounds, (west, north), g.pixel_size)


def _extent(scheme: TileScheme, grid: MapGrid, zoom: int) -> Window:
    """Return the pixels of a zoom level that may show something, a pixel more on every side."""
    west, south, east, north = scheme.bounds
    if scheme.kind == "local":
        corners = grid.to_px([[west, north], [east, south]]) + 0.5
    else:
        side = TILE_PX << zoom
        if west <= -180.0 and east >= 180.0:  # across the antimeridian: the box is the whole world's width
            return Window(0, 0, 2 * side, side)
        rows = [0.5 - math.asinh(math.tan(math.radians(lat))) / (2.0 * math.pi) for lat in (north, south)]
        corners = np.array(
            [[(lon / 360.0 + 0.5) * side, row * side] for lon, row in zip((west, east), rows, strict=True)]
        )
    left, top = (math.floor(float(v)) - 1 for v in corners[0])
    right, bottom = (math.ceil(float(v)) + 1 for v in corners[1])
    return Window(left, top, right - left, bottom - top)


def _touch(a: Window, b: Window) -> bool:
    return (
        a.col_off < b.col_off + b.width
        and b.col_off < a.col_off + a.width
        and a.row_off < b.row_off + b.height
        and b.row_off < a.row_off + a.height
    )
