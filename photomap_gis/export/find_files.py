"""Finds as the files that other programs open: GeoJSON, KML, GPX waypoints, Cursor-on-Target events."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import datetime
from enum import StrEnum
from xml.etree import ElementTree
from xml.sax.saxutils import escape

from photomap_gis.export.cot import cot_find, encode
from photomap_gis.export.finds import Find

_KML_COLOURS = {"intruder": "ff0000ff", "victim": "ff00aaff", "hazard": "ff00e5ff", "other": "ffff9933"}


class FindFormat(StrEnum):
    """The formats, by their suffixes."""

    GEOJSON = "geojson"
    KML = "kml"
    GPX = "gpx"
    COT = "cot"

    @property
    def mime(self) -> str:
        """The media type."""
        return {
            FindFormat.GEOJSON: "application/geo+json",
            FindFormat.KML: "application/vnd.google-earth.kml+xml",
            FindFormat.GPX: "application/gpx+xml",
            FindFormat.COT: "application/xml",
        }[self]


def finds_text(finds: Sequence[Find], wanted: FindFormat, *, title: str, now: datetime) -> str:
    """Return a file's text; none of it is empty where there are no finds.

    ``now`` is the moment from which Cursor-on-Target events hold; several stand in one ``events`` element.
    """
    if wanted is FindFormat.GEOJSON:
        return _geojson(finds, title)
    if wanted is FindFormat.KML:
        return _kml(finds, title)
    return _gpx(finds, title) if wanted is FindFormat.GPX else _cot(finds, now)


def _geojson(finds: Sequence[Find], title: str) -> str:
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [f.lon_deg, f.lat_deg]},
            "properties": {
                "name": f.name, "kind": f.kind or None, "note": f.remarks, "time_utc": f.time_utc, "ce90_m": f.ce90_m,
                "id": f.id or None,
            },
        }
        for f in finds
    ]  # fmt: skip
    document = {"type": "FeatureCollection", "name": title, "features": features}
    return json.dumps(document, ensure_ascii=False, allow_nan=False, indent=1)


def _kml(finds: Sequence[Find], title: str) -> str:
    styles = "".join(
        f'<Style id="{kind}"><IconStyle><color>{colour}</color></IconStyle></Style>\n'
        for kind, colour in _KML_COLOURS.items()
    )
    places = "".join(
        f"<Placemark><name>{_text(f.name)}</name><description>{_text(_words(f))}</description>"
        + (f"<TimeStamp><when>{_text(f.time_utc)}</when></TimeStamp>" if _is_time(f.time_utc) else "")
        + f"<styleUrl>#{f.kind if f.kind in _KML_COLOURS else 'other'}</styleUrl>"
        f"<Point><coordinates>{f.lon_deg:.8f},{f.lat_deg:.8f}</coordinates></Point></Placemark>\n"
        for f in finds
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n'
        f"<name>{_text(title)}</name>\n{styles}{places}</Document></kml>\n"
    )


def _gpx(finds: Sequence[Find], title: str) -> str:
    """GPX 1.1: the order of a waypoint's children is the schema's."""
    points = "".join(
        f'<wpt lat="{f.lat_deg:.8f}" lon="{f.lon_deg:.8f}">'
        + (f"<time>{_text(f.time_utc)}</time>" if _is_time(f.time_utc) else "")
        + f"<name>{_text(f.name)}</name><desc>{_text(_words(f))}</desc>"
        + (f"<type>{_text(f.kind)}</type>" if f.kind else "")
        + "</wpt>\n"
        for f in finds
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<gpx version="1.1" creator="photomap" xmlns="http://www.topografix.com/GPX/1/1">\n'
        f"<metadata><name>{_text(title)}</name></metadata>\n{points}</gpx>\n"
    )


def _cot(finds: Sequence[Find], now: datetime) -> str:
    root = ElementTree.Element("events")
    root.extend(ElementTree.fromstring(encode(cot_find(f), now)) for f in finds)  # our own words: nothing hostile
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _words(find: Find) -> str:
    """Return what is known of a find in one line."""
    lines = [
        find.kind.capitalize() if find.kind else "",
        find.remarks,
        f"seen {find.time_utc}" if find.time_utc else "",
        "" if find.ce90_m is None else f"CE90 {find.ce90_m:.1f} m",
    ]
    return "; ".join(line for line in lines if line)


def _is_time(text: str | None) -> bool:
    try:
        return datetime.fromisoformat((text or "").replace("Z", "+00:00")).tzinfo is not None
    except ValueError:
        return False


def _clean(text: str | None) -> str:
    """Leave out the control characters that XML cannot hold."""
    return "".join(c for c in text or "" if c in "\t\n" or (32 <= ord(c) < 0xD800) or (0xDFFF < ord(c) < 0xFFFE)
                   or ord(c) > 0xFFFF)  # fmt: skip


def _text(text: str | None) -> str:
    return escape(_clean(text), {'"': "&quot;"})
