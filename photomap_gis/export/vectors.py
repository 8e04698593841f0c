"""What a map is made of, for a GIS: track, camera positions, footprints, registrations, outline, finds.

GeoPackage has a layer each, in any CRS; GeoJSON (RFC 7946) and KML are in degrees, the layer told by a property or a
folder.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt
import pyogrio
import shapely
from pyogrio.errors import DataLayerError, DataSourceError
from shapely.geometry import mapping
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.errors import OutputError, UsageError
from photomap_gis.export.antimeridian import cut
from photomap_gis.export.area import Area
from photomap_gis.export.crs import WGS84, needs_place, parse_crs, point_map, same_crs, world_period
from photomap_gis.export.publish import file_in_place_of
from photomap_gis.export.words import MapWords

SUFFIXES = (".gpkg", ".geojson", ".json", ".kml")
_NO_WORDS = MapWords()
_DEGREE_DIGITS = 9
_COLOURS = {  # KML: alpha, blue, green, red
    "track": "ff00aaff", "cameras": "ff00ffff", "footprints": "ffff9933", "registrations": "ff66cc66",
    "outline": "ff3333ff", "finds": "ff0000ff",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class VectorLayer:
    """Features of one kind; ``rows`` hold the same keys each, with text, numbers, truth values or ``None``."""

    name: str
    geometries: tuple[BaseGeometry, ...]
    rows: tuple[Mapping[str, Any], ...]

    def __post_init__(self) -> None:
        if len(self.geometries) != len(self.rows):
            raise ValueError(f"layer {self.name}: {len(self.geometries)} geometries, {len(self.rows)} rows")

    def moved(self, from_crs: str | None, to_crs: str | None) -> VectorLayer:
        """Return the layer in another CRS."""
        if not self.geometries or same_crs(from_crs, to_crs):
            return self
        here, there = needs_place(from_crs, "vectors in another CRS"), needs_place(to_crs, "vectors in another CRS")
        west, south, east, north = shapely.total_bounds(np.array(self.geometries, dtype=object))
        to = point_map(here, there, around_xy=[[west, south], [east, north]])
        moved = tuple(shapely.transform(g, to) for g in self.geometries)
        if world_period(there) == 360.0:
            moved = tuple(cut(g) for g in moved)
        return VectorLayer(self.name, moved, self.rows)


def write_vectors(
    layers: Sequence[VectorLayer],
    path: Path | str,
    *,
    crs_wkt: str | None,
    crs: str | None = None,
    area: Area | None = None,
    words: MapWords = _NO_WORDS,
) -> int:
    """Write layers given in ``crs_wkt`` and return the number of features; the suffix says the format.

    ``crs`` is the GeoPackage's (default ``crs_wkt``); ``area`` keeps what touches it. Empty layers are left out.
    """
    path = Path(path).absolute()
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise UsageError(f"{path.name} must end in {', '.join(SUFFIXES)}")
    if area is not None:
        layers = [_touching(layer, area.geometry_in(crs_wkt)) for layer in layers]
    layers = [layer for layer in layers if layer.geometries]
    if not layers and area is not None:
        raise UsageError(f"{path} was not written: nothing of the flight lies within --bbox or --cutline")
    if not layers:
        raise OutputError(f"{path} was not written: there is nothing to show, no frame has a place")
    if suffix != ".gpkg":
        here = needs_place(crs_wkt, "GeoJSON" if suffix != ".kml" else "KML")
        moved = [layer.moved(here, WGS84) for layer in layers]
        text = _kml(moved, words) if suffix == ".kml" else _geojson(moved, words)
        with file_in_place_of(path, lambda p: _check_text(p, path)) as temporary:
            temporary.write_text(text, encoding="utf-8")
    else:
        target = crs_wkt
        if crs is not None:
            target = parse_crs(crs).to_wkt()
            layers = [layer.moved(needs_place(crs_wkt, f"vectors in {crs}"), target) for layer in layers]
        with file_in_place_of(path, lambda p: _check_gpkg(p, path, layers)) as temporary:
            _write_gpkg(layers, temporary, path, target, words)
    return sum(len(layer.geometries) for layer in layers)


def write_empty_layer(
    path: Path, name: str, *, geometry_type: str, fields: Mapping[str, type], crs_wkt: str | None
) -> None:
    """Write a GeoPackage with one layer that holds nothing, as a result that there is nothing to show.

    ``fields`` are names and ``int``, ``float`` or ``str``, as they would be of features.
    """
    dtypes: dict[type, Any] = {int: np.int64, float: np.float64, str: object}
    with file_in_place_of(path.absolute()) as temporary:
        try:
            pyogrio.raw.write(
                temporary,
                np.array([], dtype=object),
                [np.array([], dtype=dtypes[kind]) for kind in fields.values()],
                list(fields),
                layer=name,
                driver="GPKG",
                geometry_type=geometry_type,
                crs=crs_wkt,
            )
        except (DataSourceError, DataLayerError) as error:
            raise OutputError(f"{path} cannot be written: {' '.join(str(error).split())}; check the disk") from error


def _touching(layer: VectorLayer, area: BaseGeometry) -> VectorLayer:
    kept = [i for i, g in enumerate(layer.geometries) if g.intersects(area)]
    return VectorLayer(layer.name, tuple(layer.geometries[i] for i in kept), tuple(layer.rows[i] for i in kept))


def _write_gpkg(
    layers: Sequence[VectorLayer], temporary: Path, path: Path, crs_wkt: str | None, words: MapWords
) -> None:
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*crs.*")  # a local map has none, and says so
            for number, layer in enumerate(layers):
                kinds = {g.geom_type for g in layer.geometries}
                kind = kinds.pop() if len(kinds) == 1 else "Unknown"
                names = list(layer.rows[0])
                pyogrio.raw.write(
                    temporary,
                    np.array([shapely.to_wkb(g) for g in layer.geometries], dtype=object),
                    [_column([row[name] for row in layer.rows]) for name in names],
                    names,
                    layer=layer.name,
                    driver="GPKG",
                    geometry_type=kind,
                    crs=crs_wkt,
                    append=number > 0,
                    dataset_metadata=None if number else {**words.pairs, "attribution": words.attribution},
                    layer_options={"DESCRIPTION": words.paragraph.replace("\n", "; ")},
                )
    except (DataSourceError, DataLayerError) as error:
        raise OutputError(f"{path} cannot be written: {' '.join(str(error).split())}; check the disk") from error


def _column(values: Sequence[Any]) -> npt.NDArray[Any]:
    known = [v for v in values if v is not None]
    if known and len(known) == len(values) and all(isinstance(v, bool) for v in known):
        return np.array(values, dtype=bool)
    if known and all(isinstance(v, int) and not isinstance(v, bool) for v in known) and len(known) == len(values):
        return np.array(values, dtype=np.int64)
    if known and all(isinstance(v, int | float) and not isinstance(v, bool) for v in known):
        return np.array([math.nan if v is None else v for v in values], dtype=np.float64)
    return np.array([None if v is None else str(v) for v in values], dtype=object)


def _geojson(layers: Sequence[VectorLayer], words: MapWords) -> str:
    features = [
        {
            "type": "Feature",
            "geometry": mapping(_rounded(geometry)),
            "properties": {"layer": layer.name, **row},
        }
        for layer in layers
        for geometry, row in zip(layer.geometries, layer.rows, strict=True)
    ]
    document = {
        "type": "FeatureCollection",
        "name": words.title,
        "description": words.paragraph,
        "attribution": words.attribution,
        **words.pairs,
        "features": features,
    }
    return json.dumps(document, ensure_ascii=False, allow_nan=False)


def _rounded(geometry: BaseGeometry) -> BaseGeometry:
    rounded = shapely.transform(geometry, lambda p: np.round(p, _DEGREE_DIGITS))
    return shapely.orient_polygons(rounded) if "Polygon" in geometry.geom_type else rounded


def _kml(layers: Sequence[VectorLayer], words: MapWords) -> str:
    styles = "".join(
        f'<Style id="{name}"><LineStyle><color>{colour}</color><width>2</width></LineStyle>'
        f"<PolyStyle><fill>0</fill></PolyStyle>"  # many footprints, each a little tinted, would hide the map
        f"<IconStyle><color>{colour}</color><scale>0.6</scale></IconStyle></Style>\n"
        for name, colour in _COLOURS.items()
    )
    folders = "".join(
        f"<Folder><name>{escape(layer.name)}</name>\n"
        + "".join(_placemark(layer.name, g, row) for g, row in zip(layer.geometries, layer.rows, strict=True))
        + "</Folder>\n"
        for layer in layers
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n'
        f"<name>{_xml(words.title)}</name>\n<description>{_xml(words.paragraph)}</description>\n"
        f"{styles}{folders}</Document></kml>\n"
    )


def _placemark(layer: str, geometry: BaseGeometry, row: Mapping[str, Any]) -> str:
    name = row.get("name") or row.get("frame") or layer
    data = "".join(
        f'<Data name="{_xml(key)}"><value>{_xml(str(value))}</value></Data>'
        for key, value in row.items()
        if value is not None
    )
    return (
        f"<Placemark><name>{_xml(str(name))}</name><styleUrl>#{layer}</styleUrl>"
        f"<ExtendedData>{data}</ExtendedData>{_kml_geometry(geometry)}</Placemark>\n"
    )


def _kml_geometry(g: BaseGeometry) -> str:
    def line(coordinates: Any) -> str:
        return f"<coordinates>{' '.join(f'{x:.9f},{y:.9f}' for x, y in coordinates)}</coordinates>"

    if g.geom_type == "Point":
        return f"<Point>{line(g.coords)}</Point>"
    if g.geom_type == "LineString":
        return f"<LineString><tessellate>1</tessellate>{line(g.coords)}</LineString>"
    if g.geom_type == "Polygon":
        rings = [("outer", g.exterior), *(("inner", h) for h in g.interiors)]
        borders = "".join(f"<{n}BoundaryIs><LinearRing>{line(r.coords)}</LinearRing></{n}BoundaryIs>" for n, r in rings)
        return f"<Polygon><tessellate>1</tessellate>{borders}</Polygon>"
    return f"<MultiGeometry>{''.join(_kml_geometry(part) for part in g.geoms)}</MultiGeometry>"


def _xml(text: str) -> str:
    """Escape text, without the control characters that XML cannot hold."""
    return escape("".join(c for c in text if c in "\t\n" or ord(c) >= 32), {'"': "&quot;"})


def _check_text(temporary: Path, path: Path) -> None:
    try:
        if path.suffix.lower() == ".kml":
            ElementTree.parse(temporary)
        else:
            json.loads(temporary.read_text(encoding="utf-8"))
    except (ValueError, ElementTree.ParseError) as error:
        raise OutputError(f"{path} is damaged after writing ({error}); check the disk") from error


def _check_gpkg(temporary: Path, path: Path, layers: Sequence[VectorLayer]) -> None:
    try:
        for layer in layers:
            if pyogrio.read_info(temporary, layer=layer.name)["features"] != len(layer.geometries):
                raise OutputError(f"{path} is damaged after writing ({layer.name}); check the disk")
    except (DataSourceError, DataLayerError) as error:
        raise OutputError(f"{path} is damaged after writing ({error}); check the disk") from error
