"""What a column's header means: its quantity and the factor to SI units, as exporters really write it."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import StrEnum


class Quantity(StrEnum):
    """What a column of a flight log can hold."""

    LAT = "lat"
    LON = "lon"
    STAMP = "stamp"  # a date with a time, or Unix time
    STAMP_LOCAL = "stamp_local"
    DATE = "date"
    TIME_OF_DAY = "time_of_day"
    ELAPSED = "elapsed"  # seconds since the log's start
    ALT = "alt"
    HEIGHT = "height"
    YAW = "yaw"
    PITCH = "pitch"
    ROLL = "roll"
    GIMBAL_YAW = "gimbal_yaw"
    GIMBAL_PITCH = "gimbal_pitch"
    GIMBAL_ROLL = "gimbal_roll"
    SIGMA = "sigma"
    FOCAL_35MM = "focal_35mm"
    HFOV = "hfov"
    PHOTO = "photo"


@dataclass(frozen=True, slots=True)
class Column:
    """One understood column: its place in the row, the factor to metres, seconds or radians, its header as written."""

    index: int
    factor: float
    header: str = ""

    @property
    def names_utc(self) -> bool:
        """Whether the header says that the times are UTC."""
        return "utc" in self.header.lower() or "gmt" in self.header.lower()


# In order of preference: the first name that a file has wins.
_NAMES: dict[Quantity, tuple[str, ...]] = {
    Quantity.LAT: ("latitude", "lat", "gps_latitude", "gps_lat", "latitude_deg", "lat_deg", "osd_latitude", "gps_lati"),
    Quantity.LON: (
        "longitude",
        "lon",
        "lng",
        "long",
        "longtitude",
        "gps_longitude",
        "gps_lon",
        "gps_lng",
        "gps_long",
        "longitude_deg",
        "lon_deg",
        "osd_longitude",
    ),
    Quantity.STAMP: (
        "datetime_utc",
        "timestamp_utc",
        "time_utc",
        "utc_time",
        "utc",
        "datetime",
        "date_time",
        "timestamp",
        "time_stamp",
        "gps_time",
        "gps_datetime",
        "unix_time",
        "unix",
        "epoch",
        "time_unix",
        "custom_updatetime_utc",
        "time",
    ),
    Quantity.STAMP_LOCAL: ("datetime_local", "local_time", "time_local", "custom_updatetime", "updatetime"),
    Quantity.DATE: ("date", "date_utc", "utc_date", "date_local", "custom_date_local", "custom_date", "gps_date"),
    Quantity.TIME_OF_DAY: ("time_of_day", "custom_updatetime_local", "custom_updatetime", "updatetime_local", "time"),
    Quantity.ELAPSED: (
        "time_millisecond",
        "elapsed_time",
        "elapsed",
        "time_s",
        "time_ms",
        "seconds",
        "sec",
        "t",
        "t_s",
        "osd_flytime_s",
        "flytime_s",
        "offset_time",
        "offsettime",
        "video_time",
        "pts",
        "pts_s",
        "timestamp_s",
        "timestamp_ms",
        "time",
    ),
    Quantity.HEIGHT: (
        "height_above_takeoff",
        "rel_alt",
        "relative_altitude",
        "relative_alt",
        "relalt",
        "alt_rel",
        "altitude_relative",
        "altitude_rel",
        "height_above_takeoff_m",
        "height",
        "height_m",
        "osd_height",
        "height_agl",
        "agl",
        "alt_agl",
        "altitude_agl",
        "above_takeoff",
        "rel_alt_m",
        "relative_height",
    ),
    Quantity.ALT: (
        "altitude_above_sealevel",
        "abs_alt",
        "alt_msl",
        "altitude_msl",
        "amsl",
        "absolute_altitude",
        "gps_altitude",
        "gps_alt",
        "altitude",
        "alt",
        "alt_m",
        "altitude_m",
        "elevation",
        "ele",
        "osd_altitude",
        "height_msl",
    ),
    Quantity.YAW: (
        "yaw",
        "compass_heading",
        "heading",
        "hdg",
        "yaw_deg",
        "heading_deg",
        "osd_yaw",
        "drone_yaw",
        "flight_yaw",
        "aircraft_yaw",
        "uav_yaw",
        "true_heading",
    ),
    Quantity.PITCH: ("pitch", "pitch_deg", "osd_pitch", "drone_pitch", "flight_pitch", "aircraft_pitch", "uav_pitch"),
    Quantity.ROLL: ("roll", "roll_deg", "osd_roll", "drone_roll", "flight_roll", "aircraft_roll", "uav_roll"),
    Quantity.GIMBAL_YAW: (
        "gimbal_heading",
        "gimbal_yaw",
        "gimbal_yaw_deg",
        "gimbalyaw",
        "gimbalheading",
        "camera_yaw",
        "gb_yaw",
        "cam_yaw",
    ),
    Quantity.GIMBAL_PITCH: ("gimbal_pitch", "gimbal_pitch_deg", "gimbalpitch", "camera_pitch", "gb_pitch", "cam_pitch"),
    Quantity.GIMBAL_ROLL: ("gimbal_roll", "gimbal_roll_deg", "gimbalroll", "camera_roll", "gb_roll", "cam_roll"),
    Quantity.SIGMA: ("sigma_m", "sigma", "horizontal_accuracy", "accuracy", "hacc", "h_acc", "accuracy_m", "hpos_acc"),
    Quantity.FOCAL_35MM: ("focal_35mm", "focal_length_35mm", "focal_len"),
    Quantity.HFOV: ("hfov", "hfov_deg", "fov_h", "horizontal_fov"),
    Quantity.PHOTO: ("isphoto", "is_photo", "istakingphoto", "camera_isphoto", "photo", "shutter_trigger"),
}

_LENGTHS = {
    "ft": 0.3048,
    "feet": 0.3048,
    "foot": 0.3048,
    "m": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "metres": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "km": 1000.0,
}
_TIMES = {
    "ms": 1e-3,
    "millisecond": 1e-3,
    "milliseconds": 1e-3,
    "us": 1e-6,
    "usec": 1e-6,
    "s": 1.0,
    "sec": 1.0,
    "seconds": 1.0,
    "min": 60.0,
}
_ANGLES = {"rad": 1.0, "radian": 1.0, "radians": 1.0, "cdeg": math.radians(0.01)}
_IN_METRES = (Quantity.ALT, Quantity.HEIGHT, Quantity.SIGMA)
_IN_RADIANS = (
    Quantity.YAW,
    Quantity.PITCH,
    Quantity.ROLL,
    Quantity.GIMBAL_YAW,
    Quantity.GIMBAL_PITCH,
    Quantity.GIMBAL_ROLL,
    Quantity.HFOV,
)


def understand(header: list[str]) -> dict[Quantity, Column]:
    """Return the columns that a header names; a column may serve several quantities, the reader chooses."""
    named: dict[str, tuple[int, str]] = {}
    for index, cell in enumerate(header):
        for name, unit in _spellings(cell):
            named.setdefault(name, (index, unit))
    columns: dict[Quantity, Column] = {}
    for quantity, names in _NAMES.items():
        for name in names:
            if name in named:
                index, unit = named[name]
                columns[quantity] = Column(index, _factor(quantity, unit, name), header[index])
                break
    bare = {name for name, _ in (s for cell in header for s in _spellings(cell))}
    if "ascent" in bare and "altitude_above_sealevel" not in bare and Quantity.HEIGHT not in columns:
        # Flytrex and Litchi logs: 'ascent' is above take-off.
        index, unit = named["ascent"]
        columns[Quantity.HEIGHT] = Column(index, _factor(Quantity.HEIGHT, unit, "ascent"), header[index])
    return columns


def _spellings(cell: str) -> list[tuple[str, str]]:
    """Return the names under which a header cell may be known, each with its unit: the unit also as part of it."""
    text = cell.strip().strip('"').lower().lstrip("\ufeff")
    unit_match = re.search(r"[(\[]([^)\]]{0,16})[)\]]", text)
    unit = unit_match.group(1).strip() if unit_match else ""
    bare = re.sub(r"[(\[].*?[)\]]", "", text)
    name = re.sub(r"[^a-z0-9]+", "_", bare).strip("_")
    spelled = [(name, unit)]
    if unit:
        spelled.insert(0, (f"{name}_{re.sub(r'[^a-z0-9]+', '', unit)}", unit))
    elif (tail := name.rsplit("_", 1))[-1] in {**_LENGTHS, **_TIMES, **_ANGLES} and len(tail) == 2:
        spelled.append((tail[0], tail[1]))
    return spelled


def _factor(quantity: Quantity, unit: str, name: str) -> float:
    if quantity in _IN_METRES:
        return _LENGTHS.get(unit, 1.0)
    if quantity is Quantity.ELAPSED:
        return _TIMES.get(unit, 1e-3 if name.endswith(("_ms", "millisecond")) else 1.0)
    if quantity in _IN_RADIANS:
        return _ANGLES.get(unit, math.radians(1.0))
    return 1.0
