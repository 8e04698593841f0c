"""GPX tracks: from a logger in the drone, a phone beside it, or another program's export."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import iterparse

from photomap_gis.core.errors import DataError
from photomap_gis.ingest.telemetry.clean import clean_points
from photomap_gis.ingest.telemetry.text import MAX_TEXT_BYTES, unix_s_of_iso
from photomap_gis.ingest.telemetry.track import Clock, Track, TrackPoint

_POINTS = ("trkpt", "rtept", "wpt")


def read_gpx(path: Path) -> Track:
    """Return the timed points of a GPX file; a file that ends too early gives what it holds and a warning."""
    try:
        if path.stat().st_size > MAX_TEXT_BYTES:
            raise DataError(f"{path}: too big for a GPX track; cut out the flight you need")
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error}); check the path and its rights") from error
    points: dict[str, list[TrackPoint]] = {kind: [] for kind in _POINTS}
    untimed = 0
    warnings = []
    try:
        for kind, point in _points(data):
            if point is None:
                untimed += 1
            else:
                points[kind].append(point)
    except DefusedXmlException as error:
        raise DataError(f"{path}: this XML declares entities, which no GPX needs; export the track again") from error
    except ParseError as error:
        if not any(points.values()):
            raise DataError(f"{path}: not a readable GPX file ({error}); export the track again") from error
        warnings.append(f"{path.name}: the file is damaged or cut short ({error}); what came before is used")
    best = next((points[kind] for kind in _POINTS if points[kind]), [])
    clean, dropped = clean_points(best)
    if not clean:
        why = f"its {untimed} points carry no time" if untimed else "it holds no track points"
        raise DataError(f"{path}: {why}; export the track with times")
    if untimed:
        warnings.append(f"{path.name}: {untimed} points without a time were left out")
    warnings += [f"{path.name}: {w}" for w in dropped]
    return Track(clean, Clock.UTC, str(path), warnings=tuple(warnings))


def _points(data: bytes) -> Iterator[tuple[str, TrackPoint | None]]:
    """Yield every point as it is read, with its kind; ``None`` for one without a time."""
    for _, element in iterparse(io.BytesIO(data), events=("end",), forbid_dtd=False):
        kind = _local_name(element)
        if kind in _POINTS:
            yield kind, _point(element)
            element.clear()


def _point(element: Element) -> TrackPoint | None:
    texts = {_local_name(child): (child.text or "").strip() for child in element}
    moment = unix_s_of_iso(texts.get("time", ""))
    if moment is None:
        return None
    return TrackPoint(
        moment[0],  # GPX times are UTC by definition, also where the Z was forgotten
        _number(element.get("lat")),
        _number(element.get("lon")),
        alt_m=_number(texts.get("ele")) if texts.get("ele") else None,
    )


def _local_name(element: Element) -> str:
    return str(element.tag).rsplit("}", 1)[-1].lower()


def _number(text: str | None) -> float:
    try:
        return float(text) if text else float("nan")
    except ValueError:
        return float("nan")
