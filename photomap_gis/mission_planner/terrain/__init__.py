"""Flying at a height above the ground that is there: elevation models, and plans bent to follow them."""

from photomap_gis.elevation import Dem, VerticalDatum, open_dem
from photomap_gis.mission_planner.terrain.follow import (
    FollowSettings,
    TerrainReport,
    by_the_vehicles_terrain,
    follow_terrain,
    on_flat_ground,
)

__all__ = [
    "Dem",
    "FollowSettings",
    "TerrainReport",
    "VerticalDatum",
    "by_the_vehicles_terrain",
    "follow_terrain",
    "on_flat_ground",
    "open_dem",
]
