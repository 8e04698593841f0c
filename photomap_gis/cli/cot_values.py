"""A live pose and the mission's finds as Cursor on Target carries them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from photomap_gis.core.accuracy import CE90_PER_RMSE_R
from photomap_gis.core.errors import PhotomapError
from photomap_gis.export.cot import CotDrone, CotFind, CotFootprint, cot_find, stable_uid
from photomap_gis.export.finds import read_finds
from photomap_gis.find_store import FINDS_FILE
from photomap_gis.georef import map_to_lonlat
from photomap_gis.server.live_view import LivePose

Values = list[CotDrone | CotFootprint | CotFind]


def cot_values(pose: LivePose, folder: Path, callsign: str) -> Values:
    """Return drone, footprint and finds; nothing while the map has no place on Earth."""
    placement, frame = pose.placement, pose.map_frame
    found: Values = _finds(folder)
    if placement is None or frame.crs_wkt is None:
        return found
    plumb, outline = placement.plumb_xy_map_m, placement.outline_xy_map_m(1)
    at = placement.centre_xy_map_m if plumb is None else plumb
    if not np.isfinite(at).all() or len(outline) < 3:
        return found
    (lon, lat), *corners = map_to_lonlat(frame, np.concatenate([at[None], outline]))
    ce90 = CE90_PER_RMSE_R * math.sqrt(float(np.trace(placement.position_covariance_m2()[0])))
    base = str(folder.absolute())
    course = math.degrees(placement.heading_rad) % 360.0
    drone = CotDrone(stable_uid(base, "drone"), callsign, float(lat), float(lon), ce90_m=ce90, course_deg=course)
    ground = CotFootprint(stable_uid(base, "footprint"), f"{callsign} sees", [(float(y), float(x)) for x, y in corners])
    return [drone, ground, *found]


def _finds(folder: Path) -> Values:
    path = folder / FINDS_FILE
    if not path.is_file():
        return []
    try:
        finds = read_finds(path, may_be_none=True)
    except PhotomapError:
        return []  # being written just now: the next second tells
    return [cot_find(f) for f in finds]
