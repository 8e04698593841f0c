"""The mosaic room: from placed frames to a map that is rendered and stored tile by tile."""

from photomap_gis.mosaic.plan import TileJob, plan_grid, plan_tiles
from photomap_gis.mosaic.run import render_mosaic
from photomap_gis.mosaic.tiles import TileStore

__all__ = ["TileJob", "TileStore", "plan_grid", "plan_tiles", "render_mosaic"]
