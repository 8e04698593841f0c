"""A simulated flight flown by the simulated vehicle: what its autopilot streams while the camera films."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.core.errors import DataError
from photomap_gis.core.similarity import FloatArray
from photomap_gis.simulate.geodesy import GeoFrame
from photomap_gis.simulate.truth import read_truth
from photomap_gis.simulate.vehicle.airframe import Airframe

_YAW_IN_EARTH_FRAME = 64


@dataclass(frozen=True, slots=True, eq=False)
class FlownPath:
    """What is streamed: ``(N,)`` seconds since the first frame, the receiver's places, the camera's angles."""

    times_s: FloatArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    alt_m: FloatArray
    height_m: FloatArray
    yaw_rad: FloatArray
    pitch_rad: FloatArray
    roll_rad: FloatArray
    began_utc_s: float

    @classmethod
    def of_simulation(cls, folder: Path) -> FlownPath:
        """Return the path of a simulated flight, with the errors that its receiver had; ``DataError`` without fixes."""
        truth = read_truth(folder)
        frames = [f for f in truth.frames if f.fix is not None]
        if len(frames) < 2:
            raise DataError(f"{folder}: the flight has no positions to stream")
        first_s = truth.frames[0].time_s
        geo = GeoFrame(truth.crs_wkt)
        turn_rad = geo.convergence_rad(frames[0].pose.easting_m, frames[0].pose.northing_m)
        stand = [f.pose.attitude(turn_rad) for f in frames]
        angles = np.array([(a.yaw_rad, a.pitch_rad, a.roll_rad) for a in stand])
        fixes = [f.fix for f in frames if f.fix is not None]
        return cls(
            np.array([f.time_s - first_s for f in frames]),
            np.array([f.lat_deg for f in fixes]),
            np.array([f.lon_deg for f in fixes]),
            np.array([f.alt_m if f.alt_m is not None else 0.0 for f in fixes]),
            np.array([f.pose.height_m - f.ground_height_m for f in frames]),
            np.unwrap(angles[:, 0]),
            angles[:, 1],
            np.unwrap(angles[:, 2]),
            first_s,
        )


class Flier:
    """Has a vehicle fly a path and stream it (``hz`` times a second), from when it is told to start."""

    def __init__(self, path: FlownPath, vehicle: Airframe, hz: float) -> None:
        self._path, self._vehicle, self._step_s = path, vehicle, 1.0 / hz
        self._began_s: float | None = None
        self._next_s = 0.0
        self._count = 0

    def start(self, now_s: float) -> None:
        """Take off now."""
        self._began_s = self._next_s = now_s
        self._vehicle.armed = True
        self._vehicle.set_mode(self._vehicle.mission_mode)

    def tick(self, now_s: float) -> None:
        """Stream what is due."""
        if self._began_s is None or now_s < self._next_s:
            return
        self._next_s = max(self._next_s + self._step_s, now_s)
        path, vehicle = self._path, self._vehicle
        at_s = now_s - self._began_s
        if at_s > path.times_s[-1]:
            if vehicle.armed:  # landed
                vehicle.armed = False
                vehicle.set_mode(vehicle.mode)
            return
        columns = (path.lat_deg, path.lon_deg, path.alt_m, path.height_m, path.yaw_rad, path.pitch_rad, path.roll_rad)
        lat, lon, alt, height, yaw, pitch, roll = (float(np.interp(at_s, path.times_s, c)) for c in columns)
        place = vehicle.place
        place.lat_deg, place.lon_deg, place.alt_amsl_m, place.height_m = lat, lon, alt, height
        boot_ms = vehicle.boot_ms
        vehicle.send("GLOBAL_POSITION_INT")
        heading = math.remainder(yaw, 2.0 * math.pi)
        vehicle.say(mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, heading, 0.0, 0.0, 0.0))
        q = _quaternion(yaw, pitch, roll)
        vehicle.say(
            mavlink.MAVLink_gimbal_device_attitude_status_message(
                0, 0, boot_ms, _YAW_IN_EARTH_FRAME, q, 0.0, 0.0, 0.0, 0
            )
        )
        if self._count % 5 == 0:
            vehicle.send("GPS_RAW_INT")
            vehicle.send("EXTENDED_SYS_STATE")
            utc_us = round((path.began_utc_s + at_s) * 1e6)
            vehicle.say(mavlink.MAVLink_system_time_message(utc_us, boot_ms))
        self._count += 1


def _quaternion(yaw: float, pitch: float, roll: float) -> list[float]:
    """``w x y z`` of the aerospace order."""
    cy, sy, cp, sp, cr, sr = (f(a / 2.0) for a in (yaw, pitch, roll) for f in (math.cos, math.sin))
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
