"""Reading what a drone brought home: photos, videos, telemetry."""

from photomap_gis.ingest.describe import describe
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.sources import open_sources, read_frame, read_frames

__all__ = ["IngestOptions", "describe", "open_sources", "read_frame", "read_frames"]
