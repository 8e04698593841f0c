"""What an autopilot makes of an item: whether it takes it, and what it gives back of it.

Measured on ArduPilot Copter 4.7-dev and read from ArduPilot's ``AP_Mission``, ``AC_PolyFence_loader`` and PX4's
``MavlinkMissionManager``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

MISSION, FENCE, RALLY = 0, 1, 2

OK = mavlink.MAV_MISSION_ACCEPTED
_INVALID_PARAM1, _INVALID_PARAM7 = mavlink.MAV_MISSION_INVALID_PARAM1, mavlink.MAV_MISSION_INVALID_PARAM7
_BAD_FRAME, _UNSUPPORTED, _ERROR = (
    mavlink.MAV_MISSION_UNSUPPORTED_FRAME,
    mavlink.MAV_MISSION_UNSUPPORTED,
    mavlink.MAV_MISSION_ERROR,
)

_ABSOLUTE, _LOCAL, _NO_FRAME, _RELATIVE, _TERRAIN = 0, 1, 2, 3, 10
_PLAIN = {0: _ABSOLUTE, 5: _ABSOLUTE, 3: _RELATIVE, 6: _RELATIVE, 10: _TERRAIN, 11: _TERRAIN}
_ARDUPILOT_PLACES = {16, 17, 18, 19, 21, 22, 31, 82, 84, 85, 94, 179, 189, 195, 201}
_ARDUPILOT_OTHERS = {20, 92, 93, 112, 114, 115, 177, 178, 181, 182, 183, 184, 197, 203, 204, 205, 206, 207, 211, 222,
                     1000, 2000, 2001, 2500, 2501, 3000}  # fmt: skip
_NAN_YAW = {16, 21, 22, 17}
_FENCES, _RALLY_COMMAND = range(5000, 5005), 5100
_PX4_PLACES = {16, 17, 19, 21, 22, 31, 84, 85, 195, 201, 4501}
_PX4_OTHERS = {20, 93, 112, 114, 177, 178, 179, 183, 187, 189, 197, 203, 204, 205, 206, 214, 260, 530, 531, 532, 534,
               1000, 1001, 2000, 2001, 2003, 2500, 2501, 3000}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Stored:
    """An item as it is kept: what a read-back gives."""

    command: int
    frame: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int = 1


def taken_from(message: Any) -> Stored:
    """Return what a MISSION_ITEM_INT or MISSION_ITEM says."""
    scale = 1e7 if message.get_type() == "MISSION_ITEM" else 1
    return Stored(
        message.command,
        message.frame,
        (message.param1, message.param2, message.param3, message.param4),
        round(message.x * scale),
        round(message.y * scale),
        message.z,
        message.autocontinue,
    )


def ardupilot_keeps(kind: int, item: Stored) -> tuple[int, Stored]:
    """Return ArduPilot's verdict (``MAV_MISSION_RESULT``) on an item and what it keeps."""
    if kind == FENCE:
        if item.command not in _FENCES:
            return _UNSUPPORTED, item
        if item.frame not in _PLAIN:
            return _BAD_FRAME, item
        return OK, Stored(item.command, _ABSOLUTE, (item.params[0], 0.0, 0.0, 0.0), item.x, item.y, 0.0, 0)
    if kind == RALLY:
        if item.command != _RALLY_COMMAND:
            return _UNSUPPORTED, item
        if item.frame not in _PLAIN:
            return _BAD_FRAME, item
        return OK, Stored(item.command, _RELATIVE, (0.0,) * 4, item.x, item.y, float(math.trunc(item.z)))
    verdict = _ardupilot_verdict(item)
    return verdict, _ardupilot_mission(item) if verdict == OK else item


def _ardupilot_verdict(item: Stored) -> int:
    if item.command not in _ARDUPILOT_PLACES | _ARDUPILOT_OTHERS:
        return _UNSUPPORTED
    for n, value in enumerate(item.params):
        if math.isnan(value) and not (n == 3 and item.command in _NAN_YAW):
            return _INVALID_PARAM1 + n
    if math.isnan(item.z):
        return _INVALID_PARAM7
    if item.command in _ARDUPILOT_PLACES:
        if item.frame not in _PLAIN and item.frame != _NO_FRAME:
            return _BAD_FRAME
        if abs(item.x) > 900_000_000:
            return _INVALID_PARAM1 + 4
        if abs(item.y) > 1_800_000_000:
            return _INVALID_PARAM1 + 5
    return OK


def _ardupilot_mission(item: Stored) -> Stored:
    p = item.params
    kept = {
        16: (_whole(p[0]), 0.0, 0.0, 0.0),
        17: (0.0, 0.0, _whole(p[2]), 1.0),
        18: (_whole(p[0]), 0.0, _whole(p[2]), 1.0),
        19: (_whole(p[0]), 0.0, -1.0 if p[2] < 0 else 1.0, 1.0),
        20: (0.0,) * 4,
        21: (_whole(p[0]), 0.0, 0.0, 1.0),
        22: (_whole(p[0]), 0.0, 0.0, 0.0),
        82: (_whole(p[0]), 0.0, 0.0, 0.0),
        206: (p[0], 0.0, p[2], 0.0),
    }.get(item.command, p)
    if item.command not in _ARDUPILOT_PLACES:
        return Stored(item.command, _ABSOLUTE, kept, item.x, item.y, 0.0)
    altitude_m = math.trunc(round(item.z * 100, 3)) / 100
    return Stored(item.command, _PLAIN.get(item.frame, _ABSOLUTE), kept, item.x, item.y, altitude_m)


def _whole(value: float) -> float:
    return float(math.trunc(min(max(value, 0.0), 65535.0)))


def px4_keeps(kind: int, item: Stored) -> tuple[int, Stored]:
    """Return PX4's verdict on an item and what it keeps."""
    plain = _PLAIN.get(item.frame)
    if item.frame == _NO_FRAME:
        if item.command not in _PX4_OTHERS:
            return _UNSUPPORTED, item
        return (OK, item) if kind == MISSION else (_ERROR, item)
    if plain not in (_ABSOLUTE, _RELATIVE):
        return _BAD_FRAME, item
    if kind == FENCE:
        if item.command not in _FENCES:
            return _UNSUPPORTED, item
        if item.command in (5001, 5002) and item.params[0] < 3:
            return _ERROR, item
    elif item.command not in (_PX4_PLACES if kind == MISSION else {_RALLY_COMMAND}):
        return _UNSUPPORTED, item
    return OK, replace(item, frame=6 if plain == _RELATIVE else 5, params=_px4_params(item))


def _px4_params(item: Stored) -> tuple[float, float, float, float]:
    p = item.params
    yaw = p[3] if math.isnan(p[3]) else p[3] % 360.0
    return {
        16: (p[0], p[1], 0.0, yaw),
        17: (0.0, 0.0, p[2], yaw),
        19: (p[0], float(p[1] > 0), p[2], float(p[3] > 0)),
        21: (0.0, p[1], 0.0, yaw),
        22: (0.0, 0.0, 0.0, yaw),
        31: (float(p[0] > 0), p[1], 0.0, float(p[3] > 0)),
        84: (0.0, 0.0, 0.0, yaw),
        85: (0.0, 0.0, 0.0, yaw),
        **{command: (p[0], 0.0, 0.0, 0.0) for command in range(5001, 5005)},
    }.get(item.command, (0.0,) * 4)
