"""A server that begins without a mission: it runs photomap's commands as jobs, and opens missions."""

from photomap_gis.engine.app import create_engine
from photomap_gis.engine.documents import EngineReadyDocument
from photomap_gis.engine.jobs import Jobs
from photomap_gis.engine.kinds import KINDS, Kind

__all__ = ["KINDS", "EngineReadyDocument", "Jobs", "Kind", "create_engine"]
