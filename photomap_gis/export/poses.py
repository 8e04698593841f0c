"""One row per input frame: where it lies on the map, how sure that is, and what became of it."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from photomap_gis.core.errors import OutputError, UsageError
from photomap_gis.core.frame import FrameRef, FrameStatus
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.export.crs import WGS84, crs_label, needs_place, point_map
from photomap_gis.export.publish import file_in_place_of

_GEOJSON_SUFFIXES = (".geojson", ".json")
_DEGREE_DIGITS = 9  # a tenth of a millimetre


@dataclass(frozen=True, slots=True)
class PoseRow:
    """What is known of one frame; ``None`` is an empty cell.

    Easting and northing are of the ground at the raster's centre, in ``crs`` (``local`` for a map without a place on
    Earth: then in the map's units). ``heading_deg`` is that of the image's upper edge, clockwise from grid north.
    """

    frame: str
    source: str
    time_utc: str | None = None
    easting_m: float | None = None
    northing_m: float | None = None
    crs: str | None = None
    heading_deg: float | None = None
    gsd_m_per_px: float | None = None
    sigma_e_m: float | None = None
    sigma_n_m: float | None = None
    status: str = FrameStatus.UNPLACED.value
    reason: str | None = None
    segment: int | None = None
    method: str | None = None


COLUMNS = tuple(f.name for f in fields(PoseRow))
_DIGITS = {
    "easting_m": 4, "northing_m": 4, "heading_deg": 4, "gsd_m_per_px": 8, "sigma_e_m": 4, "sigma_n_m": 4,
}  # fmt: skip


def pose_rows(
    frames: Iterable[FrameRef],
    trajectory: Trajectory,
    map_frame: MapFrame,
    statuses: Mapping[int, FrameStatus] | None = None,
    reasons: Mapping[int, str] | None = None,
) -> list[PoseRow]:
    """Return one row per input frame, in their order.

    ``statuses`` and ``reasons`` are by frame index; where they say nothing, a placed frame has its placement's status,
    an unreadable one is an error frame, any other is unplaced.
    """
    placed = {p.frame: p for p in trajectory.placements}
    statuses, reasons = statuses or {}, reasons or {}
    label = crs_label(map_frame.crs_wkt)
    rows = []
    for ref in frames:
        placement = placed.get(ref.index)
        status = statuses.get(ref.index) or (
            placement.status
            if placement is not None
            else FrameStatus.ERROR_FRAME
            if ref.problem is not None
            else FrameStatus.UNPLACED
        )
        known = {} if placement is None else _place(placement, map_frame, label)
        rows.append(
            PoseRow(
                frame=ref.name,
                source=ref.source,
                time_utc=utc_text(ref.time_s),
                status=FrameStatus(status).value,
                reason=reasons.get(ref.index) or ref.problem,
                **known,
            )
        )
    return rows


def write_poses(rows: Sequence[PoseRow], path: Path | str, *, crs_wkt: str | None = None) -> None:
    """Write the rows as CSV (``.csv``) or as GeoJSON (``.geojson``, ``.json``: points in WGS84, RFC 7946).

    GeoJSON holds frames without a place as features without geometry. It has only one CRS, so a local map is refused.
    ``crs_wkt`` is the map's CRS where the rows' ``crs`` names one that no authority knows.
    """
    path = Path(path).absolute()
    if path.suffix.lower() in _GEOJSON_SUFFIXES:
        document = _geojson(rows, crs_wkt)  # before any file is touched: a local map is refused
        with file_in_place_of(path, lambda p: _check_geojson(p, path, len(rows))) as temporary:
            text = json.dumps(document, ensure_ascii=False, allow_nan=False, indent=1)
            temporary.write_text(text, encoding="utf-8")
        return
    if path.suffix.lower() != ".csv":
        raise UsageError(f"{path.name} must end in .csv or .geojson")
    with (
        file_in_place_of(path, lambda p: _check_csv(p, path, len(rows))) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows([_cell(row, column) for column in COLUMNS] for row in rows)


def utc_text(time_s: float | None) -> str | None:
    """Return ISO 8601 with milliseconds and Z of Unix seconds, ``None`` where the time is unknown or no date."""
    if time_s is None or not math.isfinite(time_s):
        return None
    try:
        moment = datetime.fromtimestamp(round(time_s * 1000) / 1000, tz=UTC)
    except (OverflowError, ValueError, OSError):
        return None
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _place(placement: FramePlacement, map_frame: MapFrame, label: str) -> dict[str, Any]:
    known: dict[str, Any] = {"segment": placement.segment, "method": placement.method}
    xy = placement.centre_xy_map_m
    if not np.isfinite(xy).all():  # the centre looks above the horizon
        return known
    easting, northing = (float(v) for v in map_frame.to_crs(xy))
    variance = np.diag(placement.position_covariance_m2()[0])
    sigma_e, sigma_n = (math.sqrt(v) if math.isfinite(v) and v >= 0 else None for v in variance.tolist())
    return known | {
        "easting_m": easting,
        "northing_m": northing,
        "crs": label,
        "heading_deg": _finite(math.degrees(placement.heading_rad) % 360.0),
        "gsd_m_per_px": _finite(placement.gsd_m_per_px),
        "sigma_e_m": sigma_e,
        "sigma_n_m": sigma_n,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _cell(row: PoseRow, column: str) -> str:
    value = getattr(row, column)
    if value is None:
        return ""
    if column in _DIGITS:
        return f"{value:.{_DIGITS[column]}f}"
    # A row is a line: words that came from elsewhere must not break it.
    return " ".join(str(value).split()) if column in ("reason", "method") else str(value)


def _geojson(rows: Sequence[PoseRow], crs_wkt: str | None) -> dict[str, Any]:
    placed = [r for r in rows if r.easting_m is not None and r.northing_m is not None]
    degrees: dict[int, list[float]] = {}
    if placed:
        labels = {r.crs for r in placed}
        if crs_wkt is None and "local" in labels:
            needs_place(None, "GeoJSON")
        if len(labels) != 1:
            raise ValueError(f"rows must share one crs, got {sorted(map(str, labels))}")
        en = np.array([[r.easting_m, r.northing_m] for r in placed], dtype=np.float64)
        lon_lat = point_map(crs_wkt or str(placed[0].crs), WGS84, around_xy=en)(en)
        degrees = {id(r): [round(float(v), _DEGREE_DIGITS) for v in p] for r, p in zip(placed, lon_lat, strict=True)}
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": degrees[id(r)]} if id(r) in degrees else None,
            "properties": {column: _property(r, column) for column in COLUMNS},
        }
        for r in rows
    ]
    return {"type": "FeatureCollection", "features": features}


def _property(row: PoseRow, column: str) -> Any:
    value = getattr(row, column)
    return round(value, _DIGITS[column]) if column in _DIGITS and value is not None else value


def _check_csv(temporary: Path, path: Path, count: int) -> None:
    with temporary.open(encoding="utf-8", newline="") as file:
        found = sum(1 for _ in csv.reader(file)) - 1
    if found != count:
        raise OutputError(f"{path} is damaged after writing ({found} of {count} rows); check the disk")


def _check_geojson(temporary: Path, path: Path, count: int) -> None:
    try:
        found = len(json.loads(temporary.read_text(encoding="utf-8"))["features"])
    except ValueError as error:
        raise OutputError(f"{path} is damaged after writing ({error}); check the disk") from error
    if found != count:
        raise OutputError(f"{path} is damaged after writing ({found} of {count} rows); check the disk")
