"""What a camera that looks straight down sees, and what it is sure to see when the flight is not perfect."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import Polygon

from photomap_gis.core.errors import UsageError

FloatArray = npt.NDArray[np.float64]

_TILT_DIRECTIONS = 24
_TURNS = 5
_DRIFT = 1.02
"""Shots of a distance trigger come late by up to this (FACTS: 12.50 to 12.66 m for 12.5 m)."""


@dataclass(frozen=True, slots=True)
class Optics:
    """A pinhole camera: raster in pixels, focal length in pixels. The raster's width lies across the flight."""

    width_px: int
    height_px: int
    focal_px: float
    name: str = "camera"

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1 or not (math.isfinite(self.focal_px) and self.focal_px > 0):
            raise UsageError("a camera needs a width and a height in pixels and a positive focal length")

    def gsd_m_per_px(self, height_m: float) -> float:
        """Return the ground sampling distance from a height above ground."""
        return height_m / self.focal_px

    def height_m(self, gsd_m_per_px: float) -> float:
        """Return the height above ground that gives a ground sampling distance."""
        return gsd_m_per_px * self.focal_px

    def footprint_m(self, height_m: float) -> tuple[float, float]:
        """Return width (across) and length (along) of the ground in a picture."""
        gsd = self.gsd_m_per_px(height_m)
        return gsd * self.width_px, gsd * self.height_px


@dataclass(frozen=True, slots=True)
class Tolerances:
    """By how much a flight may be off and the proof still holds: each within plus and minus."""

    cross_track_m: float = 2.0
    heading_deg: float = 5.0
    tilt_deg: float = 5.0
    height_share: float = 0.05

    def __post_init__(self) -> None:
        if not (0 <= self.cross_track_m < 1e3 and 0 <= self.heading_deg < 45 and 0 <= self.tilt_deg < 45):
            raise UsageError("tolerances must lie in: cross-track 0 to 1000 m, heading and tilt 0 to 45 degrees")
        if not 0 <= self.height_share < 0.9:
            raise UsageError("the height's tolerance must lie in 0 to 90 %")


@dataclass(frozen=True, slots=True, eq=False)
class SureFootprint:
    """The convex ground, metres about the planned plumb point, that a picture holds whatever the tolerances do.

    ``ring`` is ``(N, 2)``: x across the flight to the right, y along it; symmetric in both.
    """

    ring: FloatArray

    @property
    def half_width_m(self) -> float:
        """How far it reaches to either side."""
        return float(self.ring[:, 0].max())

    def top(self, x: npt.ArrayLike) -> FloatArray:
        """Return how far along the flight it reaches at an offset across; -inf beyond its half width."""
        upper = self.ring[self.ring[:, 1] >= 0.0]
        upper = upper[np.argsort(upper[:, 0], kind="stable")]
        offsets = np.abs(np.asarray(x, np.float64))
        reach = np.interp(offsets, upper[:, 0], upper[:, 1])
        return np.where(offsets > self.half_width_m * (1 + 1e-9), -np.inf, reach)

    def half_width_at(self, step_m: float) -> float:
        """Return the half width of the strip that pictures every ``step_m`` are sure to cover without a gap."""
        low, high = 0.0, self.half_width_m
        if 2.0 * float(self.top(0.0)) < step_m:
            return 0.0
        for _ in range(50):
            middle = (low + high) / 2.0
            low, high = (middle, high) if 2.0 * float(self.top(middle)) >= step_m else (low, middle)
        return low


def sure_footprint(
    optics: Optics,
    height_m: float,
    tolerances: Tolerances,
    *,
    crab_deg: float = 0.0,
    noses_rad: Sequence[float] = (0.0,),
) -> SureFootprint:
    """Intersect the footprints of every tilt, turn, height and offset within the tolerances.

    ``crab_deg`` widens the heading's tolerance: a nose held into the wind turns the picture against the track.
    ``noses_rad`` are the angles from the track to the nose, clockwise, that must all do: a nose that stays where it is
    lies across some lanes. Raises ``UsageError`` where nothing is left.
    """
    half_x, half_y = optics.width_px / 2.0 / optics.focal_px, optics.height_px / 2.0 / optics.focal_px
    corners = np.array([[-half_x, -half_y, 1.0], [half_x, -half_y, 1.0], [half_x, half_y, 1.0], [-half_x, half_y, 1.0]])
    tilt = math.radians(tolerances.tilt_deg)
    if tilt >= min(math.atan(half_x), math.atan(half_y)) or tilt + math.atan(math.hypot(half_x, half_y)) >= math.pi / 2:
        raise _nothing_sure("the tilt's tolerance is as wide as the camera's view")
    turn = math.radians(tolerances.heading_deg + crab_deg)
    turns = np.linspace(-turn, turn, _TURNS) if turn > 0 else np.zeros(1)
    quads = [corners[:, :2]]
    for direction in np.arange(_TILT_DIRECTIONS) * (2 * math.pi / _TILT_DIRECTIONS):
        rays = corners @ _tilted(direction, tilt).T
        quads.append(rays[:, :2] / rays[:, 2:])
    low = height_m * (1.0 - tolerances.height_share)
    turned = [q * low @ _turned(-nose - t).T for nose in noses_rad for t in turns for q in quads]
    sure = Polygon(turned[0])
    for quad in turned[1:]:
        sure = shapely.intersection(sure, Polygon(quad))
    sure = sure.buffer(-tolerances.cross_track_m, join_style="mitre") if tolerances.cross_track_m else sure
    for mirror in ((-1, 1), (1, -1)):
        sure = sure.intersection(shapely.transform(sure, lambda p, m=mirror: p * m))
    if sure.is_empty or sure.area < 1e-6:
        raise _nothing_sure(f"at {height_m:.1f} m the picture is smaller than the tolerances")
    # The samples of turns and tilts lie a little apart: what hides between them is less than this.
    sure = shapely.transform(sure.simplify(0.002 * math.sqrt(sure.area)), lambda p: p * 0.998)
    ring = np.asarray(sure.exterior.coords)[:-1]
    extra = [[0.0, s * float(np.interp(0.0, *_chain(ring)))] for s in (1.0, -1.0)]  # so that `top` has its middle
    extra += [[s * float(ring[:, 0].max()), 0.0] for s in (1.0, -1.0)]
    hull = shapely.convex_hull(shapely.multipoints(np.concatenate([ring, extra])))
    return SureFootprint(np.asarray(hull.exterior.coords)[:-1])


@dataclass(frozen=True, slots=True)
class Spacing:
    """How pictures and lanes lie: ``step_m`` along a lane, at most ``lane_m`` between lanes.

    A lane answers for ground up to ``edge_m`` to its side where no other lane follows; ``snug_edge_m`` is where the
    sure footprint is still nearly as long as in its middle. ``guard_m`` is flown at each lane's end in addition: the
    first shot may be taken in the turn, and the last one comes up to a step before the end.
    """

    step_m: float
    lane_m: float
    edge_m: float
    snug_edge_m: float
    guard_m: float
    front_overlap: float
    side_overlap: float


def space(
    optics: Optics,
    height_m: float,
    sure: SureFootprint,
    *,
    front_overlap: float,
    side_overlap: float,
    exact_shots: bool = False,
    noses_rad: Sequence[float] = (0.0,),
) -> Spacing:
    """Return the spacing that keeps the overlaps (shares, 0 to below 1) and leaves no gap within the tolerances.

    ``noses_rad`` as for `sure_footprint`; an overlap is the share of a picture's ground that its neighbour shows too.
    ``exact_shots``: each picture is taken at its place, hovering, so that no guard is needed.
    """
    if not (0.0 <= front_overlap <= 0.97 and 0.0 <= side_overlap <= 0.97):
        raise UsageError("overlaps must lie in 0 to 97 percent")
    width, length = optics.footprint_m(height_m)
    snug = _snug_width(sure)
    drift = 1.0 if exact_shots else _DRIFT
    apart = [shift_for(width, length, nose, front_overlap) for nose in noses_rad]
    beside = [shift_for(length, width, nose, side_overlap) for nose in noses_rad]
    step = min(min(apart), 2.0 * float(sure.top(snug)) / drift)
    edge = sure.half_width_at(step * drift)
    lane = min(min(beside), 2.0 * edge)
    return Spacing(
        step, lane, edge, min(snug, edge), 0.0 if exact_shots else step * drift,
        min(overlap(width, length, nose, step) for nose in noses_rad),
        min(overlap(length, width, nose, lane) for nose in noses_rad),
    )  # fmt: skip


def overlap(across_m: float, along_m: float, nose_rad: float, shift_m: float) -> float:
    """Return the share of a rectangle that is left of it in its copy, ``shift_m`` on, off its ``along`` by ``nose``."""
    one = 1.0 - shift_m * abs(math.sin(nose_rad)) / across_m
    other = 1.0 - shift_m * abs(math.cos(nose_rad)) / along_m
    return max(one, 0.0) * max(other, 0.0)


def shift_for(across_m: float, along_m: float, nose_rad: float, share: float) -> float:
    """Return the shift that leaves this ``overlap``: the smaller root of a quadratic."""
    a, b = abs(math.sin(nose_rad)) / across_m, abs(math.cos(nose_rad)) / along_m
    return 2.0 * (1.0 - share) / (a + b + math.sqrt(max((a + b) ** 2 - 4.0 * a * b * (1.0 - share), 0.0)))


def _snug_width(sure: SureFootprint) -> float:
    """The half width of the largest rectangle within."""
    offsets = np.linspace(0.02, 1.0, 99) * sure.half_width_m
    return float(offsets[np.argmax(offsets * sure.top(offsets))])


def _chain(ring: FloatArray) -> tuple[FloatArray, FloatArray]:
    upper = ring[ring[:, 1] >= 0.0]
    upper = upper[np.argsort(upper[:, 0], kind="stable")]
    return upper[:, 0], upper[:, 1]


def _tilted(direction: float, tilt: float) -> FloatArray:
    """``(3, 3)`` rotation by ``tilt`` about a level axis."""
    x, y = math.cos(direction), math.sin(direction)
    c, s = math.cos(tilt), math.sin(tilt)
    v = 1.0 - c
    return np.array([[c + x * x * v, x * y * v, y * s], [x * y * v, c + y * y * v, -x * s], [-y * s, x * s, c]])


def _turned(angle: float) -> FloatArray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def _nothing_sure(why: str) -> UsageError:
    return UsageError(f"no picture is sure to show anything: {why}; fly higher, or state smaller tolerances")
