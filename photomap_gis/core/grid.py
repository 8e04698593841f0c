"""The map's frames and grids: where internal metres become easting and northing, and those become pixels and tiles.

Inside, the map frame is image-handed (metres, x east, y **south**) about a rounded projected origin. Only this file's
``MapFrame`` and ``MapGrid`` flip the y axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray


class CrsFrame(Protocol):
    """The two-way road between the internal map frame and the CRS of a raster."""

    @property
    def crs_wkt(self) -> str | None:
        """The raster's CRS; ``None`` for a relative map."""
        ...

    def to_crs(self, xy_map_m: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` internal points to the CRS, east before north."""
        ...

    def from_crs(self, en: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` points of the CRS to internal points."""
        ...


@dataclass(frozen=True, slots=True)
class MapFrame:
    """The internal map frame's place in a projected CRS in metres.

    ``crs_wkt`` is ``None`` for a relative map (no place on Earth; units are pixels of the first frame).
    """

    crs_wkt: str | None
    origin_easting_m: float = 0.0
    origin_northing_m: float = 0.0

    def to_crs(self, xy_map_m: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` internal points to easting, northing."""
        p = np.asarray(xy_map_m, dtype=np.float64)
        return p * (1.0, -1.0) + (self.origin_easting_m, self.origin_northing_m)

    def from_crs(self, en_m: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` eastings, northings to internal points."""
        p = np.asarray(en_m, dtype=np.float64)
        return (p - (self.origin_easting_m, self.origin_northing_m)) * (1.0, -1.0)


class TileIndex(NamedTuple):
    """A tile of a grid, counted from the top left."""

    row: int
    col: int


class Window(NamedTuple):
    """A rectangle of pixels of a grid."""

    col_off: int
    row_off: int
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class MapGrid:
    """A north-up raster in a CRS: upper-left **corner**, square pixels, size, and the tiles it is cut into."""

    crs_wkt: str | None
    west: float
    north: float
    pixel_size: float
    width: int
    height: int
    tile_size: int = 512

    def __post_init__(self) -> None:
        if not (self.pixel_size > 0 and self.width > 0 and self.height > 0 and self.tile_size > 0):
            raise ValueError("pixel_size, width, height and tile_size must be positive")

    @classmethod
    def covering(cls, en_m: npt.ArrayLike, frame: CrsFrame, *, pixel_size: float, tile_size: int = 512) -> MapGrid:
        """Return the smallest grid over ``(N, 2)`` eastings, northings whose corners are whole multiples of a pixel."""
        p = np.asarray(en_m, dtype=np.float64)
        west, south = (math.floor(v / pixel_size) for v in p.min(axis=0))
        east, north = (math.ceil(v / pixel_size) for v in p.max(axis=0))
        return cls(
            frame.crs_wkt, west * pixel_size, north * pixel_size, pixel_size,
            max(1, east - west), max(1, north - south), tile_size,
        )  # fmt: skip

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north of the outer pixel edges."""
        return (
            self.west,
            self.north - self.height * self.pixel_size,
            self.west + self.width * self.pixel_size,
            self.north,
        )

    @property
    def transform(self) -> tuple[float, float, float, float, float, float]:
        """The affine (a, b, c, d, e, f) from pixel **corner** (col, row) to (x, y), as rasterio's Affine takes them."""
        return (self.pixel_size, 0.0, self.west, 0.0, -self.pixel_size, self.north)

    @property
    def tile_rows(self) -> int:
        """Number of rows of tiles."""
        return -(-self.height // self.tile_size)

    @property
    def tile_cols(self) -> int:
        """Number of columns of tiles."""
        return -(-self.width // self.tile_size)

    def tiles(self) -> Iterator[TileIndex]:
        """Yield every tile, row by row."""
        return (TileIndex(r, c) for r in range(self.tile_rows) for c in range(self.tile_cols))

    def window(self, tile: TileIndex) -> Window:
        """Return the pixels of a tile, cut at the grid's edge."""
        x, y = tile.col * self.tile_size, tile.row * self.tile_size
        return Window(x, y, min(self.tile_size, self.width - x), min(self.tile_size, self.height - y))

    def to_crs(self, xy_px: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` pixel-**centre** coordinates (col, row; (0, 0) the centre of the first pixel) to the CRS."""
        p = np.asarray(xy_px, dtype=np.float64)
        return (p + 0.5) * (self.pixel_size, -self.pixel_size) + (self.west, self.north)

    def to_px(self, xy_crs: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` points of the CRS to pixel-centre coordinates."""
        p = np.asarray(xy_crs, dtype=np.float64)
        return (p - (self.west, self.north)) / (self.pixel_size, -self.pixel_size) - 0.5


def ground_pixel_m(grid: MapGrid, frame: CrsFrame) -> float:
    """Return the side of a pixel on the ground at the grid's middle: its size in a CRS in metres true to scale."""
    return grid.pixel_size * ground_per_unit(grid.to_crs([[grid.width / 2.0, grid.height / 2.0]])[0], frame)


def ground_per_unit(en: npt.ArrayLike, frame: CrsFrame) -> float:
    """Return how many metres of the internal frame a unit of the CRS is at a ``(2,)`` point (root of the area)."""
    if isinstance(frame, MapFrame):
        return 1.0
    p = np.asarray(en, dtype=np.float64)
    step = 1e-6 * max(1.0, float(np.abs(p).max()))
    q = frame.from_crs(p + np.array([[-step, 0.0], [step, 0.0], [0.0, -step], [0.0, step]]))
    (a, b), (c, d) = (q[1] - q[0]) / (2.0 * step), (q[3] - q[2]) / (2.0 * step)
    return math.sqrt(abs(float(a * d - b * c)))
