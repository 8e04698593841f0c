"""What an autopilot holds: mission items, a fence and rally points, in MAVLink's own terms.

Files (``.plan``, ``.waypoints``) and the MAVLink exchange both speak this; neither knows what the flight is for.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Autopilot(StrEnum):
    """Whose conventions a mission follows: what item 0 is, which frames and commands it takes."""

    ARDUPILOT = "ardupilot"
    PX4 = "px4"


_PLACES = (16, 17, 18, 19, 21, 22, 31, 34, 80, 82, 84, 85, 94)  # waypoints, loiters, landing, take-off, orbit
_POINTED_AT = (
    179,
    188,
    189,
    192,
    195,
    201,
    4501,
)  # home, starts of return and landing, reposition, regions of interest
_FENCE_AND_RALLY = (5000, 5001, 5002, 5003, 5004, 5100)
PLACED_COMMANDS = frozenset((*_PLACES, *_POINTED_AT, *_FENCE_AND_RALLY))
"""The ``MAV_CMD`` whose param5 and param6 are a latitude and a longitude: on the wire degrees x 1e7. Those of all other
commands are plain numbers there (DO_DIGICAM_CONTROL's param5 of 1 is "shoot", not a ten-millionth of a degree)."""


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One item: ``command`` is a ``MAV_CMD``, ``frame`` a ``MAV_FRAME``.

    ``params`` are param1 to param4 (NaN: the vehicle decides). ``x``, ``y`` and ``z`` are param5 to param7: latitude
    and longitude in degrees and metres in the item's frame where the command is one of ``PLACED_COMMANDS``, else plain
    numbers.
    """

    command: int
    frame: int
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    autocontinue: bool = True


@dataclass(frozen=True, slots=True)
class FencePolygon:
    """A polygon to stay in (``inclusion``) or out of; ``vertices`` are (latitude, longitude) in degrees, not closed."""

    vertices: tuple[tuple[float, float], ...]
    inclusion: bool = True


@dataclass(frozen=True, slots=True)
class FenceCircle:
    """A circle to stay in (``inclusion``) or out of."""

    lat_deg: float
    lon_deg: float
    radius_m: float
    inclusion: bool = True


@dataclass(frozen=True, slots=True)
class RallyPoint:
    """A place to return to in an emergency, metres above home."""

    lat_deg: float
    lon_deg: float
    alt_m: float


@dataclass(frozen=True, slots=True)
class Home:
    """Where the vehicle starts, metres above mean sea level (None: not known)."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float | None = None


@dataclass(frozen=True, slots=True)
class Mission:
    """All that is uploaded to one vehicle for one flight.

    ``items`` do not hold ArduPilot's home item: the exchange and the files add and take it off. DO_JUMP targets in
    ``items`` count from 1 for ``items[0]``, which is how both ArduPilot (home is 0) and ``.plan`` files count.
    """

    items: tuple[MissionItem, ...] = ()
    fence_polygons: tuple[FencePolygon, ...] = ()
    fence_circles: tuple[FenceCircle, ...] = ()
    rally: tuple[RallyPoint, ...] = ()
    home: Home | None = None
    autopilot: Autopilot | None = None
    cruise_speed_m_s: float | None = None
