"""Flight logs as tables: Airdata, Litchi, Flytrex, DJI record exports, and whatever people type themselves."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path
from statistics import median

import numpy as np

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import Attitude
from photomap_gis.ingest.telemetry.clean import clean_points, clean_triggers
from photomap_gis.ingest.telemetry.columns import Column, Quantity, understand
from photomap_gis.ingest.telemetry.rotations import (
    BODY_SIGMA_TILT_RAD,
    attitudes_of_quaternions,
    belly_camera,
    quaternions_of_euler,
)
from photomap_gis.ingest.telemetry.text import read_text, unix_s, unix_s_of_iso
from photomap_gis.ingest.telemetry.track import Clock, Track, TrackPoint, Trigger

_MAX_ROWS = 3_000_000
_HEADER_WITHIN_LINES = 60
_DELIMITERS = (",", ";", "\t", "|")
_FIRST_UNIX_S = 1e8
_HEADING_ONLY_SIGMA_TILT_RAD = math.radians(10.0)

_LOOSE_DATE = re.compile(
    r"(\d{1,4})[-/.](\d{1,2})[-/.](\d{1,4})[ T]+"
    r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d{1,9})?))?\s*([AaPp][Mm])?\s*(Z|UTC)?"
)

Rows = list[list[str]]


def looks_like_table(head: str) -> bool:
    """Whether the beginning of a text holds a header with a latitude and a longitude."""
    return _find_header(head.split("\n")[:_HEADER_WITHIN_LINES]) is not None


def read_table(path: Path) -> Track:
    """Return the track of a CSV file; units come from its header, the clock from what its times look like."""
    lines = read_text(path).split("\n")
    found = _find_header(lines[:_HEADER_WITHIN_LINES])
    if found is None:
        raise DataError(f"{path}: no columns for latitude and longitude; name them lat and lon in the first line")
    start, delimiter, columns = found
    rows = _rows(lines[start + 1 :], delimiter)
    number = _Numbers(rows, decimal_comma=delimiter == ";")
    times_s, clock = _times(number, columns, path)
    lat, lon = number.of(columns[Quantity.LAT]), number.of(columns[Quantity.LON])
    attitudes = _attitudes(number, columns, len(rows))
    values = {q: number.of(columns[q]) for q in columns if q in _PLAIN}
    points = [
        TrackPoint(
            float(times_s[i]),
            float(lat[i]),
            float(lon[i]),
            attitude=attitudes[i],
            **{_PLAIN[q]: float(v[i]) for q, v in values.items() if math.isfinite(v[i])},
        )
        for i in range(len(rows))
    ]
    clean, dropped = clean_points(points)
    warnings = [f"{path.name}: {w}" for w in dropped]
    if not clean:
        raise DataError(f"{path}: none of its {len(rows)} rows holds a time and a position; export the log again")
    if len(rows) == _MAX_ROWS:
        warnings.append(f"{path.name}: only the first {_MAX_ROWS} rows are used")
    triggers = _triggers(number, columns, points)
    return Track(clean, clock, str(path), triggers=triggers, warnings=tuple(warnings))


_PLAIN = {
    Quantity.ALT: "alt_m",
    Quantity.HEIGHT: "height_m",
    Quantity.SIGMA: "sigma_m",
    Quantity.FOCAL_35MM: "focal_35mm",
    Quantity.HFOV: "hfov_rad",
}


class _Numbers:
    """The rows' cells as numbers, one column at a time; NaN where a cell holds none."""

    def __init__(self, rows: Rows, *, decimal_comma: bool) -> None:
        self.rows = rows
        self.decimal_comma = decimal_comma

    def of(self, column: Column) -> np.ndarray:
        """``(N,)`` values in SI units."""
        return np.array([self._number(c) for c in self.text(column)], dtype=np.float64) * column.factor

    def text(self, column: Column) -> list[str]:
        """Return the cells as written; empty where a row is too short."""
        i = column.index
        return [row[i].strip() if i < len(row) else "" for row in self.rows]

    def _number(self, cell: str) -> float:
        if not cell:
            return math.nan
        if self.decimal_comma:
            cell = cell.replace(",", ".")
        try:
            return float(cell)
        except ValueError:
            match = re.match(r"[-+]?\d{1,12}(\.\d{0,12})?", cell)  # "12.3 m", "45.1°"
            return float(match.group(0)) if match else math.nan


def _find_header(lines: list[str]) -> tuple[int, str, dict[Quantity, Column]] | None:
    """Return the header's line, the delimiter and what the columns mean."""
    for i, line in enumerate(lines):
        if len(line) > 100_000:
            continue
        for delimiter in sorted(_DELIMITERS, key=lambda d: -line.count(d)):
            cells = next(iter(_rows([line.lstrip("#/ ")], delimiter)), [])
            columns = understand(cells)
            if Quantity.LAT in columns and Quantity.LON in columns and len(cells) >= 3:
                return i, delimiter, columns
    return None


def _rows(lines: list[str], delimiter: str) -> Rows:
    rows: Rows = []
    try:
        for row in csv.reader(lines, delimiter=delimiter):
            if row and not row[0].startswith("#") and any(row):
                rows.append(row)
                if len(rows) == _MAX_ROWS:
                    break
    except csv.Error:
        pass  # a cell of more than 128 kB: what came before is used
    return rows


def _attitudes(number: _Numbers, columns: dict[Quantity, Column], count: int) -> list[Attitude | None]:
    """Return the camera's attitude per row, from the gimbal's columns or else the vehicle's."""

    def radians(quantity: Quantity) -> np.ndarray | None:
        if quantity not in columns:
            return None
        values = number.of(columns[quantity])
        return values if np.isfinite(values).any() else None

    yaw, pitch, roll = radians(Quantity.YAW), radians(Quantity.PITCH), radians(Quantity.ROLL)
    gimbal_yaw, gimbal_pitch = radians(Quantity.GIMBAL_YAW), radians(Quantity.GIMBAL_PITCH)
    gimbal_roll = radians(Quantity.GIMBAL_ROLL)
    if gimbal_yaw is None or not np.nan_to_num(gimbal_yaw).any():
        gimbal_yaw = yaw  # most gimbals follow the nose
    level = np.zeros(count)
    # A gimbal that is exactly zero throughout was not connected: such columns say nothing.
    if gimbal_pitch is not None and np.nan_to_num(gimbal_pitch).any() and gimbal_yaw is not None:
        return attitudes_of_quaternions(
            quaternions_of_euler(gimbal_yaw, gimbal_pitch, level if gimbal_roll is None else gimbal_roll)
        )
    if yaw is None:
        return [None] * count
    if pitch is None or roll is None:
        down = belly_camera(quaternions_of_euler(yaw, level, level))
        return attitudes_of_quaternions(down, sigma_tilt_rad=_HEADING_ONLY_SIGMA_TILT_RAD)
    if float(np.nanmedian(pitch)) < math.radians(-45.0):  # no vehicle flies so: these are a camera's angles
        return attitudes_of_quaternions(quaternions_of_euler(yaw, pitch, roll))
    body = belly_camera(quaternions_of_euler(yaw, pitch, roll))
    return attitudes_of_quaternions(body, sigma_tilt_rad=BODY_SIGMA_TILT_RAD)


def _triggers(number: _Numbers, columns: dict[Quantity, Column], points: list[TrackPoint]) -> tuple[Trigger, ...]:
    """Return the rows at which a column of photos begins to say yes."""
    if Quantity.PHOTO not in columns:
        return ()
    on = [c.lower() in ("1", "1.0", "true", "yes") for c in number.text(columns[Quantity.PHOTO])]
    shots = [p for p, now, before in zip(points, on, [False, *on], strict=False) if now and not before]
    return clean_triggers(
        Trigger(p.time_s, i, p.lat_deg, p.lon_deg, p.alt_m, p.height_m, p.attitude) for i, p in enumerate(shots)
    )


def _times(number: _Numbers, columns: dict[Quantity, Column], path: Path) -> tuple[np.ndarray, Clock]:
    """``(N,)`` times and their clock: the most absolute clock that the columns give."""
    elapsed = _elapsed(number, columns)
    for quantity in (Quantity.STAMP, Quantity.STAMP_LOCAL):
        if quantity in columns:
            stamps, is_utc = _stamps(number, columns[quantity])
            if _mostly(stamps):
                return _sharpened(stamps, elapsed), Clock.UTC if is_utc else Clock.LOCAL
    if Quantity.DATE in columns and Quantity.TIME_OF_DAY in columns:
        date, clock = columns[Quantity.DATE], columns[Quantity.TIME_OF_DAY]
        joined = [f"{d} {t}" for d, t in zip(number.text(date), number.text(clock), strict=True)]
        moments = [_moment(cell) for cell in joined]
        stamps = np.array([m[0] if m else math.nan for m in moments], dtype=np.float64)
        if _mostly(stamps):
            return _sharpened(stamps, elapsed), Clock.UTC if date.names_utc or clock.names_utc else Clock.LOCAL
    if elapsed is not None:
        return elapsed, Clock.VIDEO
    raise DataError(f"{path}: no column of times is understood; name it time (ISO 8601, Unix seconds, or seconds)")


def _mostly(values: np.ndarray) -> bool:
    return bool(len(values)) and bool(np.isfinite(values).mean() >= 0.5)


def _elapsed(number: _Numbers, columns: dict[Quantity, Column]) -> np.ndarray | None:
    if Quantity.ELAPSED not in columns:
        return None
    seconds = number.of(columns[Quantity.ELAPSED])
    return seconds if _mostly(seconds) and float(np.nanmax(np.abs(seconds))) < _FIRST_UNIX_S else None


def _stamps(number: _Numbers, column: Column) -> tuple[np.ndarray, bool]:
    """``(N,)`` Unix seconds of a column of dates or Unix times; also whether they are known to be UTC."""
    cells = number.text(column)
    is_number = np.array([_is_number(c) for c in cells], dtype=bool)
    if len(cells) and is_number.mean() > 0.5:
        values = np.where(is_number, number.of(column), np.nan)
        size = float(np.nanmedian(values))
        scale = next((s for limit, s in ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3)) if size > limit), 1.0)
        seconds = values * scale
        return np.where((seconds > _FIRST_UNIX_S) & (seconds < 1e11), seconds, np.nan), True
    moments = [_moment(c) for c in cells]
    zones = [m[1] for m in moments if m]
    stamps = np.array([m[0] if m else math.nan for m in moments], dtype=np.float64)
    return stamps, column.names_utc or (bool(zones) and all(zones))


def _is_number(cell: str) -> bool:
    return re.fullmatch(r"[-+]?\d{1,20}([.,]\d{0,12})?([eE][-+]?\d{1,2})?", cell) is not None


def _moment(cell: str) -> tuple[float, bool] | None:
    """Read ISO 8601 and its looser cousins, ``9/30/2022 1:37:23.45 PM`` (month first unless it can't be) among them."""
    iso = unix_s_of_iso(cell)
    if iso is not None:
        return iso
    loose = _LOOSE_DATE.fullmatch(cell.strip())
    if loose is None:
        return None
    a, b, c, hour, minute, second, half, zone = loose.groups()
    year, month, day = (a, b, c) if len(a) == 4 else (c, b, a) if int(a) > 12 else (c, a, b)
    hours = int(hour) % 12 + (12 if half.lower() == "pm" else 0) if half else int(hour)
    moment = unix_s(int(year), int(month), int(day), hours, int(minute), float((second or "0").replace(",", ".")))
    return None if moment is None else (moment, zone is not None)


def _sharpened(stamps: np.ndarray, elapsed: np.ndarray | None) -> np.ndarray:
    """Join a coarse wall clock (whole seconds) with a fine running one, where both are there.

    A stamp cut to whole seconds is at most a second too early: the wall clock's zero lies in the interval that all rows
    allow, its middle is taken.
    """
    both = np.isfinite(stamps) & (np.isfinite(elapsed) if elapsed is not None else False)
    if elapsed is None or both.sum() < 2:
        return stamps
    offsets = (stamps - elapsed)[both]
    whole_seconds = bool(np.all(np.abs(stamps[both] - np.round(stamps[both])) < 1e-6))
    if float(np.ptp(offsets)) > 2.0:  # the clocks do not run together: trust the wall clock
        return stamps
    low, high = float(offsets.max()), float(offsets.min()) + 1.0
    offset = (low + high) / 2.0 if whole_seconds and high > low else median(offsets.tolist())
    return elapsed + offset
