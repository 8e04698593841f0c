"""What a server asks of a live session: the seam between the flight (``live``) and the world (``server``).

A session hands out values and never waits for whoever looks. All that is here may be called from any thread at any
moment and must come back at once, with what is known now; only ``read`` of a raster and ``picture_at`` may take the
milliseconds that reading takes. Callbacks given to ``subscribe`` and ``watch`` never block and never raise, so a
session may call them from its loop.

Places are of the session's internal map frame (metres, x east, y **south**; a map without a place on Earth: pixels of
its first frame); ``MapFrame`` says where that lies. Pixels of rasters are those of their lattice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from photomap_gis.core.grid import MapFrame, MapGrid, Window
from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.similarity import FloatArray


class LivePhase(StrEnum):
    """How far a flight has come."""

    STARTING = "starting"
    FLYING = "flying"
    FINALISING = "finalising"
    ENDED = "ended"


class LinkState(StrEnum):
    """How the stream of pictures does."""

    OK = "ok"
    WAITING = "waiting"
    """Pictures come, none can be placed just now: error frames, or ground that was not recognised yet."""
    LOST = "lost"
    ENDED = "ended"


class GpsState(StrEnum):
    """How positions do."""

    NONE = "none"
    """This session has no source of positions."""
    SEARCHING = "searching"
    OK = "ok"
    LOST = "lost"


@dataclass(frozen=True, slots=True)
class Vehicle:
    """What the autopilot or the log says of the drone, WGS84 degrees; ``None`` where it does not say."""

    lon_deg: float
    lat_deg: float
    altitude_m: float | None = None
    heading_deg: float | None = None
    speed_m_s: float | None = None
    battery_percent: float | None = None
    mode: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LivePose:
    """A frame and where it lies; one for every frame that came, the newest counts.

    ``placement`` is ``None`` while the map waits. ``map_frame`` is the one that the placement is of: a pose that was on
    its way while the map snapped to the ground stays true.
    """

    frame: int
    time_s: float
    placement: FramePlacement | None
    map_frame: MapFrame
    utc_s: float | None = None
    vehicle: Vehicle | None = None


@dataclass(frozen=True, slots=True)
class LiveTiles:
    """Windows of the rasters' lattice whose pixels are new; ``version`` is what ``version_in`` says of them now."""

    version: int
    windows: tuple[Window, ...]


@dataclass(frozen=True, slots=True)
class LiveSolution:
    """A new solution was adopted: track, footprints and finds have moved, at most by ``shift_px`` of the lattice."""

    revision: int
    frame: int
    shift_px: float | None = None


@dataclass(frozen=True, slots=True)
class LiveHealth:
    """How the session does, about once a second. ``words`` are for people, the worst first, empty when all is well.

    ``latency_ms`` is from the arrival of a frame to its pose, ``fps`` the frames registered
    a second.
    """

    frames: int
    fps: float
    latency_ms: float
    dropped: int
    error_frames: int
    keyframes: int
    segments: int
    link: LinkState
    gps: GpsState
    words: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class LiveSegment:
    """A piece of the map began (``joined`` ``None``), or was found again as part of another piece (its number)."""

    segment: int
    frame: int
    joined: int | None = None
    words: str = ""


@dataclass(frozen=True, slots=True)
class LiveSnapped:
    """The map lies somewhere else from now on (it found its place on Earth, or got another lattice): a new epoch.

    State and rasters already are those of the new ``epoch`` when this is sent.
    """

    epoch: str
    words: str = ""


@dataclass(frozen=True, slots=True)
class LiveEnd:
    """The flight is over: ``FINALISING`` with ``progress`` (0 to 1), then ``ENDED``: the folder is a mission."""

    phase: LivePhase
    progress: float = 0.0
    words: str = ""


LiveEvent = LivePose | LiveTiles | LiveSolution | LiveHealth | LiveSegment | LiveSnapped | LiveEnd


@dataclass(frozen=True, slots=True, eq=False)
class LiveState:
    """A session at this moment.

    ``epoch`` is a short text that changes with every ``LiveSnapped`` and with every session. ``area_lon_lat``,
    ``(N, 2)`` degrees, is the polygon that is to be covered, where one was given. ``elapsed_s`` is the stream's time
    now, ``started_utc_s`` the time of day at which that was zero.
    """

    name: str
    folder: Path
    epoch: str
    phase: LivePhase
    map_frame: MapFrame
    revision: int
    elapsed_s: float
    started_utc_s: float | None = None
    pose: LivePose | None = None
    health: LiveHealth | None = None
    end: LiveEnd | None = None
    area_lon_lat: FloatArray | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class LiveTrack:
    """Where key frames lie by the newest solution, in the order of time; thinned to a few thousand at most.

    ``xy_map_m`` ``(N, 2)`` their centres, ``time_s`` ``(N,)``, ``segment`` ``(N,)``.
    """

    xy_map_m: FloatArray
    time_s: FloatArray
    segment: npt.NDArray[np.intp]


class RasterKind(StrEnum):
    """What a raster holds."""

    MAP = "map"
    """RGBA, ``(h, w, 4)`` uint8."""
    AGE = "age"
    """Stream seconds at which a pixel was last seen, ``(h, w)`` float32, NaN where never."""
    SIGMA = "sigma"
    """Predicted one sigma per axis in metres, ``(h, w)`` float32, NaN where nothing was seen."""
    SEARCHED = "searched"
    """Best ground sampling distance at which a pixel was seen, metres a pixel, ``(h, w)`` float32, NaN where never."""


class LiveRaster(Protocol):
    """A picture that grows on a lattice which stays for one epoch.

    ``lattice`` tells corner, pixel size, CRS and tile size; its width and height say nothing: pixels on all sides, also
    at negative columns and rows, may be read. All rasters of a session share one lattice.
    """

    @property
    def kind(self) -> RasterKind:
        """What it holds."""
        ...

    @property
    def lattice(self) -> MapGrid:
        """Where pixel (0, 0) has its upper left corner, and how large a pixel is; ``crs_wkt`` ``None``: map units."""
        ...

    def extent(self) -> Window | None:
        """The pixels that may show something by now; ``None`` before the first."""
        ...

    def read(self, window: Window) -> npt.NDArray[Any]:
        """The pixels of a window (see ``RasterKind``), transparent or NaN where nothing was seen."""
        ...

    def version_in(self, window: Window) -> int:
        """The newest version of any pixel in a window: grows with each change of them, 0 where nothing was seen."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class LivePicture:
    """The newest frame warped into the still map: what the operator sees without shaking.

    ``grid`` says where its pixels lie (CRS of the map; ``None``: map units). ``sequence`` only grows.
    """

    sequence: int
    frame: int
    time_s: float
    grid: MapGrid
    jpeg: bytes


@dataclass(frozen=True, slots=True)
class Anchor:
    """A place as a pixel of a key frame, so that it goes along when the solution moves the map."""

    frame: int
    x_px: float
    y_px: float


class LiveSession(Protocol):
    """A flight as the server sees it."""

    @property
    def state(self) -> LiveState:
        """The session at this moment."""
        ...

    @property
    def rasters(self) -> tuple[LiveRaster, ...]:
        """The map and what else is known of its pixels, the map first; of the present epoch."""
        ...

    def track(self) -> LiveTrack:
        """Where the drone's camera looked so far."""
        ...

    def covariance_at(self, xy_map_m: tuple[float, float]) -> FloatArray | None:
        """``(2, 2)`` predicted covariance (x east, y south), square map units, at a place; ``None`` if unseen."""
        ...

    def anchor_at(self, xy_map_m: tuple[float, float]) -> Anchor | None:
        """The key frame that shows a place best, and where in it; ``None`` where none does."""
        ...

    def place_of(self, anchor: Anchor) -> tuple[float, float] | None:
        """Where an anchor lies on the map by the newest solution; ``None`` where its frame has no place."""
        ...

    def picture_at(self, anchor: Anchor) -> npt.NDArray[np.uint8] | None:
        """``(h, w, 3)`` RGB of the anchor's frame about it, for a snapshot; ``None`` where its pixels are gone."""
        ...

    def subscribe(self, on_event: Callable[[LiveEvent], None]) -> Callable[[], None]:
        """Call ``on_event`` with everything that happens from now on, in any thread; return what ends it."""
        ...

    def watch(self, on_picture: Callable[[LivePicture], None]) -> Callable[[], None]:
        """Make the stabilised view and hand it over, as long as anybody watches; return what ends it."""
        ...

    def finalise(self) -> None:
        """End the flight as the operator's ``q`` does; a second time does nothing."""
        ...
