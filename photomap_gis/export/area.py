"""The part of a map that is exported: a box, which only cuts, or an outline, outside of which nothing is shown.

A box cuts the grid of the output, whatever its CRS, so its edges are the output's edges. An outline is laid over the
map's own pixels before anything is resampled, so it falls on the same ground in every format.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import shapely
from rasterio import Affine
from rasterio.features import rasterize
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.errors import UsageError
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.crs import WGS84, bounds_in, needs_place, parse_crs, point_map, same_crs
from photomap_gis.export.pixels import Rgba

_SEGMENTS_ACROSS = 200

Bounds = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Area:
    """A part of the map: its outline in ``crs_wkt`` (``None``: local units); ``masks`` where it is more than a box."""

    crs_wkt: str | None
    outline: BaseGeometry
    masks: bool

    def geometry_in(self, crs_wkt: str | None) -> BaseGeometry:
        """Return the outline in another CRS, edges densified so that they stay where they are."""
        if same_crs(self.crs_wkt, crs_wkt):
            return self.outline
        here = needs_place(self.crs_wkt, "clipping in another coordinate reference system")
        there = needs_place(crs_wkt, "clipping by a place on Earth")
        west, south, east, north = self.outline.bounds
        dense = shapely.segmentize(self.outline, max(east - west, north - south) / _SEGMENTS_ACROSS)
        to = point_map(here, there, around_xy=[[west, south], [east, north]])
        moved = shapely.transform(dense, to)
        if not np.isfinite(shapely.get_coordinates(moved)).all():
            raise UsageError("the area does not fit into the map's coordinate reference system: is it the right place?")
        return moved if moved.is_valid else shapely.make_valid(moved)

    def cut(self, bounds: Bounds, crs_wkt: str | None) -> Bounds:
        """Return the part of a map's bounds in a CRS that the area covers; ``UsageError`` where they do not touch."""
        area = self.geometry_in(crs_wkt).bounds
        west, south = max(bounds[0], area[0]), max(bounds[1], area[1])
        east, north = min(bounds[2], area[2]), min(bounds[3], area[3])
        if not (west < east and south < north):
            raise UsageError(f"the area lies off the map, which covers {_covers(bounds, crs_wkt)}")
        return west, south, east, north


def parse_bbox(text: str, crs: str | None, map_crs_wkt: str | None) -> Area:
    """Return the box of four numbers ``west,south,east,north``.

    ``crs`` says what they are in. Without it they are degrees where they can be (no projected map lies within 180
    metres of its origin), else in the map's CRS; a map without a place on Earth has its own units only.
    """
    try:
        west, south, east, north = (float(v) for v in text.replace(";", ",").split(","))
    except ValueError:
        raise UsageError(f"--bbox {text!r} must be four numbers: west,south,east,north") from None
    if not all(math.isfinite(v) for v in (west, south, east, north)) or south >= north or west == east:
        raise UsageError(f"--bbox {text!r} must be west,south,east,north, with south below north")
    in_degrees = max(abs(west), abs(east)) <= 360.0 and max(abs(south), abs(north)) <= 90.0
    if map_crs_wkt is None:
        if crs is not None:
            needs_place(None, "--bbox in a coordinate reference system")
        wkt = None
    elif crs is not None:
        wkt = parse_crs(crs).to_wkt()
    else:
        wkt = parse_crs(WGS84).to_wkt() if in_degrees else map_crs_wkt
    if west > east:
        if wkt is None or not parse_crs(wkt).is_geographic:
            raise UsageError(f"--bbox {text!r} must be west,south,east,north, with west left of east")
        east += 360.0  # across the antimeridian
    return Area(wkt, shapely.box(west, south, east, north), masks=False)


def clipped(source: TileSource, area: Area | None) -> TileSource:
    """Return the map shown within an outline only; itself where the area is a box, which grids are cut to."""
    if area is None or not area.masks:
        return source
    return MaskedSource(source, area.geometry_in(source.grid.crs_wkt))


def cut_grid(grid: MapGrid, bounds: Bounds) -> MapGrid:
    """Return the whole pixels of a grid that touch a box in its CRS."""
    p = grid.pixel_size
    left = max(0, math.floor((bounds[0] - grid.west) / p + 1e-6))
    top = max(0, math.floor((grid.north - bounds[3]) / p + 1e-6))
    right = min(grid.width, math.ceil((bounds[2] - grid.west) / p - 1e-6))
    bottom = min(grid.height, math.ceil((grid.north - bounds[1]) / p - 1e-6))
    size = (max(1, right - left), max(1, bottom - top))
    return MapGrid(grid.crs_wkt, grid.west + left * p, grid.north - top * p, p, *size, grid.tile_size)


@dataclass(frozen=True, slots=True, eq=False)
class MaskedSource:
    """A map shown within an outline in its CRS only."""

    source: TileSource
    outline: BaseGeometry
    _edges: BaseGeometry = field(init=False)

    def __post_init__(self) -> None:
        shapely.prepare(self.outline)
        object.__setattr__(self, "_edges", self.outline.boundary)
        shapely.prepare(self._edges)

    @property
    def grid(self) -> MapGrid:
        """The source's."""
        return self.source.grid

    @property
    def revision(self) -> int:
        """The source's."""
        return self.source.revision

    def read(self, window: Window) -> Rgba:
        """``(height, width, 4)`` RGBA, transparent where a pixel's centre lies outside the outline."""
        g, (c, r, w, h) = self.grid, window
        p = g.pixel_size
        # a pixel more on every side: its edge may run along the window's
        box = shapely.box(
            g.west + (c - 1) * p, g.north - (r + h + 1) * p, g.west + (c + w + 1) * p, g.north - (r - 1) * p
        )
        if not self.outline.intersects(box):
            return np.zeros((h, w, 4), np.uint8)
        rgba = self.source.read(window)
        if not self._edges.intersects(box):
            return rgba
        inside = self._inside(self.outline.intersection(box), window)
        out = rgba.copy()
        out[~inside] = 0
        return out

    def _inside(self, part: BaseGeometry, window: Window) -> npt.NDArray[np.bool_]:
        """``(h, w)`` which pixel centres lie in a geometry that reaches little beyond the window."""
        g, shape = self.grid, (window.height, window.width)
        corner = (g.west + window.col_off * g.pixel_size, g.north - window.row_off * g.pixel_size)
        transform = Affine(g.pixel_size, 0.0, corner[0], 0.0, -g.pixel_size, corner[1])
        polygons = [(p, 1) for p in polygons_of(part) if not p.is_empty]
        if not polygons:
            return np.zeros(shape, bool)
        return np.asarray(rasterize(polygons, out_shape=shape, transform=transform, dtype="uint8"), dtype=bool)


def polygons_of(geometry: BaseGeometry) -> list[shapely.Polygon]:
    """Return the polygons among a geometry's parts, however nested."""
    parts = [geometry] if isinstance(geometry, shapely.Polygon) else list(getattr(geometry, "geoms", []))
    return [p for part in parts for p in ([part] if isinstance(part, shapely.Polygon) else polygons_of(part))]


def _covers(bounds: Bounds, crs_wkt: str | None) -> str:
    if crs_wkt is None:
        return f"x {bounds[0]:.0f} to {bounds[2]:.0f}, y {bounds[1]:.0f} to {bounds[3]:.0f}"
    west, south, east, north = bounds_in(bounds, crs_wkt, parse_crs(WGS84).to_wkt())
    return f"longitude {west:.6f} to {east:.6f}, latitude {south:.6f} to {north:.6f}"
