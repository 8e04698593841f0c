"""A plan as rows and routes: CSV for a spreadsheet, GPX for a hand-held receiver [GPX 1.1]."""

from __future__ import annotations

import csv
import io
from xml.etree import ElementTree as ET

from photomap_gis.core.plan import SurveyPlan
from photomap_gis.mission_planner.files.geojson import waypoint_facts
from photomap_gis.mission_planner.heights import FRAME_WORDS, amsl_m

_GPX = "http://www.topografix.com/GPX/1/1"


def plan_csv(plan: SurveyPlan) -> str:
    """Return a table with a row a waypoint; units are in the column names, a cell is empty where nothing is known."""
    out = io.StringIO()
    writer: csv.DictWriter[str] | None = None
    for number, sortie in enumerate(plan.sorties, 1):
        for i, waypoint in enumerate(sortie.waypoints, 1):
            place = {"lat_deg": f"{waypoint.lat_deg:.9f}", "lon_deg": f"{waypoint.lon_deg:.9f}"}
            row = {"sortie": number, "seq": i, **place, **waypoint_facts(plan, waypoint)}
            if writer is None:
                writer = csv.DictWriter(out, list(row), lineterminator="\n")
                writer.writeheader()
            writer.writerow(row)
    return out.getvalue()


def plan_gpx(plan: SurveyPlan, name: str) -> str:
    """Return a route a sortie; ``ele`` is above mean sea level and stands only where that is known."""
    root = ET.Element("gpx", {"version": "1.1", "creator": "photomap", "xmlns": _GPX})
    metadata = ET.SubElement(root, "metadata")
    ET.SubElement(metadata, "name").text = name
    for number, sortie in enumerate(plan.sorties, 1):
        route = ET.SubElement(root, "rte")
        ET.SubElement(route, "name").text = name if len(plan.sorties) == 1 else f"{name} sortie {number}"
        for i, waypoint in enumerate(sortie.waypoints, 1):
            place = {"lat": f"{waypoint.lat_deg:.9f}", "lon": f"{waypoint.lon_deg:.9f}"}
            point = ET.SubElement(route, "rtept", place)
            height = amsl_m(plan, waypoint)
            if height is not None:
                ET.SubElement(point, "ele").text = f"{height:.2f}"
            ET.SubElement(point, "name").text = f"{i:03d}"
            words = f"{waypoint.alt_m:.1f} m {FRAME_WORDS[plan.frame]}"
            ET.SubElement(point, "desc").text = f"{waypoint.role}: {words}"
    ET.indent(root, " ")
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
