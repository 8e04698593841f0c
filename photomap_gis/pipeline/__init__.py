"""The corridor: the only place that knows the order of the stages."""

from photomap_gis.pipeline.deliver import Format, export_mission
from photomap_gis.pipeline.flight import map_flight, reference_mission
from photomap_gis.pipeline.settings import MapSettings
from photomap_gis.pipeline.summary import MapSummary

__all__ = ["Format", "MapSettings", "MapSummary", "export_mission", "map_flight", "reference_mission"]
