"""MAVLink telemetry logs of ground stations (.tlog): eight bytes of time, then one packet, again and again.

The packets are cut out here and only the dozen kinds that matter are decoded, by pymavlink's tables: its own reader
decodes all of them at thirty times the cost, and stops at damage that this one steps over.
"""

from __future__ import annotations

import mmap
import struct
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from photomap_gis.core.errors import DataError
from photomap_gis.ingest.telemetry.assemble import Positions, Turns, points_of
from photomap_gis.ingest.telemetry.clean import clean_triggers
from photomap_gis.ingest.telemetry.modes import COPTER_MODES, PLANE_MODES, px4_mode
from photomap_gis.ingest.telemetry.rotations import (
    BODY_SIGMA_TILT_RAD,
    attitudes_of_quaternions,
    belly_camera,
    multiply,
    quaternions_of_euler,
)
from photomap_gis.ingest.telemetry.track import Clock, ModeChange, Track, TrackPoint, Trigger

_V1, _V2 = 0xFE, 0xFD
WANTED = {
    mavlink.mavlink_map[i].msgname: mavlink.mavlink_map[i] for i in (0, 2, 24, 30, 31, 33, 112, 158, 180, 263, 265, 285)
}
_BY_ID = {m.id: m for m in WANTED.values()}
_FIRST_UNIX_US, _LAST_UNIX_US = 946_684_800_000_000, 4_102_444_800_000_000  # the years 2000 to 2100
_YAW_IN_VEHICLE_FRAME, _YAW_IN_EARTH_FRAME, _YAW_LOCK = 32, 64, 16
_3D_FIX = 3


@dataclass(slots=True)
class Messages:
    """The wanted messages of one vehicle: per kind the record's time and the decoded fields by name."""

    of: dict[str, list[tuple[float, dict[str, Any]]]] = field(default_factory=lambda: defaultdict(list))

    def column(self, kind: str, name: str) -> np.ndarray:
        """``(N,)`` values of a field."""
        return np.array([m[name] for _, m in self.of[kind]], dtype=np.float64)


def looks_like_tlog(head: bytes) -> bool:
    """Whether bytes begin with a believable time and a MAVLink packet, twice."""
    first = _packet_at(head, 0, len(head))
    return first is not None and (first[2] >= len(head) or _packet_at(head, first[2], len(head)) is not None)


def read_tlog(path: Path, *, by_record_clock: bool = False) -> Track:
    """Return the track of the vehicle that reports most positions.

    UTC is the vehicle's own where it tells, else the ground station's. ``by_record_clock``: the ground station's in any
    case, since a recording beside the log has it, too.
    """
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            vehicles, skipped = _scan(data)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read as a telemetry log ({error}); check the file") from error
    warnings = []
    if skipped:
        warnings.append(f"{path.name}: {skipped} damaged bytes were stepped over")
    if not vehicles:
        raise DataError(f"{path}: no MAVLink packets found; is this a .tlog of a ground station?")
    chosen = max(vehicles, key=lambda v: _rank(vehicles[v]))
    others = [v for v in vehicles if v != chosen and _rank(vehicles[v])[0]]
    if others:
        warnings.append(f"{path.name}: vehicle {chosen} is used, also heard: {', '.join(map(str, sorted(others)))}")
    return _track(vehicles[chosen], path, warnings, by_record_clock)


def _rank(m: Messages) -> tuple[int, int]:
    return len(m.of["GLOBAL_POSITION_INT"]) + len(m.of["GPS_RAW_INT"]), len(m.of["ATTITUDE"])


def _packet_at(data: bytes | mmap.mmap, at: int, size: int) -> tuple[int, int, int] | None:
    """Return (record time in us, message id, end) of the record at an offset, ``None`` where there is none."""
    if at + 8 + 8 > size:
        return None
    (time_us,) = struct.unpack_from(">Q", data, at)
    if not _FIRST_UNIX_US < time_us < _LAST_UNIX_US:
        return None
    start = at + 8
    magic, length = data[start], data[start + 1]
    if magic == _V1:
        return time_us, data[start + 5], start + 8 + length
    if magic == _V2 and start + 10 <= size:
        signed = 13 if data[start + 2] & 1 else 0
        return time_us, int.from_bytes(data[start + 7 : start + 10], "little"), start + 12 + length + signed
    return None


def _scan(data: mmap.mmap) -> tuple[dict[int, Messages], int]:
    """Cut the log into packets and decode the wanted ones, per system id."""
    vehicles: dict[int, Messages] = defaultdict(Messages)
    at, skipped, size = 0, 0, len(data)
    while at + 16 <= size:
        record = _packet_at(data, at, size)
        if record is None or record[2] > size:
            skipped += 1
            at += 1
            continue
        time_us, message_id, end = record
        kind = _BY_ID.get(message_id)
        if kind is not None:
            fields = _decode(data, at + 8, kind)
            if fields is None:  # a false start: look for the next packet inside it
                skipped += 1
                at += 1
                continue
            system = data[at + 8 + (3 if data[at + 8] == _V1 else 5)]
            vehicles[system].of[kind.msgname].append((time_us / 1e6, fields))
        at = end
    return dict(vehicles), skipped


def _decode(data: mmap.mmap, start: int, kind: Any) -> dict[str, Any] | None:
    """Return a packet's fields by name, ``None`` where its checksum does not hold."""
    header = 6 if data[start] == _V1 else 10
    length = data[start + 1]
    body = data[start + 1 : start + header + length]
    crc = x25crc(body)
    crc.accumulate(struct.pack("B", kind.crc_extra))
    if crc.crc != int.from_bytes(data[start + header + length : start + header + length + 2], "little"):
        return None
    payload = body[header - 1 :]
    size = kind.unpacker.size
    values = kind.unpacker.unpack(payload[:size].ljust(size, b"\0"))  # MAVLink 2 cuts trailing zeros
    fields: dict[str, Any] = {}
    at = 0
    for name, count in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):
        is_text = isinstance(values[at], bytes)
        fields[name] = values[at] if count == 0 or is_text else values[at : at + count]
        at += 1 if count == 0 or is_text else count
    return fields


def _track(m: Messages, path: Path, warnings: list[str], by_record_clock: bool) -> Track:
    if by_record_clock:
        m.of.pop("SYSTEM_TIME", None)
        for record_s, fields in m.of["GPS_RAW_INT"]:
            fields["time_usec"] = round(record_s * 1e6)
    boot_to_utc_s = _boot_to_utc_s(m)
    positions = _positions(m, boot_to_utc_s)
    body = Turns.of_euler(
        m.column("ATTITUDE", "time_boot_ms") / 1e3 + boot_to_utc_s,
        roll_rad=m.column("ATTITUDE", "roll"),
        pitch_rad=m.column("ATTITUDE", "pitch"),
        yaw_rad=m.column("ATTITUDE", "yaw"),
    )
    gimbal = _gimbal(m, boot_to_utc_s, body, path, warnings)
    points, dropped = points_of(positions, body, gimbal)
    warnings += [f"{path.name}: {w}" for w in dropped]
    triggers = _triggers(m, boot_to_utc_s)
    if not points and not triggers:
        raise DataError(f"{path}: it holds no GPS positions; was the vehicle connected and did it have a fix?")
    return Track(
        points,
        Clock.UTC,
        str(path),
        triggers=triggers,
        modes=_modes(m, _record_to_utc_s(m, boot_to_utc_s)),
        warnings=tuple(warnings),
    )


def points_of_messages(m: Messages) -> tuple[TrackPoint, ...]:
    """Return the camera's track as far as messages tell it, on the vehicle's own clock (seconds since its boot)."""
    positions = _positions(m, 0.0)
    body = Turns.of_euler(
        m.column("ATTITUDE", "time_boot_ms") / 1e3,
        roll_rad=m.column("ATTITUDE", "roll"),
        pitch_rad=m.column("ATTITUDE", "pitch"),
        yaw_rad=m.column("ATTITUDE", "yaw"),
    )
    points, _ = points_of(positions, body, _gimbal(m, 0.0, body, Path("mavlink"), []))
    return points


def _boot_to_utc_s(m: Messages) -> float:
    """What to add to the vehicle's seconds since boot to reach UTC: by its own clock, else by the ground station's."""
    pairs = [
        int(f["time_unix_usec"]) / 1e6 - int(f["time_boot_ms"]) / 1e3
        for _, f in m.of["SYSTEM_TIME"]
        if _FIRST_UNIX_US < int(f["time_unix_usec"]) < _LAST_UNIX_US
    ]
    if pairs:
        return median(pairs)
    heard = [
        record_s - float(f["time_boot_ms"]) / 1e3
        for kind in ("GLOBAL_POSITION_INT", "ATTITUDE")
        for record_s, f in m.of[kind]
    ]
    return median(heard) if heard else 0.0


def _utc_s(stamps_us: np.ndarray, boot_to_utc_s: float) -> np.ndarray:
    """Read a field that holds microseconds either of UTC or since boot."""
    return np.where(stamps_us > _FIRST_UNIX_US, stamps_us / 1e6, stamps_us / 1e6 + boot_to_utc_s)


def _positions(m: Messages, boot_to_utc_s: float) -> Positions:
    """Return the estimator's positions where there are any, else the receiver's."""
    raw_s = _utc_s(m.column("GPS_RAW_INT", "time_usec"), boot_to_utc_s)
    accuracy = m.column("GPS_RAW_INT", "h_acc") / 1e3
    accuracy = np.where(accuracy > 0, accuracy, np.nan)
    fixed = m.column("GPS_RAW_INT", "fix_type") >= _3D_FIX
    kind = "GLOBAL_POSITION_INT"
    if not m.of[kind]:
        lat = np.where(fixed, m.column("GPS_RAW_INT", "lat") / 1e7, np.nan)
        lon, alt = m.column("GPS_RAW_INT", "lon") / 1e7, m.column("GPS_RAW_INT", "alt") / 1e3
        return Positions.of(raw_s, lat, lon, alt_m=alt, sigma_m=accuracy)
    times_s = m.column(kind, "time_boot_ms") / 1e3 + boot_to_utc_s
    sigma = np.full(len(times_s), np.nan)
    if len(raw_s):
        order = np.argsort(raw_s, kind="stable")
        nearest = order[np.clip(np.searchsorted(raw_s[order], times_s), 0, len(raw_s) - 1)]
        sigma = accuracy[nearest]
    return Positions.of(
        times_s,
        m.column(kind, "lat") / 1e7,
        m.column(kind, "lon") / 1e7,
        alt_m=m.column(kind, "alt") / 1e3,
        height_m=m.column(kind, "relative_alt") / 1e3,
        sigma_m=sigma,
    )


def _gimbal(m: Messages, boot_to_utc_s: float, body: Turns, path: Path, warnings: list[str]) -> Turns | None:
    """Return the gimbal's own attitude from the best message that tells it, ``None`` where none does."""
    kind = next((k for k in ("GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION", "MOUNT_STATUS") if m.of[k]), None)
    if kind is None:
        return None
    if kind == "GIMBAL_DEVICE_ATTITUDE_STATUS":
        times_s = m.column(kind, "time_boot_ms") / 1e3 + boot_to_utc_s
        q = np.array([f["q"] for _, f in m.of[kind]], dtype=np.float64)
        flags = m.column(kind, "flags").astype(int)
        earth = (flags & _YAW_IN_EARTH_FRAME > 0) | ((flags & _YAW_IN_VEHICLE_FRAME == 0) & (flags & _YAW_LOCK > 0))
        turn = np.where(earth, 0.0, body.yaw_rad(times_s))
        return Turns.of(times_s, multiply(quaternions_of_euler(turn, 0.0 * turn, 0.0 * turn), q))
    if kind == "MOUNT_ORIENTATION":
        times_s = m.column(kind, "time_boot_ms") / 1e3 + boot_to_utc_s
        roll, pitch, yaw = (np.radians(m.column(kind, n)) for n in ("roll", "pitch", "yaw"))
        absolute = np.radians(m.column(kind, "yaw_absolute"))
        heading = np.where(np.isfinite(absolute) & (absolute != 0.0), absolute, yaw + body.yaw_rad(times_s))
    else:
        # No time inside: the record's, which is later by the link's latency.
        times_s = np.array([s for s, _ in m.of[kind]], dtype=np.float64)
        times_s = times_s + _record_to_utc_s(m, boot_to_utc_s)
        pitch, roll, yaw = (np.radians(m.column(kind, f"pointing_{c}") / 100.0) for c in "abc")
        heading = yaw + body.yaw_rad(times_s)
    if not (pitch.any() or roll.any() or yaw.any()):
        warnings.append(f"{path.name}: the gimbal reports zeros only; the vehicle's attitude is used for the camera")
        return None
    return Turns.of_euler(times_s, roll_rad=roll, pitch_rad=pitch, yaw_rad=heading)


def _record_to_utc_s(m: Messages, boot_to_utc_s: float) -> float:
    """What to add to the ground station's clock to reach UTC."""
    ahead = [float(f["time_boot_ms"]) / 1e3 + boot_to_utc_s - record_s for record_s, f in m.of["ATTITUDE"]]
    return median(ahead) if ahead else 0.0


def _triggers(m: Messages, boot_to_utc_s: float) -> tuple[Trigger, ...]:
    """Return the shots: with position and attitude where the autopilot gives them, else their moments."""
    if m.of["CAMERA_FEEDBACK"]:
        kind = "CAMERA_FEEDBACK"
        times_s = _utc_s(m.column(kind, "time_usec"), boot_to_utc_s)
        roll, pitch, yaw = (np.radians(m.column(kind, n)) for n in ("roll", "pitch", "yaw"))
        attitudes = attitudes_of_quaternions(
            belly_camera(quaternions_of_euler(yaw, pitch, roll)), sigma_tilt_rad=BODY_SIGMA_TILT_RAD
        )
        columns = (
            times_s, m.column(kind, "img_idx"), m.column(kind, "lat") / 1e7, m.column(kind, "lng") / 1e7,
            m.column(kind, "alt_msl"), m.column(kind, "alt_rel"),
        )  # fmt: skip
        shots = [
            Trigger(t, int(i), lat, lon, alt, height, a)
            for t, i, lat, lon, alt, height, a in zip(*(c.tolist() for c in columns), attitudes, strict=True)
        ]
        return clean_triggers({(s.index, round(s.time_s, 3)): s for s in shots}.values())
    if m.of["CAMERA_IMAGE_CAPTURED"]:
        kind = "CAMERA_IMAGE_CAPTURED"
        times_s = m.column(kind, "time_boot_ms") / 1e3 + boot_to_utc_s
        columns = (
            times_s, m.column(kind, "image_index"), m.column(kind, "lat") / 1e7, m.column(kind, "lon") / 1e7,
            m.column(kind, "alt") / 1e3, m.column(kind, "relative_alt") / 1e3,
        )  # fmt: skip
        return clean_triggers(
            Trigger(t, int(i), lat, lon, alt, height)
            for t, i, lat, lon, alt, height in zip(*(c.tolist() for c in columns), strict=True)
        )
    kind = "CAMERA_TRIGGER"
    times_s = _utc_s(m.column(kind, "time_usec"), boot_to_utc_s)
    return clean_triggers(
        Trigger(t, int(i)) for t, i in zip(times_s.tolist(), m.column(kind, "seq").tolist(), strict=True)
    )


def _modes(m: Messages, record_to_utc_s: float) -> tuple[ModeChange, ...]:
    """Return the changes of the flight mode, by name where the autopilot's numbers are known.

    A heartbeat tells no time: its record's is taken, whose clock is ``record_to_utc_s`` behind UTC.
    """
    modes: list[ModeChange] = []
    autopilots = Counter(f["type"] for _, f in m.of["HEARTBEAT"] if f["autopilot"] != mavlink.MAV_AUTOPILOT_INVALID)
    if not autopilots:
        return ()
    kinds = {f["autopilot"] for _, f in m.of["HEARTBEAT"]}
    is_px4 = mavlink.MAV_AUTOPILOT_PX4 in kinds
    autopilot = mavlink.MAV_AUTOPILOT_PX4 if is_px4 else mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    vehicle = int(autopilots.most_common(1)[0][0])
    for record_s, f in m.of["HEARTBEAT"]:
        if f["autopilot"] == mavlink.MAV_AUTOPILOT_INVALID:
            continue  # a gimbal or camera of the same vehicle
        name = mode_name(autopilot, vehicle, int(f["custom_mode"]))
        if not modes or modes[-1].name != name:
            modes.append(ModeChange(record_s + record_to_utc_s, name))
    return tuple(modes)


def mode_name(autopilot: int, vehicle_type: int, mode: int) -> str:
    """Return a flight mode's name by the numbers of a heartbeat."""
    if autopilot == mavlink.MAV_AUTOPILOT_PX4:
        return px4_mode(mode)
    return _mode_names(vehicle_type).get(mode, f"mode {mode}")


def _mode_names(vehicle_type: int) -> dict[int, str]:
    """ArduPilot's mode numbers for the kinds of vehicle that take photos."""
    vtols = range(19, 26)  # MAV_TYPE_VTOL_..., whose names change between versions of the dialect
    if vehicle_type == mavlink.MAV_TYPE_FIXED_WING or vehicle_type in vtols:
        return PLANE_MODES
    return COPTER_MODES
