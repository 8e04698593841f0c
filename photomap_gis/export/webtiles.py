"""The tile pyramid of web maps (EPSG:3857, 256 pixels), shared by the folder of tiles and MBTiles."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.area import Area
from photomap_gis.export.crs import WEB_MERCATOR, bounds_in, needs_place, parse_crs, same_crs
from photomap_gis.export.encode import TileChoice, encode
from photomap_gis.export.pieces import EncodedTile, Pieces
from photomap_gis.export.pyramid import Pyramid, Tile, TileKey
from photomap_gis.export.warp import Resampler, check_size, ground_pixel_m, pixel_steps

TILE_PX = 256
_HALF_WORLD_M = math.pi * 6378137.0
_FINEST_ZOOM = 26
_ZOOMS_BELOW_ONE_TILE = 4
_LATITUDE_LIMIT_M = _HALF_WORLD_M * (1 + 1e-9)

OnProgress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class WebTiles:
    """A planned pyramid: zooms from the widest to the finest, and the map's box in degrees.

    ``box_deg`` is west, south, east, north of whole pixels of the finest zoom; beyond ±180 across the antimeridian.
    """

    pyramid: Pyramid
    min_zoom: int
    max_zoom: int
    box_deg: tuple[float, float, float, float]

    @property
    def bounds_deg(self) -> tuple[float, float, float, float]:
        """The box within ±180 degrees: the whole world's width where the map crosses the antimeridian."""
        west, south, east, north = self.box_deg
        return (-180.0, south, 180.0, north) if west < -180.0 or east > 180.0 else self.box_deg

    @property
    def zooms(self) -> str:
        """The zooms as words for errors."""
        return f"{self.min_zoom} to {self.max_zoom}"

    @property
    def centre(self) -> tuple[float, float, int]:
        """Longitude, latitude, and a zoom at which the map fills a small window."""
        west, south, east, north = self.box_deg
        lon = ((west + east) / 2.0 + 180.0) % 360.0 - 180.0
        zoom = min(self.max_zoom, max(self.min_zoom, self.min_zoom + _ZOOMS_BELOW_ONE_TILE + 1))
        return (lon, (south + north) / 2.0, zoom)

    def encoded(
        self,
        choice: TileChoice,
        quality: int | None = None,
        on_progress: OnProgress | None = None,
        pieces: Pieces | None = None,
    ) -> Iterator[EncodedTile]:
        """Yield every tile's bytes (row from the north), children before parents."""
        for tile in encoded_tiles(self.pyramid, choice, quality, on_progress, pieces):
            # Across the antimeridian columns run on beyond the last: there they start again from the west.
            key = TileKey(tile.key.zoom, tile.key.x % (1 << tile.key.zoom), tile.key.y)
            yield EncodedTile(key, tile.format, tile.data)


def encoded_tiles(
    pyramid: Pyramid,
    choice: TileChoice,
    quality: int | None = None,
    on_progress: OnProgress | None = None,
    pieces: Pieces | None = None,
) -> Iterator[EncodedTile]:
    """Yield the tiles of any pyramid as they are stored, children before parents; made and encoded on all cores."""

    def make(tile: Tile) -> EncodedTile:
        tile_format = choice.of(tile.rgba)
        return EncodedTile(tile.key, tile_format, encode(tile.rgba, tile_format, quality))

    return pyramid.made(make, on_progress, pieces)


def plan_web_tiles(
    source: TileSource,
    what: str,
    *,
    min_zoom: int | None = None,
    max_zoom: int | None = None,
    gsd_m: float | None = None,
    area: Area | None = None,
) -> WebTiles:
    """Return the plan to cut a map into web tiles.

    The finest zoom is the one nearest to the map's own pixel size at its latitude; the widest is a few above where the
    map fits into one tile, so that it does not vanish at the first step back. ``what`` names the format in errors.
    """
    crs = needs_place(source.grid.crs_wkt, what)
    mercator = parse_crs(WEB_MERCATOR).to_wkt()
    west, south, east, north = (
        source.grid.bounds if same_crs(crs, mercator) else bounds_in(source.grid.bounds, crs, mercator)
    )
    if max(abs(south), abs(north)) > _LATITUDE_LIMIT_M:
        raise DataError(f"{what} ends at 85 degrees of latitude and this map lies beyond: use --geotiff")
    if area is not None:
        west, south, east, north = area.cut((west, south, east, north), mercator)
    pixel_m = min(pixel_steps(source.grid, mercator))
    native = _nearest_zoom(pixel_m)
    if max_zoom is not None:
        finest = _checked("max_zoom", max_zoom)
    elif gsd_m is not None:
        finest = _nearest_zoom(gsd_m * pixel_m / ground_pixel_m(source.grid))
    else:
        finest = native
    leaf = max(native, finest)  # coarser tiles are made of native ones: no detail is skipped on the way
    size_m = 2.0 * _HALF_WORLD_M / (TILE_PX << leaf)
    left, top = (math.floor(v / size_m + 1e-6) for v in (west + _HALF_WORLD_M, _HALF_WORLD_M - north))
    right, bottom = (math.ceil(v / size_m - 1e-6) for v in (east + _HALF_WORLD_M, _HALF_WORLD_M - south))
    extent = Window(left, top, max(1, right - left), max(1, bottom - top))
    check_size((extent.width, extent.height), source.grid, f"zoom {finest} of {what}")
    one_tile = leaf - math.ceil(math.log2(max(1.0, max(extent.width, extent.height) / TILE_PX)))
    widest = (
        max(0, min(finest, one_tile - _ZOOMS_BELOW_ONE_TILE)) if min_zoom is None else _checked("min_zoom", min_zoom)
    )
    if widest > finest:
        raise UsageError(f"the widest zoom ({widest}) must not lie beyond the finest ({finest})")
    world = MapGrid(mercator, -_HALF_WORLD_M, _HALF_WORLD_M, size_m, TILE_PX << leaf, TILE_PX << leaf, TILE_PX)
    pyramid = Pyramid(Resampler(source, world), extent, leaf, widest, finest, TILE_PX)
    return WebTiles(pyramid, widest, finest, _box_deg(extent, leaf, finest))


def _box_deg(extent: Window, leaf: int, finest: int) -> tuple[float, float, float, float]:
    """Return west, south, east, north of whole pixels of the finest zoom that is kept.

    GDAL and QGIS cut MBTiles to these bounds and round them to pixels: others would shift the map by up to half a one.
    """
    step, world_px = 1 << (leaf - finest), TILE_PX << finest
    left, top = extent.col_off // step, extent.row_off // step
    right, bottom = -(-(extent.col_off + extent.width) // step), -(-(extent.row_off + extent.height) // step)
    west, east = (360.0 * v / world_px - 180.0 for v in (left, right))
    south, north = (math.degrees(math.atan(math.sinh(math.pi * (1.0 - 2.0 * v / world_px)))) for v in (bottom, top))
    return west, south, east, north


def _nearest_zoom(pixel_m: float) -> int:
    return max(0, min(_FINEST_ZOOM, round(math.log2(2.0 * _HALF_WORLD_M / TILE_PX / pixel_m))))


def _checked(name: str, zoom: int) -> int:
    if not 0 <= zoom <= _FINEST_ZOOM:
        raise UsageError(f"{name} must lie between 0 and {_FINEST_ZOOM}, got {zoom}")
    return zoom
