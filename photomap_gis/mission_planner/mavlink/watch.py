"""A vehicle looked at: its state once, or again and again."""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.core.errors import LinkError
from photomap_gis.mission_planner.mavlink.ask import Wanted, ask_state, find_vehicle
from photomap_gis.mission_planner.mavlink.state import VehicleState
from photomap_gis.mission_planner.mavlink.talk import Steps, Stopped, Talk

_STATE_S = 4.0
_POLLED = {
    "GLOBAL_POSITION_INT": mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    "SYS_STATUS": mavlink.MAVLINK_MSG_ID_SYS_STATUS,
    "MISSION_CURRENT": mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
    "GPS_RAW_INT": mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
    "EXTENDED_SYS_STATE": mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
}


def look(talk: Talk, wanted: Wanted) -> Steps[VehicleState]:
    """Return who is there and how it is. Raises ``LinkError`` where nobody is heard in time."""
    found = yield from find_vehicle(talk, wanted, talk.patience.timeout_s)
    if found is None:
        raise LinkError(
            f"no vehicle was heard for {talk.patience.timeout_s:g} s: check --connect, the radio and that no other "
            "program has the port"
        )
    yield from ask_state(talk, _STATE_S)
    return talk.vehicle


def watch(
    talk: Talk, wanted: Wanted, *, every_s: float, times: int | None, tell: Callable[[VehicleState], None]
) -> Steps[None]:
    """Tell the state every so often, ``times`` times (None: until stopped).

    What the vehicle does not stream is asked for one by one, which leaves its streams to other stations as they are.
    Raises ``LinkError`` where its heartbeats stop.
    """
    try:
        yield from look(talk, wanted)
        told = 0
        while times is None or told < times:
            tell(talk.vehicle)
            told += 1
            if told == times:
                return
            heard: set[str] = set()
            next_s = talk.now_s + every_s
            while talk.now_s < next_s:
                talk.last_answer_s = talk.vehicle.heard_s
                message = yield from talk.wait(next_s)
                if message is not None:
                    heard.add(message.get_type())
            if talk.now_s - talk.vehicle.heard_s > talk.patience.timeout_s:
                raise LinkError(f"the vehicle fell silent {talk.patience.timeout_s:g} s ago")
            for name in _POLLED.keys() - heard:
                talk.say(
                    mavlink.MAVLink_command_long_message(
                        *talk.target, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, _POLLED[name], 0, 0, 0, 0, 0, 0
                    )
                )
    except Stopped as error:
        raise KeyboardInterrupt from error
