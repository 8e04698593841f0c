"""The pose graph: what is measured between and about frames, and what the solver made of it.

A frame's pose is ``T_map_plane``: it maps the frame's plane (pixels, see ``core.camera``) into the internal map frame
(metres, x east, y south; pixels of the first frame where there is no GPS). Its scale is the ground sampling distance,
its angle the heading (clockwise from grid north) of the image's upper edge.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.similarity import FloatArray, Similarity2D

BELIEVED_SIGMAS = 4.0
MIN_LAG_S = 0.1
"""A lag of fixes is corrected from so many of its sigmas, and from so much, on."""


class EdgeKind(StrEnum):
    """Why two frames were registered to each other."""

    SEQUENTIAL = "sequential"
    LOOP = "loop"


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """A measured motion ``T_a_b`` between the planes of frames a and b.

    ``covariance`` is ``(4, 4)`` about the origin of plane b (``T_true = T Exp(xi)``) and holds everything: the
    registration's noise and what a similarity cannot express. ``ground_slope`` is the rise of the shared ground per
    unit along plane a's x and y where the pair told it: ``T_a_b`` then is between planes that know the slope.
    """

    a: int
    b: int
    T_a_b: Similarity2D
    covariance: FloatArray
    kind: EdgeKind
    probability: float = 1.0
    overlap: float = 0.0
    method: str = "ifmi"
    ground_slope: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PositionObservation:
    """Where a frame's plumb point lies: ``(2,)`` map metres (x east, y south), ``(2, 2)`` covariance.

    ``covariance_m2`` is the whole error but for the flight's constant bias (sigma ``bias_sigma_m`` per axis). Of it,
    ``correlated_sigma_m`` per axis is shared with fixes of the same flight near in ``time_s`` (first-order
    Gauss-Markov, ``correlation_time_s``): a hundred fixes in a minute are not a hundred samples.
    """

    frame: int
    xy_map_m: FloatArray
    covariance_m2: FloatArray
    flight: int = 0
    time_s: float | None = None
    correlated_sigma_m: float = 0.0
    correlation_time_s: float = 60.0
    bias_sigma_m: float = 0.0


@dataclass(frozen=True, slots=True)
class ScaleObservation:
    """What a frame's pixel measures on the ground, from height and focal length; sigma of the logarithm."""

    frame: int
    gsd_m_per_px: float
    sigma_log: float


@dataclass(frozen=True, slots=True)
class HeadingObservation:
    """The heading of a frame's upper edge, clockwise from **grid** north (the angle of ``T_map_plane``)."""

    frame: int
    heading_rad: float
    sigma_rad: float


class PointKind(StrEnum):
    """Where a known point of the ground comes from; each kind is judged by its own spread."""

    CONTROL = "control"
    REFERENCE = "reference"


@dataclass(frozen=True, slots=True, eq=False)
class PointObservation:
    """A point of the ground whose place is known, seen in a frame: the residual is ``T_map_plane p_plane - xy_map``.

    ``xy_px`` is ``(2,)`` in the frame's raster, ``xy_plane`` the same point in the plane that the graph's edges are
    between (a view levels it); ``xy_map_m`` ``(2,)`` map metres with its ``(2, 2)`` covariance. ``sigma_px`` is the
    error of the picture's side per axis (the click, and ``bend_px`` that a plane alone leaves out), in pixels of the
    plane; on the map it is as large as the frame's pixels. Observations of one ``name`` share the error of its place.
    Points with ``check`` never enter the fit.
    """

    frame: int
    xy_px: FloatArray
    xy_plane: FloatArray
    xy_map_m: FloatArray
    covariance_m2: FloatArray
    sigma_px: float = 1.0
    name: str = ""
    check: bool = False
    kind: PointKind = PointKind.CONTROL
    bend_px: float = 0.0


@dataclass(frozen=True, slots=True)
class PoseGraph:
    """All that the solver knows; frozen, each snapshot of the builder with its revision."""

    frames: tuple[int, ...]
    edges: tuple[Edge, ...]
    positions: tuple[PositionObservation, ...] = ()
    scales: tuple[ScaleObservation, ...] = ()
    headings: tuple[HeadingObservation, ...] = ()
    revision: int = 0
    points: tuple[PointObservation, ...] = ()

    @property
    def georeferenced(self) -> bool:
        """Whether anything ties the graph to the Earth: a fix, or two points that are not kept for the check."""
        return bool(self.positions) or len({tuple(p.xy_map_m) for p in self.points if not p.check}) >= 2


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """A solved pose and its ``(4, 4)`` covariance (``T_true = T Exp(xi)``, plane axes and pixels)."""

    frame: int
    T_map_plane: Similarity2D
    covariance: FloatArray
    segment: int


@dataclass(frozen=True, slots=True)
class FixLag:
    """How much older a flight's fixes are than its pictures, by the motion seen, and the one-sigma of that."""

    lag_s: float
    sigma_s: float

    @property
    def believed(self) -> bool:
        """Whether it is told well enough to be corrected, and moves fixes by more than noise."""
        return abs(self.lag_s) >= max(BELIEVED_SIGMAS * self.sigma_s, MIN_LAG_S)


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """What the solver returns: a pose for every frame that the graph ties to something.

    ``segments`` are numbered by size, the largest 0: within one, frames are tied to each other by registrations.
    ``rejected`` are indices into ``graph.edges`` of the edges that the robust solver put aside. ``fix_lags`` tells by
    flight how much older its fixes were found to be than its pictures, where its motion told; believed ones were
    corrected (``fix_lags_s``). ``rejected_points``
    are indices into ``graph.points`` of the points (never check points) that were put aside.
    """

    poses: tuple[Pose, ...]
    chi2: float
    rejected: tuple[int, ...] = ()
    revision: int = 0
    fit_to_gps_rms_m: float | None = None
    fix_lags: Mapping[int, FixLag] = field(default_factory=dict)
    rejected_points: tuple[int, ...] = ()

    @property
    def fix_lags_s(self) -> dict[int, float]:
        """The lags that were corrected, by flight."""
        return {flight: lag.lag_s for flight, lag in self.fix_lags.items() if lag.believed}

    def pose_of(self, frame: int) -> Pose | None:
        """Return the pose of a frame, or ``None``."""
        return next((p for p in self.poses if p.frame == frame), None)


@dataclass(frozen=True, slots=True)
class Trajectory:
    """The placements of one solution: all that mosaic, live, export and report ever learn of it."""

    placements: tuple[FramePlacement, ...] = field(default=())
    revision: int = 0

    def segment(self, number: int) -> Trajectory:
        """Return the trajectory of one segment alone."""
        return Trajectory(tuple(p for p in self.placements if p.segment == number), self.revision)

    @property
    def gsd_m_per_px(self) -> float:
        """Median ground sampling distance of the placed frames' centres."""
        if not self.placements:
            raise ValueError("an empty trajectory has no ground sampling distance")
        return float(np.median([p.gsd_m_per_px for p in self.placements]))
