"""The window to the world: a mission's map, frames and accuracy over HTTP, and the page that shows them."""

from photomap_gis.server.access import Access, is_loopback, new_token
from photomap_gis.server.app import create_app
from photomap_gis.server.host import Host
from photomap_gis.server.run import BoundServer
from photomap_gis.server.view import MissionView

__all__ = ["Access", "BoundServer", "Host", "MissionView", "create_app", "is_loopback", "new_token"]
