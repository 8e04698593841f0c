"""Live sources: files at their rate, streams, cameras, folders being filled; and the black box that keeps them."""

from photomap_gis.ingest.stream.opening import open_stream

__all__ = ["open_stream"]
