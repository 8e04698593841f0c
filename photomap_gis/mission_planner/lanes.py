"""Lanes over an area: parallel strips of one heading, placed so that every strip's ground is sure to be seen.

The area is cut into slabs, one a lane, and each connected piece of a slab (a trapezoid cell of the boustrophedon
decomposition, merged where flying on costs less than turning) asks its lane for just the stretch from which all of it
is seen: edges are covered by construction, wherever they run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from photomap_gis.mission_planner.optics import Spacing, SureFootprint

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Lane:
    """A path with the camera on, ``(N, 2)`` local metres; a ``spot`` is one place where one picture is taken.

    ``nose_rad`` is the heading of the picture's upper edge where it is not the path's.
    """

    xy: FloatArray
    spot: bool = False
    nose_rad: float | None = None

    @property
    def length_m(self) -> float:
        """Length along the path."""
        return float(np.hypot(*np.diff(self.xy, axis=0).T).sum())

    def reversed(self) -> Lane:
        """Return the lane flown the other way."""
        return Lane(self.xy[::-1], self.spot, self.nose_rad)

    def shots(self, step_m: float) -> tuple[FloatArray, FloatArray]:
        """Return ``(N, 2)`` places of pictures every ``step_m`` from the start, and ``(N,)`` headings in radians."""
        if self.spot or self.length_m < 1e-9:
            return self.xy[:1], np.full(1, self.nose_rad or 0.0)
        legs = np.diff(self.xy, axis=0)
        length = np.hypot(legs[:, 0], legs[:, 1])
        ends = np.concatenate([[0.0], np.cumsum(length)])
        at = np.arange(0.0, ends[-1] + 1e-6, step_m)
        leg = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(length) - 1)
        share = (at - ends[leg]) / np.maximum(length[leg], 1e-12)
        heading = np.arctan2(legs[leg, 0], legs[leg, 1])
        if self.nose_rad is not None:
            heading = np.full(len(at), self.nose_rad)
        return self.xy[leg] + share[:, None] * legs[leg], heading


def turned(geometry: BaseGeometry, heading_rad: float) -> BaseGeometry:
    """Return a geometry in the frame of a sweep: x across to the right, y along the heading."""
    m = _axes(heading_rad)
    return shapely.transform(geometry, lambda p: p @ m.T)


def _axes(heading_rad: float) -> FloatArray:
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    return np.array([[c, -s], [s, c]])


def lane_offsets(west: float, east: float, spacing: Spacing) -> FloatArray:
    """Return where lanes lie across: the fewest that keep the spacing, the outer ones as snug as that allows."""
    width = east - west
    if width <= 2.0 * spacing.edge_m:
        return np.array([(west + east) / 2.0])
    count = math.ceil((width - 2.0 * spacing.edge_m) / spacing.lane_m - 1e-9) + 1
    least = (width - (count - 1) * spacing.lane_m) / 2.0
    edge = min(spacing.edge_m, max(least, spacing.snug_edge_m))
    return np.linspace(west + edge, east - edge, count)


def sweep(
    target: BaseGeometry,
    heading_rad: float,
    spacing: Spacing,
    sure: SureFootprint,
    *,
    merge_gap_m: float,
) -> list[Lane]:
    """Return the lanes of one heading over polygons in local metres, west to east across the heading.

    Stretches of one lane that lie nearer than ``merge_gap_m`` are flown through.
    """
    flat = turned(target, heading_rad)
    west, south, east, north = flat.bounds
    offsets = lane_offsets(west, east, spacing)
    borders = np.concatenate([[west - 1.0], (offsets[1:] + offsets[:-1]) / 2.0, [east + 1.0]])
    slabs = shapely.box(borders[:-1], south - 1.0, borders[1:], north + 1.0)
    shapely.prepare(flat)
    back = _axes(heading_rad)  # its transpose is its inverse
    lanes = []
    for x, cut in zip(offsets, shapely.intersection(flat, slabs), strict=True):
        stretches = [
            _needed(part, float(x), sure)
            for part in shapely.get_parts(cut)
            if isinstance(part, Polygon) and not part.is_empty
        ]
        for low, high in _merged(stretches, spacing, merge_gap_m):
            lanes.append(Lane(np.array([[x, low], [x, high]]) @ back))
    return lanes


def _needed(part: Polygon, x: float, sure: SureFootprint) -> tuple[float, float]:
    """The stretch of a lane from which a piece of its slab is seen whole; a place where it is short."""
    p = np.asarray(part.exterior.coords)
    reach = sure.top(np.clip(p[:, 0] - x, -sure.half_width_m, sure.half_width_m))
    low, high = float((p[:, 1] + reach).min()), float((p[:, 1] - reach).max())
    return (low, high) if low <= high else ((low + high) / 2.0,) * 2


def _merged(stretches: list[tuple[float, float]], spacing: Spacing, gap_m: float) -> list[tuple[float, float]]:
    merged: list[tuple[float, float]] = []
    for low, high in sorted((low - spacing.guard_m, high + spacing.guard_m) for low, high in stretches):
        if merged and low - merged[-1][1] < gap_m:
            merged[-1] = (merged[-1][0], max(merged[-1][1], high))
        else:
            merged.append((low, high))
    return merged


def corridor_lanes(line: LineString, width_m: float, spacing: Spacing, sure: SureFootprint) -> list[Lane]:
    """Return lanes along a line that see a strip ``width_m`` wide about it."""
    reach = float(sure.top(spacing.snug_edge_m))
    extra = width_m / 2.0 - reach + spacing.guard_m
    lanes = []
    for offset in lane_offsets(-width_m / 2.0, width_m / 2.0, spacing):
        side = line if abs(offset) < 1e-9 else line.offset_curve(-offset, join_style="mitre", mitre_limit=2.0)
        for part in shapely.get_parts(side):
            p = np.asarray(part.coords)
            if len(p) >= 2 and part.length > 1e-3:
                lanes.append(Lane(_stretched(p, extra)))
    return lanes


def _stretched(p: FloatArray, extra_m: float) -> FloatArray:
    """A path made longer at both ends; one that may end early keeps its ends."""
    if extra_m <= 0.0:
        return p
    first, last = p[0] - p[1], p[-1] - p[-2]
    return np.concatenate(
        [[p[0] + first / np.hypot(*first) * extra_m], p[1:-1], [p[-1] + last / np.hypot(*last) * extra_m]]
    )


def candidate_headings(target: BaseGeometry, *, most: int = 48) -> FloatArray:
    """Return headings in [0, pi) worth a look: along the longer edges, of the hull too, and every 15 degrees."""
    weights: dict[int, float] = {}
    rings = [shapely.convex_hull(target).boundary, shapely.boundary(target)]
    for part in shapely.get_parts(rings):
        p = np.asarray(shapely.get_coordinates(part))
        legs = np.diff(p, axis=0)
        for angle, length in zip(np.arctan2(legs[:, 0], legs[:, 1]) % math.pi, np.hypot(*legs.T), strict=True):
            key = round(float(angle) / math.radians(0.5)) % 360
            weights[key] = weights.get(key, 0.0) + float(length)
    edges = sorted(weights, key=lambda k: (-weights[k], k))[: most - 12]
    exact = {k: math.radians(0.5 * k) for k in edges} | {k: math.radians(0.5 * k) for k in range(0, 360, 30)}
    return np.array([exact[k] for k in sorted(exact)])


def estimate_s(
    edges: FloatArray, heading_rad: float, spacing: Spacing, *, speeds_m_s: Sequence[float], turn_s: float
) -> float:
    """Return roughly how long a sweep takes: chords of lanes through ``(N, 4)`` edges (x0, y0, x1, y1), and turns."""
    m = _axes(heading_rad)
    a, b = edges[:, :2] @ m.T, edges[:, 2:] @ m.T
    x = lane_offsets(float(a[:, 0].min()), float(a[:, 0].max()), spacing)
    low, high = np.minimum(a[:, 0], b[:, 0]), np.maximum(a[:, 0], b[:, 0])
    hits = (low[:, None] <= x) & (x < high[:, None])
    e, lane = np.nonzero(hits)
    share = (x[lane] - a[e, 0]) / (b[e, 0] - a[e, 0])
    y = a[e, 1] + share * (b[e, 1] - a[e, 1])
    order = np.lexsort((y, lane))
    sorted_y = y[order]
    chords = sorted_y[1::2] - sorted_y[: len(sorted_y) // 2 * 2 : 2]
    pace = sum(1.0 / s for s in speeds_m_s) / len(speeds_m_s)
    return float(chords.sum()) * pace + max(len(chords), len(x)) * turn_s
