"""Finds: what somebody pointed out on a map, where, and how sure its place is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class FindKind(StrEnum):
    """What was found, in the order of the page's keys."""

    INTRUDER = "intruder"
    VICTIM = "victim"
    HAZARD = "hazard"
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class FindAnchor:
    """A find's place as a pixel of a frame, so that it goes along when a new solution moves the map."""

    frame: int
    x_px: float
    y_px: float


@dataclass(frozen=True, slots=True)
class MarkedFind:
    """A find as the mission keeps it.

    ``lon_lat`` is in WGS84 degrees; a map without a place on Earth has ``xy_map`` in its own units (x right, y up)
    instead. ``ce90_m`` is within how many metres it lies with a chance of 90 %, as the map's solution predicts,
    ``None`` where that is not known. ``snapshot`` says whether a picture of it was kept.
    """

    id: str
    kind: FindKind
    name: str
    time_utc: str
    note: str = ""
    lon_lat: tuple[float, float] | None = None
    xy_map: tuple[float, float] | None = None
    ce90_m: float | None = None
    anchor: FindAnchor | None = None
    snapshot: bool = False
