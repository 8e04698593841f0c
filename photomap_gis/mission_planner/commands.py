"""The numbers of MAVLink's common dialect that a survey needs [MAVLink: common.xml], and makers of its items."""

from __future__ import annotations

from enum import IntEnum

from photomap_gis.core.mission import MissionItem


class Cmd(IntEnum):
    """``MAV_CMD``."""

    NAV_WAYPOINT = 16
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    CONDITION_YAW = 115
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178
    DO_DIGICAM_CONTROL = 203
    DO_MOUNT_CONTROL = 205
    DO_SET_CAM_TRIGG_DIST = 206
    IMAGE_START_CAPTURE = 2000
    IMAGE_STOP_CAPTURE = 2001


class Frame(IntEnum):
    """``MAV_FRAME``."""

    GLOBAL = 0
    """Altitude above mean sea level."""
    MISSION = 2
    """No place at all."""
    GLOBAL_RELATIVE_ALT = 3
    """Altitude above home."""
    GLOBAL_TERRAIN_ALT = 10
    """Altitude above the ground below."""


def change_speed(speed_m_s: float) -> MissionItem:
    """Ground speed from here on; the throttle (-1) stays as it is."""
    return _do(Cmd.DO_CHANGE_SPEED, 1.0, speed_m_s, -1.0)


def trigger_every(distance_m: float) -> MissionItem:
    """Take a picture here and then every so many metres.

    param2 (shutter) is 0, since ArduPilot refuses NaN there.
    """
    return _do(Cmd.DO_SET_CAM_TRIGG_DIST, distance_m, 0.0, 1.0)


def trigger_off() -> MissionItem:
    """Stop the pictures by distance."""
    return _do(Cmd.DO_SET_CAM_TRIGG_DIST)


def capture_every(interval_s: float) -> MissionItem:
    """Take pictures every so many seconds until told to stop.

    IMAGE_START_CAPTURE, since ArduPilot refuses DO_SET_CAM_TRIGG_INTERVAL in a mission.
    """
    return _do(Cmd.IMAGE_START_CAPTURE, 0.0, interval_s, 0.0)


def capture_off() -> MissionItem:
    """Stop the pictures by time."""
    return _do(Cmd.IMAGE_STOP_CAPTURE)


def capture_one() -> MissionItem:
    """Take one picture, by the camera protocol (PX4)."""
    return _do(Cmd.IMAGE_START_CAPTURE, 0.0, 0.0, 1.0)


def shoot() -> MissionItem:
    """Take one picture, by a trigger pin or whatever camera is set (ArduPilot): param5 is 1."""
    return MissionItem(Cmd.DO_DIGICAM_CONTROL, Frame.MISSION, x=1.0)


def gimbal_pitch(pitch_deg: float, mode: float) -> MissionItem:
    """Point the gimbal, -90 straight down; ``mode`` is ``MAV_MOUNT_MODE``."""
    return MissionItem(Cmd.DO_MOUNT_CONTROL, Frame.MISSION, (pitch_deg, 0.0, 0.0, 0.0), z=mode)


def face(heading_deg: float) -> MissionItem:
    """Turn the nose to a heading clockwise from north, the shorter way."""
    return _do(Cmd.CONDITION_YAW, heading_deg % 360.0)


def return_to_launch() -> MissionItem:
    """Fly home and land, in the autopilot's own way."""
    return _do(Cmd.NAV_RETURN_TO_LAUNCH)


def _do(command: Cmd, *params: float) -> MissionItem:
    p1, p2, p3, p4 = (*params, 0.0, 0.0, 0.0, 0.0)[:4]
    return MissionItem(command, Frame.MISSION, (p1, p2, p3, p4))
