"""The live session: the map grows while the drone flies, and the folder is an ordinary mission when it has landed."""

from photomap_gis.live.options import LiveOptions

__all__ = ["LiveOptions"]
