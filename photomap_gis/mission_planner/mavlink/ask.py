"""Who is there, and what it can tell: a vehicle found, its state and parameters asked for, its current item set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.core.errors import LinkError
from photomap_gis.mission_planner.mavlink.state import Message, VehicleState, first_state, is_vehicle
from photomap_gis.mission_planner.mavlink.talk import Steps, Talk

_LISTEN_S = 1.2  # a heartbeat comes once a second: what else is on the link has spoken by then
_AGAIN_S = 0.6
_WANTED = {
    "AUTOPILOT_VERSION": mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
    "HOME_POSITION": mavlink.MAVLINK_MSG_ID_HOME_POSITION,
    "GLOBAL_POSITION_INT": mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    "EXTENDED_SYS_STATE": mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    "SYS_STATUS": mavlink.MAVLINK_MSG_ID_SYS_STATUS,
    "MISSION_CURRENT": mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
    "GPS_RAW_INT": mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
}


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which vehicle on the link is meant; None: the only one."""

    system: int | None = None


def find_vehicle(talk: Talk, wanted: Wanted, timeout_s: float) -> Steps[VehicleState | None]:
    """Return the vehicle on the link, None where none was heard in time.

    Raises ``LinkError`` where several are heard and none was named.
    """
    end_s = talk.now_s + timeout_s
    found: dict[tuple[int, int], VehicleState] = {}
    talk.on_progress("vehicle", 0, 1)
    while talk.now_s < end_s:
        talk.last_answer_s = talk.now_s  # nothing was asked yet
        message = yield from talk.wait(end_s)
        if message is None or not is_vehicle(message):
            continue
        key = message.get_srcSystem(), message.get_srcComponent()
        if wanted.system is not None and key[0] != wanted.system:
            continue
        if key not in found:
            if not found:
                end_s = min(end_s, talk.now_s + _LISTEN_S)
            found[key] = first_state(message, talk.now_s)
            if wanted.system is not None and key[1] == mavlink.MAV_COMP_ID_AUTOPILOT1:
                break  # there can be no other
    if not found:
        return None
    systems = sorted({system for system, _ in found})
    if len(systems) > 1:
        raise LinkError(f"several vehicles are on this link ({', '.join(map(str, systems))}): name one by --system")
    # Of the components that call themselves autopilot the first is the flight controller.
    talk.state = found[min(found)]
    talk.on_progress("vehicle", 1, 1)
    talk.last_answer_s = talk.now_s
    return talk.state


def ask_state(talk: Talk, timeout_s: float) -> Steps[None]:
    """Ask once and again for what a vehicle does not send by itself, until all of it was heard or time is up."""
    end_s, again_s = talk.now_s + timeout_s, talk.now_s
    missing = dict(_WANTED)
    while missing and talk.now_s < end_s:
        if talk.now_s >= again_s:
            for number in missing.values():
                talk.say(_command(talk, mavlink.MAV_CMD_REQUEST_MESSAGE, number))
            again_s = talk.now_s + _AGAIN_S
        message = yield from talk.wait(min(again_s, end_s))
        if message is None or message.get_srcComponent() != talk.vehicle.component:
            continue
        missing.pop(message.get_type(), None)
        if message.get_type() == "COMMAND_ACK":
            talk.last_answer_s = talk.now_s
            if message.command == mavlink.MAV_CMD_REQUEST_MESSAGE and message.result == mavlink.MAV_RESULT_UNSUPPORTED:
                # An old autopilot: what it streams by itself is all that there is, and its version by another command.
                talk.say(_command(talk, mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1))
                missing = {name: number for name, number in missing.items() if name != "HOME_POSITION"}
    talk.last_answer_s = talk.now_s  # a vehicle need not know any of this


def ask_params(talk: Talk, names: Sequence[str], timeout_s: float) -> Steps[dict[str, float]]:
    """Return the parameters that the vehicle has of ``names``."""
    end_s, again_s = talk.now_s + timeout_s, talk.now_s
    values: dict[str, float] = {}
    while len(values) < len(names) and talk.now_s < end_s:
        if talk.now_s >= again_s:
            for name in names:
                if name not in values:
                    talk.say(mavlink.MAVLink_param_request_read_message(*talk.target, name.encode(), -1))
            again_s = talk.now_s + _AGAIN_S
        message = yield from talk.wait(min(again_s, end_s))
        if message is not None and message.get_type() == "PARAM_VALUE" and message.param_id in names:
            values[message.param_id] = message.param_value
    talk.last_answer_s = talk.now_s  # a vehicle need not have any of these
    return values


def set_current(talk: Talk, seq: int, told_seq: int, timeout_s: float) -> Steps[bool]:
    """Make ``seq`` the mission's current item and say whether the vehicle confirmed it by MISSION_CURRENT.

    ``told_seq`` is the item that it may tell instead, as the next that it flies to.
    Neither of the two ways is understood everywhere: they are tried in turns. None of them changes the mode.
    """
    end_s, again_s = talk.now_s + timeout_s, talk.now_s
    ways: list[Message] = [
        mavlink.MAVLink_mission_set_current_message(*talk.target, seq),
        _command(talk, mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, seq),
    ]
    tries = 0
    while talk.now_s < end_s:
        if talk.now_s >= again_s:
            talk.say(ways[tries % len(ways)])
            talk.say(_command(talk, mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_MISSION_CURRENT))
            tries += 1
            again_s = talk.now_s + 2 * _AGAIN_S
        message = yield from talk.wait(min(again_s, end_s))
        if message is not None and message.get_type() == "MISSION_CURRENT" and message.seq in (seq, told_seq) and tries:
            return True
    return False


def _command(talk: Talk, command: int, param1: float) -> Message:
    return mavlink.MAVLink_command_long_message(*talk.target, command, 0, param1, 0, 0, 0, 0, 0, 0)
