"""An outline from a file of the user's GIS: GeoJSON, GeoPackage, Shapefile, KML, any CRS, any layer."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import pyogrio
import shapely
from pyogrio.errors import DataLayerError, DataSourceError, GeometryError
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.errors import DataError
from photomap_gis.export.area import Area, polygons_of
from photomap_gis.export.crs import WGS84, parse_crs

_MAX_BYTES = 200 << 20
_MAX_FEATURES = 10_000


def read_cutline(path: Path) -> Area:
    """Return what a file's polygons cover together; ``DataError`` where it has none or cannot be read.

    Closed lines count as polygons (KML drawn by hand). A file without a CRS is taken to be in degrees where its numbers
    can be.
    """
    if not path.is_file():
        raise DataError(f"{path} cannot be read: no such file; name one with a polygon (GeoJSON, GPKG, KML, SHP)")
    if path.stat().st_size > _MAX_BYTES:
        raise DataError(f"{path} is larger than an outline can be ({_MAX_BYTES >> 20} MB): export one polygon only")
    with path.open("rb") as file:
        if b"<OGRVRT" in file.read(4096):  # a list of references to other files, even on other machines
            raise DataError(f"{path} only refers to other files: name the file with the polygon itself")
    crs_text, geometries = _read(path)
    parts = [p for g in geometries for p in _closed(g)]
    if not parts:
        raise DataError(f"{path} holds no polygon: an outline to cut by must be one")
    outline = shapely.union_all([p if p.is_valid else shapely.make_valid(p) for p in parts])
    outline = shapely.MultiPolygon(polygons_of(outline))
    if outline.is_empty or outline.area == 0.0:
        raise DataError(f"{path} holds polygons without an area: an outline to cut by must have one")
    west, south, east, north = outline.bounds
    if not crs_text:
        if not (max(abs(west), abs(east)) <= 360.0 and max(abs(south), abs(north)) <= 90.0):
            raise DataError(f"{path} does not say in which coordinate reference system it is: save it with one")
        crs_text = WGS84
    return Area(parse_crs(crs_text).to_wkt(), outline, masks=True)


def _read(path: Path) -> tuple[str | None, list[BaseGeometry]]:
    """Return the first layer with geometries, and its CRS."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pyogrio warns of Z values and of fields that nobody reads here
            for name, kind in pyogrio.list_layers(path):
                if kind is None:
                    continue
                meta, _, geometries, _ = _layer(path, name)
                found = [g for g in shapely.from_wkb(geometries) if g is not None and not g.is_empty]
                if any(_closed(g) for g in found):
                    return meta["crs"], [shapely.force_2d(g) for g in found]
    except (DataSourceError, DataLayerError, GeometryError, shapely.errors.ShapelyError) as error:
        reason = " ".join(str(error).split(";")[0].split())
        raise DataError(
            f"{path} cannot be read as an outline ({reason}); name a GeoJSON, GPKG, KML or SHP with a polygon"
        ) from error
    return None, []


def _layer(path: Path, name: str) -> tuple[dict[str, Any], Any, Any, Any]:
    result: tuple[dict[str, Any], Any, Any, Any] = pyogrio.raw.read(
        path, layer=name, columns=[], max_features=_MAX_FEATURES
    )
    return result


def _closed(geometry: BaseGeometry) -> list[BaseGeometry]:
    """Return the polygons of a geometry, and those that its closed lines make."""
    found: list[BaseGeometry] = list(polygons_of(geometry))
    if found:
        return found
    lines = [geometry] if geometry.geom_type == "LineString" else list(getattr(geometry, "geoms", []))
    return [shapely.Polygon(g.coords) for g in lines if g.geom_type == "LineString" and g.is_ring and len(g.coords) > 3]
