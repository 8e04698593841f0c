"""Live sources: files at their rate, streams, cameras, folders being filled; and the black box that keeps them."""

from photomap_gis.ingest.stream.opening import open_stream
from photomap_gis.ingest.stream.telemetry import open_telemetry

__all__ = ["open_stream", "open_telemetry"]
