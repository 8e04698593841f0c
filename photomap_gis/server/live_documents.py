"""The documents of a live session on the wire; ``docs/protocol.md`` says the same in words.

Places are longitude and latitude in degrees where the map has a place on Earth, else its own units (x right, y up).
Lengths that hang on the map (``gsd``, ellipses) are metres, or those units.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from photomap_gis.server.live_view import GpsState, LinkState, LivePhase
from photomap_gis.server.protocol import Bounds, Document, EventDocument

Place = tuple[float, float]


class EllipseDocument(Document):
    """How sure a place is: half axes of one sigma, ``bearing_deg`` of the longer one clockwise from grid north."""

    major: float
    minor: float
    bearing_deg: float
    ce90: float


class PoseDocument(Document):
    """A frame, and where it lies; ``centre`` and all that hangs on it is ``null`` while the map waits."""

    event: Literal["pose"] = "pose"
    frame: int
    time_s: float
    time_utc: str | None = None
    drone: Place | None = None
    centre: Place | None = None
    footprint: list[Place] | None = None
    heading_deg: float | None = None
    gsd: float | None = None
    ellipse: EllipseDocument | None = None
    segment: int | None = None
    altitude_m: float | None = None
    speed_m_s: float | None = None
    battery_percent: float | None = None
    mode: str | None = None


class TilesDocument(Document):
    """Ground whose tiles are new: ask for them with ``v=VERSION``. ``all`` where everything may have changed."""

    event: Literal["tiles"] = "tiles"
    version: int
    areas: list[Bounds] = Field(default_factory=list)
    all: bool = False


class SolutionDocument(Document):
    """A new solution: track and finds have moved; the tiles that moved are told by ``tiles``."""

    event: Literal["solution"] = "solution"
    revision: int
    frame: int
    shift_px: float | None
    shift_m: float | None = None
    georeferenced: bool


class HealthDocument(Document):
    """How the session does; ``words`` for people, the worst first."""

    event: Literal["health"] = "health"
    frames: int
    fps: float
    latency_ms: float
    dropped: int
    error_frames: int
    keyframes: int
    segments: int
    link: LinkState
    gps: GpsState
    words: list[str]


class SegmentDocument(Document):
    """A piece of the map began, or (``joined``) was found to belong to another."""

    event: Literal["segment"] = "segment"
    segment: int
    frame: int
    joined: int | None
    words: str


class SnappedDocument(Document):
    """Everything has got another place: read the mission again."""

    event: Literal["snapped"] = "snapped"
    epoch: str
    georeferenced: bool
    words: str


class EndDocument(Document):
    """The flight is over; after ``ended`` the mission is one like any other: read it again."""

    event: Literal["finalising", "ended"]
    progress: float
    words: str


class FindsDocument(Document):
    """Finds were marked, changed or taken away: read ``finds.geojson`` again."""

    event: Literal["find"] = "find"
    id: str | None
    count: int


class LiveDocument(Document):
    """``GET /missions/ID/live``, and the first event (``live``) of its stream."""

    event: Literal["live"] = "live"
    epoch: str
    phase: LivePhase
    georeferenced: bool
    revision: int
    version: int
    elapsed_s: float
    started_utc: str | None
    pose: PoseDocument | None
    health: HealthDocument | None
    end: EndDocument | None
    area: list[Place] | None
    """The outline that is to be covered, longitude and latitude; ``null`` where none was given or the map is local."""
    missed: bool = False
    """On a stream that was taken up again: events between were lost, so all tiles may have changed."""


LiveEventDocument = (
    PoseDocument
    | TilesDocument
    | SolutionDocument
    | HealthDocument
    | SegmentDocument
    | SnappedDocument
    | EndDocument
    | FindsDocument
    | LiveDocument
    | EventDocument
)
