"""Ground control files: ODM's ``gcp_list.txt`` and CSV with a header.

``gcp_list.txt``: the first line names the CRS (``EPSG:32632``, ``WGS84 UTM 32N``, a PROJ string); then one observation
a line, ``x y z px py image [name]``, x east (longitude) and y north (latitude). Lines of one place are one point.

CSV: a header with ``name``, ``lat``/``lon`` or ``x``/``y`` (with ``crs``, or the CRS given beside the file), and
optional ``z``, ``sigma_m``, ``image``, ``px``, ``py``, ``sigma_px``. One line each;
lines without image give a place alone.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from photomap_gis.core.control import CLICK_SIGMA_PX, CONTROL_SIGMA_M, ControlPoint, Sighting, is_coordinate
from photomap_gis.core.errors import DataError
from photomap_gis.ingest.telemetry.text import decode_text

MAX_BYTES = 32 * 1024 * 1024
WGS84 = "EPSG:4326"

_COLUMNS: Mapping[str, tuple[str, ...]] = {
    "name": ("name", "id", "label", "point", "gcp", "marker"),
    "lat": ("lat", "latitude", "lat_deg"),
    "lon": ("lon", "lng", "long", "longitude", "lon_deg"),
    "x": ("x", "e", "east", "easting", "x_m", "easting_m"),
    "y": ("y", "n", "north", "northing", "y_m", "northing_m"),
    "z": ("z", "h", "alt", "altitude", "height", "elevation", "z_m"),
    "crs": ("crs", "epsg", "srs"),
    "sigma": ("sigma_m", "sigma", "accuracy_m", "accuracy"),
    "image": ("image", "img", "photo", "file", "filename", "frame"),
    "sigma_px": ("sigma_px", "click_sigma_px"),
    "px": ("px", "pixel_x", "col", "x_px", "image_x", "im_x"),
    "py": ("py", "pixel_y", "row", "y_px", "image_y", "im_y"),
}


def read_control(path: Path, *, crs: str | None = None) -> tuple[str, tuple[ControlPoint, ...]]:
    """Return a control file's text and its points; ``DataError`` where it cannot be read or understood."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise DataError(f"{path}: {path.stat().st_size / 1e6:.0f} MB is too big for a list of control points")
        text = decode_text(path.read_bytes())
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error}); check the path and its rights") from error
    return text, parse_control(text, path.name, crs=crs)


def parse_control(text: str, file: str, *, crs: str | None = None) -> tuple[ControlPoint, ...]:
    """Return the points of a control file's text, in their order; ``file`` names it in errors."""
    lines = [(n, line.strip()) for n, line in enumerate(text.split("\n"), start=1)]
    lines = [(n, line) for n, line in lines if line and not line.startswith("#")]
    if not lines:
        raise DataError(
            f"{file}: is empty; give ODM's gcp_list.txt, or a CSV with a header (name, lat, lon, image, px, py)"
        )
    gathered = _Gathered(file)
    delimiter = next((d for d in (",", ";", "\t") if d in lines[0][1]), None)
    header = [cell.strip().strip('"').lower() for cell in lines[0][1].split(delimiter)] if delimiter else []
    columns = {
        k: header.index(spelling) for k, names in _COLUMNS.items() for spelling in names[::-1] if spelling in header
    }
    if delimiter and ({"lat", "lon"} <= columns.keys() or {"x", "y"} <= columns.keys()):
        _read_csv(lines[1:], delimiter, columns, gathered, crs)
    else:
        _read_list(lines, gathered, crs)
    points = gathered.points()
    if not points:
        raise DataError(f"{file}: there is no control point in it, only its first line")
    return points


@dataclass
class _Point:
    """One point while its lines are gathered."""

    line: int
    crs: str
    x: float
    y: float
    z_m: float | None
    sigma_m: float
    sightings: list[Sighting] = field(default_factory=list)


class _Gathered:
    """A builder of control points from lines: one owner, ``points`` hands them out."""

    def __init__(self, file: str) -> None:
        self.file = file
        self._points: dict[str, _Point] = {}
        self._names: dict[tuple[str, float, float], str] = {}

    def wrong(self, line: int, what: str) -> DataError:
        """Return the error of one line."""
        return DataError(f"{self.file}, line {line}: {what}")

    def number(self, line: int, text: str, what: str) -> float:
        """Return a coordinate."""
        try:
            value = float(text)
        except ValueError:
            raise self.wrong(line, f"{what} is no number: '{text[:40]}'") from None
        if not is_coordinate(value):
            raise self.wrong(line, f"{what} is no coordinate: '{text[:40]}'")
        return value

    def name_at(self, line: int, crs: str, x: float, y: float) -> str:
        """Return the name of the unnamed point at a place."""
        return self._names.setdefault((crs, x, y), f"point-{len(self._names) + 1}")

    def add(self, name: str, point: _Point, sighting: Sighting | None) -> None:
        """Add a line."""
        if point.crs == WGS84 and not (abs(point.y) <= 90.0 and abs(point.x) <= 360.0):
            raise self.wrong(point.line, f"latitude {point.y:g}, longitude {point.x:g} is no place on Earth")
        known = self._points.setdefault(name, point)
        if (known.crs, known.x, known.y) != (point.crs, point.x, point.y):
            raise self.wrong(
                point.line, f"point {name} lies elsewhere than in line {known.line}: one name is one place"
            )
        if sighting is None:
            return
        if any(s.image == sighting.image and s.xy_px != sighting.xy_px for s in known.sightings):
            raise self.wrong(point.line, f"point {name} is marked twice in {sighting.image}, at different pixels")
        if sighting not in known.sightings:
            known.sightings.append(sighting)

    def points(self) -> tuple[ControlPoint, ...]:
        """Return what was gathered."""
        return tuple(
            ControlPoint(name, p.crs, p.x, p.y, p.z_m, p.sigma_m, tuple(p.sightings))
            for name, p in self._points.items()
        )


def _read_list(lines: list[tuple[int, str]], gathered: _Gathered, crs: str | None) -> None:
    """Gather the lines of a ``gcp_list.txt``."""
    number, first = lines[0]
    if not _is_observation(first):
        crs, lines = _crs_of_header(first), lines[1:]
    if crs is None:
        raise gathered.wrong(number, "the first line must name the CRS: EPSG:32632, WGS84 UTM 32N, or a PROJ string")
    for n, line in lines:
        cells = line.split()
        if len(cells) < 6:
            raise gathered.wrong(n, f"expected 'x y z px py image [name]', found {len(cells)} of 6 fields")
        x, y, z, px, py = (gathered.number(n, c, w) for c, w in zip(cells, ("x", "y", "z", "px", "py"), strict=False))
        if crs == WGS84 and abs(y) > 90.0 >= abs(x):
            raise gathered.wrong(n, "x must be the longitude and y the latitude: they seem to be swapped")
        name = cells[6] if len(cells) > 6 else gathered.name_at(n, crs, x, y)
        gathered.add(name, _Point(n, crs, x, y, z, CONTROL_SIGMA_M), Sighting(_plain(cells[5]), (px, py)))


def _is_observation(line: str) -> bool:
    cells = line.split()
    try:
        return len(cells) >= 6 and all(map(is_coordinate, map(float, cells[:5])))
    except ValueError:
        return False


def _crs_of_header(line: str) -> str:
    """Return the CRS that the first line of a ``gcp_list.txt`` names, as pyproj takes it."""
    utm = re.fullmatch(r"WGS\s*84\s+UTM\s+(?:zone\s+)?(\d{1,2})\s*([NS])(?:orth|outh)?", line, re.IGNORECASE)
    if utm and 1 <= int(utm[1]) <= 60:
        return f"EPSG:{(32600 if utm[2].upper() == 'N' else 32700) + int(utm[1])}"
    if re.fullmatch(r"\d{4,6}", line):
        return f"EPSG:{line}"
    if line.upper().replace(" ", "") in ("WGS84", "EPSG:4326"):
        return WGS84
    return line


def _read_csv(
    lines: list[tuple[int, str]], delimiter: str, columns: Mapping[str, int], gathered: _Gathered, crs: str | None
) -> None:
    """Gather the lines of a table."""
    for n, line in lines:
        row = _Row(n, next(csv.reader([line], delimiter=delimiter)), columns, gathered, delimiter != ",")
        if {"lat", "lon"} <= columns.keys():
            where, x, y = WGS84, row.number("lon"), row.number("lat")
        else:
            written = row.text("crs") or crs
            if not written:
                raise gathered.wrong(n, "x and y need a CRS: add a column crs (EPSG:25832), or use lat and lon")
            where, x, y = _crs_of_header(written), row.number("x"), row.number("y")
        z = row.number("z") if row.text("z") else None
        sigma = row.number("sigma") if row.text("sigma") else CONTROL_SIGMA_M
        if sigma <= 0.0:
            raise gathered.wrong(n, f"sigma must be above 0, got {sigma:g}")
        sighting = None
        if row.text("image"):
            if not (row.text("px") and row.text("py")):
                raise gathered.wrong(n, "an image needs px and py: where in it the point is seen")
            click = row.number("sigma_px") if row.text("sigma_px") else CLICK_SIGMA_PX
            if click <= 0.0:
                raise gathered.wrong(n, f"sigma_px must be above 0, got {click:g}")
            sighting = Sighting(_plain(row.text("image")), (row.number("px"), row.number("py")), click)
        name = row.text("name") or gathered.name_at(n, where, x, y)
        gathered.add(name, _Point(n, where, x, y, z, sigma), sighting)


@dataclass(frozen=True, slots=True)
class _Row:
    """A line of a table, asked by what its columns hold."""

    line: int
    cells: list[str]
    columns: Mapping[str, int]
    gathered: _Gathered
    decimal_comma: bool

    def text(self, key: str) -> str:
        """Return a cell, empty where there is none."""
        column = self.columns.get(key, len(self.cells))
        return self.cells[column].strip() if column < len(self.cells) else ""

    def number(self, key: str) -> float:
        """Return a cell as a coordinate."""
        text = self.text(key)
        return self.gathered.number(self.line, text.replace(",", ".") if self.decimal_comma else text, key)


def _plain(path: str) -> str:
    """Return a path of any system with forward slashes."""
    return path.replace("\\", "/")
