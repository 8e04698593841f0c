"""A plan for Google Earth: paths at their height, waypoints, the area, what is avoided and what stays uncovered."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from xml.etree import ElementTree as ET

from photomap_gis.core.plan import AltitudeFrame, GeoPolygon, SurveyPlan, Waypoint, WaypointRole
from photomap_gis.mission_planner.files.lanes import lanes_of
from photomap_gis.mission_planner.heights import FRAME_WORDS, amsl_m

_KML = "http://www.opengis.net/kml/2.2"
_STYLES = {  # KML colours are alpha, blue, green, red
    "area": ("ff00a5ff", "2000a5ff"),
    "avoid": ("ff0000ff", "600000ff"),
    "uncovered": ("ffff00ff", "80ff00ff"),
    "path": ("ffffffff", "30ffffff"),
    "lane": ("ff00ffff", "3000ffff"),
}


def plan_kml(plan: SurveyPlan, name: str) -> str:
    """Return one document with a folder a sortie.

    Heights are absolute (above the sea) where they are known, else above the ground: with heights above the take-off
    place and no height of that place, this shows them over flat ground, which the description says.
    """
    root = ET.Element("kml", {"xmlns": _KML})
    document = ET.SubElement(root, "Document")
    _text(document, "name", name)
    _text(document, "description", _description(plan))
    for style, (line, fill) in _STYLES.items():
        _style(document, style, line, fill)
    zones = ET.SubElement(document, "Folder")
    _text(zones, "name", "ground")
    for kind, polygons in (("area", plan.area), ("avoid", plan.avoid), ("uncovered", plan.uncovered)):
        for polygon in polygons:
            _polygon(zones, kind, polygon)
    for number, sortie in enumerate(plan.sorties, 1):
        folder = ET.SubElement(document, "Folder")
        _text(folder, "name", f"sortie {number}")
        _text(
            folder, "description", f"{sortie.photos} photos, {sortie.length_m:.0f} m, {sortie.duration_s / 60:.1f} min"
        )
        _line(folder, "path", "path", plan, sortie.waypoints)
        for i, lane in enumerate(lanes_of(sortie), 1):
            _line(folder, f"lane {i}", "lane", plan, lane)
        points = ET.SubElement(folder, "Folder")
        _text(points, "name", "waypoints")
        for i, waypoint in enumerate(sortie.waypoints, 1):
            placemark = ET.SubElement(points, "Placemark")
            _text(placemark, "name", str(i))
            _text(placemark, "description", f"{waypoint.role}, {waypoint.alt_m:.1f} m {FRAME_WORDS[plan.frame]}")
            point = ET.SubElement(placemark, "Point")
            _text(point, "altitudeMode", _mode(plan))
            _text(point, "coordinates", _coordinates(plan, waypoint))
    ET.indent(root, " ")
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def plan_kmz(plan: SurveyPlan, name: str) -> bytes:
    """Return the same, zipped, ``doc.kml`` first."""
    return zipped({"doc.kml": plan_kml(plan, name)})


def zipped(texts: dict[str, str]) -> bytes:
    """Return an archive of small texts whose bytes hang on nothing but them."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, text in texts.items():
            archive.writestr(zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0)), text.encode(), zipfile.ZIP_DEFLATED)
    return out.getvalue()


def _description(plan: SurveyPlan) -> str:
    words = f"{plan.pattern}; heights {FRAME_WORDS[plan.frame]}"
    if plan.frame is AltitudeFrame.RELATIVE and plan.home_alt_amsl_m is None:
        words += ", drawn over flat ground since the take-off place's height is not known"
    return "\n".join((words, *plan.warnings))


def _mode(plan: SurveyPlan) -> str:
    known = plan.frame is not AltitudeFrame.TERRAIN and (
        plan.frame is AltitudeFrame.AMSL or plan.home_alt_amsl_m is not None
    )
    return "absolute" if known else "relativeToGround"


def _height_m(plan: SurveyPlan, waypoint: Waypoint) -> float:
    if _mode(plan) == "absolute":
        height = amsl_m(plan, waypoint)
        if height is not None:
            return height
    return 0.0 if waypoint.role is WaypointRole.LAND else waypoint.alt_m


def _coordinates(plan: SurveyPlan, waypoint: Waypoint) -> str:
    return f"{waypoint.lon_deg:.9f},{waypoint.lat_deg:.9f},{_height_m(plan, waypoint):.2f}"


def _line(parent: ET.Element, name: str, style: str, plan: SurveyPlan, waypoints: Sequence[Waypoint]) -> None:
    if len(waypoints) < 2:
        return
    placemark = ET.SubElement(parent, "Placemark")
    _text(placemark, "name", name)
    _text(placemark, "styleUrl", f"#{style}")
    line = ET.SubElement(placemark, "LineString")
    _text(line, "altitudeMode", _mode(plan))
    _text(line, "coordinates", " ".join(_coordinates(plan, w) for w in waypoints))


def _polygon(parent: ET.Element, kind: str, polygon: GeoPolygon) -> None:
    placemark = ET.SubElement(parent, "Placemark")
    _text(placemark, "name", kind)
    _text(placemark, "styleUrl", f"#{kind}")
    element = ET.SubElement(placemark, "Polygon")
    _text(element, "tessellate", "1")
    for i, ring in enumerate(polygon.rings):
        boundary = ET.SubElement(element, "outerBoundaryIs" if i == 0 else "innerBoundaryIs")
        linear = ET.SubElement(boundary, "LinearRing")
        _text(linear, "coordinates", " ".join(f"{lon:.9f},{lat:.9f},0" for lon, lat in ring))


def _style(document: ET.Element, name: str, line: str, fill: str) -> None:
    style = ET.SubElement(document, "Style", {"id": name})
    line_style = ET.SubElement(style, "LineStyle")
    _text(line_style, "color", line)
    _text(line_style, "width", "2")
    _text(ET.SubElement(style, "PolyStyle"), "color", fill)


def _text(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text
