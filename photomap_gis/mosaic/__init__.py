"""The mosaic room: from placed frames to a map that is rendered and stored tile by tile, and to its layers."""

from photomap_gis.mosaic.layer_store import LayerStore
from photomap_gis.mosaic.layers import render_layers
from photomap_gis.mosaic.plan import TileJob, plan_grid, plan_tiles
from photomap_gis.mosaic.preference import Prefer
from photomap_gis.mosaic.run import render_mosaic
from photomap_gis.mosaic.tiles import TileStore

__all__ = ["LayerStore", "Prefer", "TileJob", "TileStore", "plan_grid", "plan_tiles", "render_layers", "render_mosaic"]
