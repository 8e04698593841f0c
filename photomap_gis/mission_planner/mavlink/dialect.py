"""What the exchange must know of single MAVLink commands: which have a place, which an autopilot does not take.

Numbers are ``MAV_CMD`` and ``MAV_FRAME`` of MAVLink's common dialect.
"""

from __future__ import annotations

from photomap_gis.core.mission import PLACED_COMMANDS

WAYPOINT, LOITER_UNLIM, LOITER_TURNS, LOITER_TIME, RETURN_TO_LAUNCH = 16, 17, 18, 19, 20
LAND, TAKEOFF, SPLINE_WAYPOINT, VTOL_TAKEOFF, VTOL_LAND = 21, 22, 82, 84, 85
DO_JUMP, DO_SET_HOME, DO_LAND_START = 177, 179, 189
TRIGGER_DISTANCE, TRIGGER_INTERVAL = 206, 214
IMAGE_START_CAPTURE = 2000
FENCE_RETURN_POINT, POLYGON_INCLUSION, POLYGON_EXCLUSION, CIRCLE_INCLUSION, CIRCLE_EXCLUSION = range(5000, 5005)
RALLY_POINT = 5100

FRAME_GLOBAL, FRAME_LOCAL_NED, FRAME_MISSION, FRAME_RELATIVE, FRAME_GLOBAL_INT, FRAME_RELATIVE_INT = 0, 1, 2, 3, 5, 6
FRAME_TERRAIN, FRAME_TERRAIN_INT = 10, 11

ABSOLUTE_FRAMES = frozenset({FRAME_GLOBAL, FRAME_GLOBAL_INT})
RELATIVE_FRAMES = frozenset({FRAME_RELATIVE, FRAME_RELATIVE_INT})
TERRAIN_FRAMES = frozenset({FRAME_TERRAIN, FRAME_TERRAIN_INT})
PLACE_FRAMES = ABSOLUTE_FRAMES | RELATIVE_FRAMES | TERRAIN_FRAMES

TAKEOFFS = frozenset({TAKEOFF, VTOL_TAKEOFF})
LANDINGS = frozenset({LAND, VTOL_LAND})
LEG_ENDS = frozenset({WAYPOINT, LOITER_UNLIM, LOITER_TURNS, LOITER_TIME, LAND, TAKEOFF, 31, SPLINE_WAYPOINT,
                      VTOL_TAKEOFF, VTOL_LAND, 94})  # fmt: skip
"""Commands that move the vehicle to their place."""

REFUSED_BY_ARDUPILOT = {
    TRIGGER_INTERVAL: "the camera trigger by time (DO_SET_CAM_TRIGG_INTERVAL); plan the trigger by distance",
    260: "OBLIQUE_SURVEY; plan the trigger by distance",
}
NAN_YAW_IN_ARDUPILOT = frozenset({WAYPOINT, LAND, TAKEOFF, LOITER_UNLIM})
"""Commands whose param4 ArduPilot allows to be NaN; it refuses NaN everywhere else."""

PX4_WITHOUT_PLACE = frozenset({DO_SET_HOME, DO_LAND_START, 191})
"""Commands with a place elsewhere that PX4 takes in ``MAV_FRAME_MISSION`` only."""


def has_place(command: int) -> bool:
    """Whether the fifth and sixth parameter of a command are a latitude and a longitude."""
    return command in PLACED_COMMANDS


def starts_camera(command: int, params: tuple[float, float, float, float]) -> bool:
    """Whether a command starts a series of pictures."""
    if command in (TRIGGER_DISTANCE, TRIGGER_INTERVAL):
        return params[0] > 0
    return command == IMAGE_START_CAPTURE
