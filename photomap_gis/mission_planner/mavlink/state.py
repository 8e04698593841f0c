"""What a vehicle says of itself, message by message, as one frozen value."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.core.mission import Autopilot, Home

Message = Any
"""A message of pymavlink's ardupilotmega dialect (MAVLink 2)."""

_AUTOPILOTS = {
    mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: Autopilot.ARDUPILOT,
    mavlink.MAV_AUTOPILOT_PX4: Autopilot.PX4,
}
_NOT_VEHICLES = {
    mavlink.MAV_TYPE_GCS, mavlink.MAV_TYPE_ANTENNA_TRACKER, mavlink.MAV_TYPE_GIMBAL, mavlink.MAV_TYPE_CAMERA,
    mavlink.MAV_TYPE_ADSB, mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
}  # fmt: skip
_NO_TAKEOFF = {mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_TYPE_SURFACE_BOAT, mavlink.MAV_TYPE_SUBMARINE}
_FLIES_LIKE_A_PLANE = {16, 17, *range(19, 26), 28, 47}  # flapping wing, kite, VTOLs, parafoil, gyrodyne
_RUNS_MISSION = {Autopilot.ARDUPILOT: {"AUTO", "AUTO_RTL"}, Autopilot.PX4: {"MISSION"}}
_UNKNOWN_U16, _UNKNOWN_I8 = 0xFFFF, -1
_IN_AIR_M = 2.0


@dataclass(frozen=True, slots=True)
class VehicleState:
    """Who is there and how it is; what was not heard yet is None. Degrees, metres, volts, percent."""

    system: int
    component: int
    autopilot: Autopilot | None
    type: str
    mode: str
    armed: bool
    status: str
    heard_s: float
    version: str | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    alt_amsl_m: float | None = None
    height_m: float | None = None
    heading_deg: float | None = None
    fix: int | None = None
    satellites: int | None = None
    battery_v: float | None = None
    battery_percent: int | None = None
    landed: bool | None = None
    home: Home | None = None
    mission_seq: int | None = None
    mission_total: int | None = None
    text: str | None = None

    @property
    def flies_mission(self) -> bool:
        """Whether the vehicle flies its mission now: ArduPilot's AUTO (on the ground too), PX4's MISSION once armed.

        PX4 rests in MISSION on the ground; ArduPilot that was put to AUTO before an upload never takes off.
        """
        if self.autopilot is None or self.mode not in _RUNS_MISSION[self.autopilot]:
            return False
        return self.armed or self.autopilot is Autopilot.ARDUPILOT

    @property
    def is_in_air(self) -> bool:
        """Whether it flies, as far as it says so: armed, and off the ground by its own word or its height."""
        if self.landed is not None:
            return self.armed and not self.landed
        return self.armed and (self.height_m or 0.0) > _IN_AIR_M

    @property
    def takes_off(self) -> bool:
        """Whether this kind of vehicle needs a take-off item: all but rovers and boats."""
        return self.type not in {type_name(t) for t in _NO_TAKEOFF}

    def as_json(self) -> dict[str, Any]:
        """Return the state for scripts."""
        fields = asdict(self)
        fields.pop("heard_s")
        seq, total = fields.pop("mission_seq"), fields.pop("mission_total")
        # Items count from 1 for people, as in a plan; ArduPilot has home at 0, PX4 its first item.
        item = seq + 1 if seq is not None and self.autopilot is Autopilot.PX4 else seq
        fields["mission"] = {"current": item, "total": total}
        return fields


def type_name(number: int) -> str:
    """Return a ``MAV_TYPE`` as a word, ``quadrotor``."""
    entry = mavlink.enums["MAV_TYPE"].get(number)
    return entry.name.removeprefix("MAV_TYPE_").lower() if entry else f"type {number}"


def is_vehicle(message: Message) -> bool:
    """Whether a heartbeat is an autopilot's: not a ground station's, gimbal's or companion computer's."""
    return (
        message.get_type() == "HEARTBEAT"
        and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
        and message.type not in _NOT_VEHICLES
    )


def first_state(heartbeat: Message, now_s: float) -> VehicleState:
    """Return what a vehicle's first heartbeat says."""
    state = VehicleState(
        system=heartbeat.get_srcSystem(),
        component=heartbeat.get_srcComponent(),
        autopilot=_AUTOPILOTS.get(heartbeat.autopilot),
        type=type_name(heartbeat.type),
        mode="",
        armed=False,
        status="",
        heard_s=now_s,
    )
    return updated(state, heartbeat, now_s)


def updated(state: VehicleState, message: Message, now_s: float) -> VehicleState:
    """Return the state after a message of the same vehicle."""
    change = _CHANGES.get(message.get_type())
    return replace(state, heard_s=now_s, **(change(state, message) if change else {}))


def _heartbeat(state: VehicleState, m: Message) -> dict[str, Any]:
    if not is_vehicle(m) or m.get_srcComponent() != state.component:
        return {}
    status = mavlink.enums["MAV_STATE"].get(m.system_status)
    return {
        "mode": mode_name(state.autopilot, m.type, m.custom_mode),
        "armed": bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
        "status": status.name.removeprefix("MAV_STATE_").lower() if status else str(m.system_status),
    }


def mode_name(autopilot: Autopilot | None, vehicle_type: int, custom_mode: int) -> str:
    """Return the flight mode by the autopilot's own name."""
    if autopilot is Autopilot.PX4:
        name: str = mavutil.interpret_px4_mode(0, custom_mode)
        return name
    names = mavutil.mode_mapping_bynumber(vehicle_type) if autopilot is Autopilot.ARDUPILOT else None
    if names is None and autopilot is Autopilot.ARDUPILOT:
        # Kinds that pymavlink does not list: VTOLs and the like fly by Plane's modes, whatever else hovers by Copter's.
        plane = vehicle_type in _FLIES_LIKE_A_PLANE
        names = mavutil.mode_mapping_bynumber(mavlink.MAV_TYPE_FIXED_WING if plane else mavlink.MAV_TYPE_QUADROTOR)
    return (names or {}).get(custom_mode) or f"mode {custom_mode}"


def _position(state: VehicleState, m: Message) -> dict[str, Any]:
    if m.lat == 0 and m.lon == 0:  # no estimate yet
        return {}
    return {
        "lat_deg": m.lat / 1e7,
        "lon_deg": m.lon / 1e7,
        "alt_amsl_m": m.alt / 1e3,
        "height_m": m.relative_alt / 1e3,
        "heading_deg": None if m.hdg == _UNKNOWN_U16 else m.hdg / 100.0,
    }


def _battery(state: VehicleState, m: Message) -> dict[str, Any]:
    return {
        "battery_v": None if m.voltage_battery in (0, _UNKNOWN_U16) else m.voltage_battery / 1e3,
        "battery_percent": None if m.battery_remaining == _UNKNOWN_I8 else m.battery_remaining,
    }


def _home(state: VehicleState, m: Message) -> dict[str, Any]:
    if m.latitude == 0 and m.longitude == 0:
        return {}
    return {"home": Home(m.latitude / 1e7, m.longitude / 1e7, m.altitude / 1e3)}


def _landed(state: VehicleState, m: Message) -> dict[str, Any]:
    if m.landed_state == mavlink.MAV_LANDED_STATE_UNDEFINED:
        return {}
    return {"landed": m.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND}


def _mission(state: VehicleState, m: Message) -> dict[str, Any]:
    known = m.total not in (0, _UNKNOWN_U16)
    return {"mission_seq": m.seq, "mission_total": m.total if known else state.mission_total}


def _version(state: VehicleState, m: Message) -> dict[str, Any]:
    number = m.flight_sw_version
    kind = {0: "-dev", 64: "-alpha", 128: "-beta", 192: "-rc"}.get(number & 0xFF, "")
    return {"version": f"{number >> 24 & 0xFF}.{number >> 16 & 0xFF}.{number >> 8 & 0xFF}{kind}" if number else None}


def _fix(state: VehicleState, m: Message) -> dict[str, Any]:
    return {"fix": m.fix_type, "satellites": None if m.satellites_visible == 0xFF else m.satellites_visible}


def _text(state: VehicleState, m: Message) -> dict[str, Any]:
    # A vehicle's text may hold anything; what is not printable would reach a terminal.
    text = "".join(c for c in str(m.text) if c.isprintable()).strip()
    return {"text": text} if text else {}


_CHANGES = {
    "HEARTBEAT": _heartbeat,
    "GLOBAL_POSITION_INT": _position,
    "SYS_STATUS": _battery,
    "HOME_POSITION": _home,
    "EXTENDED_SYS_STATE": _landed,
    "MISSION_CURRENT": _mission,
    "AUTOPILOT_VERSION": _version,
    "GPS_RAW_INT": _fix,
    "STATUSTEXT": _text,
}


def distance_m(lat_a_deg: float, lon_a_deg: float, lat_b_deg: float, lon_b_deg: float) -> float:
    """Return the great-circle distance of two places on a sphere of the Earth's mean radius (haversine)."""
    a, b = math.radians(lat_a_deg), math.radians(lat_b_deg)
    half_lat, half_lon = (b - a) / 2, math.radians(lon_b_deg - lon_a_deg) / 2
    h = math.sin(half_lat) ** 2 + math.cos(a) * math.cos(b) * math.sin(half_lon) ** 2
    return 2 * 6_371_008.8 * math.asin(min(1.0, math.sqrt(h)))
