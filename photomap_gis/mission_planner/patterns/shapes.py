"""The tracks of search patterns, in local metres: from a datum, over an area, along a line.

Headings are clockwise from north, as IAMSAR has them; x is east, y north. Names and geometry are those of IAMSAR
Manual II, 5.5: SS expanding square, VS sector, PS parallel track, CS creeping line, TSR track line and return. Spiral,
point orbit and perimeter are not in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.errors import UsageError

FloatArray = NDArray[np.float64]

MOST_POINTS = 20_000


class Pattern(StrEnum):
    """The patterns, by the names of the command line."""

    EXPANDING_SQUARE = "expanding-square"
    """SS: legs of 1, 1, 2, 2, 3, 3, ... spacings about a datum, turning right by 90 degrees."""
    SECTOR = "sector"
    """VS: three triangles through a datum, turning right by 120 degrees; a second pass 30 degrees on."""
    PARALLEL = "parallel"
    """PS: legs along an area's long side."""
    CREEPING = "creeping"
    """CS: legs along an area's short side, creeping along the long one."""
    TRACKLINE = "trackline"
    """TSR: out along one side of a line and back on the other."""
    SPIRAL = "spiral"
    """An Archimedean spiral about a datum."""
    ORBIT = "orbit"
    """Circles about a point, the nose and the camera on it."""
    PERIMETER = "perimeter"
    """Round an area, inside its edge, again and again inwards."""


FROM_DATUM = (Pattern.EXPANDING_SQUARE, Pattern.SECTOR, Pattern.SPIRAL, Pattern.ORBIT)
FROM_AREA = (Pattern.PARALLEL, Pattern.CREEPING, Pattern.PERIMETER)


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Legs to fly with the camera on, each ``(N, 2)`` metres, in their order; the ways between them are free."""

    legs: tuple[FloatArray, ...]

    @property
    def length_m(self) -> float:
        """The length of all legs."""
        return float(sum(np.hypot(*np.diff(leg, axis=0).T).sum() for leg in self.legs))


def from_datum(
    pattern: Pattern, *, spacing_m: float, radius_m: float, heading_deg: float = 0.0, passes: int = 1
) -> Track:
    """Return the track about the origin that reaches ``radius_m`` to every side.

    ``heading_deg`` is the first leg's: down-drift. A sector search has 1 or 2 ``passes``, an orbit any number. Raises
    ``UsageError`` where the numbers make no pattern.
    """
    if pattern not in FROM_DATUM:
        raise UsageError(f"--pattern {pattern} needs an area or a line, not a datum")
    _check(spacing_m, radius_m, passes)
    if pattern is Pattern.EXPANDING_SQUARE:
        xy = expanding_square(spacing_m, radius_m)
    elif pattern is Pattern.SECTOR:
        xy = sector(radius_m, passes)
    elif pattern is Pattern.SPIRAL:
        xy = spiral(spacing_m, radius_m)
    else:
        xy = orbit(radius_m, passes)
    return Track((_turned(xy, heading_deg),))


def from_area(
    pattern: Pattern, area: BaseGeometry, *, spacing_m: float, heading_deg: float | None = None, passes: int = 1
) -> Track:
    """Return the track over an area in local metres.

    ``heading_deg`` turns the legs of parallel and creeping tracks (None: by the area's sides). A perimeter is flown
    ``passes`` times, each a spacing further in. Raises ``UsageError`` where nothing can be flown.
    """
    if area.is_empty or area.area <= 0:
        raise UsageError("the area is empty")
    _check(spacing_m, math.sqrt(area.area), passes)
    if pattern is Pattern.PERIMETER:
        return Track(tuple(perimeter(area, spacing_m, passes)))
    if pattern not in FROM_AREA:
        raise UsageError(f"--pattern {pattern} needs a datum (--datum LAT,LON), not an area")
    if heading_deg is None:
        heading_deg = _long_side_deg(area) + (90.0 if pattern is Pattern.CREEPING else 0.0)
    return Track(tuple(sweeps(area, spacing_m, heading_deg)))


def from_line(line: LineString, *, spacing_m: float, passes: int = 1) -> Track:
    """Return ``passes`` tracks to each side of a line in local metres, out on the right and back on the left."""
    _check(spacing_m, line.length, passes)
    legs = []
    for i in range(passes):
        offset = spacing_m * (i + 0.5)
        for side, back in ((-offset, False), (offset, True)):
            beside = shapely.offset_curve(line, side, join_style="mitre", mitre_limit=2.0)
            parts = [p for p in shapely.get_parts(beside) if p.length > 1e-6]
            if not parts:
                raise UsageError("the line bends too sharply for this --track-spacing: simplify it, or fly closer")
            xy = np.concatenate([np.asarray(p.coords) for p in parts])
            legs.append(xy[::-1] if back else xy)
    return Track(tuple(legs))


def expanding_square(spacing_m: float, radius_m: float) -> FloatArray:
    """SS with the first leg north: legs 1, 1, 2, 2, 3, 3, ... until each side sweeps to ``radius_m``."""
    # Four legs make a ring that lies a spacing further out; its swath reaches half a spacing more.
    count = 4 * max(1, math.ceil(radius_m / spacing_m - 0.5 - 1e-9)) + 1
    if count > MOST_POINTS:
        raise _too_many()
    lengths = spacing_m * (1 + np.arange(count) // 2)
    lengths[-1] -= spacing_m  # the last leg only closes the square
    angles = np.radians(90.0 * np.arange(count))
    steps = lengths[:, None] * np.column_stack((np.sin(angles), np.cos(angles)))
    keep = lengths > 0
    return np.vstack((np.zeros(2), np.cumsum(steps[keep], axis=0)))


def sector(radius_m: float, passes: int = 1) -> FloatArray:
    """VS with the first leg north: 000, 120, 240, 240, 000, 120, 120, 240, 000; again 30 degrees to the right."""
    if passes > 2:
        raise UsageError("a sector search has 1 or 2 passes")
    headings = np.radians([0, 120, 240, 240, 0, 120, 120, 240, 0])
    steps = radius_m * np.column_stack((np.sin(headings), np.cos(headings)))
    once = np.vstack((np.zeros(2), np.cumsum(steps, axis=0)))
    once[[3, 6, 9]] = 0.0  # the datum, to the last bit
    return once if passes == 1 else np.vstack((once, _turned(once, 30.0)[1:]))


def spiral(spacing_m: float, radius_m: float) -> FloatArray:
    """An Archimedean spiral, turning right, of chords that leave it by at most a twentieth of the spacing.

    Its turns lie closer by as much, so that no two chords are more than the spacing apart.
    """
    per_rad = 0.95 * spacing_m / (2.0 * math.pi)
    rim_m = max(radius_m - 0.45 * spacing_m, spacing_m / 4.0)  # whose chords' swath reaches the radius
    last = rim_m / per_rad + 2.0 * math.pi  # one turn more: all round the rim
    angle, angles = 0.0, [0.0]
    while angle < last and len(angles) <= MOST_POINTS:
        radius = max(per_rad * (angle + math.pi / 4.0), spacing_m / 4.0)  # at the chord's far end
        angle = min(last, angle + min(_chord_rad(radius, spacing_m / 20.0), math.pi / 4.0))
        angles.append(angle)
    if len(angles) > MOST_POINTS:
        raise _too_many()
    a = np.asarray(angles)
    r = np.minimum(per_rad * a, rim_m)
    return r[:, None] * np.column_stack((np.sin(a), np.cos(a)))


def orbit(radius_m: float, turns: int = 1) -> FloatArray:
    """Circles to the right about the origin, from the north; chords leave the circle by at most 2 %."""
    corners = max(12, math.ceil(2.0 * math.pi / _chord_rad(radius_m, 0.02 * radius_m)))
    if corners * turns > MOST_POINTS:
        raise _too_many()
    a = np.linspace(0.0, 2.0 * math.pi * turns, corners * turns + 1)
    return radius_m * np.column_stack((np.sin(a), np.cos(a)))


def perimeter(area: BaseGeometry, spacing_m: float, passes: int) -> list[FloatArray]:
    """Rings half a spacing inside the area's edges, then a spacing further in with each pass."""
    rings: list[FloatArray] = []
    for i in range(passes):
        inner = area.buffer(-spacing_m * (i + 0.5), join_style="mitre", mitre_limit=2.0)
        for part in shapely.get_parts(inner):
            if isinstance(part, Polygon) and not part.is_empty:
                simple = part.simplify(spacing_m / 50.0)
                # to the right round the outside, as all patterns turn
                simple = shapely.geometry.polygon.orient(simple, -1.0)
                rings += [np.asarray(ring.coords) for ring in (simple.exterior, *simple.interiors)]
        if not rings:
            raise UsageError(
                f"no perimeter fits half a track spacing ({spacing_m / 2:.1f} m) inside this area: "
                "use a smaller --track-spacing"
            )
    if sum(len(r) for r in rings) > MOST_POINTS:
        raise _too_many()
    return rings


def sweeps(area: BaseGeometry, spacing_m: float, heading_deg: float) -> list[FloatArray]:
    """Parallel legs half a spacing inside all edges, back and forth, no more than a spacing apart.

    A leg reaches as far as any part of its strip, less half a spacing at its ends, so that a square swath as wide as
    the spacing covers slanted edges too.
    """
    # Turning can make a hair's breadth of a spike cross itself.
    to_north = shapely.make_valid(shapely.affinity.rotate(area, heading_deg, origin=(0.0, 0.0)))
    west, south, east, north = to_north.bounds
    count = max(1, math.ceil((east - west) / spacing_m - 1e-9))
    if count > MOST_POINTS:
        raise _too_many()
    step = (east - west) / count
    shapely.prepare(to_north)
    legs: list[FloatArray] = []
    for i in range(count):
        strip = shapely.box(west + i * step, south - 1.0, west + (i + 1) * step, north + 1.0)
        x = west + (i + 0.5) * step
        spans = _spans(shapely.intersection(to_north, strip), spacing_m)
        if i % 2:
            spans = [(b, a) for a, b in reversed(spans)]
        legs += [_turned(np.array([[x, a], [x, b]]), heading_deg) for a, b in spans]
    return legs


def _spans(piece: BaseGeometry, spacing_m: float) -> list[tuple[float, float]]:
    """From where to where, south to north, a strip's parts are flown; near parts in one go."""
    found = sorted((part.bounds[1], part.bounds[3]) for part in shapely.get_parts(piece) if part.area > 1e-9)
    merged: list[list[float]] = []
    for low, high in found:
        if merged and low - merged[-1][1] < spacing_m:
            merged[-1][1] = max(merged[-1][1], high)
        else:
            merged.append([low, high])
    spans = []
    for low, high in merged:
        pull = min(spacing_m / 2.0, (high - low) / 2.0 - 0.05)
        spans.append((low + max(pull, 0.0), high - max(pull, 0.0)))
    return spans


def _long_side_deg(area: BaseGeometry) -> float:
    """The heading of the longer side of the smallest rectangle about the area, which has a side on its hull."""
    hull = shapely.get_coordinates(shapely.convex_hull(area))
    edges = np.diff(hull, axis=0)
    edges = edges[np.hypot(*edges.T) > 1e-9]
    best, found = math.inf, 0.0
    for x, y in edges:
        heading = math.degrees(math.atan2(x, y))
        width, length = np.ptp(_turned(hull, -heading), axis=0)
        if width * length < best * (1 - 1e-9):
            best = width * length
            found = heading if length >= width else heading + 90.0
    return found % 180.0


def _turned(xy: FloatArray, heading_deg: float) -> FloatArray:
    """Turn points clockwise, so that north becomes the heading."""
    a = math.radians(heading_deg)
    c, s = math.cos(a), math.sin(a)
    return np.column_stack((c * xy[:, 0] + s * xy[:, 1], c * xy[:, 1] - s * xy[:, 0]))


def _chord_rad(radius_m: float, sag_m: float) -> float:
    return 2.0 * math.acos(max(-1.0, 1.0 - min(sag_m / radius_m, 2.0)))


def _check(spacing_m: float, reach_m: float, passes: int) -> None:
    if not (math.isfinite(spacing_m) and spacing_m > 0):
        raise UsageError(f"--track-spacing must be above 0 m, got {spacing_m:g}")
    if not (math.isfinite(reach_m) and 0 < reach_m <= 200_000):
        raise UsageError(f"the search must reach from above 0 to 200 km, got {reach_m / 1000:g} km")
    if not 1 <= passes <= 100:
        raise UsageError(f"--passes must lie in 1 to 100, got {passes}")


def _too_many() -> UsageError:
    return UsageError(
        f"the pattern would have more than {MOST_POINTS} points: use a wider --track-spacing or a smaller search"
    )
