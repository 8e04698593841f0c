"""Long-running hosts over the server: what they serve is read through the corridor."""

from photomap_gis.engine.view import open_view

__all__ = ["open_view"]
