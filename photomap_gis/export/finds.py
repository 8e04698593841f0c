"""Finds: places on the map that somebody or something pointed out, read from any vector file of points."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from pyogrio.errors import DataLayerError, DataSourceError, FieldError, GeometryError

from photomap_gis.core.errors import DataError
from photomap_gis.export.crs import WGS84, point_map

_MAX_BYTES = 50 << 20
_MAX_FINDS = 10_000
_POINT = int(shapely.GeometryType.POINT)


@dataclass(frozen=True, slots=True)
class Find:
    """A place in WGS84 degrees; ``ce90_m`` is within how many metres it lies with a chance of 90 %, if known."""

    name: str
    lon_deg: float
    lat_deg: float
    ce90_m: float | None = None
    time_utc: str | None = None
    remarks: str = ""
    kind: str = ""
    id: str = ""


def read_finds(path: Path, *, may_be_none: bool = False) -> tuple[Find, ...]:
    """Return the points of a vector file (GeoJSON, GPKG, KML, SHP; any CRS); ``DataError`` where it has none.

    Fields ``name``, ``ce90_m`` (or ``ce90``, ``ce``), ``time`` (or ``time_utc``), ``remarks`` (or ``description``),
    ``kind`` and ``id`` are taken where they are there, in any case of letters. ``may_be_none`` takes a file without
    points for what it is: nothing was found, or nothing that has a place on Earth.
    """
    if not path.is_file():
        raise DataError(f"{path} cannot be read: no such file; name one with points (GeoJSON, GPKG, KML, SHP)")
    if path.stat().st_size > _MAX_BYTES:
        raise DataError(f"{path} is larger than a list of finds can be ({_MAX_BYTES >> 20} MB)")
    with path.open("rb") as file:
        if b"<OGRVRT" in file.read(4096):
            raise DataError(f"{path} only refers to other files: name the file with the points itself")
    finds: list[Find] = []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pyogrio warns of Z values, which nobody reads here
            for layer, kind in pyogrio.list_layers(path):
                if kind is not None:
                    finds += _finds_of(path, layer, len(finds))
    except (DataSourceError, DataLayerError, FieldError, GeometryError, shapely.errors.ShapelyError) as error:
        reason = " ".join(str(error).split(";")[0].split())
        raise DataError(f"{path} cannot be read ({reason}); name a GeoJSON, GPKG, KML or SHP with points") from error
    if not finds and not may_be_none:
        raise DataError(f"{path} holds no point: finds are points")
    return tuple(finds)


def _finds_of(path: Path, layer: str, known: int) -> list[Find]:
    meta, _, wkb, columns = pyogrio.raw.read(path, layer=layer, max_features=_MAX_FINDS, datetime_as_string=True)
    fields = {str(name).lower(): values for name, values in zip(meta["fields"], columns, strict=True)}
    geometries = shapely.force_2d(shapely.from_wkb(wkb))
    rows = np.flatnonzero((shapely.get_type_id(geometries) == _POINT) & ~shapely.is_empty(geometries)).tolist()
    if not rows:
        return []
    xy = shapely.get_coordinates(geometries[rows])
    lon_lat = point_map(meta["crs"] or WGS84, WGS84, around_xy=xy)(xy)
    return [
        Find(
            _text(fields, i, "name") or f"find {known + n + 1}",
            float(lon_lat[n, 0]),
            float(lon_lat[n, 1]),
            _number(fields, i, "ce90_m", "ce90", "ce"),
            _text(fields, i, "time_utc", "time") or None,
            _text(fields, i, "remarks", "description"),
            _text(fields, i, "kind"),
            _text(fields, i, "id"),
        )
        for n, i in enumerate(rows)
        if np.isfinite(lon_lat[n]).all()
    ]


def _text(fields: Mapping[str, Any], row: int, *names: str) -> str:
    for name in names:
        if name in fields and fields[name][row] is not None and str(fields[name][row]) not in ("nan", "NaT"):
            return str(fields[name][row])
    return ""


def _number(fields: Mapping[str, Any], row: int, *names: str) -> float | None:
    try:
        value = float(_text(fields, row, *names))
    except ValueError:
        return None
    return value if math.isfinite(value) and value >= 0 else None
