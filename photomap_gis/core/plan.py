"""What the mission planner hands out: a survey or a search as flights of waypoints, with what the camera will see."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class AltitudeFrame(StrEnum):
    """What a waypoint's altitude is counted from."""

    RELATIVE = "relative"
    """The take-off place."""
    AMSL = "amsl"
    """Mean sea level."""
    TERRAIN = "terrain"
    """The ground below; the vehicle follows its own terrain data."""


class WaypointRole(StrEnum):
    """What a waypoint is there for."""

    TAKEOFF = "takeoff"
    TRANSIT = "transit"
    LEAD_IN = "lead_in"
    SURVEY = "survey"
    """On a lane or a search leg; the camera is on from a waypoint with ``trigger`` until one without."""
    TURN = "turn"
    RETURN = "return"
    LAND = "land"


@dataclass(frozen=True, slots=True)
class CameraTrigger:
    """How pictures are taken from a waypoint on: every so many metres, every so many seconds, or once, hovering."""

    distance_m: float | None = None
    interval_s: float | None = None
    hover: bool = False


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A place to fly to. ``trigger`` holds from here on until the next waypoint; None is camera off.

    ``speed_m_s`` and ``gimbal_pitch_deg`` (-90: straight down) hold from here on until a waypoint says another.
    ``heading_deg`` is where the nose points, clockwise from north (None: along the path).
    """

    lat_deg: float
    lon_deg: float
    alt_m: float
    role: WaypointRole
    trigger: CameraTrigger | None = None
    speed_m_s: float | None = None
    heading_deg: float | None = None
    hold_s: float = 0.0
    gimbal_pitch_deg: float | None = None


@dataclass(frozen=True, slots=True)
class Sortie:
    """One flight on one battery, from take-off to return."""

    waypoints: tuple[Waypoint, ...]
    photos: int
    length_m: float
    duration_s: float


@dataclass(frozen=True, slots=True)
class GeoPolygon:
    """A polygon on Earth: rings of (longitude, latitude) in degrees, the first the shell, closed, as GeoJSON has it."""

    rings: tuple[tuple[tuple[float, float], ...], ...]


@dataclass(frozen=True, slots=True)
class SurveyPlan:
    """A planned survey or search, with the proof of what it covers.

    ``covered_share`` is of the area less what is avoided, 0 to 1, with the tolerances used; ``uncovered`` is the rest.
    ``area`` and ``avoid`` are as they were asked for (repaired), for fence and drawing.
    """

    area: tuple[GeoPolygon, ...]
    avoid: tuple[GeoPolygon, ...]
    frame: AltitudeFrame
    sorties: tuple[Sortie, ...]
    covered_share: float
    uncovered: tuple[GeoPolygon, ...]
    gsd_m_per_px: float
    pattern: str
    home: tuple[float, float] | None = None
    """(latitude, longitude) of the take-off place in degrees."""
    home_alt_amsl_m: float | None = None
    """The ground's height at the take-off place above mean sea level, metres (None: not known)."""
    warnings: tuple[str, ...] = ()
