"""PX4's onboard logs (.ulg), read by pyulog; only the topics that matter are decoded."""

from __future__ import annotations

import contextlib
import io
import logging
from pathlib import Path

import numpy as np
from pyulog import ULog

from photomap_gis.core.errors import DataError
from photomap_gis.ingest.telemetry.assemble import Positions, Turns, points_of
from photomap_gis.ingest.telemetry.clean import clean_triggers
from photomap_gis.ingest.telemetry.rotations import (
    BODY_SIGMA_TILT_RAD,
    attitudes_of_quaternions,
    belly_camera,
    multiply,
    normalise,
    quaternions_of_euler,
)
from photomap_gis.ingest.telemetry.track import Clock, ModeChange, Track, Trigger

logger = logging.getLogger(__name__)

MAGIC = b"ULog\x01\x12\x35"
_GPS_TOPICS = ("vehicle_gps_position", "sensor_gps")
_TOPICS = [
    *_GPS_TOPICS, "vehicle_global_position", "vehicle_attitude", "home_position", "vehicle_status", "camera_capture",
    "camera_trigger", "gimbal_device_attitude_status", "mount_orientation",
]  # fmt: skip
_3D_FIX = 3
_FIRST_UNIX_US = 946_684_800_000_000
_YAW_IN_VEHICLE_FRAME, _YAW_IN_EARTH_FRAME, _YAW_LOCK = 32, 64, 16
_NAV_STATES = {
    0: "MANUAL", 1: "ALTCTL", 2: "POSCTL", 3: "AUTO_MISSION", 4: "AUTO_LOITER", 5: "AUTO_RTL", 10: "ACRO",
    14: "OFFBOARD", 15: "STABILIZED", 17: "AUTO_TAKEOFF", 18: "AUTO_LAND", 21: "ORBIT",
}  # fmt: skip

Topic = dict[str, np.ndarray]


def read_ulg(path: Path) -> Track:
    """Return the track of a PX4 log; a damaged or cut one gives what it holds and a warning."""
    try:
        # pyulog prints what it thinks of damaged logs: words of a library belong into the log.
        with path.open("rb") as file, contextlib.redirect_stdout(io.StringIO()) as said:
            log = ULog(file, _TOPICS, disable_str_exceptions=True)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error}); check the path and its rights") from error
    except Exception as error:  # pyulog raises whatever the damage leads it to: TypeError, struct.error, KeyError
        raise DataError(f"{path}: not a readable PX4 log ({type(error).__name__}: {error}); copy it again") from error
    if said.getvalue():
        logger.info("pyulog on %s: %s", path, said.getvalue().strip())
    warnings = [f"{path.name}: the log is damaged; what could be read is used"] if log.file_corruption else []
    topics: dict[str, Topic] = {}
    for data in log.data_list:
        if data.multi_id == 0 or data.name not in topics:
            topics[data.name] = data.data
    gps = next((topics[t] for t in _GPS_TOPICS if t in topics and len(topics[t]["timestamp"])), None)
    boot_to_utc_s = _boot_to_utc_s(gps, topics.get("camera_capture"))
    shift_s = boot_to_utc_s or 0.0
    body = _turns(topics.get("vehicle_attitude"), shift_s)
    gimbal = _gimbal(topics, body, shift_s)
    positions, has_home = _positions(topics, gps, shift_s)
    points, dropped = points_of(positions, body, gimbal)
    triggers = _triggers(topics, shift_s)
    if not points and not triggers:
        raise DataError(f"{path}: it holds no GPS positions; did the vehicle have a fix while it logged?")
    if boot_to_utc_s is None:
        warnings.append(f"{path.name}: it never learned the time of day; give --track-offset SECONDS")
    if not has_home:
        warnings.append(f"{path.name}: no home position, so heights above take-off are unknown")
    warnings += [f"{path.name}: {w}" for w in dropped]
    clock = Clock.BOOT if boot_to_utc_s is None else Clock.UTC
    modes = _modes(topics.get("vehicle_status"), shift_s)
    return Track(points, clock, str(path), triggers=triggers, modes=modes, warnings=tuple(warnings))


def _boot_to_utc_s(gps: Topic | None, capture: Topic | None) -> float | None:
    for topic, name in ((gps, "time_utc_usec"), (capture, "timestamp_utc")):
        if topic is not None and name in topic:
            utc_us, boot_us = topic[name].astype(np.float64), topic["timestamp"].astype(np.float64)
            good = utc_us > _FIRST_UNIX_US
            if good.any():
                return float(np.median(utc_us[good] - boot_us[good])) / 1e6
    return None


def _seconds(topic: Topic, shift_s: float) -> np.ndarray:
    stamps = topic["timestamp_sample"] if "timestamp_sample" in topic else topic["timestamp"]
    stamps = np.where(stamps > 0, stamps, topic["timestamp"])
    return stamps.astype(np.float64) / 1e6 + shift_s


def _degrees(topic: Topic, name: str) -> np.ndarray:
    """Return latitude or longitude in degrees; older logs write 1e-7 degrees as integers."""
    long = {"lat": "latitude_deg", "lon": "longitude_deg"}[name]
    values = topic[long] if long in topic else topic[name]
    return values / 1e7 if values.dtype.kind in "iu" else values.astype(np.float64)


def _altitude_m(topic: Topic) -> np.ndarray:
    if "altitude_msl_m" in topic:
        return topic["altitude_msl_m"].astype(np.float64)
    values = topic["alt"]
    return values / 1e3 if values.dtype.kind in "iu" else values.astype(np.float64)


def _positions(topics: dict[str, Topic], gps: Topic | None, shift_s: float) -> tuple[Positions, bool]:
    """Return the estimator's positions where they are logged, else the receiver's; also whether home is known."""
    nothing = np.empty(0)
    accuracy_s, accuracy = nothing, nothing
    if gps is not None:
        accuracy_s = gps["timestamp"].astype(np.float64) / 1e6 + shift_s
        accuracy = np.where(gps["eph"] > 0, gps["eph"], np.nan) if "eph" in gps else np.full(len(accuracy_s), np.nan)
    home_alt = _home_altitude_m(topics.get("home_position"))
    estimate = topics.get("vehicle_global_position")
    if estimate is not None and len(estimate["timestamp"]):
        times_s, lat, lon = _seconds(estimate, shift_s), _degrees(estimate, "lat"), _degrees(estimate, "lon")
        alt = _altitude_m(estimate)
        sigma = np.interp(times_s, accuracy_s, accuracy) if len(accuracy_s) else None
    elif gps is not None:
        times_s, lon, alt, sigma = accuracy_s, _degrees(gps, "lon"), _altitude_m(gps), accuracy
        lat = np.where(gps["fix_type"] >= _3D_FIX, _degrees(gps, "lat"), np.nan)
    else:
        return Positions.of(nothing, nothing, nothing), False
    height = None if home_alt is None else alt - home_alt
    return Positions.of(times_s, lat, lon, alt_m=alt, height_m=height, sigma_m=sigma), home_alt is not None


def _home_altitude_m(home: Topic | None) -> float | None:
    if home is None or not len(home["timestamp"]):
        return None
    valid = home["valid_alt"] > 0 if "valid_alt" in home else np.isfinite(home["alt"])
    return float(home["alt"][valid][-1]) if valid.any() else None


def _quaternions(topic: Topic, name: str = "q") -> np.ndarray:
    return np.stack([topic[f"{name}[{i}]"] for i in range(4)], axis=1).astype(np.float64)


def _turns(attitude: Topic | None, shift_s: float) -> Turns:
    if attitude is None or "q[0]" not in attitude:
        return Turns(np.empty(0), np.empty((0, 4)))
    return Turns.of(_seconds(attitude, shift_s), _quaternions(attitude))


def _gimbal(topics: dict[str, Topic], body: Turns, shift_s: float) -> Turns | None:
    device = topics.get("gimbal_device_attitude_status")
    if device is not None and "q[0]" in device and len(device["timestamp"]):
        times_s = _seconds(device, shift_s)
        flags = device["device_flags"].astype(int) if "device_flags" in device else np.zeros(len(times_s), dtype=int)
        earth = (flags & _YAW_IN_EARTH_FRAME > 0) | ((flags & _YAW_IN_VEHICLE_FRAME == 0) & (flags & _YAW_LOCK > 0))
        turn = np.where(earth, 0.0, body.yaw_rad(times_s))
        return Turns.of(times_s, multiply(quaternions_of_euler(turn, 0 * turn, 0 * turn), _quaternions(device)))
    mount = topics.get("mount_orientation")
    if mount is not None and "attitude_euler_angle[0]" in mount and len(mount["timestamp"]):
        times_s = _seconds(mount, shift_s)
        roll, pitch, yaw = (mount[f"attitude_euler_angle[{i}]"].astype(np.float64) for i in range(3))
        if roll.any() or pitch.any() or yaw.any():
            return Turns.of_euler(times_s, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw + body.yaw_rad(times_s))
    return None


def _triggers(topics: dict[str, Topic], shift_s: float) -> tuple[Trigger, ...]:
    """Return the shots: with positions from camera_capture, else the moments of camera_trigger."""
    capture = topics.get("camera_capture")
    if capture is not None and len(capture["timestamp"]):
        good = capture["result"] > 0 if "result" in capture else np.ones(len(capture["timestamp"]), dtype=bool)
        times_s = _shot_times_s(capture, shift_s)
        attitudes = attitudes_of_quaternions(
            belly_camera(normalise(_quaternions(capture))), sigma_tilt_rad=BODY_SIGMA_TILT_RAD
        )
        height = capture.get("ground_distance", np.full(len(times_s), np.nan))
        rows = zip(times_s, capture["seq"], capture["lat"], capture["lon"], capture["alt"], height, attitudes, good,
                   strict=True)  # fmt: skip
        return clean_triggers(
            Trigger(float(t), int(i), float(lat), float(lon), float(alt), float(h) if h > 0 else None, a)
            for t, i, lat, lon, alt, h, a, ok in rows
            if ok
        )
    moments = topics.get("camera_trigger")
    if moments is None:
        return ()
    return clean_triggers(
        Trigger(float(t), int(i)) for t, i in zip(_shot_times_s(moments, shift_s), moments["seq"], strict=True)
    )


def _shot_times_s(topic: Topic, shift_s: float) -> np.ndarray:
    boot_s = topic["timestamp"].astype(np.float64) / 1e6 + shift_s
    if "timestamp_utc" not in topic:
        return boot_s
    utc_us = topic["timestamp_utc"].astype(np.float64)
    return np.where(utc_us > _FIRST_UNIX_US, utc_us / 1e6, boot_s)


def _modes(status: Topic | None, shift_s: float) -> tuple[ModeChange, ...]:
    if status is None or "nav_state" not in status:
        return ()
    states, times_s = status["nav_state"].astype(int), status["timestamp"].astype(np.float64) / 1e6 + shift_s
    changes = np.flatnonzero(np.diff(states, prepend=-1) != 0)
    return tuple(ModeChange(float(times_s[i]), _NAV_STATES.get(int(states[i]), f"nav {states[i]}")) for i in changes)
