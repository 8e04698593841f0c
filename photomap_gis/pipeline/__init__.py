"""The corridor: the only place that knows the order of the stages."""

from photomap_gis.pipeline.control import ControlRequest
from photomap_gis.pipeline.deliver import export_files, export_mission
from photomap_gis.pipeline.flight import map_flight
from photomap_gis.pipeline.formats import ExportOptions, Format
from photomap_gis.pipeline.graph import export_graph
from photomap_gis.pipeline.resolve import Pick, georeference, reference_mission, solve_again
from photomap_gis.pipeline.settings import Drawing, MapSettings
from photomap_gis.pipeline.summary import MapSummary

__all__ = [
    "ControlRequest",
    "Drawing",
    "ExportOptions",
    "Format",
    "MapSettings",
    "MapSummary",
    "Pick",
    "export_files",
    "export_graph",
    "export_mission",
    "georeference",
    "map_flight",
    "reference_mission",
    "solve_again",
]
