"""An ATAK data package: one file that a team's phones import, with the map, its outline and the finds.

A zip with ``MANIFEST/manifest.xml`` (version 2), the imagery as MBTiles, and one Cursor-on-Target event (2.0) a file.
``ce`` is the CE90 in metres, 9999999 where it is not known.
"""

from __future__ import annotations

import json
import uuid
import zipfile
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from xml.etree import ElementTree

from shapely.geometry import MultiPolygon, Point

from photomap_gis.core.errors import OutputError
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.area import Area, clipped
from photomap_gis.export.crs import needs_place
from photomap_gis.export.finds import Find
from photomap_gis.export.footprint import footprint, to_wgs84
from photomap_gis.export.mbtiles import write_mbtiles
from photomap_gis.export.publish import file_in_place_of
from photomap_gis.export.webtiles import OnProgress
from photomap_gis.export.words import MapWords

_UNKNOWN = "9999999.0"
_NAMESPACE = uuid.UUID("8f5b3c0e-6f0a-5d5e-9c43-2d2b7a0e4f11")
_VALID = timedelta(days=365)
_OUTLINE_POINTS = 120
_OUTLINE_ARGB = "-65536"  # opaque red as the signed number that ATAK writes
_FILL_NOTHING = "0"
_NO_WORDS = MapWords()


def write_atak(
    source: TileSource,
    path: Path | str,
    *,
    now: datetime,
    finds: Sequence[Find] = (),
    gsd_m: float | None = None,
    area: Area | None = None,
    image_format: str = "auto",
    quality: int | None = None,
    words: MapWords = _NO_WORDS,
    on_progress: OnProgress | None = None,
) -> int:
    """Write the package and return how many things are in it.

    Events are valid for a year from ``now``. A find without a CE90 of its own has the map's: it was read off the map.
    """
    path = Path(path).absolute()
    wkt = needs_place(source.grid.crs_wkt, "an ATAK data package")
    outline = to_wgs84(footprint(clipped(source, area)), wkt)
    if outline.is_empty:
        raise OutputError(f"{path} was not written: the map shows nothing")
    if area is not None:
        within = area.geometry_in("EPSG:4326")
        finds = [f for f in finds if within.covers(_point(f))]
    seed = f"{words.title}|{words.provenance_json}|{outline.bounds}"
    package = str(uuid.uuid5(_NAMESPACE, seed))
    events = [(f"{package}-outline", _outline_event(f"{package}-outline", outline, words, now))]
    for n, find in enumerate(finds, start=1):
        uid = str(uuid.uuid5(_NAMESPACE, f"{seed}|{n}|{find.name}|{find.lon_deg}|{find.lat_deg}"))
        events.append((uid, _find_event(uid, find, words, now)))
    image = "imagery/map.mbtiles"
    with file_in_place_of(path, lambda p: _check(p, path)) as temporary:
        tiles = temporary.with_name("map.mbtiles")
        try:
            write_mbtiles(
                source, tiles, gsd_m=gsd_m, area=area, image_format=image_format, quality=quality, words=words,
                on_progress=on_progress,
            )  # fmt: skip
        except OutputError as error:  # told of the file that the user named
            raise OutputError(str(error).replace(str(tiles), str(path))) from error
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, allowZip64=True) as archive:
            archive.writestr("MANIFEST/manifest.xml", _manifest(package, words, image, [uid for uid, _ in events]))
            archive.write(tiles, image, zipfile.ZIP_STORED)  # pictures are packed already
            for uid, event in events:
                archive.writestr(f"{uid}/{uid}.cot", event)
            if words.provenance:
                archive.writestr("provenance.json", json.dumps(words.provenance, ensure_ascii=False, indent=1))
        tiles.unlink()
    return 1 + len(events)


def _manifest(package: str, words: MapWords, image: str, uids: Sequence[str]) -> bytes:
    root = ElementTree.Element("MissionPackageManifest", version="2")
    configuration = ElementTree.SubElement(root, "Configuration")
    for name, value in (("uid", package), ("name", words.title), ("remarks", words.paragraph)):
        ElementTree.SubElement(configuration, "Parameter", name=name, value=value)
    contents = ElementTree.SubElement(root, "Contents")
    ElementTree.SubElement(contents, "Content", ignore="false", zipEntry=image)
    for uid in uids:
        content = ElementTree.SubElement(contents, "Content", ignore="false", zipEntry=f"{uid}/{uid}.cot")
        ElementTree.SubElement(content, "Parameter", name="uid", value=uid)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


def _event(
    uid: str, kind: str, lon: float, lat: float, ce90_m: float | None, now: datetime
) -> tuple[ElementTree.Element, ElementTree.Element]:
    start = now.astimezone(UTC)
    event = ElementTree.Element(
        "event", version="2.0", uid=uid, type=kind, how="m-g", time=_time(start), start=_time(start),
        stale=_time(start + _VALID),
    )  # fmt: skip
    ce = _UNKNOWN if ce90_m is None else f"{ce90_m:.2f}"
    ElementTree.SubElement(event, "point", lat=f"{lat:.8f}", lon=f"{lon:.8f}", hae=_UNKNOWN, ce=ce, le=_UNKNOWN)
    detail = ElementTree.SubElement(event, "detail")
    ElementTree.SubElement(detail, "archive")
    return event, detail


def _outline_event(uid: str, outline: MultiPolygon, words: MapWords, now: datetime) -> bytes:
    """Return a closed shape around the map's largest piece."""
    largest = max(outline.geoms, key=lambda p: p.area)
    tolerance = 1e-7
    while len(largest.exterior.coords) > _OUTLINE_POINTS:
        largest, tolerance = largest.simplify(tolerance), tolerance * 2.0
    centre = largest.representative_point()
    event, detail = _event(uid, "u-d-f", centre.x, centre.y, words.ce90_m, now)
    for lon, lat in largest.exterior.coords:
        ElementTree.SubElement(detail, "link", point=f"{lat:.8f},{lon:.8f}")
    for name, value in (("strokeColor", _OUTLINE_ARGB), ("strokeWeight", "2.0"), ("fillColor", _FILL_NOTHING)):
        ElementTree.SubElement(detail, name, value=value)
    ElementTree.SubElement(detail, "contact", callsign=words.title)
    ElementTree.SubElement(detail, "remarks").text = words.paragraph
    return ElementTree.tostring(event, encoding="utf-8", xml_declaration=True)


def _find_event(uid: str, find: Find, words: MapWords, now: datetime) -> bytes:
    ce90_m = find.ce90_m if find.ce90_m is not None else words.ce90_m
    event, detail = _event(uid, "b-m-p-s-m", find.lon_deg, find.lat_deg, ce90_m, now)
    ElementTree.SubElement(detail, "contact", callsign=find.name)
    lines = [find.remarks, f"seen {find.time_utc}" if find.time_utc else ""]
    lines.append("" if ce90_m is None else f"CE90 {ce90_m:.1f} m" + (" (the map's)" if find.ce90_m is None else ""))
    ElementTree.SubElement(detail, "remarks").text = "; ".join(line for line in lines if line)
    return ElementTree.tostring(event, encoding="utf-8", xml_declaration=True)


def _point(find: Find) -> Point:
    return Point(find.lon_deg, find.lat_deg)


def _time(moment: datetime) -> str:
    return moment.strftime("%Y-%m-%dT%H:%M:%S.000Z")


def _check(temporary: Path, path: Path) -> None:
    try:
        with zipfile.ZipFile(temporary) as archive:
            names = set(archive.namelist())
            root = ElementTree.fromstring(archive.read("MANIFEST/manifest.xml"))
            listed = {c.get("zipEntry") for c in root.iter("Content")}
            sound = archive.testzip() is None and listed <= names
    except (zipfile.BadZipFile, ElementTree.ParseError, KeyError) as error:
        raise OutputError(f"{path} is damaged after writing ({error}); check the disk") from error
    if not sound:
        raise OutputError(f"{path} is damaged after writing; check the disk")
