"""What every simulated vehicle does: heartbeats, a position, commands, parameters, a reboot; no socket and no clock.

The mission protocol is each autopilot's own (``ardupilot``, ``px4``). A vehicle is a mutable thing with one owner, who
calls ``receive`` and ``tick`` with the time and takes what it says by ``take_outbox``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.simulate.vehicle.stored import FENCE, MISSION, RALLY, Stored

Message = Any
Partner = tuple[int, int]
"""The system and component id of who is spoken to."""

_HEARTBEAT_S = 1.0
_CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)


@dataclass(slots=True)
class Misbehaviour:
    """What goes wrong inside a vehicle; items are numbers on the wire."""

    no_space_after_boot_s: float = 0.0
    reboot_at_item: int | None = None
    boot_s: float = 3.0
    mission_mode_at_item: int | None = None
    silent_at_item: int | None = None
    refuses_command: int | None = None
    wrong_echoes: int = 0  # so many read-backs of item 2 are wrong although it is kept right
    keeps_wrong: int = 0  # so many uploads in which item 2 is kept wrong
    ignores_us: bool = False


@dataclass(slots=True)
class Place:
    """Where the vehicle is: degrees, metres above sea level and above home."""

    lat_deg: float = 51.5
    lon_deg: float = 7.4
    alt_amsl_m: float = 100.0
    height_m: float = 0.0


@dataclass(slots=True)
class Airframe:
    """The common part; ``lists`` outlive a reboot as an autopilot's storage does."""

    system: int = 1
    place: Place = field(default_factory=Place)
    home: tuple[float, float, float] | None = (51.5, 7.4, 100.0)
    armed: bool = False
    mode: int = 0
    max_items: int = 650
    faults: Misbehaviour = field(default_factory=Misbehaviour)
    params: dict[str, float] = field(default_factory=dict)
    lists: dict[int, list[Stored]] = field(default_factory=lambda: {MISSION: [], FENCE: [], RALLY: []})
    current: int = 0
    outbox: list[Message] = field(default_factory=list)
    now_s: float = 0.0
    boots: int = 0
    _up_at_s: float = 0.0
    _beat_s: float = 0.0
    _silent: bool = False

    autopilot = mavlink.MAV_AUTOPILOT_INVALID
    mission_mode = 0
    version = 0

    def receive(self, message: Message, now_s: float) -> None:
        """Take a message in."""
        self.now_s = now_s
        if not self._is_up or self.faults.ignores_us:
            return
        target = getattr(message, "target_system", 0)
        if target not in (0, self.system):
            return
        partner = message.get_srcSystem(), message.get_srcComponent()
        name = message.get_type()
        if name == "COMMAND_LONG":
            self._command(message, partner)
        elif name == "PARAM_REQUEST_READ":
            self._send_param(message)
        elif name == "MISSION_SET_CURRENT":
            self.set_current(message.seq)
        elif name.startswith("MISSION_"):
            self.handle_mission(name, message, partner)

    def tick(self, now_s: float) -> None:
        """Let time come to ``now_s``."""
        self.now_s = now_s
        if not self._is_up:
            return
        if now_s >= self._beat_s:
            self._beat_s = now_s + _HEARTBEAT_S
            self._say_hello()
        self.keep_time()

    def take_outbox(self) -> Sequence[Message]:
        """Return what the vehicle says, and forget it."""
        said, self.outbox = self.outbox, []
        return [] if self._silent else said

    def set_mode(self, mode: int) -> None:
        """Change the flight mode as the pilot does; the next heartbeat tells."""
        self.mode = mode
        self._beat_s = self.now_s

    def boot(self) -> None:
        """Come up now."""
        self._up_at_s = self.now_s

    def reboot(self) -> None:
        """Restart: transfers are forgotten, lists are kept."""
        self.boots += 1
        self._up_at_s = self.now_s + self.faults.boot_s
        self.outbox.clear()
        self.forget_transfers()

    def count_for(self, kind: int) -> int:
        """Return how many items a list has."""
        return len(self.lists[kind])

    # What each autopilot does in its own way.
    def handle_mission(self, name: str, message: Message, partner: Partner) -> None:
        """Take a message of the mission protocol."""
        raise NotImplementedError

    def keep_time(self) -> None:
        """Ask again, or give a transfer up."""
        raise NotImplementedError

    def forget_transfers(self) -> None:
        """Lose what a reboot loses."""
        raise NotImplementedError

    def mission_total(self) -> int:
        """Return MISSION_CURRENT's ``total``."""
        raise NotImplementedError

    @property
    def _is_up(self) -> bool:
        return self.now_s >= self._up_at_s

    @property
    def boot_ms(self) -> int:
        """Milliseconds since the last boot."""
        return max(0, int((self.now_s - self._up_at_s) * 1e3))

    @property
    def is_full(self) -> bool:
        """Whether the storage says that it has no space, as just after boot."""
        return self.now_s < self._up_at_s + self.faults.no_space_after_boot_s

    def say(self, message: Message) -> None:
        """Put a message in the outbox."""
        self.outbox.append(message)

    def ack(self, partner: Partner, code: int, kind: int) -> None:
        """Send a MISSION_ACK."""
        self.say(mavlink.MAVLink_mission_ack_message(*partner, code, kind))

    def meet_fate(self, seq: int) -> bool:
        """Let happen what is to happen at an item; say whether the item is lost by it."""
        if self.faults.mission_mode_at_item == seq:
            self.faults.mission_mode_at_item = None
            self.set_mode(self.mission_mode)
        if self.faults.silent_at_item == seq:
            self._silent = True
        if self.faults.reboot_at_item == seq:
            self.faults.reboot_at_item = None
            self.reboot()
            return True
        return False

    def send_item(self, partner: Partner, kind: int, seq: int, *, as_int: bool) -> None:
        """Send an item that is asked for."""
        item = self.lists[kind][seq]
        z = item.z
        if self.faults.wrong_echoes > 0 and seq == 2:
            self.faults.wrong_echoes -= 1
            z += 7.0 + self.faults.wrong_echoes  # another mistake each time
        head = (*partner, seq, item.frame, item.command, 0, item.autocontinue, *item.params)
        if as_int:
            self.say(mavlink.MAVLink_mission_item_int_message(*head, item.x, item.y, z, kind))
        else:
            self.say(mavlink.MAVLink_mission_item_message(*head, item.x / 1e7, item.y / 1e7, z, kind))

    def set_current(self, seq: int) -> bool:
        """Make an item the current one."""
        if seq >= self.count_for(MISSION):
            return False
        self.current = seq
        self.send("MISSION_CURRENT")
        return True

    def _command(self, message: Message, partner: Partner) -> None:
        result = mavlink.MAV_RESULT_UNSUPPORTED
        if message.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            name = _BY_ID.get(int(message.param1))
            result = mavlink.MAV_RESULT_ACCEPTED if name and self.send(name) else mavlink.MAV_RESULT_FAILED
        elif message.command == mavlink.MAV_CMD_DO_SET_MISSION_CURRENT:
            done = self.set_current(int(message.param1))
            result = mavlink.MAV_RESULT_ACCEPTED if done else mavlink.MAV_RESULT_FAILED
        self.say(mavlink.MAVLink_command_ack_message(message.command, result, 0, 0, *partner))

    def _send_param(self, message: Message) -> None:
        name = message.param_id
        if name in self.params:
            self.say(mavlink.MAVLink_param_value_message(name.encode(), self.params[name], 9, len(self.params), 0))

    def _say_hello(self) -> None:
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        status = mavlink.MAV_STATE_ACTIVE if self.armed else mavlink.MAV_STATE_STANDBY
        self.say(
            mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_QUADROTOR, self.autopilot, base, self.mode, status, 3)
        )
        self.send("MISSION_CURRENT")

    def send(self, name: str) -> bool:
        """Say a message of this name, as far as there is one."""
        place, boot_ms = self.place, self.boot_ms
        lat, lon = round(place.lat_deg * 1e7), round(place.lon_deg * 1e7)
        alt_mm, height_mm = round(place.alt_amsl_m * 1e3), round(place.height_m * 1e3)
        if name == "MISSION_CURRENT":
            self.say(mavlink.MAVLink_mission_current_message(self.current, self.mission_total()))
        elif name == "GLOBAL_POSITION_INT":
            self.say(mavlink.MAVLink_global_position_int_message(boot_ms, lat, lon, alt_mm, height_mm, 0, 0, 0, 9000))
        elif name == "GPS_RAW_INT":
            self.say(mavlink.MAVLink_gps_raw_int_message(0, 6, lat, lon, alt_mm, 80, 120, 0, 0, 14))
        elif name == "SYS_STATUS":
            self.say(mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 15_900, 0, 87, 0, 0, 0, 0, 0, 0))
        elif name == "EXTENDED_SYS_STATE":
            flying = place.height_m > 0
            self.say(mavlink.MAVLink_extended_sys_state_message(0, 2 if flying else 1))
        elif name == "AUTOPILOT_VERSION":
            self.say(
                mavlink.MAVLink_autopilot_version_message(
                    _CAPABILITIES, self.version, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0
                )
            )
        elif name == "HOME_POSITION" and self.home is not None:
            home_lat, home_lon, home_alt = self.home
            self.say(
                mavlink.MAVLink_home_position_message(
                    round(home_lat * 1e7), round(home_lon * 1e7), round(home_alt * 1e3), 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
                )
            )
        else:
            return False
        return True


_BY_ID = {
    1: "SYS_STATUS", 24: "GPS_RAW_INT", 33: "GLOBAL_POSITION_INT", 42: "MISSION_CURRENT", 148: "AUTOPILOT_VERSION",
    242: "HOME_POSITION", 245: "EXTENDED_SYS_STATE",
}  # fmt: skip
