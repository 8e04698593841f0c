"""What a live map covers by now, and what is missing of the area that it is to cover, as GeoJSON."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import rasterio.features
import shapely
from affine import Affine
from shapely.geometry import MultiPolygon, Polygon, mapping, shape
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.export.crs import WGS84, point_map
from photomap_gis.export.warp import ground_pixel_m
from photomap_gis.server.live_mission import LiveMission

_SIDE_PX = 512
"""The map is looked at in a picture of at most this side: an outline, not a survey."""
_DIGITS = 7


class Coverage:
    """Works coverage out when it is asked for and something has changed; safe among threads."""

    def __init__(self, mission: LiveMission) -> None:
        self._mission = mission
        self._lock = threading.Lock()
        self._key: tuple[str, int] | None = None
        self._document: dict[str, Any] = {}

    def key(self) -> tuple[str, int]:
        """What the document hangs on: the epoch and the newest version of any pixel."""
        raster = self._mission.session.rasters[0]
        extent = raster.extent()
        return self._mission.session.state.epoch, 0 if extent is None else raster.version_in(extent)

    def document(self) -> dict[str, Any]:
        """Return a collection: ``covered`` (square metres, and outline), ``area`` and ``gaps`` where one was given."""
        with self._lock:
            key = self.key()
            if key != self._key:
                self._document, self._key = self._made(), key
            return self._document

    def _made(self) -> dict[str, Any]:
        state, layer = self._mission.session.state, self._mission.layers[0]
        lattice, extent = layer.raster.lattice, layer.raster.extent()
        covered: BaseGeometry = MultiPolygon()
        side_m = 1.0 if lattice.crs_wkt is None else ground_pixel_m(lattice)
        if extent is not None:
            covered = _covered(layer.overview(extent, _SIDE_PX), extent, lattice)
        to_m2 = (side_m / lattice.pixel_size) ** 2
        features = [_feature("covered", covered, lattice.crs_wkt)]
        found: dict[str, Any] = {"covered_m2": round(covered.area * to_m2, 1)}
        if lattice.crs_wkt is None:
            found = {"covered_px2": round(covered.area / lattice.pixel_size**2)}
        elif state.area_lon_lat is not None and len(state.area_lon_lat) >= 3:
            area = shapely.make_valid(Polygon(point_map(WGS84, lattice.crs_wkt)(state.area_lon_lat)))
            gaps = area.difference(covered)
            # Slivers along the border of what was seen are the picture's pixels, not ground.
            gaps = gaps.buffer(-lattice.pixel_size).buffer(lattice.pixel_size)
            features += [_feature("area", area, lattice.crs_wkt), _feature("gaps", gaps, lattice.crs_wkt)]
            share = area.intersection(covered).area / area.area if area.area > 0 else 0.0
            found |= {"area_m2": round(area.area * to_m2, 1), "share": round(share, 4)}
        kind = "local" if lattice.crs_wkt is None else "lonlat"
        return {"type": "FeatureCollection", "coordinates": kind, **found, "features": features}


def _covered(overview: tuple[np.ndarray[Any, Any], int], extent: Window, lattice: MapGrid) -> BaseGeometry:
    rgba, f = overview
    size = lattice.pixel_size * f
    # The overview's corner is the extent's, moved out to whole shrunk pixels.
    west = lattice.west + (extent.col_off // f) * size
    north = lattice.north - (extent.row_off // f) * size
    seen = (rgba[..., 3] >= 128).astype(np.uint8)
    found = rasterio.features.shapes(seen, mask=seen > 0, transform=Affine(size, 0.0, west, 0.0, -size, north))
    return shapely.unary_union([shape(geometry) for geometry, _ in found]).simplify(0.75 * size)


def _feature(kind: str, geometry: BaseGeometry, crs_wkt: str | None) -> dict[str, Any]:
    if crs_wkt is not None and not geometry.is_empty:
        box = np.array(geometry.bounds).reshape(2, 2)
        geometry = shapely.transform(geometry, point_map(crs_wkt, WGS84, around_xy=box))
        geometry = shapely.set_precision(geometry, 10.0**-_DIGITS, mode="pointwise")
    return {
        "type": "Feature",
        "geometry": None if geometry.is_empty else mapping(geometry),
        "properties": {"kind": kind},
    }
